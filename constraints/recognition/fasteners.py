"""What a part is as a fastener or bought-in small part: recognised from its features first, its name second.

Each rule looks at the part about its main axis (`Profile`) and at what its name says (`NameHint`). Dimensions decide
where they match a standard's; a drive, a thread with real geometry or a name where they do not. A plain cylinder or
ring that nothing names is none.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from collision import SurfaceMesh
from constraints.geometry.features import Feature
from constraints.geometry.surfaces import Cone, Cylinder, Plane, Torus, perpendicular
from constraints.recognition.drives import drive
from constraints.recognition.fastener_kinds import MM, NUTS, SCREWS, SOFT, Fastener, FastenerKind, number
from constraints.recognition.fastener_names import NameHint, name_hint
from constraints.recognition.fastener_sizes import (
    StandardSize,
    best_size,
    coarse_pitch,
    drawn_thread_error,
    matching,
    nominal_diameter,
)
from constraints.recognition.profile import Band, Profile, covers_axis, heights_radii, main_axis, prism, profile

__all__ = ["NUTS", "SCREWS", "SOFT", "Fastener", "FastenerKind", "fastener"]

MANY_FEATURES = 400
"""most features of a part that no name calls a fastener: heads with knurls have some hundred"""
LOPSIDED, LOPSIDED_NAMED = 0.1, 0.6
"""1: greatest distance of the middle of a part's box from its axis, over its radius; of T-slot nuts by their name"""
STATED = 0.04
"""1: greatest relative error of a dimension at which a standard is named"""
SURE = 0.01
"""1: greatest relative error at which dimensions alone make a screw of a part without drive or name"""
COLUMN = 1.4
"""1: greatest step of a shank: from the root of the smallest thread to its nominal diameter"""
CRESTS = 1.8
"""1: greatest radius of a thread's crests over that of its core"""
HEAD = (1.35, 3.6)
"""1: least and greatest radius of a head over that of the shank"""
HEAD_HEIGHT = (0.15, 2.8)
"""1: least and greatest height of a head over the radius of the shank"""
BEARING, RIM = 1.15, 0.7
"""1: least radius of the plane that a head bears on, over that of the shank and that of the head"""
UNDER = 1.25
"""1: radius over that of the shank where a head begins: beyond the fillet below it"""
LEAN = 0.35
"""rad: greatest difference of a countersink's half angle from 45°"""
ROUNDNESS = 1.2
"""rad: greatest angle between neighbouring vertices at the rim of a head: 60° at a hexagon's corners"""
CORNER = 0.04
"""1: greatest relative error of the corners of a hexagon or square: chamfers cut their ends"""
NAMED, NAMED_TAPPING = (0.65, 1.08), (0.65, 1.15)
"""1: drawn diameter of a thread over that its name states"""
FORMS = {
    "cylinder": ("cylinder", "dome"),
    "dome": ("dome", "flange", "cylinder"),
    "hexagon": ("hexagon",),
    "hexagon flange": ("hexagon flange",),
    "countersunk": ("countersunk", "raised countersunk"),
    "raised countersunk": ("raised countersunk", "countersunk"),
}
"""form of a head as drawn -> forms of standards that it may be"""


def fastener(mesh: SurfaceMesh, features: Sequence[Feature], words: Collection[str] = ()) -> Fastener | None:
    """Return what a part is as a fastener, None if it is none.

    Parameters
    ----------
    mesh, features: of the part, in its frame.
    words: of its name, in lower case and in their order: "screw", "m3x8", "bhcs", … (`name_words`).
    """
    hint = name_hint(words)
    if not features or (len(features) > MANY_FEATURES and not hint.kind):
        return None
    if hint.kind in SOFT:
        return _soft(mesh, features, hint)
    about = profile(mesh, features, LOPSIDED_NAMED if hint.kind else LOPSIDED)
    if about is not None:
        about = about.with_threads(mesh)
        for rule in (_o_ring, _screw, _shoulder, _headless, _nut, _ring, _hollow):
            if (found := rule(about, hint)) is not None:
                return found
    return _key(mesh, features, hint) or _circlip(mesh, features, hint) or _magnet(mesh, features, hint)


