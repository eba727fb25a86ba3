"""Clashes of shafts and bores: a shaft larger than a press fit allows, or one off the axis and in the wall.

Facets hide such overlaps up to their deflection, and deeper ones may intersect elsewhere. Here they are found from
radii and axes, where both surfaces and their material exist.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import SurfaceMesh, inside
from constraints.geometry.reach import reached
from constraints.geometry.round_fit import RoundFit
from constraints.geometry.surfaces import Cylinder, cross, perpendicular
from constraints.geometry.views import FeatureView, Limits
from constraints.geometry.words import millimetres
from constraints.recognition.candidate import Match, Pair
from constraints.recognition.pairings import concentric
from constraints.recognition.recognise import Recogniser

Segments = tuple[NDArray[np.float64], NDArray[np.float64]]
OFF_AXIS = 0.25
"""1: greatest offset of the axes, as a fraction of the bore's radius"""
ROUND, ALONG = 48, 7
"""places about the axis and along it at which both surfaces are tested for"""
SPARSE = 16
"""one place in this number is tested for common material first"""


@dataclass(frozen=True, eq=False)
class Misfit:
    """A shaft and a bore that clash."""

    pair: Pair
    fit: RoundFit
    faces: tuple[tuple[int, int], ...]
    """faces of the first and of the second body that are nearer than the overlap"""
    line: tuple[NDArray[np.float64], NDArray[np.float64]]
    """(3,) m, (3,) unit, world: middle of the shared length, and axis"""
    length: float
    """m: shared length along the axis"""
    why: str


class Cylinders(NamedTuple):
    """Cylinders of one body, in the world."""

    place: NDArray[np.int64]
    """(n,) index of the feature"""
    origin: NDArray[np.float64]
    axis: NDArray[np.float64]
    radius: NDArray[np.float64]
    sense: NDArray[np.int64]


def misfits(
    recogniser: Recogniser,
    meshes: Sequence[SurfaceMesh],
    poses: Sequence[pin.SE3],
    contacts: NDArray[Any],
    limits: Limits,
    slack: Sequence[float],
) -> tuple[Misfit, ...]:
    """Return the shafts in bores that clash, among bodies that are near each other.

    Those farther off the axis than `OFF_AXIS` are left to collision: their facets intersect.

    Parameters
    ----------
    contacts: rows of `collision.CONTACT_DTYPE` between the bodies. limits: without reach, for an assembly as drawn.
    slack: m, by body, greatest deflection of its facets.
    """
    out = []
    codes = recogniser.codes(contacts)
    contacts, codes = contacts[codes >= 0], codes[codes >= 0]
    touching = np.unique(np.stack([contacts["object_a"], contacts["object_b"]], axis=1), axis=0).tolist()
    cylinders = {i: _cylinders(recogniser, i, poses[i]) for i in {i for pair in touching for i in pair}}
    for a, b in touching:
        hidden = limits.slack + slack[a] + slack[b]
        for fa, fb in _coaxial(cylinders[a], cylinders[b], hidden, limits):
            pair = a, fa, b, fb
            if recogniser.pitch(pair) is not None or recogniser.matches(pair, poses, limits) is not None:
                continue
            first, second = recogniser.view(a, fa, poses[a]), recogniser.view(b, fb, poses[b])
            solid, hollow = (first, second) if first.feature.sense > 0 else (second, first)
            radius = hollow.geometry.radius
            any_fit = replace(
                limits,
                linear=hidden + OFF_AXIS * radius,
                clearance=np.inf,
                interference=np.inf,
                overlap=limits.slack,
                fit_class="",
            )
            match = concentric(solid, hollow, any_fit)
            if match is None or match.fit is None:
                continue
            fit = limits.round_fit(radius, match.fit, match.residual)
            beside = match.overlap <= max(-fit.gap, limits.slack)  # only the ends overlap
            at = None if fit.kind != "clash" or beside else _meeting(solid, hollow, match, limits)
            if at is None or (-fit.gap > hidden and not _common(at, (meshes[a], meshes[b]), (poses[a], poses[b]))):
                continue
            rows = contacts[(codes == recogniser.code(pair)) & (contacts["distance"] <= hidden - fit.gap)]
            faces = sorted(zip(rows["surface_a"].tolist(), rows["surface_b"].tolist(), strict=True))
            faces = faces or list(product(first.feature.surfaces, second.feature.surfaces))
            most = millimetres(limits.most_interference(radius))
            why = f"Ø{2e3 * solid.geometry.radius:.6g} in Ø{2e3 * radius:.6g} mm, "
            if match.residual > limits.slack:
                why += f"axes {millimetres(match.residual)} apart, overlap by {millimetres(-fit.gap)}"
            else:
                why += f"{fit.words}, more than the {most} of a press fit {limits.fit_class or limits.press_fit}"
            axis = match.origin, match.direction
            out.append(Misfit(pair, fit, tuple(faces), axis, match.overlap, why))
    return tuple(out)


