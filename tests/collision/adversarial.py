"""Pairs of triangles made to break floating-point tests; (n, 6, 3) arrays of corners. Shared by the tests."""

import numpy as np
from numpy.typing import NDArray

Corners = NDArray[np.float64]


def random_pairs(n: int, seed: int) -> Corners:
    """Of one size and near one another: about a third meet."""
    return np.random.default_rng(seed).normal(size=(n, 6, 3))


def adversarial_pairs(n: int, seed: int) -> Corners:
    """Equal shares of every kind in `KINDS`, then moved and scaled as engineers' coordinates are."""
    rng = np.random.default_rng(seed)
    share = -(-n // len(KINDS))
    corners = np.concatenate([kind(rng, share) for kind in KINDS])[:n]
    place = rng.integers(0, 4, n)
    scale = np.where(place == 1, 1e-6, np.where(place == 2, 1e3, 1.0))[:, None, None]
    offset = np.where(place == 3, 1e6, 0.0)[:, None, None] * rng.normal(size=(n, 1, 3)).round(3)
    return corners * scale + offset


def _grid(rng: np.random.Generator, n: int) -> Corners:
    """Corners on a grid of 3 or 4 a side: coplanar, collinear, coincident, degenerate."""
    return rng.integers(0, rng.integers(3, 5, (n, 1, 1)), (n, 6, 3)).astype(float)


def _tenths(rng: np.random.Generator, n: int) -> Corners:
    """The same grid in tenths, which float64 cannot hold: nearly coplanar."""
    return _grid(rng, n) * 0.1


def _coplanar(rng: np.random.Generator, n: int) -> Corners:
    """In one plane, exactly (axis-aligned) or as near as rounding puts them (tilted)."""
    flat = rng.normal(size=(n, 6, 3)) * (1, 1, 0)
    q = np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]
    tilted = np.einsum("nij,nkj->nki", q, flat)
    return np.where(rng.random((n, 1, 1)) < 0.5, flat, tilted)


def _shared(rng: np.random.Generator, n: int) -> Corners:
    """One corner or two in common."""
    t = rng.normal(size=(n, 6, 3))
    t[:, 3] = t[:, 0]
    two = rng.random(n) < 0.5
    t[two, 4] = t[two, 1]
    return t


def _touching(rng: np.random.Generator, n: int) -> Corners:
    """A corner of one placed, as well as float64 can, on the face or on an edge of the other."""
    t = rng.normal(size=(n, 6, 3))
    weight = rng.dirichlet((1, 1, 1), n)
    weight[rng.random(n) < 0.5, 2] = 0
    weight /= weight.sum(1, keepdims=True)
    t[:, 3] = np.einsum("ni,nij->nj", weight, t[:, :3])
    return t


def _needles(rng: np.random.Generator, n: int) -> Corners:
    """Long and thin, down to a width of 1e-12, crossing near one another."""
    t = rng.normal(size=(n, 6, 3))
    width = 10.0 ** rng.uniform(-12, -3, (n, 1))
    t[:, 2] = t[:, 1] + width * rng.normal(size=(n, 3))
    t[:, 5] = t[:, 4] + width * rng.normal(size=(n, 3))
    middle = t[:, :2].mean(1) - t[:, 3:5].mean(1) + width * rng.normal(size=(n, 3))
    t[:, 3:] += middle[:, None]
    return t


def _gaps(rng: np.random.Generator, n: int) -> Corners:
    """Parallel faces or crossing edges apart by about 1e-9, or by an ulp."""
    t = rng.normal(size=(n, 6, 3)).round(2)
    t[:, 3:] = t[:, :3] @ np.array([[0.5, 0.25, 0.0], [-0.25, 0.5, 0.0], [0.0, 0.0, 1.0]])
    t[:, :, 2] = 1.0
    gap = rng.choice([0.0, 1e-9, -1e-9, 2.3e-16], n)
    t[:, 3:, 2] += gap[:, None]
    tip = rng.random(n) < 0.5
    t[tip, 4:, 2] += 1.0
    return t


def _degenerate(rng: np.random.Generator, n: int) -> Corners:
    """One or both a segment or a point, made to lie on the other often."""
    t = rng.integers(-2, 3, (n, 6, 3)).astype(float)
    t[:, 5] = t[:, 4]
    point = rng.random(n) < 0.3
    t[point, 3] = t[point, 4]
    both = rng.random(n) < 0.5
    t[both, 2] = 2 * t[both, 1] - t[both, 0]
    return t


KINDS = (_grid, _tenths, _coplanar, _shared, _touching, _needles, _gaps, _degenerate)
