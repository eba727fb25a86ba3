"""How far two analytic surfaces face each other: area of facing planes, shared length and open angle of round ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collision.numeric.kernel import inner_kernel, kernel
from constraints.geometry.surfaces import Vector, perpendicular

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FacingArea:
    """The region two facing planar features share, seen along the normal of the first."""

    area: float
    """m²; 0 when they do not overlap"""
    centroid: Vector
    """(3,) of the region, on the first plane"""
    gap_min: float
    gap_max: float
    """m: least and greatest height of the second plane over the first within the region (negative: interference)"""
    corners: Array
    """(k, 3) the region's farthest points in eight directions, on the first plane; k <= 8"""
    gaps: Array
    """(k,) m: height of the second plane over them"""


_ANGLES = 2.0 * np.pi * (np.arange(8) + 0.5) / 8.0
_OUTWARD = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)


@inner_kernel(allocates=True)
def _clip_area(a: Array, b: Array, slope: Array, outward: Array, far: Array) -> Any:  # pragma: no cover - compiled
    """Sum over triangle pairs of their intersection (Sutherland & Hodgman 1974): area, moment, range of the height.

    a (n, 3, 2) and b (m, 3, 2): triangles in plane coordinates, counter-clockwise. slope (3,): the height of the
    second plane over the first is slope[0]*x + slope[1]*y + slope[2]. far (8, 2) becomes the region's farthest points
    in the directions outward (8, 2).
    """
    area = mx = my = 0.0
    low, high = np.inf, -np.inf
    best = np.full(outward.shape[0], -np.inf)
    poly = np.empty((16, 2))
    other = np.empty((16, 2))
    for i in range(a.shape[0]):
        ax0 = min(a[i, 0, 0], a[i, 1, 0], a[i, 2, 0])
        ax1 = max(a[i, 0, 0], a[i, 1, 0], a[i, 2, 0])
        ay0 = min(a[i, 0, 1], a[i, 1, 1], a[i, 2, 1])
        ay1 = max(a[i, 0, 1], a[i, 1, 1], a[i, 2, 1])
        for j in range(b.shape[0]):
            if max(b[j, 0, 0], b[j, 1, 0], b[j, 2, 0]) <= ax0 or min(b[j, 0, 0], b[j, 1, 0], b[j, 2, 0]) >= ax1:
                continue
            if max(b[j, 0, 1], b[j, 1, 1], b[j, 2, 1]) <= ay0 or min(b[j, 0, 1], b[j, 1, 1], b[j, 2, 1]) >= ay1:
                continue
            n = 3
            for k in range(3):
                poly[k, 0] = a[i, k, 0]
                poly[k, 1] = a[i, k, 1]
            for e in range(3):
                px, py = b[j, e, 0], b[j, e, 1]
                dx, dy = b[j, (e + 1) % 3, 0] - px, b[j, (e + 1) % 3, 1] - py
                m = 0
                for k in range(n):
                    x0, y0 = poly[k, 0], poly[k, 1]
                    x1, y1 = poly[(k + 1) % n, 0], poly[(k + 1) % n, 1]
                    s0 = dx * (y0 - py) - dy * (x0 - px)
                    s1 = dx * (y1 - py) - dy * (x1 - px)
                    if s0 >= 0.0:
                        other[m, 0] = x0
                        other[m, 1] = y0
                        m += 1
                    if (s0 > 0.0 and s1 < 0.0) or (s0 < 0.0 and s1 > 0.0):
                        t = s0 / (s0 - s1)
                        other[m, 0] = x0 + t * (x1 - x0)
                        other[m, 1] = y0 + t * (y1 - y0)
                        m += 1
                n = m
                poly, other = other, poly
                if n < 3:
                    break
            if n < 3:
                continue
            piece = cx = cy = 0.0
            x0, y0 = poly[0, 0], poly[0, 1]
            for k in range(1, n - 1):
                x1, y1, x2, y2 = poly[k, 0], poly[k, 1], poly[k + 1, 0], poly[k + 1, 1]
                w = 0.5 * ((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0))
                piece += w
                cx += w * (x0 + x1 + x2) / 3.0
                cy += w * (y0 + y1 + y2) / 3.0
            if piece > 0.0:
                area += piece
                mx += cx
                my += cy
                for k in range(n):
                    h = slope[0] * poly[k, 0] + slope[1] * poly[k, 1] + slope[2]
                    low = min(low, h)
                    high = max(high, h)
                    for d in range(outward.shape[0]):
                        e = outward[d, 0] * poly[k, 0] + outward[d, 1] * poly[k, 1]
                        if e > best[d]:
                            best[d] = e
                            far[d, 0] = poly[k, 0]
                            far[d, 1] = poly[k, 1]
    return area, mx, my, low, high


