"""The solid surfaces near a moving part as walls: contact rows, and for each the direction and the gap that it leaves.

A pair of facing planes gives a row a corner of the area they share: one witness alone would let the part tilt about it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CONTACT_DTYPE, SurfaceMesh, Tolerance
from collision.contact import picked, surfaces_of
from constraints.geometry.overlap import FacingArea, facing_area
from constraints.geometry.surfaces import Cone, Cylinder, Plane, Sphere
from constraints.geometry.views import FeatureView, Limits
from constraints.recognition.recognise import Recogniser

Array = NDArray[np.float64]
Surfaces = tuple[int, int, int, int]
"""Body, surface, body, surface."""

TOUCHING = 1e-3
"""Of `Tolerance.linear`: nearer than this two witnesses no longer tell a direction."""
FACING = 0.99
"""Cosine of the angle up to which two planes count as facing each other (8°)."""


class Near(Protocol):
    """The queries of `collision.CollisionManager` that walls need."""

    def mesh(self, i: int) -> SurfaceMesh: ...
    def contacts(self, within: float = 0.0, objects: Iterable[int] | None = None) -> NDArray[Any]: ...


class Searched(NamedTuple):
    """The result of a search for contacts."""

    rows: NDArray[Any]
    """as `contacts` returns them for the bodies that move, or for more"""
    within: float = -1.0
    """m"""


NOT_SEARCHED = Searched(np.empty(0, CONTACT_DTYPE))


class Walls:
    """Looks for what is near, with the features that the surfaces belong to."""

    def __init__(self, collision: Near, recogniser: Recogniser, tolerance: Tolerance) -> None:
        self.collision = collision
        self.recogniser = recogniser
        self.tolerance = tolerance
        self._borders: dict[tuple[int, int], float] = {}

    def near(
        self, reach: float, bodies: Iterable[int], poses: Sequence[pin.SE3], known: Searched = NOT_SEARCHED
    ) -> NDArray[Any]:
        """Contact rows of `bodies` with all others within `reach` m, those of facing planes as one a corner.

        known: a search at these poses, which is used if it went as far.

        Planes that are back to back, as those of plates that lie on each other, are left out: their solids meet before.
        """
        if known.within >= reach:
            rows = picked(known.rows, known.rows["distance"] <= reach)
        else:
            rows = self.collision.contacts(reach, bodies)
        shared, counts = {}, np.ones(len(rows), int)
        for k, ((a, sa, b, sb), distance) in enumerate(
            zip(surfaces_of(rows).tolist(), rows["distance"].tolist(), strict=True)
        ):
            found = self._shared(a, sa, b, sb, distance, poses)
            if found is None:
                continue
            region, normal = found
            if region is not None:
                shared[k], counts[k] = (region, normal), len(region.gaps)
            elif float((rows["point_b"][k] - rows["point_a"][k]) @ normal) < -TOUCHING * self.tolerance.linear:
                counts[k] = 0
        if counts.all() and not shared:
            return rows
        out = np.repeat(rows, counts)
        for k, at in zip(shared, (np.cumsum(counts) - counts)[list(shared)].tolist(), strict=True):
            region, normal = shared[k]
            end = at + len(region.gaps)
            out["distance"][at:end] = np.maximum(region.gaps, 0.0)
            out["point_a"][at:end] = region.corners
            out["point_b"][at:end] = region.corners + region.gaps[:, None] * normal
        return out

    def _shared(
        self, a: int, sa: int, b: int, sb: int, distance: float, poses: Sequence[pin.SE3]
    ) -> tuple[FacingArea | None, Array] | None:
        """The area that two facing planes share, None if they do not, and the normal of the first; None for any other
        pair of surfaces."""
        recogniser = self.recogniser
        fa, fb = recogniser.feature_of(a, sa), recogniser.feature_of(b, sb)
        if fa is None or fb is None:
            return None
        p, q = recogniser.features[a][fa].geometry, recogniser.features[b][fb].geometry
        if not (isinstance(p, Plane) and isinstance(q, Plane)):
            return None
        normal, other = poses[a].rotation @ p.normal, poses[b].rotation @ q.normal
        if normal @ other > -FACING:
            return None
        first, second = recogniser.view(a, fa, poses[a]), recogniser.view(b, fb, poses[b])
        origins = poses[a].act(p.origin), poses[b].act(q.origin)
        region = facing_area(origins[0], normal, first.triangles, second.triangles, origins[1], other)
        apart = distance > TOUCHING * self.tolerance.linear
        if not len(region.gaps) or (apart and region.gap_min < 0.0):  # back to back through a thin plate
            return None, normal
        return region, normal

    def deflection(self, body: int, surface: int) -> float:
        """m: how far the facets of an analytic surface stray from it; 0 for any other."""
        feature = self.recogniser.feature_of(body, surface)
        if feature is None:
            return 0.0
        # it is measured at centroids: a cylinder's facets stray most midway between their sides
        return 1.125 * self.recogniser.view(body, feature, pin.SE3.Identity()).extent.deflection

    def interference(self, pair: Surfaces, poses: Sequence[pin.SE3]) -> float:
        """m, at least 0: how much larger a shaft is than the bore it is in, the offset of their axes included.

        Facets that lie parallel tell no depth. 0 for any other pair, and for a shaft that is no fit (`round_fit`).
        """
        a, sa, b, sb = pair
        places = self.recogniser.feature_of(a, sa), self.recogniser.feature_of(b, sb)
        if places[0] is None or places[1] is None:
            return 0.0
        f, g = self.recogniser.features[a][places[0]], self.recogniser.features[b][places[1]]
        p, q = f.geometry, g.geometry
        if not (isinstance(p, Cylinder) and isinstance(q, Cylinder)) or f.sense == g.sense:
            return 0.0
        at = poses[a].actInv(poses[b])
        way = at.act(q.origin) - p.origin
        offset = float(np.linalg.norm(np.cross(way, p.axis)))
        turned = float(np.linalg.norm(np.cross(at.rotation @ q.axis, p.axis)))
        radius, other = (p.radius, q.radius) if f.sense < 0 else (q.radius, p.radius)
        fit = Limits.keep(self.tolerance).round_fit(radius, radius - other, offset)
        if turned > self.tolerance.angular or fit.kind == "clash" or fit.clearance > self.tolerance.clearance:
            return 0.0
        along = (f.samples - p.origin) @ p.axis, (g.samples @ at.rotation.T + at.translation - p.origin) @ p.axis
        if min(along[0].max(), along[1].max()) <= max(along[0].min(), along[1].min()):
            return 0.0
        return max(-fit.gap, 0.0)

    def _view(self, body: int, surface: int, pose: pin.SE3) -> FeatureView[Any]:
        """The feature that a surface belongs to, where its body is at `pose`."""
        feature = self.recogniser.feature_of(body, surface)
        assert feature is not None
        return self.recogniser.view(body, feature, pose)

    def _border(self, body: int, surface: int) -> float:
        """m: length of the border of a plane."""
        known = self._borders.get((body, surface))
        if known is None:
            sides = self._view(body, surface, pin.SE3.Identity()).sides
            known = self._borders[body, surface] = float(np.linalg.norm(sides[:, 1] - sides[:, 0], axis=1).sum())
        return known

    def pressed(
        self, rows: NDArray[Any], poses: Sequence[pin.SE3], target: Mapping[int, pin.SE3], slop: float,
        strip: Callable[[Surfaces], float], allowed: Callable[[Surfaces], float],
    ) -> bool:  # fmt: skip
        """Whether bodies on their way from `poses` to `target` press planes that face each other, in contact rows
        there, by more than `slop` (m) deeper into each other than is `allowed` (m) of a pair: triangles tell no depth
        of what is parallel.

        Faces that share strips no wider than `slop` pass each other. So do those that share no more than a strip along
        their border, as wide (m) as `strip` has it of a pair: the end of a shaft and the mouth of its bore.
        """
        for a, sa, b, sb in surfaces_of(rows).tolist():
            found = self._shared(a, sa, b, sb, 0.0, poses)
            region, normal = found or (None, None)
            if region is None or normal is None:
                continue
            border = min(self._border(a, sa), self._border(b, sb))
            if region.area <= strip((a, sa, b, sb)) * border:
                continue
            if region.area <= slop * border and self._in_strips(a, sa, b, sb, normal, poses, slop):
                continue
            ends = [target.get(i, poses[i]) for i in (a, b)]
            way = [end * poses[i].inverse() for end, i in zip(ends, (a, b), strict=True)]
            opposite = region.corners + region.gaps[:, None] * normal
            after = (opposite @ way[1].rotation.T + way[1].translation) - (
                region.corners @ way[0].rotation.T + way[0].translation
            )
            gaps = after @ (way[0].rotation @ normal)
            if (gaps < np.minimum(region.gaps - TOUCHING * slop, -allowed((a, sa, b, sb)) - slop)).any():
                return True
        return False

    def _in_strips(
        self, a: int, sa: int, b: int, sb: int, normal: Array, poses: Sequence[pin.SE3], wide: float
    ) -> bool:
        """Whether all that two facing planes share are strips as wide (m) as given, however many and far apart.

        The intersection of two triangles is convex: its corners give its width.
        """
        first, second = (self._view(i, s, poses[i]).triangles for i, s in ((a, sa), (b, sb)))
        origin = first[0, 0]

        def shared(one: Array, other: Array) -> FacingArea:
            return facing_area(origin, normal, one, other, origin, -normal)

        ones = [one for one in first[:, None] if shared(one, second).area > 0.0]
        others = [other for other in second[:, None] if shared(first, other).area > 0.0]
        for region in (shared(one, other) for one in ones for other in others):
            spread = region.corners - region.corners.sum(axis=0) / max(len(region.corners), 1)
            if len(spread) > 2 and np.linalg.svd(spread, compute_uv=False)[1] > wide:
                return False
        return True

    def parted(self, rows: NDArray[Any], poses: Sequence[pin.SE3]) -> tuple[Array, Array]:
        """For each row the direction (k, 3), unit, world, from a to b, along which its gap (k,) opens.

        A row that has none is left to the sweep: its gap is infinite.
        """
        gaps = np.array(rows["distance"])
        normals = np.zeros((len(rows), 3))
        apart = gaps > TOUCHING * self.tolerance.linear
        normals[apart] = (rows["point_b"] - rows["point_a"])[apart] / gaps[apart, None]
        for i in np.flatnonzero(~apart).tolist():
            normal = self._parting(rows[i], poses)
            if normal is None:
                gaps[i] = np.inf
            else:
                normals[i] = normal
        return normals, gaps

    def hollow(self, rows: NDArray[Any], poses: Sequence[pin.SE3]) -> tuple[NDArray[np.bool_], Array]:
        """Which contact rows are with a bore, or another hollow surface around a convex room, and the directions
        (k, 3), from a to b, of the facets of these that are met."""
        keep, normals = np.zeros(len(rows), bool), []
        for i, row in enumerate(rows):
            for side, sign in (("a", 1.0), ("b", -1.0)):
                body = int(row["object_" + side])
                place = self.recogniser.feature_of(body, int(row["surface_" + side]))
                feature = None if place is None else self.recogniser.features[body][place]
                if feature is not None and feature.sense < 0 and isinstance(feature.geometry, Cylinder | Cone | Sphere):
                    keep[i] = True
                    normals.append(sign * self._triangle(body, int(row["triangle_" + side]), poses[body])[1])
                    break
        return keep, np.reshape(normals, (-1, 3))

    def _parting(self, row: Any, poses: Sequence[pin.SE3]) -> Array | None:
        """(3,) unit, from a to b, where two surfaces touch.

        It is the outward normal of the triangle that parts the two best, of those that have the second body's material
        in front of them; None where neither has (edges side by side).
        """
        a, b = int(row["object_a"]), int(row["object_b"])
        ta, na = self._triangle(a, int(row["triangle_a"]), poses[a])
        tb, nb = self._triangle(b, int(row["triangle_b"]), poses[b])
        if na @ nb > self.tolerance.angular:
            return None
        beneath_a = -float(((tb - ta[0]) @ na).min())
        beneath_b = -float(((ta - tb[0]) @ nb).min())
        return na if beneath_a <= beneath_b else -nb

    def _triangle(self, body: int, triangle: int, pose: pin.SE3) -> tuple[Array, Array]:
        """Corners (3, 3) and outward normal (3,) in the world."""
        mesh = self.collision.mesh(body)
        t = mesh.vertices[mesh.triangles[triangle]] @ pose.rotation.T + pose.translation
        (ax, ay, az), (bx, by, bz) = (t[1] - t[0]).tolist(), (t[2] - t[0]).tolist()
        n = np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
        length = float(np.sqrt(n @ n))
        return t, n / length if length > 0 else np.array([0.0, 0.0, 1.0])
