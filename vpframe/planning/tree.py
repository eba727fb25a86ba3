"""A tree of displacements sampled in all six freedoms, after RRT (LaValle & Kuffner, "Randomized Kinodynamic Planning",
2001).

Each edge is one sweep that is never late, and goes as far as it can: a tree so grown holds nothing that has to be
certified afterwards, and enters passages as narrow as its sweeps' tolerance. Which kind of sample is drawn next is
chosen by a bandit (UCB1: Auer, Cesa-Bianchi & Fischer, Machine Learning 47, 2002); each kind has a reach of its own
that grows while it succeeds and shrinks while it fails.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import pinocchio as pin

from constraints.freedom.escape import EscapeCone
from vpframe.planning import ways
from vpframe.planning.assembly import Array, Assembly, Budget, BudgetError
from vpframe.planning.pushes import Found, Pushes

ARMS: Final = ("uniform", "cone", "axes", "tangent", "exit")
"""a displacement anywhere; a twist that the contacts at the start leave; about or along one of the group's axes;
along what stopped the node; straight out"""
GROW, SHRINK = 1.6, 0.6
LEAST: Final = 1e-4
"""of the group's size: an edge that comes less far is none"""
CURIOSITY: Final = 0.7
"""1: weight of the bandit's confidence bound"""


def search(
    assembly: Assembly, group: Sequence[int], others: Sequence[int], cone: EscapeCone, budget: Budget, seed: int
) -> Found:
    """Grow the tree until one straight edge takes the group clear, or the budget is used up."""
    pushes = Pushes(assembly, group, others, budget)
    try:
        return _Tree(pushes, cone, np.random.default_rng(seed)).grow()
    except BudgetError:
        return pushes.found(None)


