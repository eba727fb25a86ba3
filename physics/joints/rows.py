"""Accepted constraints as joints: their rows in the world's coordinates, and the dry ones among them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from physics.joints.thread import Thread
from physics.model.bodies import FREE, KINEMATIC, Bodies, Saved

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Law = Callable[[Ints], tuple[Array, Array]]
"""friction and restitution (c,) of pairs of bodies (c, 2), see `Touching.pair_values`"""

RANK = 1e-10
"""1: singular values of joints' rows below this times the largest are redundancy"""


class Joint(Protocol):
    """What physics needs of an accepted constraint; `constraints.kinds` are such."""

    @property
    def bodies(self) -> tuple[int, int]:
        """Ids of the two bodies."""

    def residual(self, pose_a: pin.SE3, pose_b: pin.SE3) -> Array:
        """(r,) m and rad: zero where the joint holds."""

    def jacobian(self, pose_a: pin.SE3, pose_b: pin.SE3) -> tuple[Array, Array]:
        """(r, 6) each: derivatives by the local twists of the two bodies."""


def _world_rows(jacobian: Array, bodies: Bodies, i: int) -> Array:
    """Rows (r, 6) by a local twist, rewritten for the velocity of the centre of mass and ω in world axes."""
    rotation = bodies.rotation[i]
    linear = jacobian[:, :3] @ rotation.T
    angular = jacobian[:, 3:] @ rotation.T
    d = bodies.origin[i] - bodies.center[i]
    return np.hstack([linear, angular + np.cross(d, linear)])


def assemble(joints: Sequence[Joint], bodies: Bodies, ids: Ints) -> tuple[Ints, Array, Array, Array]:
    """Rows of all joints: bodies (g, 2) as places in `ids` or -1, Jacobians (g, 1, 12), residuals (g, 1), and the rates
    (g, 1) at which what carries them (a path, a hand) changes those.
    """
    if not joints:
        return _NO_BODIES, _NO_ROWS, _NO_RESIDUALS, _NO_RESIDUALS
    place = {int(i): k for k, i in enumerate(ids)}
    which, rows, residuals, carried = [], [], [], []
    for joint in joints:
        a, b = joint.bodies
        pose_a, pose_b = bodies.pose(a), bodies.pose(b)
        residual = np.asarray(joint.residual(pose_a, pose_b))
        by_a, by_b = joint.jacobian(pose_a, pose_b)
        local = [place.get(i, -1) if bodies.kind[i] == FREE else -1 for i in (a, b)]
        sides = [_world_rows(by_a, bodies, a), _world_rows(by_b, bodies, b)]
        rows.append(np.hstack(sides))
        residuals.append(residual)
        carried.append(sum(_carried(rows, bodies, i) for rows, i in zip(sides, (a, b), strict=True)))
        which.append(np.tile(local, (len(residual), 1)))
    return (
        np.ascontiguousarray(np.concatenate(which), dtype=np.int64),
        np.ascontiguousarray(np.concatenate(rows)[:, None, :]),
        np.ascontiguousarray(np.concatenate(residuals)[:, None]),
        np.ascontiguousarray(np.concatenate(carried)[:, None]),
    )


def _carried(rows: Array, bodies: Bodies, i: int) -> Array:
    """(r,) what a body that is carried adds to the speeds of rows (r, 6)."""
    return rows @ bodies.velocity[i] if bodies.kind[i] == KINEMATIC else np.zeros(len(rows))


class Holding(NamedTuple):
    """Rows of joints as `solver.solve` takes them: ideal ones, and dry ones (two normals, and the way they slide)."""

    bodies: Ints
    """(g, 2) places, -1 for what does not move"""
    jacobian: Array
    """(g, 1, 12)"""
    bias: Array
    """(g, 1) m/s or rad/s, of what carries them"""
    dry_bodies: Ints
    """(d, 2)"""
    dry_jacobian: Array
    """(d, 3, 12)"""
    dry_bias: Array
    """(d, 3) m/s, of what carries them"""
    dry_friction: Array
    """(d,)"""


def holding(joints: Sequence[Joint], bodies: Bodies, ids: Ints, friction: Law, ahead: float = 0.0) -> Holding:
    """The rows that hold the velocities of the bodies `ids`.

    A thread whose pair has friction is held by its own rows instead of its joint's, so that all of its load is known
    where it rubs; what else joins the pair and lets it turn is implied.
    ahead: s, of motion as it is, half of which the velocities are to foresee where threads rub. What bends the bodies'
    ways then loads both half kicks of a step alike; else their loads, and friction, would sum up to too much.
    """
    dry = dry_threads(joints, bodies, friction)
    ideal = [j for j in joints if _pair(j) not in dry]
    held = _held(ideal, dry.values(), bodies, ids)
    if ahead == 0.0 or not dry:
        return held
    moving = np.unique([i for j in joints for i in j.bodies])
    start = Saved(bodies, moving)
    start.carry(bodies, moving, np.full(len(moving), ahead))
    then = _held(ideal, dry.values(), bodies, ids)
    start.restore(bodies)
    v = bodies.velocity[ids].ravel()
    rows, bias = _dense(held, len(ids))
    later, later_bias = _dense(then, len(ids))
    change = 0.5 * (later @ v + later_bias - rows @ v - bias)
    change = rows @ np.linalg.lstsq(rows, change, rcond=RANK)[0]  # redundant rows must not contradict one another
    g = len(held.bias)
    return held._replace(bias=held.bias + change[:g, None], dry_bias=held.dry_bias + change[g:].reshape(-1, 3))


