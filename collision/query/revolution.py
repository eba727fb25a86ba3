"""Distances while an object turns about an axis and moves along it, as a screw does in its hole, bounded from below.

Whatever the angle between two points, they are no nearer to each other than their places in the half plane of radius
and height about the axis. A turning object keeps these but for its travel along the axis, so that a whole way is
bounded at once; a sweep takes steps no longer than the gap is wide, all along the arcs that the surface goes.
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
"""how far directions may differ, and points over the objects' size, that count as the same"""
PAIRS = 1 << 20
"""pairs of triangles that are looked at in one go"""


def screw_axis(knots: Sequence[pin.SE3], size: float) -> tuple[Array, Array, tuple[float, float]] | None:
    """Origin (3,), direction (3,) of the one axis that displacements turn about and move along, and the least and
    greatest of how far they move, m; None where there is no such axis. size: of what is displaced, m."""
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
    """(n, 4) least and greatest radius of each triangle, placed, about an axis, and height along it; m."""
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
    """(a, b) lower bounds, at most `within`, of the distances of surfaces of both objects on the whole path, m.

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
    """(n, m) distances of rectangles (n, 4), (m, 4), each least and greatest of both coordinates."""
    apart = [
        np.maximum(0.0, np.maximum(a[:, None, k] - b[None, :, k + 1], b[None, :, k] - a[:, None, k + 1]))
        for k in (0, 2)
    ]
    return np.hypot(*apart)
