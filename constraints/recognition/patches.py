"""Least-squares cylinders, cones, spheres and tori through many small sets of points at once.

What `fits.fit_kind` does for one set, in one array operation for all: a segmentation tries tens of thousands of patches
of ten points each, and the cost of one is that of calling numpy. Sets are filled up with rows of weight 0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from constraints.errors import GeometryError
from constraints.geometry.surfaces import LARGEST, Cone, Cylinder, Geometry, Sphere, Torus
from constraints.recognition.fits import Fit, crossed

Array = NDArray[np.float64]
Patch = tuple[Array, Array, Array]
"""points (n, 3), m; bases (k, 3), m, and rough normals (k, 3) there, as `fits.fit_surface` takes them"""

_TINY = np.finfo(float).tiny


@dataclass
class _Surfaces:
    """Surfaces of one kind: a row each."""

    origin: Array
    """(n, 3) origin, apex or centre"""
    axis: Array
    """(n, 3); of spheres anything"""
    sizes: Array
    """(n, 1 or 2) radius; half angle; major and minor"""

    def __getitem__(self, rows: NDArray[np.int64] | NDArray[np.bool_]) -> _Surfaces:
        return _Surfaces(self.origin[rows], self.axis[rows], self.sizes[rows])

    def put(self, rows: NDArray[np.int64], other: _Surfaces) -> None:
        self.origin[rows], self.axis[rows], self.sizes[rows] = other.origin, other.axis, other.sizes


def fit_patches(kind: str, patches: Sequence[Patch], limit: float, iterations: int = 40) -> list[Fit | None]:
    """The least-squares surface of one kind through each patch; None where there is none within `limit`, m.

    The same surfaces as `fits.fit_kind` finds, but for rounding.
    """
    found: list[Fit | None] = [None] * len(patches)
    groups: dict[tuple[int, int], list[int]] = {}
    for i, (points, bases, _) in enumerate(patches):
        if len(points) >= 3 and len(bases):
            groups.setdefault((_filled(len(points)), _filled(len(bases))), []).append(i)
    for rows, triangles in sorted(groups):
        members = groups[rows, triangles]
        chosen = [patches[i] for i in members]
        points, weight = _stacked((patch[0] for patch in chosen), rows)
        bases, known = _stacked((patch[1] for patch in chosen), triangles)
        normals, _ = _stacked((patch[2] for patch in chosen), triangles)
        for i, fit in zip(
            members, _fitted(kind, points, weight, bases, known, normals, limit, iterations), strict=True
        ):
            found[i] = fit
    return found


def _filled(count: int) -> int:
    """The rows that `count` are filled up to."""
    return 1 << (count - 1).bit_length()


def _stacked(each: Iterable[Array], rows: int) -> tuple[Array, Array]:
    """(n, rows, 3) and their weights (n, rows): 1, or 0 for rows that fill up."""
    given = list(each)
    stack, weight = np.zeros((len(given), rows, 3)), np.zeros((len(given), rows))
    for i, one in enumerate(given):
        stack[i, : len(one)], weight[i, : len(one)] = one, 1.0
    return stack, weight


@np.errstate(all="ignore")  # sets through which no surface goes divide by nought; they are left out afterwards
def _fitted(
    kind: str, points: Array, weight: Array, bases: Array, known: Array, normals: Array, limit: float, iterations: int
) -> list[Fit | None]:
    count = weight.sum(axis=1)
    inside = weight[:, :, None] > 0.0
    center = points.sum(axis=1) / count[:, None]
    extent = np.where(inside, points, -np.inf).max(axis=1) - np.where(inside, points, np.inf).min(axis=1)
    scale = np.linalg.norm(extent, axis=1)
    p = (points - center[:, None]) / scale[:, None, None] * weight[:, :, None]
    b = (bases - center[:, None]) / scale[:, None, None] * known[:, :, None]
    surfaces, sound = _GUESS[kind](p, weight, b, known, normals)
    sound &= (scale > 0.0) & _is_surface(kind, surfaces)
    rows = np.flatnonzero(sound)
    best = _refined(kind, surfaces[rows], p[rows], weight[rows], iterations)
    residual = scale[rows] * np.abs(_distance(kind, best, p[rows]) * weight[rows]).max(axis=1)
    found: list[Fit | None] = [None] * len(points)
    for k in np.flatnonzero(residual <= limit).tolist():
        i = int(rows[k])
        origin = best.origin[k] * scale[i] + center[i]
        try:
            geometry = _geometry(kind, origin, best.axis[k], best.sizes[k], float(scale[i]), center[i])
        except GeometryError:
            continue
        given = points[i, : int(count[i])]
        residual_k = float(np.abs(geometry.distance(given)).max())
        if residual_k <= limit:
            found[i] = Fit(geometry, residual_k)
    return found


def _geometry(kind: str, origin: Array, axis: Array, sizes: Array, scale: float, middle: Array) -> Geometry:
    if kind == "cylinder":
        made = Cylinder(origin, axis, scale * sizes[0])
        return replace(made, origin=origin + ((middle - origin) @ made.axis) * made.axis)
    if kind == "cone":
        return Cone(origin, axis, sizes[0])
    if kind == "sphere":
        return Sphere(origin, scale * sizes[0])
    return Torus(origin, axis, scale * sizes[0], scale * sizes[1])


def _is_surface(kind: str, surfaces: _Surfaces) -> NDArray[np.bool_]:
    """Of each row, whether it is a surface that `constraints.geometry.surfaces` would make."""
    largest = np.nextafter(np.pi / 2, 0.0) if kind == "cone" else LARGEST
    rows = np.concatenate([np.abs(surfaces.origin) <= LARGEST, np.isfinite(surfaces.axis)], axis=1)
    sizes = (surfaces.sizes > 0.0) & (surfaces.sizes <= largest)
    return np.asarray(np.concatenate([rows, sizes], axis=1).all(axis=1))


def _refined(kind: str, best: _Surfaces, p: Array, weight: Array, iterations: int) -> _Surfaces:
    """Levenberg-Marquardt, as `fits.refine`; rows that have come to their end are left alone."""
    count = weight.sum(axis=1)
    distance = _distance(kind, best, p) * weight
    cost, damping = np.einsum("ij,ij->i", distance, distance), np.full(len(p), 1e-9)
    active = np.arange(len(p))
    for _ in range(iterations):
        if not len(active):
            break
        here, points, w, d = best[active], p[active], weight[active], distance[active]
        jacobian = _jacobian(kind, here, points) * w[:, :, None]
        matrix = np.einsum("nij,nik->njk", jacobian, jacobian)
        gradient = np.einsum("nij,ni->nj", jacobian, d)
        diagonal = np.einsum("njj->nj", matrix)
        diagonal += (damping[active] * diagonal.sum(axis=1))[:, None]
        sound = np.isfinite(matrix).all(axis=(1, 2)) & (diagonal > 0.0).all(axis=1)
        matrix[~sound] = np.eye(matrix.shape[1])
        step = -np.linalg.solve(matrix, gradient[:, :, None])[:, :, 0]
        trial = _stepped(kind, here, step)
        moved = _distance(kind, trial, points) * w
        gain = cost[active] - np.einsum("ij,ij->i", moved, moved)
        better = sound & _is_surface(kind, trial) & (gain > 0.0)
        rows = active[better]
        best.put(rows, trial[better])
        distance[rows] = moved[better]
        cost[rows] -= gain[better]
        damping[rows] = np.maximum(0.1 * damping[rows], 1e-12)
        worse = active[~better]
        ended = (damping[worse] > 1e-3) | (cost[worse] < 1e-28 * count[worse])
        damping[worse] *= 100.0
        active = np.sort(np.concatenate([rows[gain[better] > 1e-9 * cost[rows]], worse[~ended]]))
    return best


def _stepped(kind: str, surfaces: _Surfaces, step: Array) -> _Surfaces:
    """Each surface after a step of `_jacobian`'s columns."""
    rotation = step[:, None, 3:6]
    origin = _turned(surfaces.origin[:, None], rotation)[:, 0] + step[:, :3]
    axis = _turned(surfaces.axis[:, None], rotation)[:, 0]
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    return _Surfaces(origin, axis if kind != "sphere" else surfaces.axis, surfaces.sizes + step[:, 6:])


