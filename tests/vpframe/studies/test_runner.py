"""The process that runs variants: measures, generators, time."""

from pathlib import Path

import pytest

from tests.vpframe.studies.scripts import HEAD, variant, written
from vpframe.studies.child import Children

COMPILES = (
    HEAD
    + """
from collision.numeric.kernel import compilation
VARIANTS = {"how": Choice("compile", "sleep")}

def task(session, v):
    session.run(0.02)
    if v["how"] == "sleep":
        time.sleep(4.0)
    with compilation.working(), compilation.working():
        time.sleep(4.0)
"""
)


@pytest.mark.slow
def test_the_clock_stands_while_kernels_are_compiled(tmp_path: Path) -> None:
    pool = Children(written(tmp_path, COMPILES), 3.0, 0)
    try:
        pool.run(variant("compile"))  # imports, and the kernels of a step
        assert pool.run(variant("compile"))["status"] == "ok"
        assert pool.run(variant("sleep"))["status"] == "timeout"
    finally:
        pool.close()


MEASURES = (
    HEAD
    + """
import numpy as np
VARIANTS = {"how": Choice("array", "infinite", "numpy", "number", "list")}

def task(session, v):
    return {
        "array": {"y": np.zeros(2)},
        "infinite": {"y": float("inf"), "z": float("nan")},
        "numpy": {"y": np.float64(0.1) + 0.2, "n": np.int64(3), "b": np.bool_(True)},
        "number": 3.0,
        "list": {"y": [1.0]},
    }[v["how"]]
"""
)


def test_measures_are_numbers_texts_and_truth_values(tmp_path: Path) -> None:
    pool = Children(written(tmp_path, MEASURES), 60.0, 0)
    try:
        assert pool.run(variant("infinite"))["measures"] == {"y": None, "z": None}
        assert pool.run(variant("numpy"))["measures"] == {"y": 0.1 + 0.2, "n": 3, "b": True}
        for how, words in (
            ("array", "measure 'y' is a ndarray"),
            ("list", "is a list"),
            ("number", "returned a float"),
        ):
            outcome = pool.run(variant(how))
            assert outcome["status"] == "error" and words in outcome["reason"]
    finally:
        pool.close()


GLOBAL = (
    HEAD
    + """
import random
import numpy as np
VARIANTS = {"how": Choice("any")}

def task(session, v):
    return {"a": random.random(), "b": float(np.random.random()), "c": hash("text"),
            "threads": os.environ["NUMBA_NUM_THREADS"] + os.environ["OPENBLAS_NUM_THREADS"]}
"""
)


def test_scripts_that_use_global_generators_repeat_themselves(tmp_path: Path) -> None:
    script = written(tmp_path, GLOBAL)
    pools = Children(script, 60.0, 0), Children(script, 60.0, 0)
    try:
        first = pools[0].run(variant("any", 5))
        pools[1].run(variant("any", 4))
        second = pools[1].run(variant("any", 5))
        assert first["worker"] != second["worker"]
        assert first["measures"] == second["measures"]
        assert first["measures"]["threads"] == "11"
        assert pools[0].run(variant("any", 6))["measures"]["a"] != first["measures"]["a"]
    finally:
        for pool in pools:
            pool.close()
