"""Least-squares fits of analytic surfaces to points on one surface, such as the vertices of a face.

A first guess is computed from points and normals in closed form; `refine` then minimises the orthogonal distances by
Levenberg-Marquardt. Distances do not change when surface and points move together, so moving the surface by a small
twist (v, w) about the origin changes the distance of a point p with normal n by -n·v - (p×n)·w: one Jacobian serves
all kinds, with an additional column for each radius or angle.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from collision.tolerance import Tolerance
from constraints.errors import ConstraintsError, GeometryError
from constraints.geometry.surfaces import Cone, Cylinder, Geometry, Plane, Sphere, Torus, perpendicular

Array = NDArray[np.float64]

KINDS = ("plane", "cylinder", "cone", "sphere", "torus")
"""in the order in which they are tried: the first that fits is taken"""

_FEW = 200
"""points that a fit is tried on first"""


class FitError(ConstraintsError):
    """Points that do not determine a surface of the wanted kind (too few, or degenerate)."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A surface fitted to points."""

    geometry: Geometry
    residual: float
    """m: greatest distance of a point to `geometry`"""


def fit_surface(
    points: ArrayLike,
    bases: ArrayLike,
    normals: ArrayLike,
    tolerance: Tolerance | None = None,
    kinds: Sequence[str] = KINDS,
) -> Fit | None:
    """Return the simplest analytic surface within tolerance of all points, or None.

    Parameters
    ----------
    points: (n, 3) m, on the true surface.
    bases, normals: (m, 3) m and (m, 3): places and approximate normals there, weighted by their lengths, such as the
        centroids and area vectors of the face's triangles. They start the fit, and it must agree with them.
    tolerance: `fit` and `fit_relative` (of the points' extent) bound the residual.
    kinds: to try, in this order.
    """
    p = np.asarray(points, dtype=np.float64)
    limits = tolerance or Tolerance()
    limit = allowed(p, limits)
    few = p[:: -(-len(p) // _FEW)]  # a surface that does not fit some of the points does not fit all
    for kind in kinds:
        if len(p) < _ENOUGH[kind]:
            continue
        try:
            fit = fit_kind(kind, few, bases, normals)
            if fit.residual <= limit and len(few) < len(p):
                geometry = refine(fit.geometry, p)
                fit = Fit(geometry, float(np.abs(geometry.distance(p)).max()))
        except (FitError, GeometryError):
            continue
        if fit.residual <= limit and _faces_along(fit.geometry, bases, normals, limits):
            return fit
    return None


def _faces_along(geometry: Geometry, bases: ArrayLike, normals: ArrayLike, limits: Tolerance) -> bool:
    """Whether the approximate normals agree with the surface's: the corners of a cube lie on a sphere, too."""
    n = np.asarray(normals, dtype=np.float64)
    along = np.abs(np.einsum("ij,ij->i", geometry.normals(bases), n)).sum()
    return bool(along >= np.cos(limits.facet) * np.linalg.norm(n, axis=1).sum())


def allowed(points: Array, tolerance: Tolerance) -> float:
    """Return the greatest residual of a fit to `points`, m."""
    return min(tolerance.fit, tolerance.fit_relative * float(np.linalg.norm(np.ptp(points, axis=0))))


def fit_kind(kind: str, points: ArrayLike, bases: ArrayLike, normals: ArrayLike, iterations: int = 40) -> Fit:
    """Return the least-squares surface of one kind; raises FitError if there is none.

    Arguments as for `fit_surface`, `iterations` as for `refine`.
    """
    p = np.asarray(points, dtype=np.float64)
    center = p.mean(axis=0)
    scale = float(np.linalg.norm(np.ptp(p, axis=0)))
    if len(p) < 3 or not scale > 0.0:
        raise FitError(f"{len(p)} points of extent {scale} m determine no {kind}; give more")
    unit = (p - center) / scale
    guess = _GUESS[kind](unit, (np.asarray(bases, dtype=np.float64) - center) / scale, np.asarray(normals))
    geometry = _scaled(refine(guess, unit, iterations), scale, center)
    return Fit(geometry, float(np.abs(geometry.distance(p)).max()))


def refine(geometry: Geometry, points: ArrayLike, iterations: int = 40) -> Geometry:
    """Return `geometry` moved and resized to the least sum of squared distances to `points` (n, 3), m.

    Levenberg-Marquardt in coordinates of unit size; the damping fixes parameters that distances do not determine (the
    position of a cylinder along its axis). The origin of a plane or a cylinder is moved next to the points' mean.
    """
    given = np.asarray(points, dtype=np.float64)
    center, scale = given.mean(axis=0), float(np.linalg.norm(np.ptp(given, axis=0)))
    if not scale > 0.0:
        raise FitError(f"{len(given)} points of no extent determine no {geometry.kind}; give more")
    p = (given - center) / scale
    best = _scaled(geometry, 1.0 / scale, -center / scale)
    distance = best.distance(p)
    cost, damping = float(distance @ distance), 1e-9
    for _ in range(iterations):
        jacobian = _jacobian(best, p)
        matrix, gradient = jacobian.T @ jacobian, jacobian.T @ distance
        matrix[np.diag_indices_from(matrix)] += damping * matrix.trace()
        trial = _stepped(best, -np.linalg.solve(matrix, gradient).astype(np.float64))
        if trial is not None:
            moved = trial.distance(p)
            gain = cost - float(moved @ moved)
            if gain > 0.0:
                best, distance, cost, damping = trial, moved, cost - gain, max(0.1 * damping, 1e-12)
                if gain > 1e-9 * cost:
                    continue
                break
        if damping > 1e-3 or cost < 1e-28 * len(p):
            break  # even a short step gains nothing, or only rounding is left
        damping *= 100.0
    return _centred(_scaled(best, scale, center), given)


def _cost(geometry: Geometry, points: Array) -> float:
    d = geometry.distance(points)
    return float(d @ d)


def _jacobian(geometry: Geometry, points: Array) -> Array:
    n = geometry.normals(points)
    columns = [-n, crossed(n, points)]
    match geometry:
        case Cylinder() | Sphere():
            columns.append(np.full((len(points), 1), -1.0))
        case Cone():
            q = points - geometry.apex
            height = q @ geometry.axis
            radius = np.linalg.norm(q - height[:, None] * geometry.axis, axis=1)
            slant = -radius * np.sin(geometry.half_angle) - height * np.cos(geometry.half_angle)
            columns.append(slant[:, None])
        case Torus():
            q = points - geometry.center
            height = q @ geometry.axis
            radial = np.linalg.norm(q - height[:, None] * geometry.axis, axis=1) - geometry.major
            length = np.maximum(np.hypot(radial, height), np.finfo(float).tiny)
            columns.append(np.column_stack([-radial / length, np.full(len(points), -1.0)]))
    return np.hstack(columns)


def crossed(a: Array, b: Array) -> Array:
    """Return the vector products along the last axis, faster than `np.cross`, which handles other shapes."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def _stepped(geometry: Geometry, step: Array) -> Geometry | None:
    """The geometry after a step in the columns of `_jacobian`; None if it is invalid (a negative radius)."""
    moved = geometry.transformed(pin.SE3(pin.exp3(step[3:6]), step[:3]))
    sizes = [f.name for f in fields(moved) if f.name in ("radius", "half_angle", "major", "minor")]
    try:
        return replace(moved, **{f: getattr(moved, f) + dx for f, dx in zip(sizes, step[6:], strict=True)})
    except GeometryError:
        return None


def _centred(geometry: Geometry, points: Array) -> Geometry:
    if isinstance(geometry, Cylinder):
        foot = geometry.origin + ((points.mean(axis=0) - geometry.origin) @ geometry.axis) * geometry.axis
        return replace(geometry, origin=foot)
    if isinstance(geometry, Plane):
        middle = points.mean(axis=0)
        return replace(geometry, origin=middle - geometry.distance(middle)[0] * geometry.normal)
    return geometry


def _scaled(geometry: Geometry, scale: float, center: Array) -> Geometry:
    changed = {}
    for field in fields(geometry):
        value = getattr(geometry, field.name)
        if field.name in ("origin", "apex", "center"):
            changed[field.name] = value * scale + center
        elif field.name in ("radius", "major", "minor"):
            changed[field.name] = value * scale
    return replace(geometry, **changed)


def _circle(flat: Array) -> tuple[Array, float]:
    """Centre (2,) and radius of the algebraic least-squares circle through (n, 2)."""
    matrix = np.column_stack([2.0 * flat, np.ones(len(flat))])
    solution, _, rank, _ = np.linalg.lstsq(matrix, (flat * flat).sum(axis=1), rcond=1e-12)
    square = float(solution[2] + solution[:2] @ solution[:2])
    if rank < 3 or not square > 0.0:
        raise FitError("the points lie on a line; no circle goes through them")
    return solution[:2], float(np.sqrt(square))


def _guess_plane(points: Array, bases: Array, normals: Array) -> Geometry:
    middle = points.mean(axis=0)
    normal = np.linalg.svd(points - middle, full_matrices=False)[2][2]
    return Plane(middle, normal if normal @ normals.sum(axis=0) >= 0 else -normal)


def _guess_sphere(points: Array, bases: Array, normals: Array) -> Geometry:
    matrix = np.column_stack([2.0 * points, np.ones(len(points))])
    solution, _, rank, _ = np.linalg.lstsq(matrix, (points * points).sum(axis=1), rcond=1e-12)
    square = float(solution[3] + solution[:3] @ solution[:3])
    if rank < 4 or not square > 0.0:
        raise FitError("the points lie in a plane; no sphere goes through them")
    return Sphere(solution[:3], np.sqrt(square))


def _guess_cylinder(points: Array, bases: Array, normals: Array) -> Geometry:
    """Cylinder whose axis is perpendicular to the normals, or a principal axis of the points: the best circle."""
    candidates = [*np.linalg.svd(normals, full_matrices=False)[2], *np.linalg.svd(points, full_matrices=False)[2]]
    best: tuple[float, Cylinder] | None = None
    for axis in candidates:
        u = perpendicular(axis)
        frame = np.array([u, np.cross(axis, u)])
        try:
            center, radius = _circle(points @ frame.T)
        except FitError:
            continue
        guess = Cylinder(center @ frame, axis, radius)
        cost = _cost(guess, points)
        if best is None or cost < best[0]:
            best = (cost, guess)
    if best is None:
        raise FitError("the points lie in a plane; no cylinder goes through them")
    return best[1]


def _guess_cone(points: Array, bases: Array, normals: Array) -> Geometry:
    """Cone whose unit normals lie on a circle about its axis, and whose tangent planes meet in the apex."""
    weight = np.linalg.norm(normals, axis=1)
    if np.count_nonzero(weight) < 3:
        raise FitError("fewer than three tangent planes determine no cone; give more normals")
    n = normals[weight > 0] / weight[weight > 0, None]
    w = weight[weight > 0] / weight.sum()
    mean = w @ n
    axis = np.linalg.svd((n - mean) * np.sqrt(w)[:, None], full_matrices=False)[2][2]
    root = np.sqrt(w)[:, None]
    apex, _, rank, _ = np.linalg.lstsq(n * root, np.einsum("ij,ij->i", n, bases[weight > 0]) * root[:, 0], rcond=1e-9)
    if rank < 3:
        raise FitError("the tangent planes do not meet in one point; no cone goes through the points")
    if (points - apex).mean(axis=0) @ axis < 0:
        axis = -axis
    return Cone(apex, axis, np.arcsin(np.clip(abs(mean @ axis), 1e-6, 1.0 - 1e-6)))


def _guess_torus(points: Array, bases: Array, normals: Array) -> Geometry:
    """Torus whose axis all normals intersect, found as a linear complex (Pottmann & Randrup, Computing 60 (1998) 307);
    in the half plane of radius and height the meridian is a circle."""
    weight = np.linalg.norm(normals, axis=1)
    n = normals / np.maximum(weight, np.finfo(float).tiny)[:, None]
    lines = np.hstack([np.cross(bases, n), n]) * np.sqrt(weight / weight.sum())[:, None]
    matrix = lines.T @ lines
    a, b, c = matrix[:3, :3], matrix[:3, 3:], matrix[3:, 3:]
    schur = a - b @ np.linalg.pinv(c, rcond=1e-12, hermitian=True) @ b.T
    axis = np.linalg.eigh(0.5 * (schur + schur.T))[1][:, 0]
    moment = -np.linalg.pinv(c, rcond=1e-12, hermitian=True) @ b.T @ axis
    origin = np.cross(axis, moment)
    q = points - origin
    height = q @ axis
    radius = np.linalg.norm(q - height[:, None] * axis, axis=1)
    meridian, minor = _circle(np.column_stack([radius, height]))
    return Torus(origin + meridian[1] * axis, axis, meridian[0], minor)


_GUESS: dict[str, Callable[[Array, Array, Array], Geometry]] = {
    "plane": _guess_plane,
    "cylinder": _guess_cylinder,
    "sphere": _guess_sphere,
    "cone": _guess_cone,
    "torus": _guess_torus,
}
_ENOUGH = {"plane": 3, "cylinder": 6, "sphere": 6, "cone": 8, "torus": 10}
"""least number of points of a meaningful fit: more than determine the surface, or the least that a face's mesh has"""