def _screw(of: Profile, hint: NameHint) -> Fastener | None:
    """A shank with a head, at whichever end."""
    return _headed(of, hint) or _headed(of.flipped(), hint)


def _column(p: Profile) -> tuple[Band, ...]:
    """The cylinders and threads of a shank, from its tip at the greatest height to the head; empty if it has none."""
    shafts = sorted(p.shafts, key=lambda b: -b.high)
    for k, first in enumerate(shafts):
        beyond = p.radii[p.heights > first.high - 1e-3 * p.radius]
        if first.length < 0.2 * first.most or float(beyond.max(initial=0.0)) > 1.03 * first.most:
            continue
        column = [first]
        for b in shafts[k + 1 :]:  # a crest around the core of a self-tapping screw shares its heights
            shared = min(b.high, first.high) - max(b.low, first.low)
            step = CRESTS if shared >= 0.5 * b.length else COLUMN
            if first.most / COLUMN <= b.least and b.most <= step * first.most:
                column.append(b)
        return tuple(column)
    return ()


def _headed(p: Profile, hint: NameHint) -> Fastener | None:
    """A screw with its tip at the greatest height."""
    column = _column(p)
    shank = max((b.most for b in column), default=np.inf)
    if not HEAD[0] <= p.radius / shank <= HEAD[1]:
        return None
    under = _underside(p, shank)
    if p.high - under < 0.3 * shank:
        return None
    if not _all_round(p, under) or _open_at_tip(p):
        return None
    head = _head(p, shank, under)
    if head is None:
        return None
    form, across, height, flange, origin = head
    core = max(b.most for b in [b for b in column if p.has_pitch(b)] or column)
    named = _named_diameter(hint, 2.0 * shank)
    hexagon = form.startswith("hexagon")
    inside = drive(p, p.high - 0.1 * shank, p.radius)
    outside = "hexagon" if hexagon and not inside.startswith("hexagon") else inside
    widths = (across, 2.0 * p.radius) if "sunk" in form else (across,)  # of the sharp rim, and as drawn
    sizes = filter(None, (best_size(FORMS[form], 2.0 * core, width, height, flange, named) for width in widths))
    best = min(sizes, key=lambda found: found[1], default=None)
    if best is not None and hexagon:
        stepped = max(b.most for b in column) - min(b.most for b in column) > 0.02 * shank
        best = (_hexagon_screw(best[0], stepped), best[1])
    if not (hint.kind in SCREWS or named or p.pitches):
        if best is None:
            if hexagon or not inside or not nominal_diameter(2.0 * core)[1]:
                return None
        elif not outside and (best[1] > SURE or drawn_thread_error(2.0 * core, best[0].diameter, best[0].pitch) > 0.0):
            return None
    kind = FastenerKind.SELF_TAPPING if hint.kind == FastenerKind.SELF_TAPPING else FastenerKind.SCREW
    size = f"{number(across)} mm" if hexagon else f"Ø{number(across)} mm"
    words = f"{form.replace('dome', 'round')} head {size}"
    return _threaded(p, kind, (origin, p.high - origin), 2.0 * core, best, named, hint, outside, words)


def _underside(p: Profile, shank: float) -> float:
    """Height (m) of a head's underside: of the plane that it bears on, or of its first point well beside the shank."""
    height = float(p.heights[p.radii > UNDER * shank].max())
    for f in p.features:
        g, s = f.geometry, p.span(f)
        if (
            isinstance(g, Plane)
            and float(g.normal @ p.about.axis) > 0.999
            and s.most > max(BEARING * shank, RIM * p.radius)
        ):
            height = max(height, s.low)
    return height


