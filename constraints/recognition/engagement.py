"""A solid cylinder in a narrower bore: where on its axis it keeps all common material in the rim that is meant.

The surfaces of the solid that lie inside a cylinder of radius R about the axis stay in it on every motion along and
about that axis. While the other body has no material within R - depth of the axis, over all heights that they reach,
all that the two have in common there lies in the rim between the two radii: a thread, or the skin of a press fit. So
those heights are all that a motion needs to keep.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import SurfaceMesh, inside, signed_distances
from constraints.geometry.features import Feature
from constraints.geometry.surfaces import Cylinder, cross, perpendicular
from constraints.recognition.profile import flat

Array = NDArray[np.float64]
Line = tuple[Array, Array]
"""(3,) m, (3,) unit: a point of an axis, and its direction"""
TILT = 2e-3
"""rad: between the two axes"""
SIDES = 16
"""of the prism about the core to which triangles are clipped"""


@dataclass(frozen=True, eq=False)
class Engagement:
    """A solid body in a hollow one, on an axis in world coordinates."""

    line: Line
    radius: float
    """m: greatest radius of the solid's own surfaces"""
    bores: tuple[float, float]
    """m: radii of the narrowest and the widest bore that it is too large for"""
    surfaces: tuple[int, ...]
    """of the solid, inside the cylinder of that radius"""
    span: tuple[float, float]
    """m along the axis: heights of these surfaces"""
    mated: tuple[float, float]
    """m along the axis: heights of the bores"""
    free: tuple[float, float]
    """m along the axis: between which these surfaces may be"""
    offset: float = 0.0
    """m: greatest distance of the axis of such a bore from that of the solid"""

    @property
    def length(self) -> float:
        """m: that the two share."""
        return max(0.0, min(self.span[1], self.mated[1]) - max(self.span[0], self.mated[0]))

    def holds(self, point: Array, slack: float) -> bool:
        """Whether a point (3,), m, lies in the rim that the two share."""
        height, radius = (float(x) for x in flat(np.asarray(point), self.line))
        inside = self.radius - self.depth - slack <= radius <= self.radius + slack
        return inside and self.span[0] - slack <= height <= self.span[1] + slack

    @property
    def depth(self) -> float:
        """m: radial, at the narrowest bore, with the offset of its axis."""
        return self.radius - self.bores[0] + self.offset


@dataclass(frozen=True, eq=False)
class PlacedBody:
    """A body where it stands."""

    mesh: SurfaceMesh
    pose: pin.SE3
    features: Sequence[Feature]
    deflections: Array
    """(n,) m, of the facets of each surface"""


def own_surfaces(body: PlacedBody, line: Line, most: float, least: float, above: float = -np.inf) -> dict[int, Array]:
    """Least and greatest height, and greatest radius (3,), m, of the surfaces of a body that lie inside a cylinder.

    most: m: radius of the cylinder. least: m: surfaces wholly nearer to the axis are left out. above: m: least height.
    """
    corners = body.mesh.vertices[body.mesh.triangles] @ body.pose.rotation.T + body.pose.translation
    heights, radii = flat(corners, line)
    n, of = body.mesh.n_surfaces, body.mesh.surface_of_triangle
    low, high, wide = np.full(n, np.inf), np.full(n, -np.inf), np.zeros(n)
    np.minimum.at(low, of, heights.min(axis=1))
    np.maximum.at(high, of, heights.max(axis=1))
    np.maximum.at(wide, of, radii.max(axis=1))
    kept = np.flatnonzero((wide <= most) & (wide >= least) & (low >= above))
    return {int(s): np.array([low[s], high[s], wide[s]]) for s in kept}


