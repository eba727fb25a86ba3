"""OMPL's sampling planners as peers: the same parts, the same intersection queries, edges checked at sampled states.

They search six freedoms for any displacement at which the part's box is apart from that of all others, as our planner
does: told a place to go to instead, their first edge is often the answer. What meets where the parts stand may go on
meeting. Raises ImportError where `ompl` is not installed.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from ompl import base, geometric, util

import vpframe as vp
from collision import CollisionManager
from vpframe.planning.assembly import Assembly

PLANNERS = ("RRT", "RRTConnect", "KPIECE1")
RESOLUTION = 1e-2
"""of the part's size, and rad, between states of an edge that are checked: as in our own tree"""


class Apart(base.GoalSampleableRegion):  # type: ignore[misc]
    """The poses at which a part's box is apart from a box that holds all others."""

    def __init__(self, information: Any, corners: NDArray[np.float64], box: NDArray[np.float64], seed: int = 0) -> None:
        super().__init__(information)
        self.setThreshold(1e-9)
        self._corners, self._box, self._random = corners, box, np.random.default_rng(seed)
        self._radius = float(np.linalg.norm(corners, axis=1).max())

    def distanceGoal(self, state: Any) -> float:
        """m by which the boxes have to be moved apart; 0 where they are."""
        pose = _pose(state)
        at = self._corners @ pose.rotation.T + pose.translation
        return max(0.0, float(-np.maximum(at.min(axis=0) - self._box[1], self._box[0] - at.max(axis=0)).max()))

    def sampleGoal(self, state: Any) -> None:
        """Beyond a random side of the box, turned at random."""
        d, above = int(self._random.integers(3)), int(self._random.integers(2))
        place = self._random.uniform(self._box[0], self._box[1])
        place[d] = self._box[above, d] + (2 * above - 1) * 1.01 * self._radius
        q = self._random.normal(size=4)
        _set(state, pin.SE3(pin.Quaternion(q / np.linalg.norm(q)).toRotationMatrix(), place))

    def maxSampleCount(self) -> int:
        """Without end."""
        return 1 << 30


def solve(scene: vp.Scene, part: str, planner: str, seconds: float) -> tuple[float, bool]:
    """(seconds it took, whether it found a way) from where a part stands to where it is apart from all others."""
    util.setLogLevel(util.LOG_NONE)
    assembly, i = Assembly(scene), scene.index(part)
    others = [j for j in range(len(scene)) if j != i]
    world = CollisionManager()
    for k, placed in enumerate(scene.parts):
        world.add(placed.mesh, placed.pose, movable=k == i)
    for j in others:
        for mine, theirs in assembly.excused(i, j):
            world.ignore_surfaces(i, mine, j, theirs)
    start = scene[part].pose
    meeting = {tuple(row) for row in world.colliding_surfaces([i]).tolist()}
    fixed = np.concatenate([assembly.sweeps.corners(j) for j in others])
    box = np.array([fixed.min(axis=0), fixed.max(axis=0)])
    space = base.SE3StateSpace()
    room = 2.5 * assembly.size(i)
    bounds = base.RealVectorBounds(3)
    for d in range(3):
        bounds.setLow(d, float(min(box[0, d], start.translation[d]) - room))
        bounds.setHigh(d, float(max(box[1, d], start.translation[d]) + room))
    space.setBounds(bounds)
    for k, step in enumerate((RESOLUTION * assembly.size(i), RESOLUTION)):
        each = space.getSubspace(k)
        each.setLongestValidSegmentFraction(step / each.getMaximumExtent())

    def valid(state: Any) -> bool:
        world.set_pose(i, _pose(state))
        return {tuple(row) for row in world.colliding_surfaces([i]).tolist()} <= meeting

    setup = geometric.SimpleSetup(space)
    setup.setStateValidityChecker(valid)
    information = setup.getSpaceInformation()
    begin = space.allocState()
    _set(begin, start)
    setup.setStartState(begin)
    mesh = assembly.meshes[i]
    setup.setGoal(Apart(information, mesh.vertices[np.unique(mesh.triangles)], box))
    setup.setPlanner(getattr(geometric, planner)(information))
    began = time.perf_counter()
    setup.solve(seconds)
    return time.perf_counter() - began, bool(setup.haveExactSolutionPath())


def _pose(state: Any) -> pin.SE3:
    r = state.rotation()
    turn = pin.Quaternion(r.w, r.x, r.y, r.z).normalized().toRotationMatrix()
    return pin.SE3(turn, np.array([state.getX(), state.getY(), state.getZ()]))


def _set(state: Any, pose: pin.SE3) -> None:
    x, y, z = map(float, pose.translation)
    state.setX(x)
    state.setY(y)
    state.setZ(z)
    q, r = pin.Quaternion(pose.rotation), state.rotation()
    r.x, r.y, r.z, r.w = float(q.x), float(q.y), float(q.z), float(q.w)
