"""The fasteners of a scene: what each part is, what its screws clamp, and what they are screwed into."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from constraints.geometry.overlap import open_angle
from constraints.geometry.surfaces import Cylinder, perpendicular
from constraints.recognition.fastener_names import base_name, name_words
from constraints.recognition.fasteners import NUTS, SCREWS, Fastener, FastenerKind, fastener
from constraints.recognition.profile import heights_radii, main_axis
from vpframe.scene.boxes import middle
from vpframe.scene.scene import Part, Scene, Shape
from vpframe.text import plain

Array = NDArray[np.float64]

TILT = 0.02
"""rad: greatest angle between a screw and the bore it goes through"""
OFF_AXIS, OFF_PILOT = 0.15, 0.4
"""1: by which the axis of a bore misses that of a screw at most, over the screw's radius, beyond their clearance; of a
bore that the thread cuts into"""
TIGHT = (0.45, 1.01)
"""1: least and greatest radius of a bore that a thread holds in, over the screw's: a pilot hole and the nominal one"""
SHARED = 0.15
"""1: least length along a screw that counts, over its diameter"""
INSIDE = 0.6
"""1: distance from the axis at which the material of a part without a bore is looked for, over the screw's radius"""
SLOT = 10.0
"""1: greatest length of a slot, over the radius of its ends"""
HALF = 2.5
"""rad: least angle that a half cylinder leaves open"""
LINES = 4
"""lines around the axis on which it is looked for"""
COPY = re.compile(r"_\d{1,3}$")
"""number of a copy at the end of a name"""
RING = re.compile(r"\b(inner|outer) ?(?:ring|race)\b")
"""rings of a bearing that are parts of their own, in names in lower case"""
ROLLING = re.compile(r"\b(?:(?:inner|outer) ?(?:ring|race)|balls?|rollers?|cage|retainer|shield)\b")
"""parts of a bearing"""

_KNOWN: WeakKeyDictionary[Shape, dict[tuple[str, ...], Fastener | None]] = WeakKeyDictionary()
"""shape -> words of a name -> what it is"""
_BORES: WeakKeyDictionary[Shape, _Bores] = WeakKeyDictionary()


@dataclass(frozen=True)
class Fastening:
    """What a screw does in a scene; parts are given by index."""

    part: int
    fastener: Fastener
    clamps: tuple[int, ...]
    """parts that it goes through, from its head to its thread"""
    threads_into: tuple[int, ...]
    """parts that its thread holds in: a nut, an insert, a tapped hole or plastic; empty if none was found"""
    engagement: float
    """m: length of its thread in them"""


class _Bores(NamedTuple):
    """The concave cylinders of a shape."""

    points: Array
    """(n, 3) m, on their axes"""
    axes: Array
    """(n, 3)"""
    radii: Array
    """(n,) m"""
    spans: Array
    """(n, 2) m: heights from `points` that they cover"""
    places: Array
    """(n,) place among the features"""


class _Through(NamedTuple):
    """The part of a screw's length that goes through another part."""

    part: int
    low: float
    """m, from the screw's origin"""
    high: float
    tight: bool
    """whether the thread holds there"""
    nut: bool


def fasteners_of(scene: Scene) -> dict[int, Fastener]:
    """Return the parts that are fasteners, by index; computed once for each shape and name.

    Axes and origins are in the frames of the parts.
    """
    found: dict[int, Fastener] = {}
    for i, part in enumerate(scene.parts):
        known, words = _KNOWN.setdefault(part.shape, {}), name_words(part.name)
        if words not in known:
            known[words] = fastener(part.mesh, part.features, words)
        if (one := known[words]) is not None:
            found[i] = one
    return dict(sorted((found | _bearings(scene)).items()))


def _bearings(scene: Scene) -> dict[int, Fastener]:
    """The parts of bearings whose rings are parts of their own, each as a bearing, about the axis of its rings."""
    groups: dict[str, list[tuple[int, str]]] = {}
    for i, name in enumerate(scene.names):
        words = " ".join(name_words(name))
        if ROLLING.search(words):
            groups.setdefault(name.rpartition("/")[0], []).append((i, words))
    found: dict[int, Fastener] = {}
    for members in groups.values():
        rings = {
            side: [i for i, words in members if (m := RING.search(words)) and m[1] == side]
            for side in ("inner", "outer")
        }
        for inner in rings["inner"]:
            for outer in rings["outer"]:
                found |= _bearing(scene, inner, outer, [i for i, _ in members])
    return found