def _head(p: Profile, shank: float, under: float) -> tuple[str, float, float, float, float] | None:
    """Form of a head, its diameter or width across flats, height and flange diameter, and where the length begins, m.

    under: m: height of the head's underside.
    """
    rim = p.radius
    below = [f for f in p.features if p.span(f).high <= under + 0.02 * shank]
    if flats := _key_flats(p, below, 6, 0.6 * shank):
        across = 2.0 * p.apothem(flats)
        plain = rim <= 0.61 * across
        return ("hexagon", across, under - p.low, 0.0, under) if plain else (
            "hexagon flange", across, under - p.low, 2.0 * rim, under
        )  # fmt: skip
    sink = None
    for b in p.bands:
        g = b.feature.geometry
        widens = isinstance(g, Cone) and float(g.axis @ p.about.axis) < 0.0 and abs(g.half_angle - np.pi / 4.0) <= LEAN
        deep = b.length >= 0.3 * (under - p.low) and b.most - b.least > 0.2 * shank and b.high >= under - 0.05 * shank
        if b.convex and b.whole and widens and b.most > UNDER * shank and (deep or b.high >= under + 0.2 * shank):
            sink = b if sink is None or b.most > sink.most else sink
    if sink is not None and isinstance(sink.feature.geometry, Cone):
        half = sink.feature.geometry.half_angle
        flat = any(
            isinstance(f.geometry, Plane) and p.span(f).high <= p.low + 1e-6 and p.span(f).most >= 0.85 * sink.most
            for f in p.features
        )
        if flat:  # the standard's diameter is that of the sharp rim, which is often rounded
            return "countersunk", 2.0 * (sink.most + (sink.low - p.low) * float(np.tan(half))), 0.0, 0.0, p.low
        top = float(p.heights[p.radii >= 0.995 * rim].min())
        return "raised countersunk", 2.0 * (sink.most + max(sink.low - top, 0.0) * float(np.tan(half))), 0.0, 0.0, top
    if not HEAD_HEIGHT[0] <= (under - p.low) / shank <= HEAD_HEIGHT[1]:
        return None
    side = max((b.length for b in p.shafts if b.most >= 0.97 * rim), default=0.0)
    return "cylinder" if side >= 0.5 * (under - p.low) else "dome", 2.0 * rim, under - p.low, 0.0, under


def _hexagon_screw(row: StandardSize, stepped: bool) -> StandardSize:
    """Return the size of a hexagon screw by the ISO standard of its shank: 4014 with a plain part, 4017 without."""
    rows = matching("hexagon", diameter=(row.diameter, 1e-6), a=(row.a, 0.01))
    standard = "ISO 4014" if stepped else "ISO 4017"
    return replace(row, standard=standard) if any(r.standard == standard for r in rows) else row


def _all_round(p: Profile, under: float) -> bool:
    """Whether the outermost vertices below a height are all round the axis."""
    u = perpendicular(p.about.axis)
    v = np.cross(p.about.axis, u)
    away = p.points[(p.heights <= under + 1e-3 * p.radius) & (p.radii >= 0.93 * p.radius)] - p.about.origin
    angles = np.sort(np.arctan2(away @ v, away @ u))
    return len(angles) > 4 and max(float(np.diff(angles).max()), 2.0 * np.pi - float(np.ptp(angles))) <= ROUNDNESS


def _open_at_tip(p: Profile) -> bool:
    """Whether a bore opens at the tip of a shank, as in a sleeve."""
    for f in p.features:
        g, s = f.geometry, p.span(f)
        facing = isinstance(g, Plane) and float(g.normal @ p.about.axis) > 0.999
        if facing and s.low >= p.high - 1e-3 * p.radius and covers_axis(f, p.about):
            return False  # what is hollow is the inside of a thread that is a solid of its own, around a core
    inside = (b for b in p.bands if not b.convex and b.whole and b.length > 0.3 * b.most)
    return any(b.high >= p.high - 0.02 * p.radius for b in inside)


