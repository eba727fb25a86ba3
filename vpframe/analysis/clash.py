"""Clash, contact, clearance and containment of a scene at its present poses: `vpframe clash FILE...`.

Planes, cylinders, cones, spheres and tori are judged by the gap of the surfaces themselves, within their trimmed faces
(see `vpframe.analysis.gaps`); other faces by their triangles, less the deflections of both. Fits of round surfaces
(shaft and bore) are judged by radii and axes; facing planes by their exact distance. Overlaps that are meant are kinds
of their own: threads, press fits, what gives way (`vpframe.analysis.meanings`). A screw overlaps its hole by design,
and so does a pin that is pressed into its bore.
"""

from __future__ import annotations

import math
import os
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from heapq import merge
from operator import itemgetter
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import Tolerance
from collision.classify import PairClass, near_pairs
from constraints.geometry.surfaces import Plane
from vpframe.analysis import clash_status
from vpframe.analysis.clash_status import ClashKey
from vpframe.analysis.fits import BAD_KINDS, ClashReason, FittedPair, Key, ThreadedPair, Verdict, fits_of
from vpframe.analysis.gaps import Gap, PlacedFaces, gaps_of
from vpframe.analysis.meanings import Meaning, meanings_of
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
from vpframe.analysis.static import StaticAnalysis, analysis_of
from vpframe.errors import VpframeError
from vpframe.outputs import STATUS, claimed
from vpframe.scene.overlap_rules import MEANT, OverlapRule, product
from vpframe.scene.planes import PlaneOverlap, facing_overlaps, is_exact_overlap
from vpframe.scene.scene import Part, Scene
from vpframe.scene.subassembly import parts_named
from vpframe.text import plain

INSIDE_KINDS = ("clash", "containment", "authorised", *MEANT)
"""kinds of rows that depend on containment"""
PLURALS = {"clash": "clashes", "press fit": "press fits", "thread": "threads", "contact": "contacts"}
"""of kinds, in counts"""
SHOWN = 5e-7
"""least length that is printed, m; smaller ones would read 0.000 mm"""
FITS = 0.2
"""fraction of the time spent on fits"""


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
        out.rules += tuple(replace(rule, scope=prefix) for rule in scene.rules)
    out.notes = tuple(f"{scene.source}: {note}" for scene in scenes for note in scene.notes)
    return out


def clash(
    scene: Scene,
    clearance: float = 0.0,
    tolerance: Tolerance | None = None,
    authorised: Iterable[tuple[str, str]] = (),
    progress: Callable[[float, str], None] = lambda fraction, text: None,
    decided: Callable[[tuple[ClashRow, ...]], None] = lambda rows: None,
    as_drawn: bool = False,
) -> tuple[ClashRow, ...]:
    """Find all pairs of surfaces that clash, touch or are nearer than `clearance` (m).

    Parameters
    ----------
    tolerance: penetrations up to `tolerance.linear` are contacts, not clashes.
    authorised: pairs of parts, by name, that may overlap, such as a press fit.
    progress: receives the fraction done and the present task.
    decided: receives the rows of each pair of parts, in the order of parts, as soon as they are known.
    as_drawn: whether overlaps that are meant count as clashes, as if all parts were solid.

    Returns
    -------
    Rows in the order of parts and surfaces. The kind "thread" is the overlap of a screw with its nut or hole, "press
    fit" that of a shaft larger than its bore by no more than its kind allows, "soft" that of a seal, belt or spring,
    "glue" that of parts that a person says are glued: none is a clash.
    """
    analysis = analysis_of(scene, tolerance)
    meant = [(scene.index(a), scene.index(b)) for a, b in authorised]
    fits, threads = fits_of(analysis, lambda done: progress(FITS * done, "fits"))
    judge = _Judge(scene, analysis, clearance, {frozenset(pair) for pair in meant}, fits, threads, as_drawn)
    near = near_pairs(analysis.world, clearance, analysis.deflections)
    settled: defaultdict[tuple[int, int], list[tuple[Sequence[int], Sequence[int]]]] = defaultdict(list)
    for fit in fits:
        if fit.fit.kind not in (*BAD_KINDS, "press fit"):
            settled[fit.parts] += [fit.beside, *(([key[2]], [key[3]]) for key in fit.mated)]
    classified = zip(near.pairs, near.classified(meant, settled), strict=True)
    others = sorted(judge.pairs().difference(near.pairs))
    pairs: Iterator[tuple[tuple[int, ...], Sequence[PairClass]]]
    pairs = merge(classified, ((pair, ()) for pair in others), key=itemgetter(0))
    total, clashing = len(near.pairs) + len(others), 0
    out: list[ClashRow] = []
    for number, rows in enumerate(_as_done(judge.rows, pairs)):
        out += rows
        clashing += any(row.kind in BAD_KINDS for row in rows)
        decided(rows)
        progress(FITS + (1.0 - FITS) * number / total, f"{number + 1} of {total} pairs of parts, {clashing} clash")
    return tuple(out)