def _turned(vectors: Array, rotation: Array) -> Array:
    """Vectors turned by rotation vectors (Rodrigues)."""
    angle = np.linalg.norm(rotation, axis=-1, keepdims=True)
    unit = rotation / np.maximum(angle, _TINY)
    sine, rest = np.sin(angle), 2.0 * np.sin(0.5 * angle) ** 2
    across = crossed(unit, vectors)
    return vectors + sine * across + rest * crossed(unit, across)


def _radial(surfaces: _Surfaces, points: Array) -> tuple[Array, Array, Array]:
    """Heights along the axis, radial vectors and radii."""
    q = points - surfaces.origin[:, None]
    height = np.einsum("nij,nj->ni", q, surfaces.axis)
    r = q - height[:, :, None] * surfaces.axis[:, None]
    return height, r, np.sqrt(np.einsum("nij,nij->ni", r, r))


def _distance(kind: str, surfaces: _Surfaces, points: Array) -> Array:
    if kind == "sphere":
        return np.linalg.norm(points - surfaces.origin[:, None], axis=2) - surfaces.sizes
    height, _, radius = _radial(surfaces, points)
    if kind == "cylinder":
        return radius - surfaces.sizes
    if kind == "cone":
        c, s = np.cos(surfaces.sizes), np.sin(surfaces.sizes)
        return np.where(height * c + radius * s < 0.0, np.hypot(height, radius), radius * c - height * s)
    return np.hypot(radius - surfaces.sizes[:, :1], height) - surfaces.sizes[:, 1:]


