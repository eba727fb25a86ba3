"""What the first import and the first question do."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ASK = """
import numpy as np
from collision import SurfaceMesh, colliding_surfaces
mesh = SurfaceMesh(np.eye(3), [[0, 1, 2]])
print(colliding_surfaces(mesh, mesh, np.eye(4)).tolist())
"""


def run(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)} | environment,
        capture_output=True,
        text=True,
        check=True,
    )


def test_importing_takes_no_compiler() -> None:
    done = run("import sys, collision; print(sorted({'numba', 'coal', 'pinocchio'} & set(sys.modules)))")
    assert done.stdout.strip() == "[]" and done.stderr == ""


@pytest.mark.slow
def test_compiling_is_said_once(tmp_path: Path) -> None:
    cold = run(ASK, NUMBA_CACHE_DIR=str(tmp_path))
    assert cold.stdout.strip() == "[[0, 0]]"
    assert cold.stderr.count("compiling collision kernels") == 1 and cold.stderr.count("\n") == 1
    warm = run(ASK, NUMBA_CACHE_DIR=str(tmp_path))
    assert (warm.stdout, warm.stderr) == (cold.stdout, "")


SIGNATURES = """
import numpy as np, pinocchio as pin
from collision import CollisionManager
from collision.query import distance, intersection, time_of_impact
from tests.collision.shapes import box
world = CollisionManager()
for k in range(3):
    world.add(box(), pin.SE3(np.eye(3), np.array([0.99 * k, 0.0, 0.0])))
target = pin.SE3(np.eye(3), np.array([0.98, 0.1, 0.1]))
for _ in range(2):
    world.contacts(0.1), world.colliding_surfaces(), world.time_of_impact({1: target}), world.clearance(0, 1)
    world.ignore_surfaces(0, [1], 1, [2])
kernels = distance.contacts, distance.clearance, intersection.intersect, time_of_impact.advance
print([len(kernel.signatures) for kernel in kernels])
"""


def test_kernels_are_compiled_for_one_signature() -> None:
    """Also where surfaces are left out: a table of them and the lack of one are of the same type."""
    assert run(SIGNATURES).stdout.strip() == "[1, 1, 1, 1]"