def coaxial_cylinders(
    body: PlacedBody, line: Line, sense: int, aside: float
) -> list[tuple[float, float, float, float]]:
    """Radius, least and greatest height, and distance, m, of the cylinders of a body that are no farther than `aside` m
    from a line."""
    out = []
    for feature in body.features:
        g = feature.geometry
        if feature.sense != sense or not isinstance(g, Cylinder):
            continue
        axis, points = body.pose.rotation @ g.axis, body.pose.act(g.origin)
        heights, _ = flat(feature.samples @ body.pose.rotation.T + body.pose.translation, line)
        # the offset is measured where the cylinder is
        middle = points + ((line[0] - points) @ axis + 0.5 * float(heights.min() + heights.max())) * axis
        tilt = np.linalg.norm(cross(axis, line[1]))
        offset = float(flat(middle, line)[1])
        if tilt <= TILT and offset <= aside:
            out.append((g.radius, float(heights.min()), float(heights.max()), offset))
    return out


@dataclass(frozen=True)
class Shank:
    """A cylinder of the solid body that may be too large for a bore."""

    radius: float
    """m"""
    above: float = -np.inf
    """m along the axis: where the surfaces of a screw begin, below its head"""
    within: tuple[float, float] = (-np.inf, np.inf)
    """m along the axis: its heights; only surfaces that reach there count"""


def engagement(
    solid: PlacedBody, hollow: PlacedBody, line: Line, shank: Shank, depth: float, slack: float,
    aside: Callable[[float, float], float] = lambda shaft, bore: 0.0,
) -> Engagement | str:  # fmt: skip
    """Return how a solid body is engaged in a hollow one, or why their common material is more than is meant.

    Parameters
    ----------
    line: axis of the solid, world. depth: m, radial: the most that the two may share on one axis. slack: m: overlaps up
        to it are none.
    aside: most that the axis of a bore may be off, m, of the radii of the shaft and the bore; `slack` in any case.
    """
    within = shank.within
    own = own_surfaces(solid, line, shank.radius + slack, 0.0, shank.above)
    own = {s: box for s, box in own.items() if box[0] <= within[1] + slack and box[1] >= within[0] - slack}
    if not own:
        return "no surface of it lies inside its own cylinder"
    widest = max(float(box[2]) for box in own.values())
    core = widest - depth
    span = min(float(box[0]) for box in own.values()), max(float(box[1]) for box in own.values())
    bores = [
        (r, low, high, offset)
        for r, low, high, offset in coaxial_cylinders(hollow, line, -1, widest)
        if r < widest - slack
        and offset <= max(slack, aside(widest, r))
        and min(high, span[1], within[1]) - max(low, span[0], within[0]) > slack
    ]
    if not bores:
        return "there is no bore on its axis that is narrower"
    narrow, wide = min(bore[0] for bore in bores), max(bore[0] for bore in bores)
    if narrow < core - slack:
        return f"a bore of Ø{2e3 * narrow:.4g} mm is narrower than Ø{2e3 * core:.4g} mm"
    mated = min(bore[1] for bore in bores), max(bore[2] for bore in bores)
    offset = max(bore[3] for bore in bores)
    if offset > slack:
        core = min(core, *(bore[0] - bore[3] for bore in bores))
    own = {s: box for s, box in own.items() if box[2] >= core}
    span = min(float(box[0]) for box in own.values()), max(float(box[1]) for box in own.values())
    free = _free(solid, hollow, line, core, slack, span, own)
    if isinstance(free, str):
        return free
    beyond = _others(hollow, line, widest, slack, span, mated)
    free = max(free[0], beyond[0]), min(free[1], beyond[1])
    return Engagement(line, widest, (narrow, wide), tuple(sorted(own)), span, mated, free, offset)


