"""The contact solver against the laws it solves, checked row by row, and against closed forms."""

import numpy as np
import pytest

from physics.solver.newton import rows_of_contacts, solve

NO_JOINTS = (np.zeros((0, 2), np.int64), np.zeros((0, 1, 12)), np.zeros((0, 1)), np.zeros((0, 1)))


def run(free, mass, inertia, bodies, points, normals, mu, centers, target=None, least=0.0):
    c = len(bodies)
    reals = np.hstack([points, normals, np.zeros((c, 1))])
    jacobian = np.empty((c, 3, 12))
    rows_of_contacts(np.asarray(bodies), reals, centers, jacobian)
    bias = np.zeros((c, 3))
    if target is not None:
        bias[:, 0] = -target
    impulse = np.zeros((c, 3))
    v = np.empty_like(free)
    residual = solve(
        free, v, mass, inertia, 1 / mass, np.linalg.inv(inertia), np.asarray(bodies), jacobian, bias,
        np.full(c, mu), np.zeros(c, bool), np.full(c, least), impulse, *NO_JOINTS, 1e-14,
    )  # fmt: skip
    return v, impulse, jacobian, bias, residual


def relative(bodies, jacobian, v, bias):
    padded = np.vstack([v, np.zeros(6)])
    both = np.hstack([padded[np.asarray(bodies)[:, 0]], padded[np.asarray(bodies)[:, 1]]])
    return np.einsum("cij,cj->ci", jacobian, both) + bias


def column(n, ratio=1.0, tilt=0.0):
    bodies, points = [], []
    for i in range(n):
        for x in (-0.05, 0.05):
            for y in (-0.05, 0.05):
                bodies.append((i, i - 1))
                points.append([x, y, 0.1 * i])
    mass = ratio ** np.arange(n, dtype=float)
    free = np.zeros((n, 6))
    free[:, :3] = 0.0981 * np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
    centers = np.array([[0, 0, 0.05 + 0.1 * i] for i in range(n)])
    inertia = mass[:, None, None] / 6 * 0.01 * np.eye(3)
    return free, mass, inertia, bodies, np.array(points), np.tile([0, 0, 1.0], (len(points), 1)), centers


@pytest.mark.parametrize(("n", "ratio"), [(1, 1.0), (10, 1.0), (30, 1.0), (2, 1e6), (2, 1e-6), (5, 10.0), (4, 1e3)])
def test_a_column_stands_still(n, ratio):
    """Exactly: also with a body a million times heavier on a light one, and with redundant contacts."""
    free, mass, inertia, bodies, points, normals, centers = column(n, ratio)
    v, impulse, *_ = run(free, mass, inertia, bodies, points, normals, 0.5, centers)
    assert np.abs(v).max() < 1e-12 * np.abs(free).max()
    assert impulse[:4, 0].sum() == pytest.approx(mass.sum() * 0.0981, rel=1e-9)


@pytest.mark.parametrize("mu", [0.0, 0.2, 0.5])
def test_a_box_slides_down_as_coulomb_says(mu):
    tilt = 0.6
    free, mass, inertia, bodies, points, normals, centers = column(1, tilt=tilt)
    v, *_ = run(free, mass, inertia, bodies, points, normals, mu, centers)
    expected = 0.0981 * (np.sin(tilt) - mu * np.cos(tilt))
    assert v[0] == pytest.approx([expected, 0, 0, 0, 0, 0], abs=1e-14)


@pytest.mark.parametrize("seed", [*range(3), pytest.param(3, marks=pytest.mark.slow), *range(4, 40)])
def test_random_contacts_obey_the_law(seed):
    """Signorini and the friction cone, row by row, on random clusters of bodies with random masses."""
    rng = np.random.default_rng(seed)
    n, c = int(rng.integers(1, 6)), int(rng.integers(1, 14))
    centers = rng.normal(size=(n, 3))
    bodies = np.array([sorted(rng.choice(np.arange(-1, n), 2, replace=False))[::-1] for _ in range(c)])
    bodies = bodies[bodies[:, 0] >= 0]
    c = len(bodies)
    if c == 0:
        pytest.skip("no contact drawn")
    points = rng.normal(size=(c, 3))
    normals = rng.normal(size=(c, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    mass = 10.0 ** rng.uniform(-2, 2, n)
    roots = rng.normal(size=(n, 3, 3))
    inertia = np.einsum("nij,nkj->nik", roots, roots) * mass[:, None, None] * 0.1 + 0.05 * mass[:, None, None] * np.eye(
        3
    )
    free = rng.normal(size=(n, 6))
    mu = float(rng.uniform(0, 1))
    v, impulse, jacobian, bias, residual = run(free, mass, inertia, bodies, points, normals, mu, centers)
    if residual > 1e-9:  # Painlevé: no solution need exist; the solver must then say so
        assert mu > 0.2
        return
    speed = relative(bodies, jacobian, v, bias)
    scale = np.abs(free).max()
    assert (speed[:, 0] > -1e-8 * scale).all()
    assert (impulse[:, 0] >= 0).all()
    weight = impulse[:, 0] / max(impulse[:, 0].max(), 1e-300)
    assert np.abs(weight * speed[:, 0]).max() < 1e-7 * scale
    size = np.linalg.norm(impulse[:, 1:], axis=1)
    assert (size <= mu * impulse[:, 0] * (1 + 1e-9) + 1e-12).all()
    sliding = np.linalg.norm(speed[:, 1:], axis=1) > 1e-6 * scale
    active = impulse[:, 0] > 1e-6 * impulse[:, 0].max()
    for k in np.flatnonzero(sliding & active):
        direction = speed[k, 1:] / np.linalg.norm(speed[k, 1:])
        assert np.abs(impulse[k, 1:] + mu * impulse[k, 0] * direction).max() < 1e-5 * impulse[k, 0]


def test_momentum_balance_holds():
    free, mass, inertia, bodies, points, normals, centers = column(3)
    v, impulse, jacobian, *_ = run(free, mass, inertia, bodies, points, normals, 0.5, centers)
    pushed = np.zeros((3, 6))
    for k, (a, b) in enumerate(bodies):
        pushed[a] += impulse[k] @ jacobian[k, :, :6]
        if b >= 0:
            pushed[b] += impulse[k] @ jacobian[k, :, 6:]
    momentum = np.hstack([mass[:, None] * (v - free)[:, :3], np.einsum("nij,nj->ni", inertia, (v - free)[:, 3:])])
    assert np.abs(momentum - pushed).max() < 1e-14


def test_restitution_is_a_target_speed():
    free, mass, inertia, bodies, points, normals, centers = column(1)
    free[0] = [0, 0, -2.0, 0, 0, 0]
    v, *_ = run(free, mass, inertia, bodies, points, normals, 0.5, centers, target=np.full(4, 1.6))
    assert v[0, 2] == pytest.approx(1.6, abs=1e-14)


def test_a_least_impulse_is_given_and_rubs():
    """A box that slides is pushed off the floor by its corners' least impulses; friction is μ times those."""
    free, mass, inertia, bodies, points, normals, centers = column(1)
    free[0] = [1.0, 0, 0, 0, 0, 0]
    v, impulse, *_ = run(free, mass, inertia, bodies, points, normals, 0.1, centers, least=0.25)
    assert impulse[:, 0] == pytest.approx(0.25, abs=1e-12)
    assert np.linalg.norm(impulse[:, 1:], axis=1) == pytest.approx(0.025, abs=1e-12)
    assert v[0, [0, 2]] == pytest.approx([0.9, 1.0], abs=1e-12)
