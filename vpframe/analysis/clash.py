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
from collision.classify import classify
from constraints.geometry.surfaces import Plane
from vpframe.analysis import clash_status
from vpframe.analysis.clash_status import ClashKey
from vpframe.analysis.fits import BAD_KINDS, ClashReason, Key, Verdict, fits_of
from vpframe.analysis.gaps import Gap, gaps_of
from vpframe.analysis.pairs import (
    KINDS,
    ClashRow,
    PartPair,
    by_parts,
    count_words,
    meeting_box,
    place_words,
    worst_first,
)
from vpframe.analysis.static import analysis_of
from vpframe.errors import VpframeError
from vpframe.outputs import STATUS, claimed
from vpframe.scene.planes import facing_overlaps, is_exact_overlap
from vpframe.scene.scene import Part, Scene
from vpframe.scene.subassembly import parts_named
from vpframe.text import plain

INSIDE_KINDS = ("clash", "containment", "authorised", "thread")
"""kinds of rows that depend on containment"""
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
            out.add(part.copy(f"{prefix}/{part.name}"))
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
) -> tuple[ClashRow, ...]:
    """Find all pairs of surfaces that clash, touch or are nearer than `clearance` (m).

    Parameters
    ----------
    tolerance: penetrations up to `tolerance.linear` are contacts, not clashes.
    authorised: pairs of parts, by name, that may overlap, such as a press fit.
    progress: receives the fraction done and the present task.

    Returns
    -------
    Rows in the order of parts and surfaces. The kind "thread" is the overlap of a screw with its nut or tapped hole,
    "press fit" that of a shaft larger than its bore by no more than `Tolerance.press_fit` allows: neither is a clash.
    """
    analysis = analysis_of(scene, tolerance)
    world, t, sags = analysis.world, analysis.tolerance, analysis.deflections
    meant = [(scene.index(a), scene.index(b)) for a, b in authorised]
    names = scene.names
    found = classify(
        world, clearance, sags, meant, tell=lambda fraction: progress(TRIANGLES * fraction, "pairs of parts")
    )
    allowed = {frozenset(pair) for pair in meant}
    rows: dict[Key, Verdict] = {}
    exact: set[Key] = set()
    deepest = {(*p.objects, *(p.surfaces or ())): p.witness for p in found}
    shapes = [part.shape for part in scene.parts]
    for p in found:
        kind: str = p.kind
        key: Key = (*p.objects, *(p.surfaces or ()))
        if kind == "contact" and is_exact_overlap(p, shapes, world, sags):
            kind = "clash"
            exact.add(key)
        rows[key] = Verdict(kind, p.distance, p.depth, ClashReason(p.reason), p.words(names), open=p.open)
    for overlap in facing_overlaps(scene, world, analysis.contacts(analysis.within_deflection), sags):
        rows[overlap.key] = Verdict("clash", 0.0, overlap.depth, ClashReason.PLANES, overlap.why)
        exact.add(overlap.key)
    fits, threads = fits_of(analysis, lambda done: progress(TRIANGLES + (1.0 - TRIANGLES) * done, "fits"))
    wanted = max(t.linear, clearance)
    near = {key for key, row in rows.items() if row.distance <= wanted}
    for fit in fits:
        for key in fit.mated | (fit.beside & (near if fit.fit.gap <= wanted else rows.keys())):
            rows.pop(key, None)
            kind, gap = fit.fit.kind, fit.fit.gap
            exact.add(key)
            if gap > wanted:
                continue
            rows[key] = Verdict(kind, max(gap, 0.0), max(-gap, 0.0), ClashReason.FIT, fit.why, fit.fit)
            whole = rows.get(key[:2])
            if kind == "press fit" and whole is not None and whole.depth <= -gap + t.linear + _sag(sags, key):
                del rows[key[:2]]  # the material that the two have in common is that of the press fit
    left = rows.keys() - exact
    judged = (p for p in found if p.surfaces is not None and (*p.objects, *p.surfaces) in left)
    gaps = gaps_of(scene, judged, sags, wanted)
    for key, between in gaps.items():
        known, row = rows.pop(key), between.verdict(t.linear, clearance)
        if row is not None:
            rows[key] = row._replace(open=known.open)
            deepest[key] = between.point
    for key, row in rows.items():
        if row.kind == "clash" and frozenset(key[:2]) in allowed:
            rows[key] = row._replace(kind="authorised")
    for thread in threads:  # after the fits, because crests in roots are fits too
        a, b = thread.parts
        slack = t.linear + _sag(sags, (a, b))
        rows.update(thread.claimed(rows, deepest, slack))
    return tuple(_row(scene, key, row, gaps.get(key), deepest.get(key)) for key, row in sorted(rows.items()))


def _row(scene: Scene, key: Key, row: Verdict, gap: Gap | None, deepest: NDArray[np.float64] | None) -> ClashRow:
    a, b = parts = [scene.parts[i] for i in key[:2]]
    gaps = row.open
    if not gaps and row.kind in INSIDE_KINDS:
        gaps = tuple(i for i in key[:2] if not scene.parts[i].shape.closed)
    low, high = (row.distance - row.depth,) * 2 if gap is None else (gap.low, gap.high)
    x, y, z = (_middle(scene, key) if deepest is None else deepest).tolist()
    faces = tuple(part.surfaces[s] for part, s in zip(parts, key[2:], strict=False))
    return ClashRow(
        row.kind, (a.name, b.name), key[2:], faces, row.distance, row.depth, (low, high), (x, y, z), row.reason,
        row.words, row.fit, tuple(scene.parts[i].name for i in gaps),
        planes=sum(isinstance(face.geometry, Plane) for face in faces),
    )  # fmt: skip


