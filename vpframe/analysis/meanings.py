"""What it means that two parts share volume as they are drawn: a thread, a press fit, something soft, or a clash.

`MEANINGS` is the table. Each row says what kind of part tells such an overlap, how deep it may be, by which source. Its
limits are geometric: a bore on the part's axis, no narrower than the core of the thread (or than what is pressed in),
and no material nearer to the axis than that (`constraints.recognition.engagement`). What lies outside of them is a
clash, whatever the parts are called. Rules of a person come first (`vpframe.scene.overlap_rules`): they may choose the
kind and the depth, and never the axis.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Final, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from constraints.geometry.metric_threads import PITCHES
from constraints.geometry.surfaces import Cylinder
from constraints.geometry.words import millimetres
from constraints.recognition.engagement import (
    TILT,
    Engagement,
    Line,
    PlacedBody,
    Shank,
    coaxial_cylinders,
    engagement,
    own_surfaces,
)
from constraints.recognition.fasteners import SCREWS, SOFT, Fastener, FastenerKind
from constraints.recognition.iso286 import greatest_interference
from vpframe.analysis.fasteners import fasteners_of
from vpframe.analysis.static import StaticAnalysis
from vpframe.scene.overlap_rules import CLASH, OverlapRule, rule_for, rule_of
from vpframe.scene.scene import Scene

Array = NDArray[np.float64]
Kind = str
"""one of `vpframe.scene.overlap_rules.MEANT`"""
MINOR: Final = 0.61343
"""pitches by which the root of an external thread lies below its crest (d3 of ISO 724: d - 1.22687·P)"""
CORE: Final = 0.70
"""1: core of a tapping screw over its outside, at least (ISO 1478: 0.72 to 0.75)"""
OVERSIZE: Final = 1.15
"""1: most that a screw may be drawn thicker than its size (M2 for plastic is drawn Ø2.2)"""
THINNEST: Final = 0.4
"""1: of the size of a screw: least radius of its shank"""
INSERTED: Final = 0.15
"""1: most by which the hole of an insert is narrower than the insert: plastic flows around its knurls"""
PRESSED: Final = 0.01
"""1: of its diameter: radial interference of a magnet or bearing that is drawn pressed in; others have their ISO fit"""
MOST_PRESSED: Final = 5e-5
"""m, radial: the most of these"""
SQUEEZED: Final = 0.35
"""1: of its section: most that a seal is squeezed (ISO 3601-2 has 11 to 32 %)"""
SOFTENED: Final = 0.3
"""1: of its least extent: most that a belt, spring or tie is drawn into its neighbour"""
LEAD: Final = 0.36
"""1: pitch of a tapping screw over its diameter (ISO 1478), where none is known"""
OFF_AXIS: Final = 0.02
"""1: of its diameter: most that an axis is off, unless the bore lies inside the screw all round, which is more"""
OFF_TAPPED: Final = 0.5
"""1: of the radius of its hole: most that a tapping screw is drawn off its axis; it cuts its thread where it stands"""
BY_HAND: Final = 0.5
"""1: of its radius: the most that a rule without a depth lets a part be deep"""
GLUED: Final = ("glue", "glued", "weld", "welded", "adhesive", "tape", "sticker", "label", "vhb")
"""words of the names of parts that are glued on, or of what glues"""


@dataclass(frozen=True)
class Row:
    """A row of the table: parts of these kinds tell this kind of overlap."""

    kind: Kind
    of: frozenset[FastenerKind]
    depth: Callable[[Fastener, float], float]
    """m, radial: the most, of a part and the radius (m) by which it is too large"""
    source: str
    aside: Callable[[float, float], float] = lambda shaft, bore: OFF_AXIS * 2.0 * shaft
    """m: the most that the axes are apart, of the radii of shaft and bore"""


def _around(shaft: float, bore: float) -> float:
    return max(OFF_AXIS * 2.0 * shaft, shaft - bore)


def _depth_by_hand(rule: OverlapRule, part: Fastener | None, radius: float) -> float:
    return rule.depth or BY_HAND * radius


def _by_hand(shaft: float, bore: float) -> float:
    return OFF_TAPPED * bore


def _thread(part: Fastener, radius: float) -> float:
    return MINOR * pitch_of(part, radius) + max(0.0, radius - 0.5 * part.diameter)


def _press(part: Fastener, radius: float) -> float:
    return max(min(PRESSED * 2.0 * radius, MOST_PRESSED), 0.5 * greatest_interference("s7", 2.0 * radius))


MEANINGS: Final = (
    Row(
        "thread",
        frozenset({FastenerKind.SELF_TAPPING}),
        lambda part, radius: (1.0 - CORE) * radius,
        "ISO 1478",
        lambda shaft, bore: OFF_TAPPED * bore,
    ),
    Row("thread", SCREWS - {FastenerKind.SELF_TAPPING}, _thread, "ISO 724", _around),
    Row("press fit", frozenset({FastenerKind.INSERT}), lambda part, radius: INSERTED * radius, "of its diameter"),
    Row(
        "press fit",
        frozenset({FastenerKind.MAGNET, FastenerKind.BEARING}),
        _press,
        "ISO 286 s7, or 1 % of the diameter up to 50 µm all round",
    ),
    Row("soft", frozenset({FastenerKind.SEAL}), lambda part, radius: SQUEEZED * section_of(part), "ISO 3601-2"),
)  # fmt: skip
"""what tells which overlap; the first row that holds counts"""


@dataclass(frozen=True, eq=False)
class Meaning:
    """What the overlap of two parts means."""

    kind: Kind
    parts: tuple[int, int]
    """in the order of the scene"""
    what: str
    """"M2x10 self-tapping screw": equal for instances of one pattern"""
    words: str
    """with measures and evidence"""
    limit: float
    """m: the most that the overlap may be deep, radial"""
    source: str
    """of the limit"""
    part: int = -1
    """the fastener, or the part that a rule takes for one"""
    solid: int = -1
    """the part that is too large; -1 where the two have no axis"""
    fit: Engagement | None = None
    pitch: float | None = None
    """m a turn, of a thread"""
    rule: str = ""
    """where a person stated it"""
    driven: bool = False
    """whether the axis points the way in which `part` is driven in"""
    drive: str = ""
    """of a screw: "Torx T6", …; empty if none is known"""

    @property
    def effort(self) -> str:
        """What a workshop wants to know of it, and that no force is computed."""
        if self.kind == "thread":
            tool = f" by {self.drive}" if self.drive else ""
            return f"{self.what}{tool}, pitch {millimetres(self.pitch or 0.0)}, torque not computed"
        return f"{self.what}, {self.kind}, force not computed"

    def engaged(self, moved: pin.SE3) -> bool:
        """Whether the two share some length, where the first of them is displaced against the second by `moved`."""
        if self.fit is None:
            return False
        origin, axis = self.fit.line
        shift = moved.act(origin) - origin
        along = float(shift @ axis) * (1.0 if self.solid == self.parts[0] else -1.0)
        span, mated = self.fit.span, self.fit.mated
        aside = float(np.linalg.norm(shift - (shift @ axis) * axis))
        return aside < self.fit.radius and span[0] + along < mated[1] and span[1] + along > mated[0]

    def claims(self, key: tuple[int, ...], depth: float, point: Array | None, slack: float) -> bool:
        """Whether a clash of these parts, of surfaces or as a whole, is this overlap.

        Of the surfaces of the head those clashes are that are deepest in the rim that the two share: where the bore
        begins.

        depth, point: of the clash, m, and (3,), m, world. slack: m: how exactly they are known.
        """
        if self.fit is None:
            return self.kind == "glue" or depth <= self.limit + slack
        if len(key) == 4 and key[2 if self.solid == key[0] else 3] in self.fit.surfaces:
            return True
        if depth > self.fit.depth + slack:
            return False
        return len(key) == 2 or (point is not None and self.fit.holds(point, slack))

    def on(self, line: Line) -> bool:
        """Whether a world line is the axis of this overlap, or that of one of its bores."""
        if self.fit is None:
            return False
        origin, axis = self.fit.line
        tilt = float(np.linalg.norm(np.cross(axis, line[1])))
        off = float(np.linalg.norm(np.cross(line[0] - origin, axis)))
        return tilt <= TILT and off <= self.fit.offset + OFF_AXIS * 2.0 * self.fit.radius

    def document(self) -> dict[str, Any]:
        """Return it for JSON."""
        sizes: dict[str, Any] = {}
        if self.fit is not None:
            sizes = {"shaft": 2.0 * self.fit.radius, "bore": [2.0 * r for r in self.fit.bores]}
            sizes |= {"length": self.fit.length, "offset": self.fit.offset}
        more = {} if self.pitch is None else {"pitch": self.pitch}
        stated = {"rule": self.rule} if self.rule else {}
        return {
            "kind": self.kind,
            "what": self.what,
            "limit": self.limit,
            "source": self.source,
            **sizes,
            **more,
            **stated,
        }


def pitch_of(part: Fastener, radius: float) -> float:
    """m a turn of a thread: as recognised, else the coarse one of its size, else that of a tapping screw."""
    if part.pitch > 0.0:
        return part.pitch
    size = round(1e3 * (part.diameter or 2.0 * radius), 3)
    return 1e-3 * PITCHES[size][0] if size in PITCHES else LEAD * 2.0 * radius


def _is_sure(part: Fastener) -> bool:
    """Whether a part is what it is taken for by more than its shape: a ring of steel has the shape of an O-ring."""
    return part.kind not in SOFT or bool(part.standard) or 'name "' in part.evidence


def section_of(part: Fastener) -> float:
    """m: radial thickness of a seal between its inside and its outside."""
    return max(0.0, part.outside - 0.5 * part.diameter)


class _Side(NamedTuple):
    """A cylinder of a part that may be too large for a bore of another."""

    solid: int
    hollow: int
    shank: Shank


class Meanings:
    """The meanings of the overlaps of a scene as it stands, each computed at its first use.

    analysis: of the scene, whose tolerance counts.
    """

    def __init__(self, scene: Scene, analysis: StaticAnalysis) -> None:
        self.scene, self.analysis = scene, analysis
        self.rules = scene.rules
        self._known: dict[tuple[int, int], Meaning | None] = {}
        self._bodies: dict[int, PlacedBody] = {}

    @cached_property
    def fasteners(self) -> dict[int, Fastener]:
        """The parts that are fasteners."""
        return fasteners_of(self.scene)

    def of(self, a: int, b: int) -> Meaning | None:
        """What the overlap of two parts means; None for a clash, if they overlap at all."""
        pair = min(a, b), max(a, b)
        if pair not in self._known:
            self._known[pair] = self._of(pair)
        return self._known[pair]

    def solid(self, a: int, b: int, kind: str) -> bool:
        """Whether a person says that an overlap of two parts that was recognised as this kind is a clash."""
        stated = rule_of(self.rules, self.scene.names[a], self.scene.names[b])
        if stated is not None:
            return stated.means == CLASH
        return rule_for(self.rules, kind) is not None

    def between(self, pairs: Iterable[tuple[int, int]]) -> tuple[Meaning, ...]:
        """Return the meanings that have an axis, of pairs of parts, in their order."""
        found = (self.of(a, b) for a, b in pairs)
        return tuple(meaning for meaning in found if meaning is not None and meaning.fit is not None)

    def _of(self, pair: tuple[int, int]) -> Meaning | None:
        a, b = (self.scene.names[i] for i in pair)
        stated = rule_of(self.rules, a, b)
        if stated is not None:
            return None if stated.means == CLASH else self._stated(pair, stated)
        found = self._recognised(pair)
        return None if found is not None and self.solid(*pair, found.kind) else found

    def _recognised(self, pair: tuple[int, int]) -> Meaning | None:
        for row in MEANINGS:
            for part, other in (pair, pair[::-1]):
                fastener = self.fasteners.get(part)
                if fastener is None or fastener.kind not in row.of or not _is_sure(fastener):
                    continue
                found = self._engaged(pair, part, other, fastener, row)
                if found is not None:
                    return found
        for part in pair:
            fastener = self.fasteners.get(part)
            if fastener is not None and fastener.kind in SOFT and _is_sure(fastener):
                thin = float(np.ptp(self.scene.parts[part].mesh.vertices, axis=0).min())
                what = _what(fastener)
                return Meaning(
                    "soft", pair, what, f"{what} gives way", SOFTENED * thin, "30 % of its least extent", part
                )
        return None

    def _engaged(
        self, pair: tuple[int, int], part: int, other: int, fastener: Fastener, row: Row,
    ) -> Meaning | None:  # fmt: skip
        """A fastener in a bore of the other part, or around its shaft."""
        pose = pin.SE3(self.scene.parts[part].pose)
        line = np.asarray(pose.act(fastener.origin)), np.asarray(pose.rotation @ fastener.axis)
        what = _what(fastener)
        for side in self._sides(part, other, line, fastener, row.kind):
            limit = row.depth(fastener, side.shank.radius)
            fit = self._fit(side, line, limit, row.aside)
            if isinstance(fit, str):
                continue
            pitch = pitch_of(fastener, fit.radius) if row.kind == "thread" else None
            words = _words(row.kind, what, fit, limit, row.source, fastener.evidence)
            return Meaning(
                row.kind, pair, what, words, limit, row.source, part, side.solid, fit, pitch,
                driven=row.kind == "thread", drive=fastener.drive,
            )  # fmt: skip
        return None

    def _sides(self, part: int, other: int, line: Line, fastener: Fastener, kind: Kind) -> list[_Side]:
        """The cylinders that may be too large for the other part: of the fastener, then of what it is around."""
        slack = self.analysis.tolerance.linear
        own = coaxial_cylinders(self.body(part), line, 1, slack)
        if kind == "thread":
            most = 0.5 * OVERSIZE * fastener.diameter
            headed = fastener.kind in (FastenerKind.SCREW, FastenerKind.SELF_TAPPING)
            above = -(slack + 0.01 * fastener.length) if headed else -np.inf
            shanks = [r for r, low, *_ in own if THINNEST * fastener.diameter <= r <= most and low >= above]
            shanks = shanks or [float(box[2]) for box in own_surfaces(self.body(part), line, most, 0.0, above).values()]
            return [_Side(part, other, Shank(max(shanks), above))] if shanks else []
        around = coaxial_cylinders(self.body(other), line, 1, slack)
        found = [_Side(part, other, Shank(r, within=(low, high))) for r, low, high, _ in own]
        found += [
            _Side(other, part, Shank(r, within=(low, high))) for r, low, high, _ in around if r < fastener.outside
        ]
        return sorted(set(found), key=lambda side: (side.solid != part, -side.shank.radius, side.shank.within))

    def _stated(self, pair: tuple[int, int], rule: OverlapRule) -> Meaning | None:
        """What a person says of a pair, where its geometry bears it out."""
        what = f"by rule ({rule.source})"
        if rule.means in ("soft", "glue"):
            limit = rule.depth or np.inf
            return Meaning(rule.means, pair, rule.means, what, limit, rule.source, rule=rule.source)
        known = self._recognised(pair)
        if known is not None and known.kind == rule.means and not rule.depth and not rule.pitch:
            return known
        for part, other in (pair, pair[::-1]) if rule.means == "thread" else ():
            fastener = self.fasteners.get(part)
            if fastener is not None and fastener.kind in SCREWS:
                depth = partial(_depth_by_hand, rule)
                row = Row("thread", SCREWS, depth, f"{what}; {rule.source}", _by_hand)
                found = self._engaged(pair, part, other, fastener, row)
                if found is not None:
                    return replace(found, pitch=rule.pitch or found.pitch, rule=rule.source)
        for solid, hollow in (pair, pair[::-1]):
            for line, radius, within, name in self._shafts(solid):
                limit = _depth_by_hand(rule, None, radius)
                fit = self._fit(_Side(solid, hollow, Shank(radius, within=within)), line, limit, _by_hand)
                if isinstance(fit, str):
                    continue
                pitch = None
                if rule.means == "thread":
                    size = round(2e3 * radius, 3)
                    pitch = rule.pitch or (1e-3 * PITCHES[size][0] if size in PITCHES else LEAD * 2.0 * radius)
                words = _words(rule.means, name, fit, limit, rule.source, what)
                ends = solid, solid
                return Meaning(rule.means, pair, name, words, limit, rule.source, *ends, fit, pitch, rule.source)
        return None

    def _shafts(self, part: int) -> list[tuple[Line, float, tuple[float, float], str]]:
        """Axes, radii, heights and names of the convex cylinders of a part, the largest first."""
        body, fastener = self.body(part), self.fasteners.get(part)
        found = []
        for feature in body.features:
            g = feature.geometry
            if feature.sense > 0 and isinstance(g, Cylinder):
                line = np.asarray(body.pose.act(g.origin)), np.asarray(body.pose.rotation @ g.axis)
                heights = (feature.samples - g.origin) @ g.axis
                name = f"shaft Ø{2e3 * g.radius:.4g}" if fastener is None else _what(fastener)
                found.append((line, g.radius, (float(heights.min()), float(heights.max())), name))
        return sorted(found, key=lambda shaft: -shaft[1])

    def _fit(self, side: _Side, line: Line, depth: float, aside: Callable[[float, float], float]) -> Engagement | str:
        slack = self.analysis.tolerance.linear
        if depth <= slack:
            return "nothing may be shared"
        solid, hollow = self.body(side.solid), self.body(side.hollow)
        return engagement(solid, hollow, line, side.shank, depth, slack, aside)

    def body(self, i: int) -> PlacedBody:
        """A part where it stands."""
        if i not in self._bodies:
            part = self.scene.parts[i]
            pose = pin.SE3(part.pose)
            self._bodies[i] = PlacedBody(part.mesh, pose, self.analysis.features[i], self.analysis.deflections[i])
        return self._bodies[i]


_KNOWN: WeakKeyDictionary[StaticAnalysis, tuple[Any, Meanings]] = WeakKeyDictionary()
"""rules and meanings of each analysis that is alive"""


def meanings_of(scene: Scene, analysis: StaticAnalysis) -> Meanings:
    """Return the meanings of a scene; the same ones until its analysis or its rules change."""
    known = _KNOWN.get(analysis)
    if known is None or known[0] != scene.rules:
        known = _KNOWN[analysis] = scene.rules, Meanings(scene, analysis)
    return known[1]


def _words(kind: Kind, what: str, fit: Engagement, limit: float, source: str, evidence: str) -> str:
    narrow, wide = (2e3 * r for r in fit.bores)
    bore = f"Ø{narrow:.4g}" if wide - narrow < 1e-3 else f"Ø{narrow:.4g}..{wide:.4g}"
    words = f"{kind} {what}: Ø{2e3 * fit.radius:.4g} in {bore} mm over {millimetres(fit.length)}"
    if fit.offset > 1e-6:
        words += f", axes {millimetres(fit.offset)} apart"
    words += f", {millimetres(fit.radius - fit.bores[0])} larger of at most {millimetres(limit)} ({source})"
    return f"{words}; {evidence}" if evidence else words


def _what(fastener: Fastener) -> str:
    """Size and kind: "M2x10 self-tapping screw"."""
    return f"{fastener.size} {fastener.kind.value}"