def _cylinders(recogniser: Recogniser, body: int, pose: pin.SE3) -> Cylinders:
    """The cylinders among a body's features, in the world."""
    features = recogniser.features[body]
    places = [f for f, feature in enumerate(features) if isinstance(feature.geometry, Cylinder)]
    geometries: list[Any] = [features[f].geometry.transformed(pose) for f in places]
    return Cylinders(
        np.array(places, np.int64),
        np.array([g.origin for g in geometries]).reshape(-1, 3),
        np.array([g.axis for g in geometries]).reshape(-1, 3),
        np.array([g.radius for g in geometries]),
        np.array([features[f].sense for f in places]),
    )


def _coaxial(first: Cylinders, second: Cylinders, hidden: float, limits: Limits) -> list[tuple[int, int]]:
    """Features of pairs of a solid and a hollow cylinder on one axis that overlap by less than half the radius."""
    turn = np.linalg.norm(np.cross(first.axis[:, None], second.axis[None]), axis=2)
    aside = np.linalg.norm(np.cross(second.origin[None] - first.origin[:, None], first.axis[:, None]), axis=2)
    larger = first.sense[:, None] * (first.radius[:, None] - second.radius[None])
    facing = first.sense[:, None] != second.sense[None]
    # the rule measures the offset where both are; the origins may be distant along axes that are nearly parallel
    length = np.linalg.norm(second.origin[None] - first.origin[:, None], axis=2)
    reach = hidden + OFF_AXIS * second.radius[None] + np.abs(larger) + length * limits.angular
    found = facing & (turn <= limits.angular) & (aside <= reach)
    found &= (larger + aside >= 0.0) & (larger <= 0.5 * np.minimum(first.radius[:, None], second.radius[None]))
    return [(int(first.place[i]), int(second.place[j])) for i, j in np.argwhere(found)]


def _meeting(
    solid: FeatureView[Cylinder], hollow: FeatureView[Cylinder], match: Match, limits: Limits
) -> Segments | None:
    """Points of the bore (n, 3), m, world, and the opposite ones of the shaft, where both surfaces exist and the shaft
    is larger; None without such points."""
    s, h = solid.geometry, hollow.geometry
    u = perpendicular(h.axis)
    v = cross(h.axis, u)
    angle = 2.0 * np.pi * np.arange(ROUND) / ROUND
    ways = np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v
    heights = 0.49 * match.overlap * np.linspace(-1.0, 1.0, ALONG)
    points = (match.origin + heights[:, None, None] * h.axis + h.radius * ways).reshape(-1, 3)
    depth = -s.distance(points)
    points, depth = points[depth > limits.slack], depth[depth > limits.slack]
    there = reached(points, hollow.triangles, 2.0 * hollow.extent.deflection + limits.slack)
    points, depth = points[there], depth[there]
    opposite = points + depth[:, None] * s.normals(points)
    both = reached(opposite, solid.triangles, 2.0 * solid.extent.deflection + limits.slack)
    return (points[both], opposite[both]) if both.any() else None


def _common(at: Segments, meshes: tuple[SurfaceMesh, SurfaceMesh], poses: tuple[pin.SE3, pin.SE3]) -> bool:
    """Whether two bodies have common material all the way from a bore to a shaft. A bush in a ring has none, though the
    ring is larger than the bore of the bush."""
    bore, shaft = at
    for chosen in (slice(None, None, SPARSE), slice(None)):  # a few points are often enough
        start, way = bore[chosen], shaft[chosen] - bore[chosen]
        for t, k in product((0.5, 0.25, 0.75), (0, 1)):
            points = start + t * way - poses[k].translation
            common = inside(meshes[k], points @ poses[k].rotation)
            start, way = start[common], way[common]
            if not len(start):
                break
        if len(start):
            return True
    return False