def _jacobian(kind: str, surfaces: _Surfaces, points: Array) -> Array:
    """(n, points, 6 + sizes): how a twist of the surface, and its sizes, change the distances."""
    minus = np.full((*points.shape[:2], 1), -1.0)
    if kind == "sphere":
        q = points - surfaces.origin[:, None]
        length = np.linalg.norm(q, axis=2)[:, :, None]
        n = np.where(length > 0.0, q / np.maximum(length, _TINY), [0.0, 0.0, 1.0])
        return np.concatenate([-n, crossed(n, points), minus], axis=2)
    height, r, radius = _radial(surfaces, points)
    aside = np.where(
        radius[:, :, None] > 0.0, r / np.maximum(radius, _TINY)[:, :, None], _aside(surfaces.axis)[:, None]
    )
    if kind == "cylinder":
        n, more = aside, minus
    elif kind == "cone":
        c, s = np.cos(surfaces.sizes), np.sin(surfaces.sizes)
        n = aside * c[:, :, None] - (surfaces.axis * s)[:, None]
        more = (-radius * s - height * c)[:, :, None]
    else:
        across = radius - surfaces.sizes[:, :1]
        length = np.hypot(across, height)[:, :, None]
        normal = across[:, :, None] * aside + height[:, :, None] * surfaces.axis[:, None]
        n = np.where(length > 0.0, normal / np.maximum(length, _TINY), aside)
        more = np.concatenate([-across[:, :, None] / np.maximum(length, _TINY), minus], axis=2)
    return np.concatenate([-n, crossed(n, points), more], axis=2)


def _aside(axis: Array) -> Array:
    """Unit vectors (n, 3) at right angles to `axis` (n, 3)."""
    other = np.eye(3)[np.abs(axis).argmin(axis=1)]
    p = crossed(axis, other)
    return p / np.linalg.norm(p, axis=1)[:, None]


def _least_squares(matrix: Array, right: Array, rcond: float) -> tuple[Array, NDArray[np.bool_]]:
    """Solutions (n, k) of (n, m, k) systems, and whether each has full rank."""
    sound = np.asarray(np.isfinite(matrix).all(axis=(1, 2)) & np.isfinite(right).all(axis=1))
    u, s, v = np.linalg.svd(np.where(sound[:, None, None], matrix, 0.0), full_matrices=False)
    full = sound & (s[:, -1] > rcond * s[:, 0])
    solution = np.einsum("nij,ni->nj", v, np.einsum("nij,ni->nj", u, right) / np.where(full[:, None], s, 1.0))
    return solution, full