def _bearing(scene: Scene, inner: int, outer: int, members: Sequence[int]) -> dict[int, Fastener]:
    """The members of a bearing between two rings; empty if their axes differ."""
    parts = scene.parts
    axis = main_axis(parts[inner].features)
    if axis is None:
        return {}
    about = axis.transformed(parts[inner].pose)
    radii, heights = [], []
    for k in (inner, outer):
        h, r = heights_radii(parts[k].mesh.vertices @ parts[k].pose.rotation.T + parts[k].pose.translation, about)
        radii.append(r)
        heights.append(h)
    low, high = float(min(h.min() for h in heights)), float(max(h.max() for h in heights))
    around = float(radii[1].max())
    other = main_axis(parts[outer].features)
    if (
        other is None
        or radii[1].min() < radii[0].min()
        or abs(float(about.axis @ (parts[outer].pose.rotation @ other.axis))) < 0.999
    ):
        return {}
    found = {}
    for k in members:
        pose = parts[k].pose
        h, r = heights_radii((pose.act(middle(parts[k].mesh)))[None], about)
        if r[0] <= around and low <= h[0] <= high:
            back = pose.inverse()
            origin, direction = back.act(about.origin + low * about.axis), back.rotation @ about.axis
            found[k] = Fastener(
                FastenerKind.BEARING, origin, direction, 2.0 * float(radii[0].min()), high - low, around,
                evidence="rings of a bearing about one axis, by their names", confidence=0.8,
            )  # fmt: skip
    return found


def fastenings(scene: Scene, found: dict[int, Fastener] | None = None) -> tuple[Fastening, ...]:
    """Return what each screw of a scene clamps and is screwed into, at the present poses of its parts.

    found: `fasteners_of(scene)`, if known.
    """
    found = fasteners_of(scene) if found is None else found
    parts = scene.parts
    boxes = [part.mesh.bounds for part in parts]
    low = np.array([box[0] for box in boxes])
    high = np.array([box[1] for box in boxes])
    poses = [part.pose for part in parts]
    rotations, places = np.array([p.rotation for p in poses]), np.array([p.translation for p in poses])
    out = []
    for i, one in found.items():
        if one.kind not in SCREWS or one.diameter <= 0.0:
            continue
        pose, radius = poses[i], 0.5 * one.diameter
        ends = pose.act(one.origin), pose.act(one.origin + one.length * one.axis)
        a, b = (np.einsum("nji,nj->ni", rotations, end - places) for end in ends)  # in the frames of the parts
        near = np.all((np.minimum(a, b) - radius <= high) & (np.maximum(a, b) + radius >= low), axis=1)
        through = []
        for k in np.flatnonzero(near).tolist():
            if k != i:
                through += _through(parts[k], k, found.get(k), poses[k].inverse() * pose, one)
        out.append(_fastening(i, one, through))
    return tuple(out)


def _through(part: Part, index: int, other: Fastener | None, pose: pin.SE3, one: Fastener) -> list[_Through]:
    """Where a screw goes through a part; pose: of the screw in the part's frame."""
    origin, axis = np.asarray(pose.act(one.origin)), pose.rotation @ one.axis
    radius, least = 0.5 * one.diameter, SHARED * one.diameter
    if other is not None and other.kind in NUTS and abs(other.diameter - one.diameter) <= 0.05 * one.diameter:
        away = other.origin - origin
        aside = away - (away @ axis) * axis
        if abs(float(other.axis @ axis)) > 1.0 - TILT and float(aside @ aside) <= (0.3 * radius) ** 2:
            h = sorted(float((x - origin) @ axis) for x in (other.origin, other.origin + other.length * other.axis))
            low, high = max(h[0], 0.0), min(h[1], one.length)
            return [_Through(index, low, high, True, True)] if high - low >= least else []
    if other is not None and other.kind in SCREWS:
        return []
    bores = _bores(part.shape)
    away = bores.points - origin
    along = away @ axis
    beside = away - along[:, None] * axis
    aside = np.linalg.norm(beside, axis=1)
    turn = bores.axes @ axis
    most = np.where(bores.radii < radius, OFF_PILOT * radius, bores.radii - radius + OFF_AXIS * radius)
    fits = np.abs(turn) > 1.0 - 0.5 * TILT**2
    fits &= (bores.radii >= TIGHT[0] * radius) & (bores.radii <= max(one.outside, TIGHT[1] * radius))
    found = []
    for k in [
        *np.flatnonzero(fits & (aside <= most)),
        *_slots(part.shape, np.flatnonzero(fits & (aside > most)).tolist(), beside, most),
    ]:
        first, last = sorted((along[k] + turn[k] * bores.spans[k]).tolist())
        low, high = max(first, 0.0), min(last, one.length)
        if high - low >= min(least, 0.5 * (last - first)):
            found.append(_Through(index, low, high, bool(bores.radii[k] <= TIGHT[1] * radius), False))
    return found or _solid(part, index, origin, axis, one)