def between(
    first: Part, second: Part, poses: tuple[pin.SE3, pin.SE3], tolerance: Tolerance | None = None
) -> dict[tuple[int, ...], ClashRow]:
    """Return the rows of `clash` of two parts at world poses, by surfaces of the first and the second, () for the parts
    as a whole: sessions and reports judge a pair by them, as `vpframe clash` does."""
    pair = Scene(part.copy(pose=pin.SE3(pose)) for part, pose in zip((first, second), poses, strict=True))
    return {row.surfaces: row for row in clash(pair, tolerance=tolerance)}


def _sag(sags: Sequence[NDArray[np.float64]], key: Key) -> float:
    """Greatest deflections of the two parts of a key together, m."""
    return float(sum(sags[i].max(initial=0.0) for i in key[:2]))


def with_status(rows: Iterable[ClashRow], path: str | os.PathLike[str]) -> tuple[ClashRow, ...]:
    """Update the status file and return the rows, clashes among them with status and remark.

    Parameters
    ----------
    path: status file of `vpframe.analysis.clash_status`, or its `Output`; created if it does not exist.

    Raises
    ------
    VpframeError: it is not a status file.
    """
    rows = tuple(rows)
    keys = [_key(row) if row.kind in BAD_KINDS else None for row in rows]
    with claimed(path, STATUS) as output:
        file = output.path
        known, pairs = (clash_status.read(file), clash_status.read_authorised(file)) if output.ours else ((), ())
        records = clash_status.updated(known, filter(None, keys))
        clash_status.write(file, records, pairs)
    marks = {record.key: record for record in records}
    return tuple(
        replace(row, status=marks[key].status, remark=marks[key].remark) if key else row
        for row, key in zip(rows, keys, strict=True)
    )


def _key(row: ClashRow) -> ClashKey:
    (a, b), (i, j) = row.parts, row.surfaces or (clash_status.WHOLE, clash_status.WHOLE)
    return ClashKey.of(a, i, b, j)


def is_open(pair: ClashRow | PartPair[ClashRow]) -> bool:
    """Whether it is a clash that has not been accepted."""
    return pair.kind in BAD_KINDS and pair.status != "accepted"


def document(rows: Iterable[ClashRow], **more: Any) -> dict[str, Any]:
    """Return the document of `vpframe clash --json`, with further entries `more`.

    {"pairs": [{"kind", "parts", "count", "surface_pairs": [row, …], …}], …}: one row for each pair of parts, gravest
    first, with the fields of its worst surface pair and the rows of all of them.
    """
    return {"pairs": [pair.document() for pair in by_parts(rows)], **more}


def table(rows: Sequence[ClashRow], surfaces: bool = False, contacts: bool = False) -> str:
    """Format the result of `clash`: one line for each pair of parts, gravest and deepest first.

    Parameters
    ----------
    surfaces: one line for each pair of surfaces instead, with contacts.
    contacts: one line for each pair of parts that only touch; otherwise they are counted at the end.
    """
    if not rows:
        return "no two parts touch"
    pairs = by_parts(rows)
    kinds = [row.kind for row in rows] if surfaces else [pair.kind for pair in pairs]
    head = ", ".join(f"{kinds.count(kind)} {kind}" for kind in KINDS if kind in kinds)
    if surfaces:
        return "\n".join(map(plain, [head, *map(_surface_line, sorted(rows, key=worst_first))]))
    lines = [f"{head} (pairs of parts)"]
    touching = [pair for pair in pairs if pair.kind == "contact"]
    counted = not contacts and len(touching) > 1
    lines += [_pair_line(pair) for pair in pairs if not (counted and pair.kind == "contact")]
    if counted:
        inner = count_words(sum(len(pair.rows) for pair in touching), "surfaces")
        lines.append(
            f"  {'contact':11}  {count_words(len(touching), 'parts')} only touch ({inner}); --contacts lists them"
        )
    return "\n".join(map(plain, lines))


def _pair_line(pair: PartPair[ClashRow]) -> str:
    row = pair.worst
    words = [f"{_size(row)} at {place_words(row.point)}", _where(row)]
    if len(pair.rows) > 1:
        words.append(count_words(len(pair.rows), "surfaces"))
    return _line(replace(row, status=pair.status, remark=pair.remark), words)


def _surface_line(row: ClashRow) -> str:
    return _line(row, [_where(row), _size(row)])


def _line(row: ClashRow, words: Sequence[str]) -> str:
    text = ", ".join(filter(None, [*words, row.status, row.remark, row.why]))
    return f"  {row.kind:11}  {' – '.join(row.parts)}: {text}"


def _where(row: ClashRow) -> str:
    return " – ".join(row.face_words) or "as a whole"


def _size(row: ClashRow) -> str:
    low, high = row.interval
    if high - low <= 2.0 * SHOWN:
        low = high = row.distance - row.depth
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
