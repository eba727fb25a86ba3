"""The null space by way of a spanning tree against that of the whole Jacobian."""

import numpy as np
import pytest

from collision import Tolerance
from constraints.freedom.mobility import mobility
from constraints.solve import null_space
from constraints.solve.system import System, systems
from tests.constraints import problems

SAME = 1e-8
MADE = {
    "four-bar": problems.four_bar(),
    "Bennett": problems.bennett(),
    "flat parallelogram": problems.parallelogram(0.0),
    "Sarrus": problems.sarrus(),
    "stretched pair": problems.stretched_pair(),
    "chain": problems.chain(20),
    "flange": problems.flange(),
    "net": problems.lattice(6, 5),
}


def same_space(system: System, poses, monkeypatch) -> int:
    """Check both ways on one system; returns the freedom."""
    rotation, translation = system.gather(poses)
    monkeypatch.setattr(null_space, "DENSE", len(system.movable))
    whole, _, _ = null_space.null_space(system, rotation, translation, Tolerance())
    tree, _, margin = null_space.through_tree(system, rotation, translation, Tolerance())
    assert tree.shape == whole.shape and 0.0 < margin <= 1.0
    columns = 6 * len(system.movable)
    a, b = whole.reshape(columns, -1), tree.reshape(columns, -1)
    np.testing.assert_allclose(b.T @ b, np.eye(b.shape[1]), atol=1e-12)
    np.testing.assert_allclose(a @ (a.T @ b), b, atol=SAME)
    return whole.shape[2]


@pytest.mark.parametrize("name", MADE)
def test_linkages(name, monkeypatch):
    problem = MADE[name]
    made = systems(problem.constraints, frozenset(problem.movable))
    assert made and all(same_space(system, problem.poses, monkeypatch) >= 0 for system in made)


@pytest.mark.parametrize("seed", range(60))
def test_random_assemblies_with_and_without_a_fixed_body(seed, monkeypatch):
    problem = problems.random_assembly(seed)
    held = sum(
        same_space(system, problem.poses, monkeypatch)
        for system in systems(problem.constraints, frozenset(problem.movable))
    )
    loose = sum(
        same_space(system, problem.poses, monkeypatch)
        for system in systems(problem.constraints, frozenset(range(len(problem.poses))))
    )
    assert loose == held + 6  # the whole may also move as one


def test_a_wide_net_has_one_motion():
    problem = problems.lattice(12, 10)
    found = mobility(problem.constraints, problem.poses, [0])
    assert (found.freedom, found.finite) == (1, 1)
    assert found.parts[1].joint == "1-dof" and len(found.pairs) == 120