def _slots(shape: Shape, others: Iterable[int], beside: Array, most: Array) -> list[int]:
    """The half cylinders at one end of slots that a screw goes through: its axis is between theirs and equal ones.

    others: bores that are parallel to the screw. beside: (m, 3) m: from its axis to those of all bores. most: (m,) m:
    greatest distance of its axis from the middle line of a slot.
    """
    bores = _bores(shape)
    found = []
    for j, k in combinations(others, 2):
        line = beside[k] - beside[j]
        length = float(np.linalg.norm(line))
        if abs(bores.radii[j] - bores.radii[k]) > 1e-6 or not 0.0 < length <= SLOT * bores.radii[j]:
            continue
        at = -float(beside[j] @ line) / length**2
        if 0.0 <= at <= 1.0 and float(np.linalg.norm(beside[j] + at * line)) <= most[j]:
            features = [shape.features[int(bores.places[i])] for i in (j, k)]
            axes = [(f.geometry.origin, f.geometry.axis) for f in features if isinstance(f.geometry, Cylinder)]
            if all(open_angle(f.samples, *of) > HALF for f, of in zip(features, axes, strict=True)):
                found.append(j)
    return found


def _solid(part: Part, index: int, origin: Array, axis: Array, one: Fastener) -> list[_Through]:
    """Where a screw is drawn into the material of a part without a hole for it."""
    u = perpendicular(axis)
    frame = np.array([u, np.cross(axis, u), axis])
    radius = 0.5 * one.diameter
    corners = ((part.mesh.vertices - origin) @ frame.T)[part.mesh.triangles]  # (t, 3, 3)
    low, high = corners.min(axis=1), corners.max(axis=1)
    reach = INSIDE * radius
    corners = corners[np.all((low[:, :2] <= reach) & (high[:, :2] >= -reach), axis=1)]
    if len(corners) == 0:
        return []
    inside = []
    for angle in np.arange(LINES) * 2.0 * np.pi / LINES + 0.1:
        p = corners - reach * np.array([np.cos(angle), np.sin(angle), 0.0])
        x, y = p[:, :, 0], p[:, :, 1]
        areas = np.stack([x[:, k - 2] * y[:, k - 1] - x[:, k - 1] * y[:, k - 2] for k in range(3)], axis=1)
        hit = np.all(areas > 0.0, axis=1) | np.all(areas < 0.0, axis=1)
        total = areas[hit].sum(axis=1)
        heights = (areas[hit] * p[hit][:, :, 2]).sum(axis=1) / total
        order = np.argsort(heights)
        depth = -np.cumsum(np.sign(total[order]))  # a face turned against the axis is where the line enters
        heights = heights[order]
        for k in np.flatnonzero(depth[:-1] > 0):
            inside.append((max(heights[k], 0.0), min(heights[k + 1], one.length)))
    spans = [(a, b) for a, b in inside if b - a >= SHARED * one.diameter]
    if len(spans) < LINES // 2:
        return []
    return [_Through(index, float(min(a for a, _ in spans)), float(max(b for _, b in spans)), True, False)]


def _bores(shape: Shape) -> _Bores:
    found = _BORES.get(shape)
    if found is None:
        numbers = []
        for k, f in enumerate(shape.features):
            g = f.geometry
            if isinstance(g, Cylinder) and f.sense < 0:
                h = (f.samples - g.origin) @ g.axis
                numbers.append((*g.origin, *g.axis, g.radius, h.min(), h.max(), k))
        rows = np.array(numbers, dtype=np.float64).reshape(-1, 10)
        found = _BORES[shape] = _Bores(rows[:, :3], rows[:, 3:6], rows[:, 6], rows[:, 7:9], rows[:, 9])
    return found


