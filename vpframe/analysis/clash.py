"""Clash, contact, clearance and containment of a scene at its present poses: `vpframe clash FILE...`.

Planes, cylinders, cones, spheres and tori are judged by the gap of the surfaces themselves, within their trimmed faces
(see `vpframe.analysis.gaps`); other faces by their triangles, less the deflections of both. Fits of round surfaces
(shaft and bore) are judged by radii and axes; facing planes by their exact distance. Threads and press fits are kinds
of their own: drawn as cylinders or out of phase, a screw and its nut overlap by design, and so does a pin that is
pressed into its bore.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import Tolerance
from collision.classify import KINDS as CLASSIFIED
from collision.classify import classify
from vpframe.analysis import clash_status
from vpframe.analysis.clash_status import ClashKey
from vpframe.analysis.fits import BAD_KINDS, Key, Row, fits_of
from vpframe.analysis.gaps import gaps_of
from vpframe.analysis.pairs import by_parts, count_words, meeting_box, place_words, worst_first
from vpframe.analysis.static import world_of
from vpframe.errors import VpframeError
from vpframe.outputs import STATUS, claimed
from vpframe.scene.deflection import deflections
from vpframe.scene.names import face_words
from vpframe.scene.planes import facing_overlaps, is_exact_overlap
from vpframe.scene.scene import Part, Scene
from vpframe.scene.subassembly import parts_named
from vpframe.text import plain

KINDS = (*CLASSIFIED[: CLASSIFIED.index("contact")], "press fit", "thread", *CLASSIFIED[CLASSIFIED.index("contact") :])
"""in descending gravity"""
INSIDE_KINDS = ("clash", "containment", "authorised", "thread")
"""kinds of rows that depend on containment"""
OPEN_WORDS = "is not closed"
OPEN = "{} " + OPEN_WORDS + ": its winding number decides what is inside it"
SHOWN = 5e-7
"""least length that is printed, m; smaller ones would read 0.000 mm"""
TRIANGLES = 0.9
"""fraction of the time spent on triangle tests"""


def merged(scenes: Sequence[Scene]) -> Scene:
    """Merge scenes, each in its own coordinates; with several scenes, parts are renamed to `file/part`."""
    if len(scenes) == 1:
        return scenes[0]
    out = Scene()
    stems: dict[str, int] = {}
    for scene in scenes:
        stem = Path(scene.source or "scene").stem
        stems[stem] = stems.get(stem, 0) + 1
        prefix = stem if stems[stem] == 1 else f"{stem}_{stems[stem]}"
        for part in scene.parts:
            out.add(replace(part, name=f"{prefix}/{part.name}"))
        names = {name: f"{prefix}/{name}" for name in scene.names}
        out.statements += tuple(statement.renamed(names) for statement in scene.statements)
    out.notes = tuple(f"{scene.source}: {note}" for scene in scenes for note in scene.notes)
    return out


def clash(
    scene: Scene,
    clearance: float = 0.0,
    tolerance: Tolerance | None = None,
    authorised: Iterable[tuple[str, str]] = (),
    progress: Callable[[float, str], None] = lambda fraction, text: None,
) -> dict[str, Any]:
    """Find all pairs of surfaces that clash, touch or are nearer than `clearance` (m).

    Parameters
    ----------
    tolerance: penetrations up to `tolerance.linear` are contacts, not clashes.
    authorised: pairs of parts, by name, that may overlap, such as a press fit.
    progress: receives the fraction done and the present task.

    Returns
    -------
    {"pairs": [{"kind", "parts": [a, b], "surfaces": [i, j], "faces": [words, words], "distance", "depth", "interval",
    "point", "reason"}]}, lengths in metres, in the order of parts and surfaces; `surfaces` and `faces` are empty for
    parts as a whole (containment, coincidence); `point` (3,), world, is the deepest or nearest point. `kind` is one of
    `KINDS`; "thread" is the overlap of a screw with its nut or tapped hole, "press fit" that of a shaft larger than its
    bore by no more than `Tolerance.press_fit` allows: neither is a clash. `interval` is [low, high]: bounds of the
    signed gap of the two true surfaces, negative for depths; `distance` is the lower bound, or 0, and never more than
    the true one.
    """
    world = world_of(scene, tolerance)
    t = world.tolerance
    meant = [(scene.index(a), scene.index(b)) for a, b in authorised]
    sag = {shape: deflections(shape) for shape in {part.shape for part in scene.parts}}
    sags = [sag[part.shape] for part in scene.parts]
    names = scene.names
    found = classify(
        world, clearance, sags, meant, names=names,
        tell=lambda fraction: progress(TRIANGLES * fraction, "pairs of parts"),
    )  # fmt: skip
    allowed = {frozenset(pair) for pair in meant}
    rows: dict[Key, Row] = {}
    exact: set[Key] = set()
    deepest = {(*p.objects, *(p.surfaces or ())): p.witness for p in found}
    shapes = [part.shape for part in scene.parts]
    for p in found:
        kind: str = p.kind
        key: Key = (*p.objects, *(p.surfaces or ()))
        if kind == "contact" and is_exact_overlap(p, shapes, world, sags):
            kind = "authorised" if frozenset(p.objects) in allowed else "clash"
            exact.add(key)
        rows[key] = (kind, p.distance, p.depth, p.reason)
    for overlap in facing_overlaps(scene, world, sags):
        kind = "authorised" if frozenset(overlap.key[:2]) in allowed else "clash"
        rows[overlap.key] = (kind, 0.0, overlap.depth, overlap.why)
        exact.add(overlap.key)
    fits, threads = fits_of(scene, world, sags, lambda done: progress(TRIANGLES + (1.0 - TRIANGLES) * done, "fits"))
    wanted = max(t.linear, clearance)
    near = {key for key, row in rows.items() if row[1] <= wanted}
    for fit in fits:
        for key in fit.mated | (fit.beside & (near if fit.fit.gap <= wanted else rows.keys())):
            rows.pop(key, None)
            kind, gap = fit.fit.kind, fit.fit.gap
            exact.add(key)
            if gap > wanted:
                continue
            if kind == "clash" and frozenset(key[:2]) in allowed:
                kind = "authorised"
            rows[key] = (kind, max(gap, 0.0), max(-gap, 0.0), fit.why)
            whole = rows.get(key[:2])
            if kind == "press fit" and whole is not None and whole[2] <= -gap + t.linear + _sag(sags, key):
                del rows[key[:2]]  # the material that the two have in common is that of the press fit
    left = rows.keys() - exact
    judged = (p for p in found if p.surfaces is not None and (*p.objects, *p.surfaces) in left)
    gaps = gaps_of(scene, judged, sags, wanted)
    for key, between in gaps.items():
        row = between.row(t.linear, clearance, frozenset(key[:2]) in allowed, rows.pop(key)[3])
        if row is not None:
            rows[key] = row
            deepest[key] = between.point
    for thread in threads:  # after the fits, because crests in roots are fits too
        a, b = thread.parts
        slack = t.linear + _sag(sags, (a, b))
        rows.update(thread.claimed(rows, deepest, slack))
    for key, (kind, distance, depth, reason) in rows.items():
        words = [reason, *(OPEN.format(names[i]) for i in key[:2] if not shapes[i].closed)]
        if kind in INSIDE_KINDS and OPEN_WORDS not in reason:
            rows[key] = (kind, distance, depth, "; ".join(filter(None, words)))
    return {
        "pairs": [
            {
                "kind": kind,
                "parts": [names[key[0]], names[key[1]]],
                "surfaces": list(key[2:]),
                "faces": [face_words(scene.parts[i], s) for i, s in zip(key[:2], key[2:], strict=False)],
                "distance": distance,
                "depth": depth,
                "interval": gaps[key].interval if key in gaps else [distance - depth] * 2,
                "point": (deepest[key] if key in deepest else _middle(scene, key)).tolist(),
                "reason": reason,
            }
            for key, (kind, distance, depth, reason) in sorted(rows.items())
        ]
    }


def between(
    first: Part, second: Part, poses: tuple[pin.SE3, pin.SE3], tolerance: Tolerance | None = None
) -> dict[tuple[int, ...], dict[str, Any]]:
    """Return the rows of `clash` of two parts at world poses, by surfaces of the first and the second, () for the parts
    as a whole: sessions and reports judge a pair by them, as `vpframe clash` does."""
    pair = Scene(replace(part, pose=pin.SE3(pose)) for part, pose in zip((first, second), poses, strict=True))
    return {tuple(row["surfaces"]): row for row in clash(pair, tolerance=tolerance)["pairs"]}


def _sag(sags: Sequence[NDArray[np.float64]], key: Key) -> float:
    """Greatest deflections of the two parts of a key together, m."""
    return float(sum(sags[i].max(initial=0.0) for i in key[:2]))


def with_status(document: dict[str, Any], path: str | os.PathLike[str]) -> None:
    """Update the status file and set "status" and "remark" of each clash in `document`.

    Parameters
    ----------
    path: status file of `vpframe.analysis.clash_status`, or its `Output`; created if it does not exist.

    Raises
    ------
    VpframeError: it is not a status file.
    """
    keys = {_key(pair): pair for pair in document["pairs"] if pair["kind"] in BAD_KINDS}
    with claimed(path, STATUS) as output:
        file = output.path
        known, pairs = (clash_status.read(file), clash_status.read_authorised(file)) if output.ours else ((), ())
        records = clash_status.updated(known, keys)
        clash_status.write(file, records, pairs)
    for record in records:
        if record.key in keys:
            keys[record.key].update(status=record.status, remark=record.remark)


def _key(pair: dict[str, Any]) -> ClashKey:
    (a, b), (i, j) = pair["parts"], pair["surfaces"] or (clash_status.WHOLE, clash_status.WHOLE)
    return ClashKey.of(a, i, b, j)


def is_open(pair: dict[str, Any]) -> bool:
    """Whether a row of `clash` is a clash that has not been accepted."""
    return pair["kind"] in BAD_KINDS and pair.get("status") != "accepted"


def document(found: dict[str, Any], **more: Any) -> dict[str, Any]:
    """Return the document of `vpframe clash --json`, with further entries `more`.

    {"pairs": [{"kind", "parts", "count", "surface_pairs": [row, …], …}], …}: one row for each pair of parts, gravest
    first, with the fields of its worst surface pair and the rows of all of them, as `clash` returns them.
    """
    return {"pairs": by_parts(found["pairs"], KINDS), **more}


def table(found: dict[str, Any], surfaces: bool = False, contacts: bool = False) -> str:
    """Format the result of `clash`: one line for each pair of parts, gravest and deepest first.

    Parameters
    ----------
    surfaces: one line for each pair of surfaces instead, with contacts.
    contacts: one line for each pair of parts that only touch; otherwise they are counted at the end.
    """
    if not found["pairs"]:
        return "no two parts touch"
    pairs = by_parts(found["pairs"], KINDS)
    rows = sorted(found["pairs"], key=lambda row: worst_first(row, KINDS)) if surfaces else pairs
    counts = ((kind, sum(row["kind"] == kind for row in rows)) for kind in KINDS)
    head = ", ".join(f"{n} {kind}" for kind, n in counts if n)
    if surfaces:
        return "\n".join(map(plain, [head, *map(_surface_line, rows)]))
    lines = [f"{head} (pairs of parts)"]
    touching = [pair for pair in pairs if pair["kind"] == "contact"]
    counted = not contacts and len(touching) > 1
    lines += [_pair_line(pair) for pair in pairs if not (counted and pair["kind"] == "contact")]
    if counted:
        inner = count_words(sum(pair["count"] for pair in touching), "surfaces")
        lines.append(
            f"  {'contact':11}  {count_words(len(touching), 'parts')} only touch ({inner}); --contacts lists them"
        )
    return "\n".join(map(plain, lines))


def _pair_line(pair: dict[str, Any]) -> str:
    place = place_words(pair.get("point"))
    words = [f"{_size(pair)}{f' at {place}' if place else ''}", _where(pair)]
    if pair["count"] > 1:
        words.append(count_words(pair["count"], "surfaces"))
    return _line(pair, words)


def _surface_line(pair: dict[str, Any]) -> str:
    return _line(pair, [_where(pair), _size(pair)])


def _line(pair: dict[str, Any], words: list[str]) -> str:
    words += [pair[name] for name in ("status", "remark", "reason") if pair.get(name)]
    return f"  {pair['kind']:11}  {pair['parts'][0]} – {pair['parts'][1]}: {', '.join(words)}"


def _where(pair: dict[str, Any]) -> str:
    faces = pair.get("faces") or [f"face {surface}" for surface in pair["surfaces"]]
    return " – ".join(faces) or "as a whole"


def _size(pair: dict[str, Any]) -> str:
    low, high = pair.get("interval") or [pair["distance"] - pair["depth"]] * 2
    if high - low <= 2.0 * SHOWN:
        low = high = pair["distance"] - pair["depth"]
    if low <= -SHOWN and high >= SHOWN:
        return f"touching within their deflection, from {-low * 1e3:.3f} mm deep to {high * 1e3:.3f} mm apart"
    if low <= -SHOWN:
        return f"{_range(-high, -low)} mm deep"
    return f"{_range(low, high)} mm apart" if high >= SHOWN else "touching"


def _range(low: float, high: float) -> str:
    """Format a length in mm: "0.020", or its bounds: "0.020..0.075"; the lower one rounded down, the upper one up."""
    if high == low:
        return f"{low * 1e3:.3f}"
    return f"{max(0.0, math.floor(low * 1e6 + 1e-6) / 1e3):.3f}..{math.ceil(high * 1e6 - 1e-6) / 1e3:.3f}"


def _middle(scene: Scene, key: Key) -> NDArray[np.float64]:
    """Middle (3,) of the region where two faces or two parts meet, world, m."""
    parts = [scene.parts[i] for i in key[:2]]
    poses = [part.pose for part in parts]
    if key[2:]:
        low, high = meeting_box(parts, poses, key[2:])
        return 0.5 * (low + high)
    return np.asarray(poses[1].act(parts[1].shape.center), dtype=np.float64)


def authorised_pairs(text: Iterable[str], scene: Scene | None = None) -> list[tuple[str, str]]:
    """Parse pairs of part names `a:b`; with a `scene`, the name of a subassembly means each of its parts.

    Raises
    ------
    VpframeError: not two names, or unknown names.
    """
    out = []
    for entry in text:
        a, colon, b = entry.partition(":")
        if not (a and colon and b):
            raise VpframeError(f"authorised pair {entry!r}: write two part names as A:B")
        if scene is None:
            out.append((a, b))
        else:
            out += [
                (one, other)
                for one in parts_named(scene.names, a)
                for other in parts_named(scene.names, b)
                if one != other
            ]
    return out