def _shoulder(of: Profile, hint: NameHint) -> Fastener | None:
    """A shoulder screw: a thread, a wider shoulder and a head, as ISO 7379 has them."""
    for p in (of, of.flipped()):
        thread = max(p.shafts, key=lambda b: b.high, default=None)
        for row in matching("shoulder", a=(2.0 * p.radius, 0.03)) if thread is not None else ():
            beyond = p.heights[p.radii > 1.05 * 0.5 * row.c]
            fits = any(abs(2.0 * b.most / row.c - 1.0) <= 0.01 and b.length > 0.5 * row.c for b in p.shafts)
            if fits and thread is not None and drawn_thread_error(2.0 * thread.most, row.diameter, row.pitch) < 1.0:
                under = float(beyond.max())
                words = f"head Ø{number(row.a)} mm, shoulder Ø{number(row.c)} mm"
                inside, extent = drive(p, p.high - 0.5 * p.height, p.radius), (under, p.high - under)
                size = (row, 0.0)
                return _threaded(p, FastenerKind.SCREW, extent, 2.0 * thread.most, size, 0.0, hint, inside, words)
    return None


def _named_diameter(hint: NameHint, drawn: float) -> float:
    """The nominal diameter (m) of the thread that a name states, 0 if none or if it is not that drawn (m)."""
    least, most = NAMED_TAPPING if hint.kind == FastenerKind.SELF_TAPPING else NAMED
    return hint.diameter if hint.diameter and least <= drawn / hint.diameter <= most else 0.0


def _threaded(
    p: Profile,
    kind: FastenerKind,
    extent: tuple[float, float],
    drawn: float,
    best: tuple[StandardSize, float] | None,
    named: float,
    hint: NameHint,
    drive: str,
    form: str,
) -> Fastener:
    """A part with a thread.

    extent: height at which its length begins, and length, m. drawn: diameter of the thread, m. best: size of a standard
    that it matches, with the error. named: nominal diameter stated by its name, m. form: its geometry in words.
    """
    row = best[0] if best is not None else None
    if row is not None:
        diameter, pitch, thread = row.diameter, row.pitch, row.name
    else:
        diameter, pitch = (named, coarse_pitch(named)) if named else nominal_diameter(drawn, kind in NUTS)
        thread = f"M{number(diameter)}" if named or pitch else ""
    if p.pitches:
        pitch = abs(max(p.pitches.items(), key=lambda item: p.features[item[0]].area)[1])
    matches = best is not None and best[1] <= STATED and kind != FastenerKind.SELF_TAPPING
    standard = hint.standard or (row.standard if row is not None and matches else "")
    says = hint.kind == kind or bool(named)
    evidence = [
        form,
        f"thread of pitch {number(pitch)} mm" if p.pitches else "",
        drive,
        f"dimensions of {standard}" if standard and not hint.standard else "",
        f'name "{hint.text}"' if says else "",
    ]
    signs = (bool(drive), row is not None, says, bool(p.pitches))
    return Fastener(
        kind, p.about.origin + extent[0] * p.about.axis, p.about.axis, diameter, extent[1], p.radius, thread, pitch,
        standard, drive, ", ".join(filter(None, evidence)), min(1.0, 0.5 + 0.2 * sum(signs)),
    )  # fmt: skip


def _plain(
    p: Profile,
    kind: str,
    diameter: float,
    hint: NameHint,
    form: str,
    row: StandardSize | None = None,
    confidence: float = 0.8,
) -> Fastener:
    """A part without a thread of its own; row: size of a standard that it matches."""
    evidence = [
        form,
        f"dimensions of {row.standard}" if row else "",
        f'name "{hint.text}"' if hint.kind == kind else "",
    ]
    return Fastener(
        FastenerKind(kind), p.about.origin + p.low * p.about.axis, p.about.axis, diameter, p.height, p.radius,
        standard=hint.standard or (row.standard if row else ""), evidence=", ".join(filter(None, evidence)),
        confidence=min(1.0, confidence + 0.1 * (row is not None) + 0.1 * (hint.kind == kind)),
    )  # fmt: skip


