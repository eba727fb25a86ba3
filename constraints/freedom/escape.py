"""The escape cone of a body: the first-order motions that its contacts allow, and the proof that there is none.

At a contact point p (3,) with the unit normal n out of the fixed body, the moving body's twist (v, w) obeys
n·(v + w × p) >= 0. If only the zero twist obeys all rows the body is locked: every gap function is smooth, so the pose
is isolated among those without penetration (first-order form closure: Rimon & Burdick, "Mobility of Bodies in
Contact", IEEE Trans. Robotics and Automation 14, 1998). By Farkas' lemma this holds if and only if the rows have rank
six and positive multipliers with which they add up to zero; these are checked in rational arithmetic.

The proof assumes contact of surfaces within a tolerance. Every unit twist of a locked body makes some row less than
minus `margin`, so that gaps within the tolerance leave it a motion of about tolerance / margin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from constraints.geometry.features import Feature
from constraints.geometry.overlap import facing_area
from constraints.geometry.surfaces import Freeform, Geometry, Plane

Array = NDArray[np.float64]

INSIDE: Final = np.array([[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]])
"""barycentric coordinates of the tested points of a facet: inside it, near its corners"""
FACING: Final = 1e-6
"""1: greatest sum of the unit normals of two surfaces in contact"""
MARGIN: Final = 1e-3
"""1: a lock of a smaller margin depends on errors of the rows, and is not reported"""
MOST_ROWS: Final = 400
"""greatest number of rows of a linear program; the others would only narrow the cone"""


@dataclass(frozen=True, eq=False)
class Patch:
    """Contact patch of a surface of a moving body and one of a fixed body."""

    points: Array
    """(n, 3) world, m"""
    normals: Array
    """(n, 3) unit, world: out of the fixed body"""
    surfaces: tuple[int, int]
    """a face of the moving feature, one of the fixed"""


def contact_patch(
    moving: Feature, pose: pin.SE3, fixed: Feature, fixed_pose: pin.SE3, tolerance: float
) -> Patch | None:
    """Return points at which two features touch within `tolerance` m over an area, and normals; None without contact.

    For planes face to face these are the farthest points of the shared area; for round surfaces, points inside facets
    of one that lie on the other: each is a contact, and there may be more.
    """
    surfaces = moving.surfaces[0], fixed.surfaces[0]
    m, s = moving.geometry.transformed(pose), fixed.geometry.transformed(fixed_pose)
    if isinstance(m, Freeform) or isinstance(s, Freeform) or max(moving.residual, fixed.residual) > tolerance:
        return None  # a fit to a mesh is less accurate than a contact requires
    mine, theirs = _triangles(moving, pose), _triangles(fixed, fixed_pose)
    if isinstance(m, Plane) and isinstance(s, Plane):
        if np.linalg.norm(m.normal + s.normal) > 1e-4 or abs(float(s.distance(m.origin)[0])) > 1e-2:
            return None
        region = facing_area(s.origin, s.normal, theirs, mine, m.origin, m.normal)
        if not len(region.gaps) or np.abs(region.gaps).max() > tolerance:
            return None
        return Patch(region.corners, np.tile(s.normal, (len(region.corners), 1)), surfaces)
    rows = [
        (points, fixed.sense * s.normals(points))
        for own, g, other in ((mine, m, theirs), (theirs, s, mine))
        for points in [_inner_points(own, g)]
        for points in [points[_touches(points, other, m, s, moving.sense, fixed.sense, tolerance)]]
    ]
    points, normals = (np.concatenate(each) for each in zip(*rows, strict=True))
    return Patch(points, normals, surfaces) if len(points) else None


def _inner_points(triangles: Array, geometry: Geometry) -> Array:
    """(n, 3) points inside facets, projected onto the analytic surface."""
    facet = np.einsum("kc,tcd->tkd", INSIDE, triangles).reshape(-1, 3)
    return np.asarray(facet - geometry.distance(facet)[:, None] * geometry.normals(facet))


def _touches(
    points: Array, other: Array, m: Geometry, s: Geometry, sense_m: int, sense_s: int, tolerance: float
) -> NDArray[np.bool_]:
    """(n,) bool: points on both surfaces, between their materials, and inside one of the facets (t, 3, 3)."""
    out = np.maximum(np.abs(m.distance(points)), np.abs(s.distance(points))) <= tolerance
    outward = sense_s * s.normals(points)
    out &= np.linalg.norm(outward + sense_m * m.normals(points), axis=1) <= FACING
    if out.any():
        deflection = float(np.abs(s.distance(other.mean(axis=1))).max()) + tolerance
        for k in np.flatnonzero(out).tolist():
            out[k] = _over(points[k], outward[k], other, 2.0 * deflection)
    return out


def _triangles(feature: Feature, pose: pin.SE3) -> Array:
    """(t, 3, 3) world."""
    return np.asarray((feature.samples @ pose.rotation.T + pose.translation)[feature.triangles])


def _over(p: Array, n: Array, triangles: Array, reach: float) -> bool:
    """Whether the line through p along n hits the inside of one of the triangles within `reach` m."""
    a, ab, ac = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    h = np.cross(n, ac)
    det = np.einsum("ij,ij->i", ab, h)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / det
        u = np.einsum("ij,ij->i", p - a, h) * inverse
        q = np.cross(p - a, ab)
        v = (q @ n) * inverse
        t = np.einsum("ij,ij->i", ac, q) * inverse
        return bool(((u > 0.0) & (v > 0.0) & (u + v < 1.0) & (np.abs(t) <= reach)).any())


@dataclass(frozen=True, eq=False)
class Lock:
    """Proof that contacts allow a body no motion."""

    multipliers: tuple[Fraction, ...]
    """positive: with them the rows add up to exactly zero"""
    rows: tuple[int, ...]
    """the rows of the cone to which they belong, of rank six"""
    margin: float
    """1: every twist of greatest entry 1, turns scaled by the cone's length, closes some gap by at least this"""


