"""Displacements of a group reached by swept legs, and pushes between them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import pinocchio as pin

from vpframe.planning.assembly import Array, Assembly, Budget, BudgetError, GroupStop, Knots, translation
from vpframe.planning.ways import RemovalPath

SHORTCUTS: Final = 60
"""attempts to shortcut a path"""


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The result of a search for a way."""

    way: RemovalPath | None
    stopped_by: tuple[int, ...]
    """parts that blocked most pushes, three at most, ascending"""
    last: tuple[tuple[int, int, int, int], ...]
    """part, surface, blocking part, its surface: the contacts that stopped the last push"""
    reached: float
    """largest displacement of the group's middle, m"""
    ended: str = ""
    """the budget that ended the search (`Budget.ended`)"""


@dataclass(frozen=True, eq=False)
class Displacement:
    """A displacement that was reached, and the leg that led there."""

    at: pin.SE3
    parent: int
    legs: Knots
    """displacements passed since the parent's, this one the last"""
    normals: Array
    """(k, 3) unit, world: out of what stopped the leg"""
    depth: int


class Pushes:
    """The displacements of a group that a search has reached."""

    def __init__(self, assembly: Assembly, group: Sequence[int], others: Sequence[int], budget: Budget) -> None:
        self.assembly, self.group, self.others, self.budget = assembly, tuple(group), tuple(others), budget
        frame = assembly.poses[self.group[0]]  # of the group itself, so that nothing hangs on how the scene is turned
        corners = np.concatenate([assembly.sweeps.corners(i) for i in group])
        local = (corners - frame.translation) @ frame.rotation
        low, high = local.min(axis=0), local.max(axis=0)
        self.center = np.asarray(frame.act(0.5 * (low + high)))
        self.length = 0.5 * float(np.linalg.norm(high - low))
        """m: a turn of 1 rad counts as this much"""
        self.nodes = [Displacement(pin.SE3.Identity(), -1, (), np.zeros((0, 3)), 0)]
        self.reached, self.stopped_by = 0.0, 0
        self.last: tuple[tuple[int, int, int, int], ...] = ()
        """`SearchResult.last`"""
        self._blockers: dict[int, int] = {}

    def push(self, start: pin.SE3, end: pin.SE3) -> tuple[pin.SE3, GroupStop | None]:
        """Sweep one leg: the displacement reached, and the stop if there is one."""
        before = self.assembly.sweeps.count
        stop = self.assembly.first_stop(self.group, self.others, start, end)
        self.budget.ask(max(1, self.assembly.sweeps.count - before))
        if stop is None:
            return end, None
        faces = zip(stop.stop.contacts["surface_a"].tolist(), stop.stop.contacts["surface_b"].tolist(), strict=True)
        self.note(stop.by, [(stop.part, a, stop.by, b) for a, b in sorted(faces)])
        return start * pin.exp6(pin.log6(start.actInv(end)) * stop.t), stop

    def note(self, blocker: int, contacts: Iterable[tuple[int, int, int, int]]) -> None:
        """Record which part stopped a push, and the contacts as in `SearchResult.last`."""
        self._blockers[blocker] = self._blockers.get(blocker, 0) + 1
        self.last = tuple(contacts)

    def add(self, parent: int, legs: Sequence[pin.SE3], stop: GroupStop | None) -> int:
        """Add a displacement; returns its index."""
        normals = np.zeros((0, 3)) if stop is None else self._normals(stop)
        self.nodes.append(Displacement(legs[-1], parent, tuple(legs), normals, self.nodes[parent].depth + 1))
        moved = float(np.linalg.norm(legs[-1].act(self.center) - self.center))
        self.reached = max(self.reached, moved)
        return len(self.nodes) - 1

    def _normals(self, stop: GroupStop) -> Array:
        """(k, 3) outward unit normals, world, of the blocking facets of the static part."""
        mesh, pose = self.assembly.meshes[stop.by], self.assembly.poses[stop.by]
        corners = mesh.vertices[mesh.triangles[stop.stop.contacts["triangle_b"]]]
        n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ pose.rotation.T
        length = np.linalg.norm(n, axis=1)
        return np.asarray(n[length > 0.0] / length[length > 0.0, None])

    def exit(self, start: pin.SE3, direction: Array) -> pin.SE3:
        """The displacement at which a straight path is clear of all others."""
        return translation(self.assembly.far(self.group, self.others, direction, start) * direction) * start

    def way(self, node: int, end: pin.SE3, direction: Array, motion: str) -> RemovalPath:
        """The path to a node, and on to `end`, with shortcuts."""
        legs: list[pin.SE3] = [end]
        while node > 0:
            legs = [*self.nodes[node].legs, *legs]
            node = self.nodes[node].parent
        return self.cut_short(motion, direction, [pin.SE3.Identity(), *legs])

    def cut_short(self, motion: str, direction: Array, knots: list[pin.SE3]) -> RemovalPath:
        """The path through the knots, with shortcuts."""
        return RemovalPath(motion, direction, tuple(self._shortened(knots)), middle=self.center, radius=self.length)

    def _shortened(self, knots: list[pin.SE3]) -> list[pin.SE3]:
        """Shortcut the knots by direct legs, each swept."""
        tries = 0
        span = len(knots) - 1
        while span >= 2 and tries < SHORTCUTS:
            k = 0
            while k + span < len(knots) and tries < SHORTCUTS:
                tries += 1
                start, end = knots[k], knots[k + span]
                if self._far(knots[k : k + span + 1]) > 1.001 * self._far([start, end]) or span == 2:
                    try:
                        if np.linalg.norm(pin.log3(start.rotation.T @ end.rotation)) < 2.5:
                            _, stop = self.push(start, end)
                            if stop is None:
                                del knots[k + 1 : k + span]
                    except BudgetError:
                        return knots
                k += 1
            span = min(span - 1, len(knots) - 1)
        return knots

    def _far(self, knots: Sequence[pin.SE3]) -> float:
        return sum(self.distance(a, b) for a, b in pairwise(knots))

    def distance(self, a: pin.SE3, b: pin.SE3) -> float:
        """Distance of two displacements: shift of the centre plus `length` times the angle, m."""
        shift = np.linalg.norm(b.act(self.center) - a.act(self.center))
        return float(shift + self.length * np.linalg.norm(pin.log3(a.rotation.T @ b.rotation)))

    def found(self, way: RemovalPath | None, ended: str = "") -> SearchResult:
        """The result of the search with these pushes."""
        worst = sorted(self._blockers, key=lambda j: (-self._blockers[j], j))[:3]
        return SearchResult(way, tuple(sorted(worst)), self.last, self.reached, ended)