T = TypeVar("T")
R = TypeVar("R")


def _as_done(work: Callable[[T], R], items: Iterable[T]) -> Iterator[R]:
    """Yield `work` of each item, in order, done by threads while later items are computed."""
    jobs: deque[Future[R]] = deque()
    pool = ThreadPoolExecutor(os.cpu_count(), "judge")
    try:
        for item in items:
            jobs.append(pool.submit(work, item))
            while jobs and jobs[0].done():
                yield jobs.popleft().result()
        while jobs:
            yield jobs.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)


class _Judge:
    """Decides on the pairs of surfaces of two parts: exact planes, fits, gaps and threads before facets."""

    def __init__(
        self, scene: Scene, analysis: StaticAnalysis, clearance: float, allowed: set[frozenset[int]],
        fits: Iterable[FittedPair], threads: Iterable[ThreadedPair], as_drawn: bool,
    ) -> None:  # fmt: skip
        self.scene, self.analysis, self.allowed, self.as_drawn = scene, analysis, allowed, as_drawn
        self.meanings = meanings_of(scene, analysis)
        self.clearance, self.wanted = clearance, max(analysis.tolerance.linear, clearance)
        self.placed = PlacedFaces(scene, analysis.deflections)
        self.shapes = [part.shape for part in scene.parts]
        self.overlaps: defaultdict[tuple[int, ...], list[PlaneOverlap]] = defaultdict(list)
        self.fits: defaultdict[tuple[int, ...], list[FittedPair]] = defaultdict(list)
        self.threads: defaultdict[tuple[int, ...], list[ThreadedPair]] = defaultdict(list)
        contacts = analysis.contacts(analysis.within_deflection)
        for overlap in facing_overlaps(scene, analysis.world, contacts, analysis.deflections):
            self.overlaps[overlap.key[:2]].append(overlap)
        for fit in fits:
            self.fits[fit.parts].append(fit)
        for thread in threads:
            self.threads[thread.parts].append(thread)

    def pairs(self) -> set[tuple[int, ...]]:
        """Return the pairs of parts of which more than distances and depths is known."""
        return {*self.overlaps, *self.fits, *self.threads}

    def rows(self, item: tuple[tuple[int, ...], Sequence[PairClass]]) -> tuple[ClashRow, ...]:
        """Return the rows of two parts, given by their indices and what `classify` found of them."""
        pair, found = item
        t, sags, wanted = self.analysis.tolerance.linear, self.analysis.deflections, self.wanted
        slack = t + float(sum(sags[i].max(initial=0.0) for i in pair))
        rows: dict[Key, Verdict] = {}
        exact: set[Key] = set()
        deepest = {(*p.objects, *(p.surfaces or ())): p.witness for p in found}
        for p in found:
            kind: str = p.kind
            key: Key = (*p.objects, *(p.surfaces or ()))
            if kind == "contact" and is_exact_overlap(p, self.shapes, self.analysis.world, sags):
                kind = "clash"
                exact.add(key)
            rows[key] = Verdict(
                kind, p.distance, p.depth, ClashReason(p.reason), p.words(self.scene.names), open=p.open
            )
        for overlap in self.overlaps.get(pair, ()):
            rows[overlap.key] = Verdict("clash", 0.0, overlap.depth, ClashReason.PLANES, overlap.why)
            exact.add(overlap.key)
        near = {key for key, row in rows.items() if row.distance <= wanted}
        for fit in self.fits.get(pair, ()):
            for key in fit.mated | fit.of(near if fit.fit.gap <= wanted else rows):
                rows.pop(key, None)
                kind, gap = fit.fit.kind, fit.fit.gap
                exact.add(key)
                if gap > wanted:
                    continue
                rows[key] = Verdict(kind, max(gap, 0.0), max(-gap, 0.0), ClashReason.FIT, fit.why, fit.fit)
                whole = rows.get(pair)
                if kind == "press fit" and whole is not None and whole.depth <= -gap + slack:
                    del rows[pair]  # the material that the two have in common is that of the press fit
        left = rows.keys() - exact
        judged = (p for p in found if p.surfaces is not None and (*p.objects, *p.surfaces) in left)
        gaps = gaps_of(self.placed, judged, wanted)
        for key, between in gaps.items():
            known, row = rows.pop(key), between.verdict(t, self.clearance)
            if row is not None:
                rows[key] = row._replace(open=known.open)
                deepest[key] = between.point
        for key, row in rows.items():
            if row.kind == "clash" and frozenset(pair) in self.allowed:
                rows[key] = row._replace(kind="authorised")
        for thread in self.threads.get(pair, ()):  # after the fits, because crests in roots are fits too
            rows.update(thread.claimed(rows, deepest, slack))
        meant = self._meant(pair, rows, deepest, slack)
        return tuple(
            _row(self.scene, key, row, gaps.get(key), deepest.get(key), meant.get(key))
            for key, row in sorted(rows.items())
        )

    def _meant(
        self, pair: tuple[int, ...], rows: dict[Key, Verdict], deepest: Mapping[Key, NDArray[np.float64]], slack: float
    ) -> dict[Key, Meaning]:
        """Change the kinds of rows to what their overlap means, and back where it is none; return meanings by row."""
        a, b = pair
        for key, row in rows.items():
            if row.kind in MEANT and (self.as_drawn or self.meanings.solid(a, b, row.kind)):
                deep = row.depth > self.analysis.tolerance.linear
                rows[key] = row._replace(kind="clash" if deep else "contact")
        bad = [key for key, row in rows.items() if row.kind in BAD_KINDS]
        meaning = self.meanings.of(a, b) if bad and not self.as_drawn else None
        if meaning is None:
            return {}
        found = {key: meaning for key in bad if meaning.claims(key, rows[key].depth, deepest.get(key), slack)}
        if pair in found and any(len(key) == 4 and key not in found for key in bad):
            del found[pair]  # there is more than the overlap that is meant
        for key in found:
            rows[key] = rows[key]._replace(kind=meaning.kind, words=meaning.words)
        return found