def facing_area(
    origin: Vector, normal: Vector, first: Array, second: Array, other_origin: Vector, other_normal: Vector
) -> FacingArea:
    """Overlap of two planar triangle sets seen along `normal`.

    first (n, 3, 3), second (m, 3, 3): triangles in world coordinates, m. `origin`, `normal` is the first plane,
    `other_origin`, `other_normal` the second one, whose height over the first is what `gap` means.
    """
    u = perpendicular(normal)
    v = np.array(_crossed(*normal.tolist(), *u.tolist()))
    down = float(other_normal @ normal)
    slope = -np.array([other_normal @ u, other_normal @ v, other_normal @ (origin - other_origin)]) / down
    far = np.empty((8, 2))
    area, mx, my, low, high, count = _facing(first, second, np.array(origin), u, v, slope, _OUTWARD, far)
    if area <= 0.0:
        return FacingArea(0.0, origin, np.inf, np.inf, np.zeros((0, 3)), np.zeros(0))
    far = far[:count]
    return FacingArea(
        area=area,
        centroid=origin + (mx / area) * u + (my / area) * v,
        gap_min=low,
        gap_max=high,
        corners=origin + far[:, :1] * u + far[:, 1:] * v,
        gaps=far @ slope[:2] + slope[2],
    )


def _crossed(a: float, b: float, c: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    return b * z - c * y, c * x - a * z, a * y - b * x


@kernel(allocates=True)
def _facing(
    first: Array, second: Array, origin: Array, u: Array, v: Array, slope: Array, outward: Array, far: Array
) -> Any:  # pragma: no cover - compiled
    """`_clip_area` of triangles (n, 3, 3), (m, 3, 3) in the plane of u and v; the first `count` of far are sorted."""
    area, mx, my, low, high = _clip_area(
        _flattened(first, origin, u, v), _flattened(second, origin, u, v), slope, outward, far
    )
    count = 0
    for k in range(len(far)):  # by x, then y, each once
        x, y = far[k, 0], far[k, 1]
        at = 0
        while at < count and (far[at, 0] < x or (far[at, 0] == x and far[at, 1] < y)):
            at += 1
        if at < count and far[at, 0] == x and far[at, 1] == y:
            continue
        for i in range(count, at, -1):
            far[i, 0], far[i, 1] = far[i - 1, 0], far[i - 1, 1]
        far[at, 0], far[at, 1] = x, y
        count += 1
    return area, mx, my, low, high, count


@inner_kernel(allocates=True)
def _flattened(triangles: Array, origin: Array, u: Array, v: Array) -> Array:  # pragma: no cover - compiled
    """(n, 3, 2) triangles in the coordinates of a plane, all wound counter-clockwise."""
    out = np.empty((len(triangles), 3, 2))
    for i in range(len(triangles)):
        for k in range(3):
            x, y, z = triangles[i, k, 0] - origin[0], triangles[i, k, 1] - origin[1], triangles[i, k, 2] - origin[2]
            out[i, k, 0] = x * u[0] + y * u[1] + z * u[2]
            out[i, k, 1] = x * v[0] + y * v[1] + z * v[2]
        turn = (out[i, 1, 0] - out[i, 0, 0]) * (out[i, 2, 1] - out[i, 0, 1])
        if turn < (out[i, 1, 1] - out[i, 0, 1]) * (out[i, 2, 0] - out[i, 0, 0]):
            for d in range(2):
                out[i, 0, d], out[i, 2, d] = out[i, 2, d], out[i, 0, d]
    return out


def height_spans(samples: Array, triangles: NDArray[np.int32], origin: Vector, axis: Vector) -> Array:
    """(k, 2) heights (m) along a unit `axis` from `origin` that the triangles cover, ascending, apart from each other.

    Two ears of a hinge are one feature with two spans: a pin between them is in neither.
    """
    h = ((samples - origin) @ axis)[triangles]
    low, high = h.min(axis=1), h.max(axis=1)
    order = np.argsort(low, kind="stable")
    low, high = low[order], np.maximum.accumulate(high[order])
    slack = 1e-9 * (high[-1] - low[0])  # faces that meet in one circle may differ by rounding
    first = np.concatenate([[True], low[1:] > high[:-1] + slack])
    last = np.concatenate([first[1:], [True]])
    return np.stack([low[first], high[last]], axis=1)


def shared_height(first: Array, second: Array) -> tuple[float, float, float]:
    """How much two sets of spans (k, 2) share, and the least and greatest height where they do (m).

    Where they share nothing the first number is minus the gap between them, and the heights are the gap's ends.
    """
    low = np.maximum(first[:, None, 0], second[None, :, 0]).ravel()
    high = np.minimum(first[:, None, 1], second[None, :, 1]).ravel()
    shared = high > low
    if not shared.any():
        k = int(np.argmax(high - low))
        return float(high[k] - low[k]), float(high[k]), float(low[k])
    return float((high - low)[shared].sum()), float(low[shared].min()), float(high[shared].max())


def open_angle(samples: Array, origin: Vector, axis: Vector) -> float:
    """Greatest angle (rad) about the axis that no sample covers: π for a half bore, small for a whole one."""
    u = perpendicular(axis)
    v = np.cross(axis, u)
    q = samples - origin
    angles = np.sort(np.arctan2(q @ v, q @ u))
    return float(max(np.diff(angles).max(initial=0.0), 2 * np.pi - (angles[-1] - angles[0])))