@dataclass(frozen=True, eq=False)
class EscapeCone:
    """The twists (v, w·length) about `center` that contacts allow a body, {x : rows x >= 0}."""

    rows: Array
    """(n, 6)"""
    center: Array
    """(3,) world, m"""
    length: float
    """m: a turn of 1 rad counts as this much"""

    @classmethod
    def of(cls, points: Array, normals: Array, center: Array, length: float) -> EscapeCone:
        """Return the cone of contacts at points (n, 3) with normals (n, 3), world, about a center (3,), m."""
        arm = np.cross(points - center, normals) / length
        return cls(np.hstack([normals, arm]).reshape(-1, 6), np.asarray(center, np.float64), float(length))

    def lock(self) -> Lock | None:
        """Return the proof that the cone contains only the zero twist; None if it does not, or the proof fails."""
        if len(self.rows) < 7 or np.linalg.matrix_rank(self.rows, tol=MARGIN) < 6:
            return None
        chosen = self._spanning()
        if chosen is None:
            return None
        rows = self.rows[chosen]
        margin = _margin(rows)
        if margin < MARGIN:
            return None
        multipliers = _multipliers(rows)
        return None if multipliers is None else Lock(multipliers, tuple(chosen), margin)

    def _spanning(self) -> list[int] | None:
        """A few rows whose non-negative combinations span all vectors; None if there are none."""
        from scipy.optimize import linprog

        kept = self._spread()
        used: set[int] = set()
        for k in range(6):
            for sign in (1.0, -1.0):
                target = np.zeros(6)
                target[k] = sign
                found = linprog(np.ones(len(kept)), A_eq=self.rows[kept].T, b_eq=target, method="highs")
                if found.status != 0:
                    return None
                used |= set(kept[found.x > 1e-9].tolist())
        return sorted(used)

    def _spread(self) -> NDArray[np.int64]:
        """Indices of at most MOST_ROWS different rows, evenly spaced."""
        _, first = np.unique(np.round(self.rows, 9), axis=0, return_index=True)
        first = np.sort(first)
        if len(first) > MOST_ROWS:
            first = first[np.linspace(0, len(first) - 1, MOST_ROWS).astype(np.int64)]
        return first

    def directions(self) -> tuple[Array, ...]:
        """Return unit translations (3,) that span the translations in the cone: its extreme rays, and their mean.

        At most 40 evenly spaced different normals are used; the cone of a part of them is wider.
        """
        normals = np.unique(np.round(self.rows[:, :3], 9), axis=0) + 0.0
        if len(normals) > 40:
            normals = normals[np.linspace(0, len(normals) - 1, 40).astype(int)]
        if not len(normals):
            return ()
        i, j = np.triu_indices(len(normals), 1)
        rays = np.cross(normals[i], normals[j])
        length = np.linalg.norm(rays, axis=1)
        rays = rays[length > 1e-6] / length[length > 1e-6, None]
        rays = np.concatenate([rays, -rays, normals])
        inside = rays[(rays @ normals.T >= -1e-9).all(axis=1)]
        if not len(inside):
            return ()
        inside = np.unique(np.round(inside, 9), axis=0)
        middle = inside.sum(axis=0)
        if np.linalg.norm(middle) > 1e-6:
            inside = np.vstack([inside, middle])
        return tuple(ray / np.linalg.norm(ray) + 0.0 for ray in inside)

    def twists(self) -> tuple[Array, ...]:
        """Return twists (6,) (v, w) in the cone, world, about `center`: the farthest along each axis with |x| <= 1."""
        from scipy.optimize import linprog

        out: list[Array] = []
        below = {"A_ub": -self.rows[self._spread()], "b_ub": np.zeros(len(self._spread()))} if len(self.rows) else {}
        for k in range(5, -1, -1):  # turns first
            for sign in (1.0, -1.0):
                cost = np.full(6, 0.0)
                cost[k] = -sign
                found = linprog(cost, bounds=[(-1.0, 1.0)] * 6, method="highs", **below)
                if found.status != 0 or -found.fun < 1e-6:
                    continue
                x = np.concatenate([found.x[:3], found.x[3:] / self.length])
                if not any(np.allclose(x, y, atol=1e-9) for y in out):
                    out.append(x)
        return tuple(out)


