"""The narrow phase: queries of pairs of objects on two threads, with a cache of the results.

A pair of objects neither of which has moved since its last query is not tested again; for the others the triangles that
intersected, or were nearest, are tested first. Results do not depend on the number of threads.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from time import thread_time
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from collision.bvh.build import build, bvh_of
from collision.bvh.layout import LANES, Bvh
from collision.bvh.traverse import QueryWorkspace, counts_of, large_enough
from collision.contact import CONTACT_DTYPE
from collision.query.distance import clearance_entry, contacts_entry, lanes_of, with_surfaces
from collision.query.intersection import ALL_ENABLED, NO_TRIANGLES, intersect_entry
from collision.statistics import Statistics

MOST_CACHED: Final = 1 << 16
"""pairs of surfaces above which no triangles are kept for a pair of objects"""
WORTH_A_THREAD: Final = 2e-3
"""s: queries that take longer in total are shared by two threads"""
NO_ROWS: Final = np.empty((0, 4), np.int32)
Enabled = Callable[[int, int], NDArray[np.uint8] | None]
"""callback(i, j): (ka, kb), 0 for the pairs of surfaces to leave out; None if all are enabled"""


class PairCache:
    """Cache of a pair of objects: last results, their versions, and the triangles that intersected or were nearest."""

    __slots__ = (
        "a", "age", "b", "contacts", "enabled", "i", "j", "met", "near", "nearest", "rows", "version", "within",
    )  # fmt: skip

    def __init__(self, i: int, j: int, a: Bvh, b: Bvh, enabled: NDArray[np.uint8] | None) -> None:
        self.i, self.j, self.a, self.b = i, j, a, b
        self.enabled = ALL_ENABLED if enabled is None else enabled.ravel()
        self.met = self.near = NO_TRIANGLES
        self.nearest: dict[tuple[int | None, int | None], NDArray[np.int64]] = {}
        """`last` of `query.distance.clearance`, by surfaces"""
        self.rows: NDArray[np.int32] = NO_ROWS
        """(k, 4) object, surface, object, surface"""
        self.contacts: NDArray[Any] = np.empty(0, CONTACT_DTYPE)
        self.within = (-1, -1.0)
        """version and distance (m) for which `contacts` holds"""
        self.version = -1
        """sum of the versions of both objects for which `rows` holds"""
        self.age = -1
        """`NarrowPhase._age` for which `near`, `nearest` and `contacts` hold"""

    def table(self) -> NDArray[np.int64]:
        """Return a table of two triangles for each pair of surfaces, empty for more than MOST_CACHED pairs."""
        pairs = len(self.a.root) * len(self.b.root)
        return np.full(pairs, -1, np.int64) if pairs <= MOST_CACHED else NO_TRIANGLES


class NarrowPhase:
    """Cache of the pairs of objects queried so far, and the workspaces of two threads; a copy is empty."""

    def __init__(self) -> None:
        self.pairs: dict[int, PairCache] = {}
        """by key, 2³²·i + j"""
        self._workspaces: list[QueryWorkspace | None] = [None, None]
        self._sizes = 1, 1
        self._age = 0
        self._pace = [0.1 * WORTH_A_THREAD] * 2  # s per pair, of `intersecting` and of `contacts`, as last measured

    def __reduce__(self) -> tuple[Any, ...]:
        return NarrowPhase, ()

    def intersecting(
        self, keys: list[int], meshes: Sequence[Any], version: Sequence[int], poses: NDArray[np.float64],
        enabled: Enabled,
    ) -> list[NDArray[np.int32]]:  # fmt: skip
        """Return for each pair (k, 4) object, surface, object, surface: the surfaces that intersect. Read-only.

        keys: 2³²·i + j of the pairs. version: of each object, changed by each move. poses: (n, 12), world frame, m.
        """
        pairs = self.pairs
        self._add(keys, meshes, enabled)
        moved = [pair for key in keys if (pair := pairs[key]).version != version[pair.i] + version[pair.j]]
        self._share(0, self._intersect, moved, version, poses)
        return [pairs[key].rows for key in keys]

    def contacts(
        self, keys: list[int], meshes: Sequence[Any], version: Sequence[int], poses: NDArray[np.float64],
        enabled: Enabled, within: float,
    ) -> list[NDArray[Any]]:  # fmt: skip
        """Return for each pair the CONTACT_DTYPE rows of surfaces at most `within` (m), or somewhat more, apart.
        Read-only."""
        pairs = self.pairs
        self._add(keys, meshes, enabled)
        moved = []
        for key in keys:
            pair = self._current(pairs[key])
            if pair.within[0] != version[pair.i] + version[pair.j] or pair.within[1] < within:
                moved.append(pair)
        self._share(1, partial(self._contacts, within), moved, version, poses)
        return [pairs[key].contacts for key in keys]

    def clearance(
        self, key: int, meshes: Sequence[Any], poses: NDArray[np.float64], enabled: Enabled,
        surfaces: tuple[int | None, int | None],
    ) -> NDArray[Any]:  # fmt: skip
        """Return one CONTACT_DTYPE row: the nearest triangles of a pair of objects, or of a surface of either."""
        self._add([key], meshes, enabled)
        pair = self._current(self.pairs[key])
        last = pair.nearest.get(surfaces)
        if last is None:
            last = pair.nearest[surfaces] = lanes_of(pair.a, pair.b, *surfaces)
        ws = self._workspaces[0] = large_enough(self._workspaces[0], *self._sizes)
        rows = np.zeros(1, CONTACT_DTYPE)
        clearance_entry.call(pair.a, pair.b, ws, poses, pair.i, pair.j, np.inf, last, rows)
        return with_surfaces(rows, meshes[pair.i], meshes[pair.j])

    def forget_nearest(self) -> None:
        """Drop contacts and nearest triangles: among equally near triangles, results depend on the last query."""
        self._age += 1

    def _current(self, pair: PairCache) -> PairCache:
        """Return a pair without results dropped by `forget_nearest`."""
        if pair.age != self._age:
            pair.near, pair.nearest, pair.within, pair.age = NO_TRIANGLES, {}, (-1, -1.0), self._age
        return pair

    def _add(self, keys: list[int], meshes: Sequence[Any], enabled: Enabled) -> None:
        new = [key for key in keys if key not in self.pairs]
        if not new:
            return
        both = [(key >> 32, key & 0xFFFFFFFF) for key in new]
        build(meshes[i] for i in {i for pair in both for i in pair})
        nodes, packets = self._sizes
        for key, (i, j) in zip(new, both, strict=True):
            a, b = bvh_of(meshes[i]), bvh_of(meshes[j])
            self.pairs[key] = PairCache(i, j, a, b, enabled(i, j))
            nodes = max(nodes, len(a.child) // LANES, len(b.child) // LANES)
            packets = max(packets, len(a.first) - 1, len(b.first) - 1)
        self._sizes = nodes, packets

    def _share(
        self, query: int, work: Callable[..., None], pairs: list[PairCache], version: Sequence[int],
        poses: NDArray[np.float64],
    ) -> None:  # fmt: skip
        """Run query number `query` for these pairs, on two threads if it would take long at the pace last measured.

        Each thread takes the next pair, so that a thread that gets no processor delays nothing.
        """
        if len(pairs) < 2:
            work(pairs, 0, version, poses)
            return
        left = iter(pairs)

        def run(thread: int) -> float:
            began = thread_time()
            work(left, thread, version, poses)
            return thread_time() - began

        other = _pool().submit(run, 1) if len(pairs) * self._pace[query] > WORTH_A_THREAD else None
        took = run(0)
        if other is not None and not other.cancel():
            took += other.result()
        self._pace[query] = took / len(pairs)

    def _intersect(
        self, pairs: Iterable[PairCache], thread: int, version: Sequence[int], poses: NDArray[np.float64]
    ) -> None:
        ws = self._workspaces[thread] = large_enough(self._workspaces[thread], *self._sizes)
        for pair in pairs:
            if not len(pair.met):
                pair.met = pair.table()
            while True:
                found = intersect_entry.call(pair.a, pair.b, ws, poses, pair.i, pair.j, pair.met, pair.enabled)
                if found >= 0:
                    break
                ws = self._workspaces[thread] = large_enough(ws, *self._sizes, pairs=~found)
            pair.rows, pair.version = ws.rows[:found].copy(), version[pair.i] + version[pair.j]

    def _contacts(
        self, within: float, pairs: Iterable[PairCache], thread: int, version: Sequence[int], poses: NDArray[np.float64]
    ) -> None:
        ws = self._workspaces[thread] = large_enough(self._workspaces[thread], *self._sizes)
        rows = np.empty(len(ws.pairs), CONTACT_DTYPE)
        for pair in pairs:
            if not len(pair.near):
                pair.near = pair.table()
            while True:
                if len(rows) != len(ws.pairs):
                    rows = np.empty(len(ws.pairs), CONTACT_DTYPE)
                given = pair.a, pair.b, ws, poses, pair.i, pair.j, within, pair.enabled, pair.near, rows
                found = contacts_entry.call(*given)
                if found >= 0:
                    break
                ws = self._workspaces[thread] = large_enough(ws, *self._sizes, pairs=~found)
            pair.contacts, pair.within = rows[:found].copy(), (version[pair.i] + version[pair.j], within)

    def forget(self, outdated: Callable[[int, int], bool]) -> None:
        """Drop the pairs (i, j) of objects that are outdated."""
        self.pairs = {key: pair for key, pair in self.pairs.items() if not outdated(pair.i, pair.j)}

    @property
    def statistics(self) -> Statistics:
        """Counts of all queries so far."""
        return sum((Statistics(*counts_of(ws)) for ws in self._workspaces if ws is not None), Statistics())


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, "collision")


os.register_at_fork(after_in_child=_pool.cache_clear)  # the child has the pool, but not its thread
