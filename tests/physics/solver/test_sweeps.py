"""Accelerated sweeps against the exact solver, on piles of bodies with random contacts."""

import numpy as np
import pytest

from physics.solver.newton import SOME, rows_of_contacts, solve


def pile(n, seed):
    """n bodies of random mass over one another, four contacts a pair and with the ground; arguments of `solve`."""
    rng = np.random.default_rng(seed)
    mass = rng.uniform(0.5, 2.0, n)
    inertia = np.einsum("n,ij->nij", mass / 6.0, np.eye(3))
    free = np.zeros((n, 6))
    free[:, 2] = -0.1
    free[:, :2] = 0.02 * rng.normal(size=(n, 2))
    centers = np.stack([np.zeros(n), np.zeros(n), 0.5 + np.arange(n)], axis=1)
    bodies, reals = [], []
    for k in range(n):
        for x, y in ((-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)):
            normal = np.array([0.1, 0.1, 1.0]) * [*rng.uniform(-1, 1, 2), 1.0]
            bodies.append([k, k - 1])
            reals.append([x, y, float(k), *(normal / np.linalg.norm(normal)), 0.0])
    cb, reals = np.array(bodies), np.array(reals)
    cj = np.empty((len(cb), 3, 12))
    rows_of_contacts(cb, reals, centers, cj)
    return free, mass, inertia, 1.0 / mass, np.linalg.inv(inertia), cb, cj


def solved(problem, friction, tolerance):
    free, mass, inertia, im, ii, cb, cj = problem
    v, impulse = np.empty_like(free), np.zeros((len(cb), 3))
    mu = np.full(len(cb), friction)
    none = np.zeros((0, 2), np.int64), np.zeros((0, 1, 12)), np.zeros((0, 1)), np.zeros((0, 1))
    left = solve(
        free, v, mass, inertia, im, ii, cb, cj, np.zeros((len(cb), 3)), mu, np.zeros(len(cb), bool), np.zeros(len(cb)),
        impulse, *none, tolerance,
    )  # fmt: skip
    return v, impulse, left


@pytest.mark.parametrize("seed", range(3))
def test_without_friction_velocities_are_those_of_the_exact_solver(seed):
    problem = pile(SOME + 4, seed)
    exact, _, left = solved(problem, 0.0, 1e-14)
    assert left < 1e-13
    rough, impulse, _ = solved(problem, 0.0, 1e-5)
    assert np.abs(rough - exact).max() < 0.02 * np.abs(exact).max()
    assert impulse[:, 0].min() >= 0.0


@pytest.mark.parametrize("friction", [0.2, 0.8])
def test_a_tall_pile_is_carried_within_the_sweeps_that_are_allowed(friction):
    """Forty layers: unaccelerated, as many sweeps leave several mm/s."""
    problem = pile(40, 5)
    free, mass = problem[0], problem[1]
    v, impulse, left = solved(problem, friction, 1e-5)
    assert left < 1e-3
    assert impulse[:4, 0].sum() == pytest.approx(mass.sum() * 0.1, rel=0.05)
    assert (np.hypot(impulse[:, 1], impulse[:, 2]) <= friction * impulse[:, 0] + 1e-12).all()
    kick = np.einsum("cr,crk->ck", impulse, problem[6]).reshape(-1, 2, 6)
    total = np.zeros((41, 6))
    np.add.at(total, problem[5], kick)  # the last row takes what the ground bears
    assert mass[:, None] * (v - free)[:, :3] == pytest.approx(total[:40, :3], abs=1e-12)