def _fastening(index: int, one: Fastener, through: Sequence[_Through]) -> Fastening:
    """Sort the parts that a screw goes through: its thread holds in nuts and inserts, else in the last tight one."""
    tight = [t for t in through if t.tight]
    if one.kind == FastenerKind.SET_SCREW:
        holding = tight
    elif any(t.nut for t in tight):
        holding = [t for t in tight if t.nut]
    else:
        last = max(tight, key=lambda t: (t.high, t.low), default=None)
        holding = [t for t in tight if last is not None and t.part == last.part]
    into = tuple(dict.fromkeys(t.part for t in holding))
    start = min((t.low for t in holding), default=one.length)
    least = min(SHARED * one.diameter, 0.5 * start)
    before = sorted((t.low, t.part) for t in through if t.part not in into and min(t.high, start) - t.low > least)
    engagement = max((t.high for t in holding), default=0.0) - start if holding else 0.0
    return Fastening(index, one, tuple(dict.fromkeys(part for _, part in before)), into, engagement)


@dataclass(frozen=True)
class FastenerRow:
    """Fasteners of one kind and size that clamp and thread into parts of the same names."""

    fastener: Fastener
    parts: tuple[str, ...]
    clamps: tuple[str, ...]
    """names without numbers of instances"""
    threads_into: tuple[str, ...]
    engagement: tuple[float, float]
    """m: least and greatest"""

    def __str__(self) -> str:
        f = self.fastener
        words = [f"{len(self.parts)} × {f.size or base_name(self.parts[0])} {f.kind}", f.standard, f.drive]
        words += [f"clamps {', '.join(self.clamps)}" if self.clamps else ""]
        if self.threads_into:
            deep = " to ".join(dict.fromkeys(f"{1e3 * x:.3g}" for x in self.engagement))
            words += [f"threads into {', '.join(self.threads_into)}, {deep} mm deep"]
        elif f.kind in SCREWS:
            words += ["threads into nothing found"]
        return " · ".join(filter(None, words))

    def document(self) -> dict[str, Any]:
        """Return it for JSON, lengths in metres."""
        f = self.fastener
        return {
            "kind": str(f.kind), "size": f.size, "diameter": f.diameter, "length": f.length, "pitch": f.pitch,
            "standard": f.standard, "drive": f.drive, "count": len(self.parts), "parts": list(self.parts),
            "clamps": list(self.clamps), "threads_into": list(self.threads_into), "engagement": list(self.engagement),
            "evidence": f.evidence, "confidence": round(f.confidence, 2),
        }  # fmt: skip


def fastener_rows(scene: Scene) -> tuple[FastenerRow, ...]:
    """Return the fasteners of a scene, those of one pattern as one row, the most frequent first."""
    found = fasteners_of(scene)
    does = {f.part: f for f in fastenings(scene, found)}
    names = scene.names

    def plain_names(parts: Iterable[int]) -> tuple[str, ...]:
        return tuple(dict.fromkeys(COPY.sub("", base_name(names[k])) for k in parts))

    rows: dict[tuple[Any, ...], FastenerRow] = {}
    for i, one in found.items():
        d = does.get(i)
        clamps, into = (plain_names(d.clamps), plain_names(d.threads_into)) if d is not None else ((), ())
        deep = d.engagement if d is not None else 0.0
        size = one.size or base_name(names[i])
        key = (one.kind, size, round(one.length, 6), one.standard, one.drive, clamps, into)
        row = rows.get(key)
        if row is None:
            rows[key] = FastenerRow(one, (names[i],), clamps, into, (deep, deep))
        else:
            least, most = row.engagement
            rows[key] = replace(row, parts=(*row.parts, names[i]), engagement=(min(least, deep), max(most, deep)))
    order = list(FastenerKind)
    return tuple(sorted(rows.values(), key=lambda r: (order.index(r.fastener.kind), -len(r.parts))))


def table(rows: Sequence[FastenerRow]) -> str:
    """Format the result of `fastener_rows`; empty without fasteners."""
    count = sum(len(row.parts) for row in rows)
    return "\n".join(map(plain, [f"{count} fasteners", *(f"  {row}" for row in rows)])) if rows else ""
