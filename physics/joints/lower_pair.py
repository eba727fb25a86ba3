"""The lower pair that constraints leave between two bodies, and Pinocchio's joint for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from physics.joints.rows import Joint

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LowerPair:
    """The joint between two bodies: its name and its frame (z along the axis) in the second body's mesh frame."""

    name: str
    """"rigid", "revolute", "prismatic", "screw", "cylindrical", "planar", "spherical" or "free\""""
    frame: pin.SE3
    pitch: float = 0.0
    """m/rad, of a screw"""


def lower_pair(joints: Sequence[Joint], child: int, pose_parent: pin.SE3, pose_child: pin.SE3) -> LowerPair | None:
    """The lower pair that constraints between two bodies leave at these poses, or None if it is none of them."""
    rows = []
    for joint in joints:
        a, _ = joint.bodies
        poses = (pose_child, pose_parent) if a == child else (pose_parent, pose_child)
        by_a, by_b = joint.jacobian(*poses)
        rows.append(by_a if a == child else by_b)
    jacobian = np.concatenate(rows)
    length = 1.0
    _, s, vt = np.linalg.svd(jacobian)
    rank = int((s > 1e-9 * max(s.max(), length)).sum())
    null = vt[rank:].T  # (6, f): twists left, linear first, at the child's origin
    f = null.shape[1]
    if f == 0:
        return LowerPair("rigid", pin.SE3.Identity())
    if f == 6:
        return LowerPair("free", pin.SE3.Identity())
    _, s, vt = np.linalg.svd(null[3:])
    turns = int((s > 1e-7).sum())
    slides = null[:3] @ vt[turns:].T  # pure translations among them
    if turns == 0 and f == 1:
        return LowerPair("prismatic", _frame(slides[:, 0], np.zeros(3)))
    if turns == 1:
        twist = null @ vt[0]
        omega, v = twist[3:] / s[0], twist[:3] / s[0]
        point = np.cross(omega, v)
        if f == 1:
            pitch = float(omega @ v)
            if abs(pitch) < 1e-12:
                return LowerPair("revolute", _frame(omega, point))
            return LowerPair("screw", _frame(omega, point), pitch)
        if f == 2 and np.linalg.norm(np.cross(omega, slides[:, 0])) < 1e-7:
            return LowerPair("cylindrical", _frame(omega, point))
        if f == 3 and np.abs(omega @ slides).max() < 1e-7:
            return LowerPair("planar", _frame(omega, np.zeros(3)))
    if turns == 3 and f == 3:
        by_turn = null[:3] @ np.linalg.inv(null[3:])  # v = [c]× … : v = -ω × c for a centre c
        center = 0.5 * np.array(
            [by_turn[1, 2] - by_turn[2, 1], by_turn[2, 0] - by_turn[0, 2], by_turn[0, 1] - by_turn[1, 0]]
        )
        if np.abs(by_turn - pin.skew(center)).max() < 1e-7 or np.abs(by_turn + pin.skew(center)).max() < 1e-7:
            sign = 1.0 if np.abs(by_turn - pin.skew(center)).max() < 1e-7 else -1.0
            return LowerPair("spherical", pin.SE3(np.eye(3), sign * center))
    return None


def _frame(z: Array, point: Array) -> pin.SE3:
    """A frame at `point` with its third axis along `z`."""
    z = z / np.linalg.norm(z)
    e = np.zeros(3)
    e[int(np.argmin(np.abs(z)))] = 1.0
    x = np.cross(e, z)
    x /= np.linalg.norm(x)
    return pin.SE3(np.column_stack([x, np.cross(z, x), z]), point)


def model_of(pair: LowerPair) -> pin.JointModel:
    """The joint whose coordinates are what the pair leaves free, along and about z."""
    if pair.name == "revolute":
        return pin.JointModelRZ()
    if pair.name == "prismatic":
        return pin.JointModelPZ()
    if pair.name == "screw":
        return pin.JointModelHZ(pair.pitch)
    if pair.name == "spherical":
        return pin.JointModelSpherical()
    if pair.name == "planar":
        return pin.JointModelPlanar()
    if pair.name == "cylindrical":
        joint = pin.JointModelComposite()
        joint.addJoint(pin.JointModelPZ())
        joint.addJoint(pin.JointModelRZ())
        return joint
    return pin.JointModelFreeFlyer()
