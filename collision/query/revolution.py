"""Lower bounds of distances while an object turns about an axis and moves along it, as a screw in its hole.

The distance of two points is at least that of their places in the half plane of radius and height about the axis,
whatever the angle between them. Turning keeps radius and height, so that one test bounds a whole path, where a sweep
would take steps no longer than the gap all along the arcs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pinocchio as pin

    from collision.mesh import SurfaceMesh

Array = NDArray[np.float64]
SAME = 1e-12
"""1: greatest difference of equal directions, and of equal points as a part of the objects' size"""
PAIRS = 1 << 20
"""pairs of triangles compared in one array operation"""


def screw_axis(knots: Sequence[pin.SE3], size: float) -> tuple[Array, Array, tuple[float, float]] | None:
    """Return the common screw axis of displacements: origin (3,), direction (3,), (least, greatest) travel along it, m;
    None if there is none. size: of the displaced object, m."""
    import pinocchio as pin

    way = np.asarray(pin.log6(knots[0].actInv(knots[1])))
    turn = float(np.linalg.norm(way[3:]))
    if turn < 1e-3:
        return None
    axis = knots[0].rotation @ (way[3:] / turn)
    origin = knots[0].act(np.cross(way[3:], way[:3]) / turn**2)
    moved = [knot.act(knots[0].actInv(origin)) - origin for knot in knots]
    along = [float(each @ axis) for each in moved]
    for knot, each, far in zip(knots, moved, along, strict=True):
        turned = knot.rotation @ knots[0].rotation.T @ axis
        if np.linalg.norm(turned - axis) > SAME or np.linalg.norm(each - far * axis) > SAME * (size + abs(far)):
            return None
    return origin, axis, (min(along), max(along))


def profile(mesh: SurfaceMesh, pose: pin.SE3, origin: Array, axis: Array) -> Array:
    """Return (n, 4), m: least and greatest radius about an axis, and height along it, of each triangle at a pose."""
    corners = mesh.vertices[mesh.triangles] @ pose.rotation.T + (pose.translation - origin)
    heights = corners @ axis
    u = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    u /= np.linalg.norm(u)
    flat = corners @ np.stack([u, np.cross(axis, u)], axis=1)
    edges = np.roll(flat, -1, axis=1) - flat
    length = np.maximum((edges**2).sum(axis=2), np.finfo(float).tiny)
    t = np.clip(-(flat * edges).sum(axis=2) / length, 0.0, 1.0)
    nearest = np.linalg.norm(flat + t[..., None] * edges, axis=2).min(axis=1)
    sides = edges[..., 0] * flat[..., 1] - edges[..., 1] * flat[..., 0]
    nearest[(sides >= 0.0).all(axis=1) | (sides <= 0.0).all(axis=1)] = 0.0  # the axis goes through it
    return np.stack([nearest, np.linalg.norm(flat, axis=2).max(axis=1), heights.min(axis=1), heights.max(axis=1)], 1)


def least_gaps(
    moving: SurfaceMesh,
    static: SurfaceMesh,
    profiles: tuple[Array, Array],
    travel: tuple[float, float],
    within: float,
) -> Array:
    """Return (a, b) lower bounds, m, at most `within`, of the distances of the surfaces of two objects on a path.

    profiles: of both objects about the axis. travel: least and greatest displacement along it, m.
    """
    out = np.full((moving.n_surfaces, static.n_surfaces), within)
    mine, theirs = profiles[0] + np.array([0.0, 0.0, *travel]), profiles[1]
    slack = 4.0 * SAME * max(float(np.abs(mine).max()), float(np.abs(theirs).max()))
    hull = np.array([mine[:, 0].min(), mine[:, 1].max(), mine[:, 2].min(), mine[:, 3].max()])
    close = np.flatnonzero(_gaps(hull[None, :], theirs)[0] < within)
    close = close[np.argsort(static.surface_of_triangle[close], kind="stable")]
    if not len(close):
        return out
    columns, starts = np.unique(static.surface_of_triangle[close], return_index=True)
    step = max(1, PAIRS // len(close))
    for s in range(moving.n_surfaces):
        own = moving.triangles_of(s)
        for k in range(0, len(own), step):
            gaps = _gaps(mine[own[k : k + step]], theirs[close]).min(axis=0)
            out[s, columns] = np.minimum(out[s, columns], np.minimum.reduceat(gaps, starts) - slack)
    return np.maximum(out, 0.0)


def _gaps(a: Array, b: Array) -> Array:
    """(n, m) distances of rectangles (n, 4) and (m, 4): least and greatest first, then second coordinate."""
    apart = [
        np.maximum(0.0, np.maximum(a[:, None, k] - b[None, :, k + 1], b[None, :, k] - a[:, None, k + 1]))
        for k in (0, 2)
    ]
    return np.hypot(*apart)