class _Tree:
    def __init__(self, pushes: Pushes, cone: EscapeCone, random: np.random.Generator) -> None:
        self.pushes, self.random = pushes, random
        self.directions = ways.directions(pushes.assembly, pushes.group, pushes.others, cone)[:20]
        self.twists = cone.twists() or (np.zeros(6),)
        corners = np.concatenate([pushes.assembly.sweeps.corners(j) for j in pushes.others])
        self.low, self.high = corners.min(axis=0) - pushes.length, corners.max(axis=0) + pushes.length
        self.points = np.zeros((64, 7))  # middle and quaternion of each node
        self._note(0)
        self.scale = dict.fromkeys(ARMS, pushes.length)
        self.pulls = dict.fromkeys(ARMS, 0)
        self.gain = dict.fromkeys(ARMS, 0.0)

    def grow(self) -> Found:
        while True:
            arm = self._choose()
            node, target, direction = getattr(self, "_" + arm)()
            start = self.pushes.nodes[node].at
            self.pulls[arm] += 1
            if self.pushes.distance(start, target) < LEAST * self.pushes.length:
                continue
            reached, stop = self.pushes.push(start, target)
            if stop is None and direction is not None:
                return self.pushes.found(self.pushes.way(node, target, direction, "free"))
            came = self.pushes.distance(start, reached)
            new = came >= LEAST * self.pushes.length
            if new:
                self._note(self.pushes.add(node, [reached], stop))
            self.gain[arm] += min(1.0, self._novelty(reached) / self.pushes.length) if new else 0.0
            if arm != "exit":
                grown = self.scale[arm] * (GROW if stop is None else SHRINK)
                self.scale[arm] = float(np.clip(grown, 1e-2 * self.pushes.length, 4.0 * self.pushes.length))

    def _choose(self) -> str:
        for arm in ARMS:
            if self.pulls[arm] == 0:
                return arm
        total = float(np.log(sum(self.pulls.values())))
        worth = {a: self.gain[a] / self.pulls[a] + CURIOSITY * np.sqrt(total / self.pulls[a]) for a in ARMS}
        return max(ARMS, key=lambda a: worth[a])

    def _note(self, place: int) -> None:
        if place == len(self.points):
            self.points = np.concatenate([self.points, np.zeros_like(self.points)])
        at = self.pushes.nodes[place].at
        self.points[place, :3] = at.act(self.pushes.center)
        self.points[place, 3:] = pin.Quaternion(at.rotation).coeffs()

    def _distances(self, at: pin.SE3) -> Array:
        n = len(self.pushes.nodes)
        shift = np.linalg.norm(self.points[:n, :3] - at.act(self.pushes.center), axis=1)
        cosine = np.abs(self.points[:n, 3:] @ pin.Quaternion(at.rotation).coeffs())
        return np.asarray(shift + 2.0 * self.pushes.length * np.arccos(np.minimum(cosine, 1.0)))

    def _novelty(self, at: pin.SE3) -> float:
        """m from the nearest node but the newest."""
        d = self._distances(at)[:-1]
        return float(d.min()) if len(d) else self.pushes.length

    def _node(self) -> int:
        """A node: late ones, which came farther, as often as all."""
        n = len(self.pushes.nodes)
        low = max(0, n - 20) if self.random.random() < 0.5 else 0
        return int(self.random.integers(low, n))

    def _moved(self, node: int, twist: Array, far: float) -> pin.SE3:
        """A node's displacement, moved along a world twist about the group's middle by `far` m."""
        at = self.pushes.nodes[node].at
        middle = at.act(self.pushes.center)
        v, w = twist[:3], twist[3:]
        size = max(float(np.linalg.norm(v)), self.pushes.length * float(np.linalg.norm(w)), 1e-12)
        v, w = v * far / size, w * far / size
        turn = float(np.linalg.norm(w))
        if turn > 2.5:
            v, w = v * 2.5 / turn, w * 2.5 / turn
        rotation = pin.exp3(w)
        return pin.SE3(rotation, middle + v - rotation @ middle) * at

    # -- arms: (node, target, direction if it is an exit)

    def _uniform(self) -> tuple[int, pin.SE3, Array | None]:
        middle = self.random.uniform(self.low, self.high)
        q = self.random.normal(size=4)
        rotation = pin.Quaternion(q / np.linalg.norm(q)).toRotationMatrix()
        target = pin.SE3(rotation, middle - rotation @ self.pushes.center)
        node = int(np.argmin(self._distances(target)))
        start = self.pushes.nodes[node].at
        share = min(1.0, self.scale["uniform"] / max(self.pushes.distance(start, target), 1e-12))
        turn = float(np.linalg.norm(pin.log3(start.rotation.T @ target.rotation)))
        share = min(share, 2.5 / turn if turn > 0.0 else 1.0)
        rotation = start.rotation @ pin.exp3(share * pin.log3(start.rotation.T @ target.rotation))
        at = start.act(self.pushes.center) * (1.0 - share) + share * middle
        return node, pin.SE3(rotation, at - rotation @ self.pushes.center), None

    def _cone(self) -> tuple[int, pin.SE3, Array | None]:
        weight = self.random.random(len(self.twists)) ** 4
        node = self._node()
        turn = self.pushes.nodes[node].at.rotation
        twist = weight @ np.array(self.twists)
        twist = np.concatenate([turn @ twist[:3], turn @ twist[3:]])
        return node, self._moved(node, twist, self.scale["cone"] * self.random.random()), None

    def _axes(self) -> tuple[int, pin.SE3, Array | None]:
        node, twist = self._node(), np.zeros(6)
        twist[self.random.integers(6)] = self.random.choice([-1.0, 1.0])
        return node, self._moved(node, twist, self.scale["axes"] * self.random.random()), None

    def _tangent(self) -> tuple[int, pin.SE3, Array | None]:
        node = self._node()
        v, w = self.random.normal(size=3), self.random.normal(size=3) / self.pushes.length
        for normal in self.pushes.nodes[node].normals:
            v = v - min(float(v @ normal), 0.0) * normal
        if self.random.random() < 0.5:
            w *= 0.0
        return node, self._moved(node, np.concatenate([v, w]), self.scale["tangent"] * self.random.random()), None

    def _exit(self) -> tuple[int, pin.SE3, Array | None]:
        node = self._node()
        if self.random.random() < 0.7:
            direction = self.directions[int(self.random.integers(len(self.directions)))]
        else:
            direction = ways.unit(self.random.normal(size=3))
        return node, self.pushes.exit(self.pushes.nodes[node].at, direction), direction