def _row(
    scene: Scene, key: Key, row: Verdict, gap: Gap | None, deepest: NDArray[np.float64] | None, meaning: Meaning | None
) -> ClashRow:
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
        planes=sum(isinstance(face.geometry, Plane) for face in faces), meaning=meaning,
    )  # fmt: skip


def between(
    first: Part,
    second: Part,
    poses: tuple[pin.SE3, pin.SE3],
    tolerance: Tolerance | None = None,
    rules: Iterable[OverlapRule] = (),
) -> dict[tuple[int, ...], ClashRow]:
    """Return the rows of `clash` of two parts at world poses, by surfaces of the first and the second, () for the parts
    as a whole: sessions and reports judge a pair by them, as `vpframe clash` does. rules: of their scene."""
    parts = (part.copy(pose=pin.SE3(pose)) for part, pose in zip((first, second), poses, strict=True))
    pair = Scene(parts, rules=rules)
    return {row.surfaces: row for row in clash(pair, tolerance=tolerance)}


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

    {"counts": {kind: pairs of parts}, "pairs": [{"kind", "parts", "count", "surface_pairs": [row, …], …}], …}: one row
    for each pair of parts, gravest first, with the fields of its worst surface pair and the rows of all of them.
    """
    pairs = by_parts(rows)
    kinds = [pair.kind for pair in pairs]
    counts = {kind: kinds.count(kind) for kind in KINDS if kind == "clash" or kind in kinds}
    return {"counts": counts, "pairs": [pair.document() for pair in pairs], **more}


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
    head = _head([row.kind for row in rows] if surfaces else [pair.kind for pair in pairs])
    if surfaces:
        return "\n".join(map(plain, [head, *map(_surface_line, sorted(rows, key=worst_first))]))
    lines = [f"{head} (pairs of parts)"]
    touching = [pair for pair in pairs if pair.kind == "contact"]
    counted = not contacts and len(touching) > 1
    patterns: dict[Any, list[PartPair[ClashRow]]] = {}
    for pair in pairs:
        if not (counted and pair.kind == "contact"):
            patterns.setdefault(_pattern(pair), []).append(pair)
    lines += [_pattern_line(alike) for alike in patterns.values()]
    if counted:
        inner = count_words(sum(len(pair.rows) for pair in touching), "surfaces")
        lines.append(
            f"  {'contact':11}  {count_words(len(touching), 'parts')} only touch ({inner}); --contacts lists them"
        )
    return "\n".join(map(plain, lines))


def _head(kinds: Sequence[str]) -> str:
    """Count kinds: "0 clashes, 60 contacts; 48 threads, as drawn: --as-drawn judges them as solid"."""

    def counted(chosen: Iterable[str]) -> str:
        counts = ((kinds.count(kind), kind) for kind in chosen)
        return ", ".join(
            f"{n} {kind if n == 1 else PLURALS.get(kind, kind)}" for n, kind in counts if n or kind == "clash"
        )

    text = counted(kind for kind in KINDS if kind not in MEANT)
    meant = counted(kind for kind in KINDS if kind in MEANT)
    return f"{text}; {meant}, as drawn: --as-drawn judges them as solid" if meant else text


def _pattern(pair: PartPair[ClashRow]) -> Any:
    """What instances of one pattern have in common; clashes and contacts are listed one by one."""
    row = pair.worst
    if pair.kind not in MEANT:
        return row.parts
    if row.meaning is None or row.meaning.solid < 0:
        return pair.kind, tuple(map(product, row.parts))
    return pair.kind, row.meaning.what, product(row.other), f"{row.meaning.limit:.3g}"


def _pattern_line(alike: Sequence[PartPair[ClashRow]]) -> str:
    """The line of a pair, or of several of one pattern: "20 x thread M2x10 screw – board: Ø2.2 in Ø1.6..1.7 mm, …"."""
    pair, row = alike[0], alike[0].worst
    if len(alike) == 1:
        return _pair_line(pair)
    names, sizes = " – ".join(map(product, row.parts)), ""
    fits = [p.worst.meaning.fit for p in alike if p.worst.meaning is not None and p.worst.meaning.fit is not None]
    if row.meaning is not None and fits:
        bores = _diameters(r for fit in fits for r in fit.bores)
        names = f"{row.meaning.what} – {product(row.other)}"
        sizes = f"{_diameters(fit.radius for fit in fits)} in {bores} mm, "
    depths = [p.worst.depth for p in alike]
    text = f"{sizes}{_range(min(depths), max(depths))} mm deep, the first of them {' – '.join(row.parts)}"
    return f"  {pair.kind:11}  {len(alike)} x {pair.kind} {names}: {text}, {row.why}"


def _diameters(radii: Iterable[float]) -> str:
    """Format radii (m) as a diameter in mm, or as a range: "Ø1.6..1.7"."""
    known = list(radii)
    low, high = f"{2e3 * min(known):.4g}", f"{2e3 * max(known):.4g}"
    return f"Ø{low}" if low == high else f"Ø{low}..{high}"


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