def _free(
    solid: PlacedBody,
    hollow: PlacedBody,
    line: Line,
    core: float,
    slack: float,
    span: tuple[float, float],
    own: Iterable[int],
) -> tuple[float, float] | str:
    """Heights between which a hollow body has no material within `core` m of a line; or where it has some."""
    if core <= slack:
        return "its core has no radius"
    low, high = -np.inf, np.inf
    middle, edge = 0.5 * (span[0] + span[1]), slack
    hidden = slack + float(solid.deflections[list(own)].max(initial=0.0))
    for piece in _pieces(hollow, line, core - slack):
        heights, _ = flat(piece, line)
        least, most = float(heights.min()), float(heights.max())
        if most <= span[0] + edge:
            low = max(low, most)
        elif least >= span[1] - edge:
            high = min(high, least)
        else:
            points = np.concatenate([piece, piece.mean(axis=0)[None], 0.5 * (piece + piece.mean(axis=0))])
            if (-signed_distances(solid.mesh, _local(points, solid)) > hidden).any():
                return f"material reaches into its core, within {1e3 * core:.4g} mm of the axis"
            if 0.5 * (least + most) >= middle:  # such as the cone of a drill around a tip: it goes no deeper
                high = min(high, span[1])
            else:
                low = max(low, span[0])
    heights = np.linspace(*span, 9)[1:-1]
    points = line[0] + heights[:, None] * line[1]
    common = inside(hollow.mesh, _local(points, hollow)) & inside(solid.mesh, _local(points, solid))
    return "there is no hole on its axis" if common.any() else (low, high)


def _others(
    hollow: PlacedBody, line: Line, radius: float, slack: float, span: tuple[float, float], mated: tuple[float, float]
) -> tuple[float, float]:
    """Heights beyond the present ones, and beyond the bores, at which other material is met within `radius` m."""
    start, end = min(span[0], mated[0]), max(span[1], mated[1])
    low, high = -np.inf, np.inf
    for piece in _pieces(hollow, line, radius - slack):
        heights, _ = flat(piece, line)
        if heights.max() < start - slack:
            low = max(low, float(heights.max()))
        elif heights.min() > end + slack:
            high = min(high, float(heights.min()))
    return low, high


def _local(points: Array, body: PlacedBody) -> Array:
    return np.ascontiguousarray((points - body.pose.translation) @ body.pose.rotation)


def _pieces(body: PlacedBody, line: Line, radius: float) -> list[Array]:
    """The triangles of a body that come nearer to a line than `radius` m, beyond what their deflection explains, each
    clipped to a prism about that cylinder."""
    corners = body.mesh.vertices[body.mesh.triangles] @ body.pose.rotation.T + body.pose.translation
    u = perpendicular(line[1])
    frame = np.stack([u, cross(line[1], u)], axis=1)
    plane = (corners - line[0]) @ frame
    near = np.flatnonzero(_least_radius(plane) < radius - body.deflections[body.mesh.surface_of_triangle])
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    normals = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ frame.T
    out = []
    for k in near.tolist():
        piece = corners[k]
        for normal in normals:
            piece = _clipped(piece, normal, radius - (piece - line[0]) @ normal)
            if not len(piece):
                break
        if len(piece):
            out.append(piece)
    return out


def _least_radius(plane: Array) -> Array:
    """(n,) least distance of plane triangles (n, 3, 2) from the origin; 0 of those around it."""
    ends = np.roll(plane, -1, axis=1)
    way = ends - plane
    square = np.maximum((way * way).sum(axis=2), np.finfo(float).tiny)
    t = np.clip(-(plane * way).sum(axis=2) / square, 0.0, 1.0)
    least = np.linalg.norm(plane + t[..., None] * way, axis=2).min(axis=1)
    turn = plane[..., 0] * ends[..., 1] - plane[..., 1] * ends[..., 0]
    around = (turn > 0.0).all(axis=1) | (turn < 0.0).all(axis=1)
    return np.where(around, 0.0, least)


def _clipped(polygon: Array, normal: Array, side: Array) -> Array:
    """The part (k, 3) of a convex polygon where `side` (n,), linear over it, is not negative."""
    kept = []
    for k in range(len(polygon)):
        m = (k + 1) % len(polygon)
        if side[k] >= 0.0:
            kept.append(polygon[k])
        if (side[k] < 0.0) != (side[m] < 0.0):
            kept.append(polygon[k] + side[k] / (side[k] - side[m]) * (polygon[m] - polygon[k]))
    return np.array(kept).reshape(-1, 3)