def _margin(rows: Array) -> float:
    """The least, over x of greatest entry 1, of the greatest -row·x."""
    from scipy.optimize import linprog

    least = np.inf
    cost = np.array([0.0] * 6 + [1.0])
    for k in range(6):
        for sign in (1.0, -1.0):
            bounds = [(-1.0, 1.0)] * 6 + [(None, None)]
            bounds[k] = (sign, sign)
            below = np.hstack([-rows, -np.ones((len(rows), 1))])
            found = linprog(cost, A_ub=below, b_ub=np.zeros(len(rows)), bounds=bounds, method="highs")
            if found.status != 0:
                return -np.inf
            least = min(least, float(found.fun))
    return least


def _multipliers(rows: Array) -> tuple[Fraction, ...] | None:
    """Positive rational multipliers with which the rows, as exact rationals, add up to zero; None if not found."""
    from scipy.linalg import qr
    from scipy.optimize import linprog

    found = linprog(np.ones(len(rows)), A_eq=rows.T, b_eq=np.zeros(6), bounds=[(1.0, None)] * len(rows), method="highs")
    if found.status != 0:
        return None
    _, _, order = qr(rows.T, pivoting=True)
    basis, others = sorted(order[:6].tolist()), sorted(order[6:].tolist())
    exact = [[Fraction(float(x)) for x in row] for row in rows]
    out = [Fraction(0)] * len(rows)
    for k in others:
        out[k] = Fraction(float(found.x[k]))
    right = [-sum((out[k] * exact[k][d] for k in others), Fraction(0)) for d in range(6)]
    solved, rank = _reduced([[exact[k][d] for k in basis] + [right[d]] for d in range(6)])
    if rank < 6:
        return None
    for d, k in enumerate(basis):
        out[k] = solved[d][6] / solved[d][d]
    return tuple(out) if holds(rows, out) else None


def holds(rows: Array, multipliers: Sequence[Fraction]) -> bool:
    """Whether multipliers prove exactly that only x = 0 has rows x >= 0: positive, sum zero, rank six."""
    if len(rows) != len(multipliers) or not all(x > 0 for x in multipliers):
        return False
    exact = [[Fraction(float(x)) for x in row] for row in rows]
    for d in range(6):
        if sum((x * row[d] for x, row in zip(multipliers, exact, strict=True)), Fraction(0)) != 0:
            return False
    return _reduced(exact)[1] == 6


def _reduced(matrix: list[list[Fraction]]) -> tuple[list[list[Fraction]], int]:
    """A matrix with its first six columns diagonal as far as possible (Gauss-Jordan), and the rank of these."""
    rows, rank = [list(row) for row in matrix], 0
    for column in range(6):
        pivot = next((k for k in range(rank, len(rows)) if rows[k][column] != 0), None)
        if pivot is None:
            continue
        rows[rank], rows[pivot] = rows[pivot], rows[rank]
        for k in range(len(rows)):
            factor = rows[k][column] / rows[rank][column]
            if k != rank and factor:
                rows[k] = [x - factor * y for x, y in zip(rows[k], rows[rank], strict=True)]
        rank += 1
    return rows, rank
