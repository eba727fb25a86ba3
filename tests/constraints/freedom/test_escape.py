"""Escape cones: what contacts leave, and proofs that they leave nothing."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from constraints.freedom.escape import MARGIN, EscapeCone, _margin, holds


def pocket(open_sides=()):
    """Contacts at the corners of a block (20 x 30 x 40 mm) in a pocket: points, normals out of the pocket's walls."""
    half = np.array([0.01, 0.015, 0.02])
    points, normals = [], []
    for axis, sign in product(range(3), (-1.0, 1.0)):
        if (axis, sign) in open_sides:
            continue
        for u, v in product((-1.0, 1.0), repeat=2):
            p = np.array([u, v, v])
            p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3] = sign, u, v
            points.append(p * half)
            normals.append(-sign * np.eye(3)[axis])
    return np.array(points), np.array(normals)


def cone(points, normals):
    return EscapeCone.of(points, normals, np.zeros(3), 0.02)


def test_a_block_in_a_closed_pocket_is_locked_and_the_proof_is_exact():
    c = cone(*pocket())
    lock = c.lock()
    assert lock is not None
    rows = c.rows[list(lock.rows)]
    assert holds(rows, lock.multipliers)
    for d in range(6):
        assert sum((m * Fraction(float(r[d])) for m, r in zip(lock.multipliers, rows, strict=True)), Fraction(0)) == 0
    assert lock.margin > 0.1
    assert c.directions() == ()
    assert c.twists() == ()


@pytest.mark.parametrize(("axis", "sign"), list(product(range(3), (-1.0, 1.0))))
def test_one_open_side_is_the_one_way_out(axis, sign):
    c = cone(*pocket({(axis, sign)}))
    assert c.lock() is None
    (direction,) = {tuple(d) for d in c.directions()}
    assert direction == tuple(sign * np.eye(3)[axis] + 0.0)
    assert any(np.allclose(t[:3] / np.linalg.norm(t[:3]), sign * np.eye(3)[axis]) for t in c.twists())


def test_three_contacts_a_side_are_needed_to_bound_turns():
    """One witness a side bounds no turn: no lock is claimed."""
    points = np.concatenate([np.diag([0.01, 0.015, 0.02]), -np.diag([0.01, 0.015, 0.02])])
    normals = np.concatenate([-np.eye(3), np.eye(3)])
    assert cone(points, normals).lock() is None


def test_a_forged_proof_does_not_hold():
    c = cone(*pocket())
    lock = c.lock()
    rows = c.rows[list(lock.rows)]
    assert not holds(rows, (*lock.multipliers[:-1], lock.multipliers[-1] + Fraction(1, 10**30)))
    assert not holds(rows, (-lock.multipliers[0], *lock.multipliers[1:]))
    assert not holds(rows[:6], lock.multipliers[:6])
    moved = rows.copy()
    moved[0, 0] = np.nextafter(moved[0, 0], np.inf) + 1e-300
    assert not holds(moved, lock.multipliers)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(6, 24))
def test_a_lock_is_claimed_only_where_every_twist_closes_a_gap(seed, n):
    random = np.random.default_rng(seed)
    normals = random.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    c = cone(random.uniform(-0.02, 0.02, (n, 3)), normals)
    lock = c.lock()
    twists = random.normal(size=(4000, 6))
    twists /= np.abs(twists).max(axis=1)[:, None]
    deepest = (twists @ c.rows.T).min(axis=1)
    if lock is not None:
        assert (deepest <= -lock.margin + 1e-9).all()
    else:  # a twist is left, or rows so near to leaving one that nothing is claimed
        free = [
            linprog(-s * np.eye(6)[k], A_ub=-c.rows, b_ub=np.zeros(n), bounds=[(-1, 1)] * 6)
            for k in range(6)
            for s in (1, -1)
        ]
        assert max(-f.fun for f in free) > 1e-9 or _margin(c.rows) < MARGIN