def _headless(of: Profile, hint: NameHint) -> Fastener | None:
    """A set screw, threaded rod, dowel or disc magnet: one shank from end to end."""
    for p in (of, of.flipped()):
        column = _column(p)
        shank = max((b.most for b in column), default=0.0)
        if p.radius > 1.03 * shank or sum(b.length for b in column) < 0.4 * p.height or p.hollow:
            continue
        threads = [b for b in column if p.has_pitch(b)]
        drawn = 2.0 * max(b.most for b in threads or column)
        named, extent = _named_diameter(hint, 2.0 * shank), (p.low, p.height)
        form = f"one shank Ø{number(2.0 * shank)} mm from end to end"
        inside = drive(p, p.high - 0.2 * p.height, shank)
        if inside and hint.kind not in ("dowel", "bearing", "bushing", "magnet"):
            socket = float(inside.split()[-2]) * MM if inside.startswith("hexagon") else 0.0
            best = best_size(("set screw",), drawn, socket, 0.0, 0.0, named) if socket else None
            if best is not None or hint.kind in SCREWS or named or threads:
                rod = hint.kind == FastenerKind.THREADED_ROD
                kind = FastenerKind.THREADED_ROD if rod else FastenerKind.SET_SCREW
                return _threaded(p, kind, extent, drawn, best, named, hint, inside, form)
        if sum(b.length for b in threads) > 0.5 * p.height or hint.kind in ("threaded rod", "set screw"):
            kind = FastenerKind(hint.kind) if hint.kind in SCREWS else FastenerKind.THREADED_ROD
            return _threaded(p, kind, extent, drawn, None, named, hint, "", form)
        if hint.kind in ("dowel", "rivet", "magnet"):
            return _plain(p, hint.kind, 2.0 * shank, hint, form)
    return None


def _key_flats(p: Profile, features: Sequence[Feature], corners: int, least: float) -> tuple[Feature, ...]:
    """The flats for a wrench, at least as far from the axis as given (m); empty if there are none.

    Each meets its neighbours at the corners, unlike the flanks of teeth.
    """
    flats = prism(features, p.about, 1, corners, (least, p.radius))
    corner = p.apothem(flats) / np.cos(np.pi / corners) if flats else 0.0
    return flats if all(abs(p.span(f).most / corner - 1.0) <= CORNER for f in flats) else ()


def _nut(p: Profile, hint: NameHint) -> Fastener | None:
    """A hexagon or square with a threaded hole."""
    bore = p.bore
    if bore is None:
        return None
    flats = _key_flats(p, p.features, 6, 1.1 * bore.least) or _key_flats(p, p.features, 4, 1.1 * bore.least)
    if not flats:
        return None
    apothem, square = p.apothem(flats), len(flats) == 4
    wider = p.radius > 1.02 * apothem / np.cos(np.pi / len(flats))
    height = max(p.span(f).high for f in flats) - min(p.span(f).low for f in flats)
    if (square and wider) or height < (0.6 if p.hollow and not wider else 0.35) * p.height:
        return None
    threads = [b for b in p.bands if p.has_pitch(b) and not b.convex]
    drawn = 2.0 * min(b.least for b in threads or [bore])
    forms = {"hexagon nut"} if not square else {"square nut"}
    if not square and (wider or not p.hollow):
        forms = {"flange nut"} if p.hollow else {"cap nut"}
    named = _named_diameter(hint, drawn)
    best = best_size(forms, drawn, 2.0 * apothem, p.height if p.hollow else height, 0.0, named)
    if best is None:
        if not (hint.kind == FastenerKind.NUT or threads or named):
            return None
        best = best_size({"hexagon nut", "square nut"}, drawn, 2.0 * apothem, 0.0, 0.0, named)
        best = None if best is None else (best[0], 1.0)
    form = f"{'square' if square else 'hexagon'} {number(2.0 * apothem)} mm with a bore Ø{number(drawn)} mm"
    key = "square" if square else "hexagon"
    return _threaded(p, FastenerKind.NUT, (p.low, p.height), drawn, best, named, hint, key, form)


