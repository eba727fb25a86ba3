"""Evidence that a shaft larger than its bore is a screw in its tapped hole, drawn as two plain cylinders.

Diameters alone tell no thread: a dowel Ø10 in a bore Ø8.5 is drawn like M10. It takes a head or a hexagon socket of the
screw, the hexagon of a nut, a countersink or counterbore that takes the screw in, or a name that the caller passes on.
A fine pitch takes a name that states it.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from constraints.geometry.features import Feature
from constraints.geometry.metric_threads import DrawnThread, metric_threads
from constraints.geometry.surfaces import Cone, Cylinder, Plane
from constraints.recognition.profile import ALIKE, coaxial, heights_radii, prism

HEAD = (1.2, 4.0)
"""1: least and greatest radius of a head or nut, over that of the screw"""
HEAD_HEIGHT = 3.5
"""1: greatest height of a head, over the radius of the screw"""
MOUTH = 3.5
"""1: greatest radius of a countersink or counterbore, over that of the screw"""
BESIDE = 1.0
"""1: farthest that a countersink or counterbore is from the end of the bore, over the radius of the screw"""


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
            or ("hexagon socket" if prism(screw, s, -1) else "")
            or ("hexagon nut" if prism(hole, h, 1, bounds=_bounds(s)) else "")
            or _mouth(hole, bore, h, s.radius)
            or next((f'name "{word}"' for word in sorted(words) if not stated), "")
        )
    if coarse is not None and found:
        return DrawnThread(coarse, found)
    return None if named is None else DrawnThread(named, f'name "{named.name}"')


def _head(features: Sequence[Feature], shank: int, s: Cylinder) -> str:
    """Words for a round or hexagonal head at one end of a shank; empty if there is none."""
    own, _ = heights_radii(features[shank].samples, s)
    everything = [heights_radii(feature.samples, s) for feature in features]
    slack = ALIKE * s.radius
    for sign in (1.0, -1.0):
        end = float((sign * own).max()) - slack
        beyond = [np.flatnonzero(sign * heights >= end) for heights, _ in everything]
        top = max(float((sign * h[k]).max(initial=end)) for (h, _), k in zip(everything, beyond, strict=True))
        radius = max(float(r[k].max(initial=0.0)) for (_, r), k in zip(everything, beyond, strict=True))
        if top - end > HEAD_HEIGHT * s.radius or not HEAD[0] <= radius / s.radius <= HEAD[1]:
            continue
        whole = [f for f, (heights, _) in zip(features, everything, strict=True) if (sign * heights).min() >= end]
        if prism(whole, s, 1, bounds=_bounds(s)):
            return "hexagon head"
        for feature in whole:
            if feature.sense < 0 or isinstance(feature.geometry, Plane) or not coaxial(feature, s):
                continue
            wide = float(heights_radii(feature.samples, s)[1].max())
            if wide >= HEAD[0] * s.radius:
                kind = "countersunk head" if isinstance(feature.geometry, Cone) else "head"
                return f"{kind} Ø{2e3 * wide:.4g} mm"
    return ""


def _bounds(s: Cylinder) -> tuple[float, float]:
    """Least and greatest distance (m) of the planes of a head or nut of a screw from its axis."""
    return HEAD[0] * s.radius, HEAD[1] * s.radius


def _mouth(features: Sequence[Feature], bore: int, h: Cylinder, screw: float) -> str:
    """Words for a countersink or counterbore at one end of a bore that a screw of radius `screw` (m) goes into."""
    own, _ = heights_radii(features[bore].samples, h)
    for feature in features:
        if feature.sense > 0 or not isinstance(feature.geometry, Cone | Cylinder) or not coaxial(feature, h):
            continue
        heights, radii = heights_radii(feature.samples, h)
        apart = max(float(heights.min() - own.max()), float(own.min() - heights.max()))
        if abs(apart) <= BESIDE * screw and (1.0 - ALIKE) * screw <= float(radii.max()) <= MOUTH * screw:
            kind = "countersink" if isinstance(feature.geometry, Cone) else "counterbore"
            return f"{kind} Ø{2e3 * float(radii.max()):.4g} mm"
    return ""