def _dense(held: Holding, n: int) -> tuple[Array, Array]:
    """All rows (r, 6 n) and biases (r,) of joints of n bodies."""
    jacobian = np.concatenate([held.jacobian.reshape(-1, 2, 6), held.dry_jacobian.reshape(-1, 2, 6)])
    which = np.concatenate([held.bodies, np.repeat(held.dry_bodies, 3, axis=0)])
    rows = np.zeros((len(jacobian), n + 1, 6))  # the last is what does not move, place -1
    for side in range(2):
        rows[np.arange(len(rows)), which[:, side]] += jacobian[:, side]
    return rows[:, :n].reshape(len(rows), 6 * n), np.concatenate([held.bias.ravel(), held.dry_bias.ravel()])


def _held(ideal: Sequence[Joint], dry: Collection[tuple[Thread, float]], bodies: Bodies, ids: Ints) -> Holding:
    """The rows of ideal joints, and of threads with friction, as the bodies stand."""
    jb, jj, _, jbias = assemble(ideal, bodies, ids)
    if not dry:
        return Holding(jb, jj, jbias, _NO_BODIES, _NO_BLOCKS, _NO_BIAS, _NO_FRICTION)
    place = {int(i): k for k, i in enumerate(ids)}
    upright, upright_bias, blocks, bias, which = [], [], [], [], []
    coefficients: list[float] = []
    for thread, m in dry:
        linear, angular, point = thread.rows(bodies.pose(thread.bodies[0]))
        tilts = np.hstack([np.zeros((2, 3)), linear[1:3]])
        local, sides, carried = [], [], np.zeros(6)
        for i, sign in zip(thread.bodies, (-1.0, 1.0), strict=True):
            slide = np.hstack([linear, np.cross(point - bodies.center[i], linear) + angular])
            sides.append(sign * np.concatenate([slide, tilts]))
            local.append(place.get(i, -1) if bodies.kind[i] == FREE else -1)
            carried += _carried(sides[-1], bodies, i)
        rows = np.hstack(sides)
        blocks += [rows[[0, 0, 3]] * [[1.0], [0.0], [1.0]], rows[1:4]]
        bias += [carried[[0, 0, 3]] * [1.0, 0.0, 1.0], carried[1:4]]
        coefficients += thread.friction(m)
        which += [local, local]
        upright.append(rows[4:, None, :])
        upright_bias.append(carried[4:, None])
    return Holding(
        np.concatenate([jb, np.repeat(np.array(which[::2], np.int64), 2, axis=0)]),
        np.concatenate([jj, *upright]),
        np.concatenate([jbias, *upright_bias]),
        np.array(which, np.int64), np.array(blocks), np.array(bias), np.array(coefficients),
    )  # fmt: skip


def dry_threads(joints: Sequence[Joint], bodies: Bodies, friction: Law) -> dict[tuple[int, int], tuple[Thread, float]]:
    """The threads that can turn among some joints, and do so with friction μ, by their pair of bodies (sorted)."""
    by_pair: dict[tuple[int, int], list[Joint]] = {}
    for joint in joints:
        by_pair.setdefault(_pair(joint), []).append(joint)
    out = {}
    for pair, same in by_pair.items():
        thread = next((t for joint in same if (t := Thread.of(joint)) is not None), None)
        if thread is None:
            continue
        a, b = thread.bodies
        poses = {i: bodies.pose(i) for i in pair}
        rows = [j.jacobian(*(poses[i] for i in j.bodies))[j.bodies.index(b)] for j in same]
        if all(thread.lets(r, poses[a], poses[b]) for r in rows):
            out[pair] = thread
    mu = friction(np.array(list(out), np.int64).reshape(-1, 2))[0]
    return {pair: (out[pair], m) for pair, m in zip(out, mu.tolist(), strict=True) if m > 0.0}


def _pair(joint: Joint) -> tuple[int, int]:
    a, b = joint.bodies
    return min(a, b), max(a, b)


_NO_BODIES = np.zeros((0, 2), np.int64)
_NO_ROWS = np.zeros((0, 1, 12))
_NO_RESIDUALS = np.zeros((0, 1))
_NO_BLOCKS = np.zeros((0, 3, 12))
_NO_BIAS = np.zeros((0, 3))
_NO_FRICTION = np.zeros(0)