def _ring(p: Profile, hint: NameHint) -> Fastener | None:
    """Round outside and inside: washer, bushing, bearing, insert, standoff, ring magnet."""
    outside = [b for b in p.bands if b.convex and b.whole and b.most >= 0.98 * p.radius]
    if not outside or not p.hollow:
        return None
    d, outer, height = 2.0 * (p.bore.least if p.bore is not None else p.inner), 2.0 * p.radius, p.height
    form = f"ring Ø{number(outer)} mm with a bore Ø{number(d)} mm, {number(height)} mm long"
    threads = [b for b in p.bands if p.has_pitch(b) and not b.convex]
    if hint.kind in NUTS or (not hint.kind and (threads or _knurled(p))):
        drawn = 2.0 * min(b.least for b in threads) if threads else d
        kind = FastenerKind(hint.kind or FastenerKind.INSERT)
        named = _named_diameter(hint, drawn)
        best = best_size({"insert"}, drawn, outer, height, 0.0, named) if kind == FastenerKind.INSERT else None
        if hint.kind or best is not None:
            return _threaded(p, kind, (p.low, height), drawn, best, named, hint, "", form)
    if hint.kind in ("washer", ""):
        thick = max(b.length for b in outside)
        rows = matching("washer", a=(d, 0.02), b=(outer, 0.02), c=(height, 0.06))
        rows = rows or matching("tooth washer", a=(2.0 * p.inner, 0.02), b=(outer, 0.02), c=(thick, 0.06))
        rows = [r for r in rows if abs(r.diameter - hint.diameter) < 1e-6] or rows
        if rows:
            return replace(_plain(p, "washer", rows[0].diameter, hint, form, rows[0]), thread=rows[0].name)
    if hint.kind == "bearing" or (not hint.kind and _grooved(p)):
        rows = matching("bearing", diameter=(d, 0.01), a=(outer, 0.01), b=(_between_flats(p), 0.03))
        if rows:
            made = _plain(p, "bearing", d, hint, form, rows[0])
            return replace(made, evidence=f"{made.evidence} ({rows[0].name})")
    if hint.kind in ("washer", "bushing", "bearing", "magnet", "rivet", "circlip", "dowel"):
        made = _plain(p, hint.kind, d, hint, form)
        stated = hint.diameter if hint.kind == "washer" else 0.0
        return replace(made, thread=f"M{number(stated)}", diameter=stated) if stated else made
    return None


def _between_flats(p: Profile) -> float:
    """Greatest distance (m) of faces square to the axis: the width of a bearing, whose cage may stand out."""
    g = [f.geometry for f in p.features if isinstance(f.geometry, Plane)]
    heights = [
        float((x.origin - p.about.origin) @ p.about.axis) for x in g if abs(float(x.normal @ p.about.axis)) > 0.999
    ]
    return max(heights) - min(heights) if len(heights) > 1 else p.height


def _knurled(p: Profile) -> bool:
    """Whether many small faces are around the outside of a ring."""
    own = {id(b.feature) for b in p.bands}
    beside = [p.span(f) for f in p.features if id(f) not in own]
    return sum(s.most >= 0.97 * p.radius and s.least > 0.6 * p.radius and s.high - s.low > 0.0 for s in beside) >= 12


def _grooved(p: Profile) -> bool:
    """Whether a ring has round faces between its bore and its outside, as races and shields have."""
    between = [b for b in p.bands if b.whole and b.least > 1.05 * p.inner and b.most < 0.97 * p.radius]
    return sum(b.length >= 0.3 * p.height or not isinstance(b.feature.geometry, Cone) for b in between) >= 2


def _hollow(p: Profile, hint: NameHint) -> Fastener | None:
    """A part with a threaded hole that its name calls a nut or insert: T-slot nuts, barrel nuts."""
    bore = p.bore
    if hint.kind not in NUTS or bore is None:
        return None
    p = p if p.hollow or bore.high >= p.high - 0.1 * p.radius else p.flipped()
    drawn = 2.0 * bore.least
    form = f"a bore Ø{number(drawn)} mm, {number(bore.length)} mm deep"
    extent, kind = (p.low, p.height), FastenerKind(hint.kind)
    return _threaded(p, kind, extent, drawn, None, _named_diameter(hint, drawn), hint, "", form)


