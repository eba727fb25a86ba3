"""Lower pairs: name and frame of the joint whose motions span a space of twists.

The motions of a lower pair form a subgroup of SE(3) (Hervé, Mechanism and Machine Theory 13, 1978). Its twists are
recognised by the rank of their angular part, their pitch and the point that their axes share.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from constraints.solve.system import Array

SUBGROUPS = ("rigid", "revolute", "prismatic", "screw", "cylindrical", "planar", "spherical", "translational", "free")
"""names whose motions form a subgroup of SE(3)"""


def orthonormal(columns: Array, threshold: float) -> Array:
    """Return an orthonormal basis (n, k) of the columns' span, without singular values up to `threshold`."""
    if columns.shape[1] == 0:
        return columns
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    return u[:, : int(np.sum(s > threshold))]


def name_joint(twists: Array, length: float, across: float) -> str:
    """Return the name of the lower pair of the space spanned by `twists` (6, f), linear first.

    length: m, scale of pitches and offsets. across: rad, or fraction of `length`, within which directions are parallel,
    axes meet and pitches vanish.

    "rigid", "revolute", "prismatic", "screw", "cylindrical", "universal", "planar", "spherical",
    "translational", "free", else "n-dof".
    """
    freedom = twists.shape[1]
    if freedom == 0:
        return "rigid"
    if freedom == 6:
        return "free"
    basis = np.linalg.qr(np.vstack([twists[:3] / length, twists[3:]]))[0]
    u, s, vt = np.linalg.svd(basis[3:])
    rank = int(np.sum(s > across))
    turning = basis @ vt[:rank].T  # (6, rank) motions that turn
    sliding = (basis @ vt[rank:].T)[:3]  # (3, freedom - rank) motions that only slide
    axis = u[:, 0]
    if rank == 0:
        return {1: "prismatic", 3: "translational"}.get(freedom, f"{freedom}-dof")
    if freedom == rank and _meet(turning, across):
        return {1: "revolute", 2: "universal", 3: "spherical"}[rank]
    if rank > 1:
        return f"{freedom}-dof"
    if freedom == 1:
        return "screw"
    skew = np.abs(axis @ sliding)
    pitch = abs(float(axis @ (turning[:3, 0] - sliding @ (sliding.T @ turning[:3, 0]))))
    if freedom == 2 and skew[0] > 1.0 - across:
        return "cylindrical"
    if freedom == 3 and skew.max() < across and pitch < across:
        return "planar"
    return f"{freedom}-dof"


def _meet(turning: Array, across: float) -> bool:
    """Whether all the motions are rotations about axes through one point c: v = c × ω for each."""
    c, error = _center(turning)
    return error < across * (1.0 + float(np.abs(c).max()))


def _center(turning: Array) -> tuple[Array, float]:
    """(point c (3,) nearest to the axes of turning motions (6, k), greatest error of v = c × ω)."""
    rows = [np.array([[0.0, w[2], -w[1]], [-w[2], 0.0, w[0]], [w[1], -w[0], 0.0]]) for w in turning[3:].T]
    a, b = np.vstack(rows), turning[:3].T.ravel()
    c = np.linalg.lstsq(a, b, rcond=None)[0]
    return c, float(np.abs(a @ c - b).max())


@dataclass(frozen=True, eq=False)
class LowerPair:
    """A joint between two bodies."""

    name: str
    """one of `name_joint`'s, but for "universal", "translational" and "n-dof\""""
    frame: pin.SE3
    """frame of the joint, z along its axis, in the frame of the twists"""
    pitch: float = 0.0
    """m/rad, of a screw"""


def lower_pair(twists: Array, length: float, across: float) -> LowerPair | None:
    """Return the lower pair of the space spanned by `twists` (6, f), see `name_joint`; None if it is not one."""
    name = name_joint(twists, length, across)
    if name in ("rigid", "free"):
        return LowerPair(name, pin.SE3.Identity())
    if name == "prismatic":
        return LowerPair(name, frame_along(twists[:3, 0], np.zeros(3)))
    if name == "spherical":
        return LowerPair(name, pin.SE3(np.eye(3), _center(twists)[0]))
    if name not in ("revolute", "screw", "cylindrical", "planar"):
        return None
    _, s, vt = np.linalg.svd(twists[3:])
    turn = twists @ vt[0] / s[0]
    v, omega = turn[:3], turn[3:]
    point = np.zeros(3) if name == "planar" else np.cross(omega, v)
    return LowerPair(name, frame_along(omega, point), float(omega @ v) if name == "screw" else 0.0)


def frame_along(z: Array, origin: Array) -> pin.SE3:
    """Return a frame at `origin` (3,) with its third axis along `z` (3,), of any length."""
    z = z / np.linalg.norm(z)
    x = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    return pin.SE3(np.stack([x, np.cross(z, x), z], axis=1), origin)


def joint_model(name: str, pitch: float = 0.0) -> pin.JointModel:
    """Return Pinocchio's joint for a lower pair, along and about z of its frame; a free flyer for any other name.

    pitch: m a radian, of a screw.
    """
    if name == "cylindrical":
        joint = pin.JointModelComposite()
        joint.addJoint(pin.JointModelPZ())
        joint.addJoint(pin.JointModelRZ())
        return joint
    if name == "screw":
        return pin.JointModelHZ(pitch)
    simple = {
        "revolute": pin.JointModelRZ,
        "prismatic": pin.JointModelPZ,
        "spherical": pin.JointModelSpherical,
        "planar": pin.JointModelPlanar,
    }
    return simple.get(name, pin.JointModelFreeFlyer)()
