"""Accepted constraints as joints: velocity rows in world coordinates, with friction where screws have it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from physics.joints.thread import ThreadFriction
from physics.model.bodies import FREE, KINEMATIC, Bodies, Saved

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Law = Callable[[Ints], tuple[Array, Array]]
"""friction and restitution (c,) of pairs of bodies (c, 2), see `ContactSet.pair_values`"""

RANK = 1e-10
"""1: rows are redundant where singular values are below this times the largest"""


class JointConstraint(Protocol):
    """What physics needs of an accepted constraint; every class of `constraints.kinds` has it."""

    @property
    def bodies(self) -> tuple[int, int]:
        """Ids of the two bodies."""

    def residual(self, pose_a: pin.SE3, pose_b: pin.SE3) -> Array:
        """(r,) m and rad: zero where the joint holds."""

    def jacobian(self, pose_a: pin.SE3, pose_b: pin.SE3) -> tuple[Array, Array]:
        """(r, 6) each: derivatives by the local twists of the two bodies."""


def _world_rows(jacobian: Array, bodies: Bodies, i: int) -> Array:
    """Rows (r, 6) for the velocity of the centre of mass and ω in world axes, from rows for the local twist."""
    rotation = bodies.rotation[i]
    linear = jacobian[:, :3] @ rotation.T
    angular = jacobian[:, 3:] @ rotation.T
    d = bodies.origin[i] - bodies.center[i]
    return np.hstack([linear, angular + np.cross(d, linear)])


def assemble(joints: Sequence[JointConstraint], bodies: Bodies, ids: Ints) -> tuple[Ints, Array, Array, Array]:
    """Rows of all joints: bodies (g, 2) as places in `ids` or -1, Jacobians (g, 1, 12), residuals (g, 1), and rates of
    the residuals (g, 1) due to kinematic bodies.
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
    """(r,) rates of rows (r, 6) due to body i if it is kinematic."""
    return rows @ bodies.velocity[i] if bodies.kind[i] == KINEMATIC else np.zeros(len(rows))


class JointRows(NamedTuple):
    """Rows of joints for `newton.solve`: ideal rows, and blocks with friction (two normals, the sliding direction)."""

    bodies: Ints
    """(g, 2) places, -1 for bodies that do not move"""
    jacobian: Array
    """(g, 1, 12)"""
    bias: Array
    """(g, 1) m/s or rad/s, due to kinematic bodies"""
    dry_bodies: Ints
    """(d, 2)"""
    dry_jacobian: Array
    """(d, 3, 12)"""
    dry_bias: Array
    """(d, 3) m/s, due to kinematic bodies"""
    dry_friction: Array
    """(d,)"""


def joint_rows(
    joints: Sequence[JointConstraint], bodies: Bodies, ids: Ints, friction: Law, ahead: float = 0.0
) -> JointRows:
    """Velocity rows of joints of the bodies `ids`.

    A thread with friction contributes its own rows instead of its joint's, so that its friction sees all of its load;
    other joints of the same pair that let it turn are implied by it.
    ahead: s; with friction, velocities satisfy the joints as they will stand after half of this time. Centripetal loads
    then enter both half kicks of a step equally, and friction does not act on them twice.
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


def _dense(held: JointRows, n: int) -> tuple[Array, Array]:
    """Dense rows (r, 6 n) and biases (r,) of the joints of n bodies."""
    jacobian = np.concatenate([held.jacobian.reshape(-1, 2, 6), held.dry_jacobian.reshape(-1, 2, 6)])
    which = np.concatenate([held.bodies, np.repeat(held.dry_bodies, 3, axis=0)])
    rows = np.zeros((len(jacobian), n + 1, 6))  # the last is what does not move, place -1
    for side in range(2):
        rows[np.arange(len(rows)), which[:, side]] += jacobian[:, side]
    return rows[:, :n].reshape(len(rows), 6 * n), np.concatenate([held.bias.ravel(), held.dry_bias.ravel()])


def _held(
    ideal: Sequence[JointConstraint], dry: Collection[tuple[ThreadFriction, float]], bodies: Bodies, ids: Ints
) -> JointRows:
    """Rows of ideal joints and of threads with friction, as the bodies stand."""
    jb, jj, _, jbias = assemble(ideal, bodies, ids)
    if not dry:
        return JointRows(jb, jj, jbias, _NO_BODIES, _NO_BLOCKS, _NO_BIAS, _NO_FRICTION)
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
    return JointRows(
        np.concatenate([jb, np.repeat(np.array(which[::2], np.int64), 2, axis=0)]),
        np.concatenate([jj, *upright]),
        np.concatenate([jbias, *upright_bias]),
        np.array(which, np.int64), np.array(blocks), np.array(bias), np.array(coefficients),
    )  # fmt: skip


def dry_threads(
    joints: Sequence[JointConstraint], bodies: Bodies, friction: Law
) -> dict[tuple[int, int], tuple[ThreadFriction, float]]:
    """Threads that can turn and have friction, and its μ, by their pair of bodies (sorted)."""
    by_pair: dict[tuple[int, int], list[JointConstraint]] = {}
    for joint in joints:
        by_pair.setdefault(_pair(joint), []).append(joint)
    out = {}
    for pair, same in by_pair.items():
        thread = next((t for joint in same if (t := ThreadFriction.of(joint)) is not None), None)
        if thread is None:
            continue
        a, b = thread.bodies
        poses = {i: bodies.pose(i) for i in pair}
        rows = [j.jacobian(*(poses[i] for i in j.bodies))[j.bodies.index(b)] for j in same]
        if all(thread.lets(r, poses[a], poses[b]) for r in rows):
            out[pair] = thread
    mu = friction(np.array(list(out), np.int64).reshape(-1, 2))[0]
    return {pair: (out[pair], m) for pair, m in zip(out, mu.tolist(), strict=True) if m > 0.0}


def _pair(joint: JointConstraint) -> tuple[int, int]:
    a, b = joint.bodies
    return min(a, b), max(a, b)


_NO_BODIES = np.zeros((0, 2), np.int64)
_NO_ROWS = np.zeros((0, 1, 12))
_NO_RESIDUALS = np.zeros((0, 1))
_NO_BLOCKS = np.zeros((0, 3, 12))
_NO_BIAS = np.zeros((0, 3))
_NO_FRICTION = np.zeros(0)