def _o_ring(p: Profile, hint: NameHint) -> Fastener | None:
    """A whole torus and nothing else, of a size of ISO 3601."""
    g = p.features[0].geometry
    if len(p.features) != 1 or not isinstance(g, Torus) or not p.bands or not p.bands[0].whole or not p.bands[0].convex:
        return None
    bore = 2.0 * (g.major - g.minor)
    rows = matching("seal", diameter=(bore, 0.01), a=(2.0 * g.minor, 0.02))
    if not rows:
        return None
    form = f"torus with a bore Ø{number(bore)} mm, {number(2.0 * g.minor)} mm thick"
    return _plain(p, "seal", bore, hint, form, rows[0])


def _sheet(features: Sequence[Feature]) -> tuple[Plane, float, list[Feature]] | None:
    """One face of a part of even thickness, the thickness (m) and the features square to it; None if it is not even."""
    planes = sorted((f for f in features if isinstance(f.geometry, Plane)), key=lambda f: -f.area)
    if len(planes) < 2:
        return None
    top, back = planes[0].geometry, planes[1].geometry
    assert isinstance(top, Plane) and isinstance(back, Plane)
    if float(top.normal @ back.normal) > -0.9999:
        return None
    sides = [f for f in features if f is not planes[0] and f is not planes[1]]
    for f in sides:
        g = f.geometry
        across = isinstance(g, Plane) and abs(float(g.normal @ top.normal)) < 1e-3
        if not across and not (isinstance(g, Cylinder) and abs(float(g.axis @ top.normal)) > 0.9999):
            return None
    return top, abs(float((back.origin - top.origin) @ top.normal)), sides


def _key(mesh: SurfaceMesh, features: Sequence[Feature], hint: NameHint) -> Fastener | None:
    """A parallel key: a block with two round ends, or one that its name calls a key."""
    flat = _sheet(features) if len(features) <= 6 else None
    if flat is None or hint.kind not in ("", "key"):
        return None
    top, height, sides = flat
    ends = [f.geometry for f in sides if isinstance(f.geometry, Cylinder) and f.sense > 0]
    walls = [f.geometry for f in sides if isinstance(f.geometry, Plane)]
    if len(ends) == 2 and len(walls) == 2:
        width = 2.0 * ends[0].radius
        gap = ends[1].origin - ends[0].origin
        gap = gap - (gap @ top.normal) * top.normal
        length = float(np.linalg.norm(gap)) + width
        if abs(ends[1].radius - ends[0].radius) > 1e-6 or length <= width:
            return None
        along = gap / (length - width)
    elif len(walls) == 4 and hint.kind:
        spans = {float(np.ptp(mesh.vertices @ w.normal)): w.normal for w in walls}
        width, length = min(spans), max(spans)
        along = spans[length]
    else:
        return None
    rows = matching("key", diameter=(width, 0.01), a=(height, 0.01)) or matching(
        "key", diameter=(height, 0.01), a=(width, 0.01)
    )
    if not rows and not hint.kind:
        return None
    form = f"key {number(width)} mm wide, {number(height)} mm high"
    origin = _start(mesh, along)[0]
    return _flat_part(mesh, FastenerKind.KEY, origin, along, width, length, hint, form, rows[0] if rows else None)


