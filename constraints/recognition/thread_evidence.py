"""Evidence that a shaft larger than its bore is a screw in its tapped hole, drawn as two plain cylinders.

Diameters alone tell no thread: a dowel Ø10 in a bore Ø8.5 is drawn like M10. It takes a head or a hexagon socket of the
screw, the hexagon of a nut, a countersink or counterbore that takes the screw in, or a name that the caller passes on.
A fine pitch takes a name that states it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from constraints.geometry.features import Feature
from constraints.geometry.metric_threads import DrawnThread, metric_threads
from constraints.geometry.surfaces import Cone, Cylinder, Plane, Sphere, Torus, perpendicular

Array = NDArray[np.float64]

HEAD = (1.2, 4.0)
"""1: least and greatest radius of a head or nut, over that of the screw"""
HEAD_HEIGHT = 3.5
"""1: greatest height of a head, over the radius of the screw"""
MOUTH = 3.5
"""1: greatest radius of a countersink or counterbore, over that of the screw"""
BESIDE = 1.0
"""1: farthest that a countersink or counterbore is from the end of the bore, over the radius of the screw"""
ALIKE = 0.01
"""rad, and over the radius of the screw: within it axes coincide, and planes are those of one hexagon"""


def drawn_thread(
    screw: Sequence[Feature], shank: int, hole: Sequence[Feature], bore: int, words: Collection[str]
) -> DrawnThread | None:
    """Return the thread that a shank and a bore stand for, with the evidence; None without evidence.

    Parameters
    ----------
    screw, hole: features of the two bodies; shank, bore: places of the two cylinders among them.
    words: of the two bodies' names that speak of threads: "screw", "nut", …, or sizes as "M6" and "M8×1".
    """
    s, h = screw[shank].geometry, hole[bore].geometry
    if not (isinstance(s, Cylinder) and isinstance(h, Cylinder)):
        return None
    sizes = metric_threads(2.0 * s.radius, 2.0 * h.radius)
    if not sizes:
        return None
    stated = [word for word in words if word[:1] == "M" and word[1:2].isdigit()]
    named = next((size for size in sizes if size.name in stated), None)
    coarse = next((size for size in sizes if size.coarse), None)
    found = ""
    if coarse is not None and named in (None, coarse):
        found = (
            _head(screw, shank, s)
            or _hexagon(screw, s, -1, "hexagon socket")
            or _hexagon(hole, h, 1, "hexagon nut", s.radius)
            or _mouth(hole, bore, h, s.radius)
            or next((f'name "{word}"' for word in sorted(words) if not stated), "")
        )
    if coarse is not None and found:
        return DrawnThread(coarse, found)
    return None if named is None else DrawnThread(named, f'name "{named.name}"')


def _head(features: Sequence[Feature], shank: int, s: Cylinder) -> str:
    """Words for a round or hexagonal head at one end of a shank; empty if there is none."""
    own, _ = _flat(features[shank], s)
    everything = [_flat(feature, s) for feature in features]
    slack = ALIKE * s.radius
    for sign in (1.0, -1.0):
        end = float((sign * own).max()) - slack
        beyond = [np.flatnonzero(sign * heights >= end) for heights, _ in everything]
        top = max(float((sign * h[k]).max(initial=end)) for (h, _), k in zip(everything, beyond, strict=True))
        radius = max(float(r[k].max(initial=0.0)) for (_, r), k in zip(everything, beyond, strict=True))
        if top - end > HEAD_HEIGHT * s.radius or not HEAD[0] <= radius / s.radius <= HEAD[1]:
            continue
        whole = [f for f, (heights, _) in zip(features, everything, strict=True) if (sign * heights).min() >= end]
        if _hexagon(whole, s, 1, "hexagon head", s.radius):
            return "hexagon head"
        for feature in whole:
            if feature.sense < 0 or isinstance(feature.geometry, Plane) or not _coaxial(feature, s):
                continue
            wide = float(_flat(feature, s)[1].max())
            if wide >= HEAD[0] * s.radius:
                kind = "countersunk head" if isinstance(feature.geometry, Cone) else "head"
                return f"{kind} Ø{2e3 * wide:.4g} mm"
    return ""


def _mouth(features: Sequence[Feature], bore: int, h: Cylinder, screw: float) -> str:
    """Words for a countersink or counterbore at one end of a bore that a screw of radius `screw` (m) goes into."""
    own, _ = _flat(features[bore], h)
    for feature in features:
        if feature.sense > 0 or not isinstance(feature.geometry, Cone | Cylinder) or not _coaxial(feature, h):
            continue
        heights, radii = _flat(feature, h)
        apart = max(float(heights.min() - own.max()), float(own.min() - heights.max()))
        if abs(apart) <= BESIDE * screw and (1.0 - ALIKE) * screw <= float(radii.max()) <= MOUTH * screw:
            kind = "countersink" if isinstance(feature.geometry, Cone) else "counterbore"
            return f"{kind} Ø{2e3 * float(radii.max()):.4g} mm"
    return ""


def _hexagon(features: Sequence[Feature], about: Cylinder, side: int, words: str, screw: float = 0.0) -> str:
    """`words` if six planes about an axis are a hexagon, else empty.

    side: 1 where they face away from the axis, as those of a nut, -1 where they face it. screw: m: radius that the
    hexagon is a head or nut of; 0 for any.
    """
    u = perpendicular(about.axis)
    frame = np.array([u, np.cross(about.axis, u)])
    found: list[tuple[float, float]] = []  # distance from the axis, direction in turns of 60°
    for geometry in _planes(features):
        if abs(float(geometry.normal @ about.axis)) > ALIKE:
            continue
        away = float((geometry.origin - about.origin) @ geometry.normal)
        if away * side > 0.0 and (screw == 0.0 or HEAD[0] * screw <= abs(away) <= HEAD[1] * screw):
            x, y = frame @ geometry.normal
            found.append((abs(away), float(np.arctan2(y, x)) * 3.0 / np.pi))
    for distance, turn in found:
        alike = [t - turn for d, t in found if abs(d - distance) <= ALIKE * distance]
        places = {round(t) % 6 for t in alike if abs(t - round(t)) <= ALIKE}
        if len(places) == 6:
            return words
    return ""


def _planes(features: Sequence[Feature]) -> Iterator[Plane]:
    for feature in features:
        if isinstance(feature.geometry, Plane):
            yield feature.geometry


def _flat(feature: Feature, about: Cylinder) -> tuple[Array, Array]:
    """Heights along an axis and distances from it (n,), m, of a feature's samples."""
    away = feature.samples - about.origin
    heights = away @ about.axis
    return heights, np.linalg.norm(away - heights[:, None] * about.axis, axis=1)


def _coaxial(feature: Feature, about: Cylinder) -> bool:
    """Whether a round surface is one of revolution about an axis."""
    g = feature.geometry
    if isinstance(g, Sphere):
        axis, point = about.axis, g.center
    elif isinstance(g, Cylinder | Cone | Torus):
        axis, point = g.axis, g.apex if isinstance(g, Cone) else g.center if isinstance(g, Torus) else g.origin
    else:
        return False
    aside = np.cross(point - about.origin, about.axis)
    return bool(np.linalg.norm(np.cross(axis, about.axis)) <= ALIKE and np.linalg.norm(aside) <= ALIKE * about.radius)