def _circles(flat: Array, weight: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Centres (n, 2), radii (n,) of the algebraic least-squares circles, and where there is one."""
    matrix = np.concatenate([2.0 * flat, np.ones((*flat.shape[:2], 1))], axis=2) * weight[:, :, None]
    solution, full = _least_squares(matrix, np.einsum("nij,nij->ni", flat, flat) * weight, 1e-12)
    square = solution[:, 2] + np.einsum("ni,ni->n", solution[:, :2], solution[:, :2])
    return solution[:, :2], np.sqrt(np.maximum(square, 0.0)), full & (square > 0.0)


Guess = tuple[_Surfaces, NDArray[np.bool_]]
"""and where there is one"""


def _guess_sphere(p: Array, weight: Array, bases: Array, known: Array, normals: Array) -> Guess:
    matrix = np.concatenate([2.0 * p, np.ones((*p.shape[:2], 1))], axis=2) * weight[:, :, None]
    solution, full = _least_squares(matrix, np.einsum("nij,nij->ni", p, p) * weight, 1e-12)
    square = solution[:, 3] + np.einsum("ni,ni->n", solution[:, :3], solution[:, :3])
    axis = np.tile([0.0, 0.0, 1.0], (len(p), 1))
    return _Surfaces(solution[:, :3], axis, np.sqrt(np.maximum(square, 0.0))[:, None]), full & (square > 0.0)


def _guess_cylinder(p: Array, weight: Array, bases: Array, known: Array, normals: Array) -> Guess:
    """Axis at right angles to the normals, or along the points' spread: whichever circle fits best."""
    rows = len(p)
    candidates, there = [], []
    for vectors, count in ((normals, known.sum(axis=1)), (p, weight.sum(axis=1))):
        filled = np.concatenate([vectors, np.zeros((rows, max(3 - vectors.shape[1], 0), 3))], axis=1)
        axes = np.linalg.svd(np.where(np.isfinite(filled), filled, 0.0), full_matrices=False)[2]
        for k in range(3):
            candidates.append(axes[:, k])
            there.append(count > k)
    best = _Surfaces(np.zeros((rows, 3)), np.zeros((rows, 3)), np.zeros((rows, 1)))
    least = np.full(rows, np.inf)
    for axis, is_there in zip(candidates, there, strict=True):
        u = _aside(axis)
        v = crossed(axis, u)
        center, radius, found = _circles(np.stack([_along(p, u), _along(p, v)], axis=2), weight)
        guess = _Surfaces(center[:, :1] * u + center[:, 1:] * v, axis, radius[:, None])
        distance = _distance("cylinder", guess, p) * weight
        cost = np.where(is_there & found, np.einsum("ij,ij->i", distance, distance), np.inf)
        better = np.flatnonzero(cost < least)
        best.put(better, guess[better])
        least[better] = cost[better]
    return best, np.isfinite(least)


def _along(vectors: Array, axis: Array) -> Array:
    return np.einsum("nij,nj->ni", vectors, axis)


def _guess_cone(p: Array, weight: Array, bases: Array, known: Array, normals: Array) -> Guess:
    """Normals of a cone end on a circle about its axis; its tangent planes meet in the apex."""
    area = np.linalg.norm(normals, axis=2)
    enough = (area > 0.0).sum(axis=1) >= 3
    n = normals / np.maximum(area, _TINY)[:, :, None]
    w = area / np.maximum(area.sum(axis=1), _TINY)[:, None]
    root = np.sqrt(w)[:, :, None]
    mean = np.einsum("ni,nij->nj", w, n)
    spread = (n - mean[:, None]) * root
    spread = np.concatenate([spread, np.zeros((len(p), max(3 - spread.shape[1], 0), 3))], axis=1)
    axis = np.linalg.svd(spread, full_matrices=False)[2][:, 2]
    planes = np.einsum("nij,nij->ni", n, bases)[:, :, None] * root
    filled = np.zeros((len(p), max(3 - n.shape[1], 0), 3))
    apex, full = _least_squares(
        np.concatenate([n * root, filled], axis=1), np.concatenate([planes, filled[:, :, :1]], axis=1)[:, :, 0], 1e-9
    )
    away = (p.sum(axis=1) / weight.sum(axis=1)[:, None] - apex) * axis
    axis = np.where(away.sum(axis=1)[:, None] < 0.0, -axis, axis)
    angle = np.arcsin(np.clip(np.abs(np.einsum("ni,ni->n", mean, axis)), 1e-6, 1.0 - 1e-6))
    return _Surfaces(apex, axis, angle[:, None]), enough & full


def _guess_torus(p: Array, weight: Array, bases: Array, known: Array, normals: Array) -> Guess:
    """As `fits._guess_torus`: the normals meet the axis, found as a linear complex; the meridian is a circle."""
    area = np.linalg.norm(normals, axis=2)
    n = normals / np.maximum(area, _TINY)[:, :, None]
    share = np.sqrt(area / np.maximum(area.sum(axis=1), _TINY)[:, None])
    lines = np.concatenate([crossed(bases, n), n], axis=2) * share[:, :, None]
    matrix = np.einsum("nij,nik->njk", lines, lines)
    matrix[~np.isfinite(matrix).all(axis=(1, 2))] = np.eye(6)
    a, b, c = matrix[:, :3, :3], matrix[:, :3, 3:], matrix[:, 3:, 3:]
    inverse = np.linalg.pinv(c, rcond=1e-12, hermitian=True)
    schur = a - b @ inverse @ b.transpose(0, 2, 1)
    axis = np.linalg.eigh(0.5 * (schur + schur.transpose(0, 2, 1)))[1][:, :, 0]
    moment = -np.einsum("nij,nkj,nk->ni", inverse, b, axis)
    origin = crossed(axis, moment)
    height, _, radius = _radial(_Surfaces(origin, axis, np.empty((len(p), 0))), p)
    meridian, minor, found = _circles(np.stack([radius, height], axis=2), weight)
    return _Surfaces(origin + meridian[:, 1:] * axis, axis, np.column_stack([meridian[:, 0], minor])), found


_GUESS: dict[str, Callable[[Array, Array, Array, Array, Array], Guess]] = {
    "cylinder": _guess_cylinder, "cone": _guess_cone, "sphere": _guess_sphere, "torus": _guess_torus,
}  # fmt: skip
