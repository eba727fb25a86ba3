"""OMPL's sampling planners as peers: the same parts, the same intersection queries, edges checked at sampled states.

They are told where to go (the end of a way that was found) and search six freedoms between; what meets where the parts
stand may go on meeting. Raises ImportError where `ompl` is not installed.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pinocchio as pin
from ompl import base, geometric, util

import vpframe as vp
from collision import CollisionManager
from vpframe.planning.assembly import Assembly

PLANNERS = ("RRT", "RRTConnect", "KPIECE1")
RESOLUTION = 2e-3
"""of the space's extent, between states of an edge that are checked"""


def solve(scene: vp.Scene, part: str, planner: str, end: pin.SE3, seconds: float) -> tuple[float, bool]:
    """(seconds it took, whether it found a way) from where a part stands to a displacement of it."""
    util.setLogLevel(util.LOG_NONE)
    assembly, i = Assembly(scene), scene.index(part)
    world = CollisionManager()
    for k, placed in enumerate(scene.parts):
        world.add(placed.mesh, placed.pose, movable=k == i)
    for j in range(len(scene)):
        for mine, theirs in assembly.excused(i, j) if j != i else ():
            world.ignore_surfaces(i, mine, j, theirs)
    start = scene[part].pose
    meeting = {tuple(row) for row in world.colliding_surfaces([i]).tolist()}
    space = base.SE3StateSpace()
    low, high = (
        np.min([start.translation, (end * start).translation], axis=0),
        np.max([start.translation, (end * start).translation], axis=0),
    )
    room = 2.0 * assembly.size(i)
    bounds = base.RealVectorBounds(3)
    for d in range(3):
        bounds.setLow(d, float(low[d] - room))
        bounds.setHigh(d, float(high[d] + room))
    space.setBounds(bounds)

    def valid(state: Any) -> bool:
        r = state.rotation()
        turn = pin.Quaternion(r.w, r.x, r.y, r.z).normalized().toRotationMatrix()
        world.set_pose(i, pin.SE3(turn, np.array([state.getX(), state.getY(), state.getZ()])))
        return {tuple(row) for row in world.colliding_surfaces([i]).tolist()} <= meeting

    setup = geometric.SimpleSetup(space)
    setup.setStateValidityChecker(valid)
    information = setup.getSpaceInformation()
    information.setStateValidityCheckingResolution(RESOLUTION)
    setup.setStartAndGoalStates(_state(space, start), _state(space, end * start))
    setup.setPlanner(getattr(geometric, planner)(information))
    began = time.perf_counter()
    setup.solve(seconds)
    return time.perf_counter() - began, bool(setup.haveExactSolutionPath())


def _state(space: Any, pose: pin.SE3) -> Any:
    state = space.allocState()
    state.setX(float(pose.translation[0]))
    state.setY(float(pose.translation[1]))
    state.setZ(float(pose.translation[2]))
    q, r = pin.Quaternion(pose.rotation), state.rotation()
    r.x, r.y, r.z, r.w = float(q.x), float(q.y), float(q.z), float(q.w)
    return state
