"""Displacements of a group that were reached by certified legs, and pushes from one to the next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import pinocchio as pin

from vpframe.planning.assembly import Array, Assembly, Budget, BudgetError, GroupStop, Knots, translation
from vpframe.planning.ways import Way

SHORTCUTS: Final = 60
"""attempts to cut a way short"""


@dataclass(frozen=True, eq=False)
class Found:
    """What a search came to."""

    way: Way | None
    stopped_by: tuple[int, ...]
    """parts that stopped it where it came farthest"""
    reached: float
    """m: how far the group's middle came, at most"""
    ended: str = ""
    """the budget that ended the search (`Budget.ended`)"""


@dataclass(frozen=True, eq=False)
class Node:
    """A displacement, and the leg by which it was reached."""

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
        self.nodes = [Node(pin.SE3.Identity(), -1, (), np.zeros((0, 3)), 0)]
        self.reached, self.stopped_by = 0.0, 0
        self._blockers: dict[int, int] = {}

    def push(self, start: pin.SE3, end: pin.SE3) -> tuple[pin.SE3, GroupStop | None]:
        """How far the group gets along one leg, and what stops it."""
        before = self.assembly.sweeps.count
        stop = self.assembly.first_stop(self.group, self.others, start, end)
        self.budget.ask(max(1, self.assembly.sweeps.count - before))
        if stop is None:
            return end, None
        self._blockers[stop.by] = self._blockers.get(stop.by, 0) + 1
        return start * pin.exp6(pin.log6(start.actInv(end)) * stop.t), stop

    def add(self, parent: int, legs: Sequence[pin.SE3], stop: GroupStop | None) -> int:
        """Keep a displacement; its place among the nodes."""
        normals = np.zeros((0, 3)) if stop is None else self._normals(stop)
        self.nodes.append(Node(legs[-1], parent, tuple(legs), normals, self.nodes[parent].depth + 1))
        moved = float(np.linalg.norm(legs[-1].act(self.center) - self.center))
        self.reached = max(self.reached, moved)
        return len(self.nodes) - 1

    def _normals(self, stop: GroupStop) -> Array:
        """Outward normals of the facets of the standing part that stop it."""
        mesh, pose = self.assembly.meshes[stop.by], self.assembly.poses[stop.by]
        corners = mesh.vertices[mesh.triangles[stop.stop.contacts["triangle_b"]]]
        n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ pose.rotation.T
        length = np.linalg.norm(n, axis=1)
        return np.asarray(n[length > 0.0] / length[length > 0.0, None])

    def exit(self, start: pin.SE3, direction: Array) -> pin.SE3:
        """Where a straight way from a displacement is clear of all others."""
        return translation(self.assembly.far(self.group, self.others, direction, start) * direction) * start

    def way(self, node: int, end: pin.SE3, direction: Array, motion: str) -> Way:
        """The way to a node, and on to `end`, cut short where a straight leg does as well."""
        legs: list[pin.SE3] = [end]
        while node > 0:
            legs = [*self.nodes[node].legs, *legs]
            node = self.nodes[node].parent
        return self.cut_short(motion, direction, [pin.SE3.Identity(), *legs])

    def cut_short(self, motion: str, direction: Array, knots: list[pin.SE3]) -> Way:
        """The way through the knots, without those that a straight leg passes by."""
        return Way(motion, direction, tuple(self._shortened(knots)), middle=self.center, radius=self.length)

    def _shortened(self, knots: list[pin.SE3]) -> list[pin.SE3]:
        """The knots without those that a direct leg, certified like the others, passes by."""
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
        """m between two displacements: of the middle, and the turn."""
        shift = np.linalg.norm(b.act(self.center) - a.act(self.center))
        return float(shift + self.length * np.linalg.norm(pin.log3(a.rotation.T @ b.rotation)))

    def found(self, way: Way | None, ended: str = "") -> Found:
        """The outcome: of parts that stopped pushes, those that did most often first, three at most."""
        worst = sorted(self._blockers, key=lambda j: (-self._blockers[j], j))[:3]
        return Found(way, tuple(sorted(worst)), self.reached, ended)