def _circlip(mesh: SurfaceMesh, features: Sequence[Feature], hint: NameHint) -> Fastener | None:
    """A retaining ring of even thickness with a gap and, in its ends, two holes."""
    flat = _sheet(features) if hint.kind in ("", "circlip") and len(features) <= 40 else None
    if flat is None:
        return None
    top, thickness, sides = flat
    arcs = [f for f in sides if isinstance(f.geometry, Cylinder)]
    rows: list[tuple[StandardSize, Cylinder]] = []
    for sense, standard in ((-1, "DIN 471"), (1, "DIN 472")):
        largest = max((f for f in arcs if f.sense == sense), key=lambda f: f.area, default=None)
        if largest is not None and isinstance(largest.geometry, Cylinder):
            g = largest.geometry
            found = matching("circlip", a=(thickness, 0.02), b=(2.0 * g.radius, 0.01))
            rows += [(row, g) for row in found if row.standard == standard]
    holes = [f.geometry.radius for f in arcs if f.sense < 0 and isinstance(f.geometry, Cylinder)]
    if not rows or (not hint.kind and not any(abs(x - y) < 1e-6 for k, x in enumerate(holes) for y in holes[k + 1 :])):
        return None
    row, g = rows[0]
    form = f"ring with a gap, {number(thickness)} mm thick"
    origin = g.origin + (float((top.origin - g.origin) @ top.normal) - thickness) * top.normal
    return _flat_part(mesh, FastenerKind.CIRCLIP, origin, top.normal, row.diameter, thickness, hint, form, row)


def _flat_part(
    mesh: SurfaceMesh,
    kind: FastenerKind,
    origin: np.ndarray,
    axis: np.ndarray,
    diameter: float,
    length: float,
    hint: NameHint,
    form: str,
    row: StandardSize | None,
) -> Fastener:
    """A part that is not round about its axis."""
    outside = float(heights_radii(mesh.vertices, Cylinder(origin, axis, 1.0))[1].max())
    evidence = [
        form,
        f"dimensions of {row.standard}" if row else "",
        f'name "{hint.text}"' if hint.kind == kind else "",
    ]
    return Fastener(
        kind, origin, axis, diameter, length, outside, standard=hint.standard or (row.standard if row else ""),
        evidence=", ".join(filter(None, evidence)), confidence=0.7 + 0.1 * bool(row) + 0.1 * (hint.kind == kind),
    )  # fmt: skip


def _magnet(mesh: SurfaceMesh, features: Sequence[Feature], hint: NameHint) -> Fastener | None:
    """A block that its name calls a magnet."""
    if hint.kind != FastenerKind.MAGNET:
        return None
    axis = _thinnest(mesh, features)
    origin, thickness = _start(mesh, axis)
    return _flat_part(mesh, FastenerKind.MAGNET, origin, axis, 0.0, thickness, hint, "block", None)


def _soft(mesh: SurfaceMesh, features: Sequence[Feature], hint: NameHint) -> Fastener:
    """A belt, spring, seal or tie, by its name."""
    about = main_axis(features)
    axis = _thinnest(mesh, features) if about is None else about.axis
    origin, length = _start(mesh, axis)
    if about is not None:
        origin = about.origin + float((origin - about.origin) @ axis) * axis
    radii = heights_radii(mesh.vertices, Cylinder(origin, axis, 1.0))[1]
    bore = 2.0 * float(radii.min()) if hint.kind in (FastenerKind.SEAL, FastenerKind.SPRING) else 0.0
    return Fastener(
        FastenerKind(hint.kind), origin, axis, bore, length, float(radii.max()), standard=hint.standard,
        evidence=f'name "{hint.text}"', confidence=0.8,
    )  # fmt: skip


def _thinnest(mesh: SurfaceMesh, features: Sequence[Feature]) -> np.ndarray:
    """The normal of a plane of the part (of its box without planes) along which it is thinnest."""
    normals = [f.geometry.normal for f in features if isinstance(f.geometry, Plane)] or list(np.eye(3))
    return min(normals, key=lambda n: float(np.ptp(mesh.vertices @ n)))


def _start(mesh: SurfaceMesh, axis: np.ndarray) -> tuple[np.ndarray, float]:
    """The point (3,) where a part begins on the middle line of its box along an axis, and its length along it, m."""
    u = perpendicular(axis)
    frame = np.array([u, np.cross(axis, u), axis])
    local = mesh.vertices @ frame.T
    low, high = local.min(axis=0), local.max(axis=0)
    return np.array([*(0.5 * (low + high))[:2], low[2]]) @ frame, float(high[2] - low[2])
