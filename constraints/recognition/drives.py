"""The drive of a screw: what is sunk into the end of its head, or of a set screw."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from constraints.geometry.features import Feature
from constraints.geometry.surfaces import Cone, Cylinder, Plane, Torus, perpendicular
from constraints.recognition.fastener_kinds import MM, number
from constraints.recognition.profile import Profile, Span, covers_axis, prism

WIDEST = 0.9
"""1: greatest radius of a socket over that of the head it is in"""
DEEPEST = 0.8
"""1: greatest depth at which a drive begins, over the radius of the head: below the dome it is in"""
SHALLOWEST = 0.1
"""1: least depth of a recess, over the radius of the head"""
TORX = {
    6: 1.75, 7: 2.06, 8: 2.4, 9: 2.58, 10: 2.8, 15: 3.35, 20: 3.95, 25: 4.5, 27: 5.07, 30: 5.6, 40: 6.75, 45: 7.93,
    50: 8.95, 55: 11.35, 60: 13.45,
}  # fmt: skip
"""mm: size of a hexalobular socket (ISO 10664) -> its greatest diameter"""
TORX_LIKE = 0.12
"""1: greatest relative error of the diameter at which a size is named"""
SQUARE = 1.7
"""1: greatest reach of a square socket's walls over their distance from the axis; those of a cross reach farther"""
SLOT = 0.3
"""1: greatest half width of a slot over the radius of the head"""


def drive(p: Profile, tip: float, rim: float) -> str:
    """Return words for the drive at the end of the least height; empty if there is none.

    tip: m: height that all of it is below. rim: m: radius of the head.
    """
    near = [(f, s) for f in p.features if (s := p.span(f)).high < tip and s.low <= p.low + DEEPEST * rim]
    sunk = [(f, s) for f, s in near if s.most <= WIDEST * rim]
    within = [f for f, _ in sunk]
    if socket := prism(within, p.about, -1):
        return f"hexagon socket {number(2.0 * p.apothem(socket))} mm"
    if square := prism(within, p.about, -1, 4):
        reach = max(p.span(f).most for f in square)
        return "square socket" if reach <= SQUARE * p.apothem(square) else "cross"
    return _lobes(p, sunk, rim) or _slopes(p, sunk) or _slot(p, near, rim) or _recess(p, tip, rim)


def _lobes(p: Profile, sunk: Sequence[tuple[Feature, Span]], rim: float) -> str:
    """Words for a hexalobular socket: at least six round faces beside the axis, in different directions."""
    u = perpendicular(p.about.axis)
    v = np.cross(p.about.axis, u)
    own = {id(b.feature) for b in p.bands}
    lobes = [(f, s) for f, s in sunk if isinstance(f.geometry, Cylinder | Cone | Torus) and id(f) not in own]
    aside = [f.samples.mean(axis=0) - p.about.origin for f, _ in lobes]
    if len({round(float(np.arctan2(a @ v, a @ u)) * 6.0 / np.pi) % 12 for a in aside}) < 6:
        return ""
    across = 2.0 * max(s.most for _, s in lobes) / MM
    size = min(TORX, key=lambda n: abs(TORX[n] - across))
    return f"Torx T{size}" if abs(TORX[size] / across - 1.0) <= TORX_LIKE else "Torx"


def _slopes(p: Profile, sunk: Sequence[tuple[Feature, Span]]) -> str:
    """Words for a recess with at least four walls that lean towards the axis."""
    planes = [f.geometry for f, _ in sunk if isinstance(f.geometry, Plane)]
    return "cross" if sum(0.05 < abs(float(g.normal @ p.about.axis)) < 0.7 for g in planes) >= 4 else ""


def _slot(p: Profile, near: Sequence[tuple[Feature, Span]], rim: float) -> str:
    """Words for two walls that face each other across the axis; a cross has two more at right angles to them."""
    walls = []
    for f, _ in near:
        g = f.geometry
        if isinstance(g, Plane) and abs(float(g.normal @ p.about.axis)) < 0.01:
            away = float((g.origin - p.about.origin) @ g.normal)
            if -SLOT * rim <= away < 0.0:
                walls.append((away, g.normal))
    for k, (d, n) in enumerate(walls):
        if any(float(n @ m) < -0.999 and abs(d - e) < 0.02 * rim for e, m in walls[k + 1 :]):
            return "cross" if any(abs(float(n @ m)) < 0.05 for _, m in walls) else "slot"
    return ""


def _recess(p: Profile, tip: float, rim: float) -> str:
    """Word for a recess with freeform walls: its ground is across the axis, and no bore leads to it."""
    for f in p.features:
        g, s = f.geometry, p.span(f)
        facing = isinstance(g, Plane) and float(g.normal @ p.about.axis) < -0.999
        if facing and p.low + SHALLOWEST * rim < s.low < tip and s.most < WIDEST * rim and covers_axis(f, p.about):
            bored = any(not b.convex and b.whole and b.cylinder and b.low < s.low for b in p.bands)
            return "" if bored else "recess"
    return ""
