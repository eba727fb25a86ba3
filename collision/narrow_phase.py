"""The pairs of objects of a manager that have come near: what was answered about them, and when.

Pairs of which neither object has moved since are not asked again; of the others the triangles that met, or were
nearest, are looked at first. With enough pairs, two threads share them; answers do not depend on it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from collision.bvh.build import build, bvh_of
from collision.bvh.layout import LANES, Bvh
from collision.bvh.traverse import Workspace, counts_of, large_enough
from collision.contact import CONTACT_DTYPE
from collision.query.distance import clearance_of, contacts_of, lanes_of, with_surfaces
from collision.query.intersection import intersect_of
from collision.statistics import Statistics

REMEMBERED: Final = 1 << 16
"""pairs of surfaces beyond which nothing is remembered of a pair of objects"""
WORTH_A_THREAD: Final = 4
"""pairs of objects that take longer than handing them to a thread"""
NO_PAIRS, ALL, NO_ROWS = np.empty(0, np.int64), np.empty(0, np.uint8), np.empty((0, 4), np.int32)
Enabled = Callable[[int, int], NDArray[np.uint8] | None]
"""(ka, kb), 0 for the pairs of surfaces of two objects that are left out; None if none is"""


class PairCache:
    """A pair of objects: what was answered, when, and which triangles met or were nearest."""

    __slots__ = (
        "a",
        "asked",
        "b",
        "contacts",
        "enabled",
        "i",
        "j",
        "met",
        "near",
        "nearest",
        "rows",
        "version",
        "within",
    )

    def __init__(self, i: int, j: int, a: Bvh, b: Bvh, enabled: NDArray[np.uint8] | None) -> None:
        self.i, self.j, self.a, self.b = i, j, a, b
        self.enabled = ALL if enabled is None else enabled.ravel()
        self.met = self.near = NO_PAIRS
        self.nearest: dict[tuple[int | None, int | None], NDArray[np.int64]] = {}
        """what `query.distance.clearance` takes as `last`, for the surfaces asked about"""
        self.rows: NDArray[np.int32] = NO_ROWS
        """(k, 4) object, surface, object, surface"""
        self.contacts: NDArray[Any] = np.empty(0, CONTACT_DTYPE)
        self.within = (-1, -1.0)
        """when, and within what distance (m), `contacts` was answered"""
        self.version = self.asked = -1
        """how often both had been moved when `rows` was answered; the same of the question that is being answered"""

    def remembering(self) -> NDArray[np.int64]:
        """A table for two triangles a pair of surfaces, if there are not too many."""
        pairs = len(self.a.root) * len(self.b.root)
        return np.full(pairs, -1, np.int64) if pairs <= REMEMBERED else NO_PAIRS


class NarrowPhase:
    """The pairs of objects that have come near, and the workspaces of two threads; a copy of it is empty."""

    def __init__(self) -> None:
        self.pairs: dict[int, PairCache] = {}
        """by 2^32·i + j"""
        self._workspaces: list[Workspace | None] = [None, None]
        self._sizes = 1, 1

    def __reduce__(self) -> tuple[Any, ...]:
        return NarrowPhase, ()

    def intersecting(
        self, keys: list[int], meshes: Sequence[Any], version: Sequence[int], poses: NDArray[np.float64],
        enabled: Enabled,
    ) -> list[NDArray[np.int32]]:  # fmt: skip
        """Of each pair the rows object, surface, object, surface that intersect; not to be written to.

        version: how often each object has been moved.
        """
        pairs = self.pairs
        self._add(keys, meshes, enabled)
        asked = []
        for key in keys:
            pair = pairs[key]
            pair.asked = version[pair.i] + version[pair.j]
            if pair.asked != pair.version:
                asked.append(pair)
        self._share(self._intersect, asked, poses)
        return [pairs[key].rows for key in keys]

    def contacts(
        self, keys: list[int], meshes: Sequence[Any], version: Sequence[int], poses: NDArray[np.float64],
        enabled: Enabled, within: float,
    ) -> list[NDArray[Any]]:  # fmt: skip
        """Of each pair the surfaces at most `within` (m) apart, CONTACT_DTYPE rows; not to be written to."""
        pairs = self.pairs
        self._add(keys, meshes, enabled)
        asked = []
        for key in keys:
            pair = pairs[key]
            wanted = version[pair.i] + version[pair.j], within
            if pair.within != wanted:
                pair.within = wanted
                asked.append(pair)
        try:
            self._share(self._contacts, asked, poses)
        except BaseException:
            for pair in asked:
                pair.within = (-1, -1.0)
            raise
        return [pairs[key].contacts for key in keys]

    def clearance(
        self, key: int, meshes: Sequence[Any], poses: NDArray[np.float64], enabled: Enabled,
        surfaces: tuple[int | None, int | None],
    ) -> NDArray[Any]:  # fmt: skip
        """One CONTACT_DTYPE row: the nearest triangles of a pair of objects, or of a surface of either."""
        self._add([key], meshes, enabled)
        pair = self.pairs[key]
        last = pair.nearest.get(surfaces)
        if last is None:
            last = pair.nearest[surfaces] = lanes_of(pair.a, pair.b, *surfaces)
        ws = self._workspaces[0] = large_enough(self._workspaces[0], *self._sizes)
        rows = np.zeros(1, CONTACT_DTYPE)
        clearance_of(pair.a, pair.b, ws, poses, pair.i, pair.j, np.inf, last, rows)
        return with_surfaces(rows, meshes[pair.i], meshes[pair.j])

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

    def _share(self, work: Callable[..., None], asked: list[PairCache], poses: NDArray[np.float64]) -> None:
        if len(asked) >= 2 * WORTH_A_THREAD:
            other = _pool().submit(work, asked[1::2], 1, poses)
            work(asked[::2], 0, poses)
            other.result()
        elif asked:
            work(asked, 0, poses)

    def _intersect(self, asked: list[PairCache], which: int, poses: NDArray[np.float64]) -> None:
        ws = self._workspaces[which] = large_enough(self._workspaces[which], *self._sizes)
        for pair in asked:
            if not len(pair.met):
                pair.met = pair.remembering()
            while True:
                found = intersect_of(pair.a, pair.b, ws, poses, pair.i, pair.j, pair.met, pair.enabled)
                if found >= 0:
                    break
                ws = self._workspaces[which] = large_enough(ws, *self._sizes, pairs=~found)
            pair.rows, pair.version = ws.rows[:found].copy(), pair.asked

    def _contacts(self, asked: list[PairCache], which: int, poses: NDArray[np.float64]) -> None:
        ws = self._workspaces[which] = large_enough(self._workspaces[which], *self._sizes)
        for pair in asked:
            if not len(pair.near):
                pair.near = pair.remembering()
            within = pair.within[1]
            while True:
                rows = np.zeros(len(ws.pairs), CONTACT_DTYPE)
                found = contacts_of(pair.a, pair.b, ws, poses, pair.i, pair.j, within, pair.enabled, pair.near, rows)
                if found >= 0:
                    break
                ws = self._workspaces[which] = large_enough(ws, *self._sizes, pairs=~found)
            pair.contacts = rows[:found].copy()

    def forget(self, keep: Callable[[int, int], bool]) -> None:
        """Forget the pairs that are not to be kept."""
        self.pairs = {key: pair for key, pair in self.pairs.items() if keep(pair.i, pair.j)}

    @property
    def statistics(self) -> Statistics:
        """Counts of all questions so far."""
        return sum((Statistics(*counts_of(ws)) for ws in self._workspaces if ws is not None), Statistics())


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, "collision")


os.register_at_fork(after_in_child=_pool.cache_clear)  # its thread is not in the child, where a result never came
