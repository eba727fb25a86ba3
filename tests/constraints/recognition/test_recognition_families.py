"""The benchmark's families of assemblies: every mate found and none invented, still and under a shaking hand."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from vpframe.scene import modelling

PATH = Path(__file__).parents[2] / "benchmarks" / "bench_constraints_recognition.py"
spec = importlib.util.spec_from_file_location("bench_constraints_recognition", PATH)
bench = importlib.util.module_from_spec(spec)
spec.loader.exec_module(bench)


@pytest.mark.parametrize("family", bench.FAMILIES)
def test_generated_assemblies(family):
    for seed, deflection in ((11, 2e-4), (12, 1e-5)):
        parts, true = bench.FAMILIES[family](np.random.default_rng(seed))
        scene = modelling.scene(parts, deflection=deflection, angular=0.8)
        for tolerance, noise in ((bench.EXACT, 0.0), (bench.NEAR, 0.0), (bench.NEAR, 0.2)):
            poses = bench.shaken(scene, noise, np.random.default_rng(seed))
            found, _ = bench.judge(scene, poses, tolerance, "contacts")
            assert found == true, (seed, deflection, noise)


def test_scores_count_misses_and_inventions():
    score = bench.Score()
    score.add(
        bench.truth(("against", "a", "b"), ("against", "a", "c")),
        bench.truth(("against", "b", "a"), ("concentric", "a", "b")),
        0.1,
    )
    assert (score.precision, score.recall) == (0.5, 0.5)
    assert score.row("x", "y")["error"] == pytest.approx(0.5)
