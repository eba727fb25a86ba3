"""`Bodies`: state and constants of all objects of a world as arrays by id, and kernels that move them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision.numeric.kernel import kernel
from physics.model.body import Body
from physics.model.free_rotation import fly
from physics.model.rotations import exponential, matrix, multiply

Array = NDArray[np.float64]

ABSENT, STATIC, KINEMATIC, FREE = range(4)
LIGHT = 299_792_458.0
"""m/s: the speed of light, which no point of a body reaches"""


class Bodies:
    """Arrays whose row i is object i: `CONSTANTS`, set with the mass, and `STATE`, which a step changes."""

    def __init__(self) -> None:
        self.n = 0
        self.kind = np.zeros(0, np.int64)
        self.center = np.zeros((0, 3))
        """centre of mass, world, m"""
        self.attitude = np.zeros((0, 4))
        """unit quaternion (x, y, z, w), mesh axes to world"""
        self.velocity = np.zeros((0, 6))
        """of the centre of mass m/s, angular rad/s, both in world axes"""
        self.offset = np.zeros((0, 3))
        """centre of mass in the mesh frame, m"""
        self.mass = np.zeros(0)
        self.inertia = np.zeros((0, 3, 3))
        """about the centre of mass, mesh axes, kg·m²"""
        self.inverse = np.zeros((0, 3, 3))
        self.radius = np.zeros(0)
        """m, of the bounding ball about the centre of mass"""
        self.thickness = np.zeros(0)
        """m: least extent of the mesh's box; its thinnest wall once the contact shape is built"""
        self.rotation = np.zeros((0, 3, 3))
        """derived from `attitude`"""
        self.origin = np.zeros((0, 3))
        """derived: origin of the mesh frame in the world, m"""
        self.awake = np.zeros(0, np.bool_)
        self.quiet = np.zeros(0)
        """s: how long the body has been at rest"""
        self.rate = np.zeros((0, 6))
        """m/s², rad/s²: acceleration by forces, joints and contacts in the last half kick"""
        self.momentum = np.zeros((0, 6))
        """kg·m²/s, rad/s, world axes: angular momentum and the angular velocity it belongs to; kept to the bit while no
        torque acts"""
        self.steady = np.zeros(0, np.bool_)
        """whether the next half kick mirrors the last (see `stepping.step`)"""

    CONSTANTS = ("offset", "mass", "inertia", "inverse", "radius")
    STATE = (
        "kind", "center", "attitude", "velocity", "thickness", "rotation", "origin", "awake", "quiet",
        "rate", "steady", "momentum",
    )  # fmt: skip
    ARRAYS = CONSTANTS + STATE

    def reserve(self, n: int) -> None:
        """Grow the arrays to hold ids below n."""
        if n <= self.n:
            return
        capacity = len(self.kind)
        if n > capacity:
            grown = max(n, 2 * capacity, 16)
            for name in self.ARRAYS:
                old = getattr(self, name)
                new = np.zeros((grown, *old.shape[1:]), old.dtype)
                new[:capacity] = old
                setattr(self, name, new)
        self.n = n

    def set_constants(self, i: int, body: Body | None, vertices: Array) -> None:
        """Set mass properties and extents of one object; without a body its centre is that of its box."""
        lower, upper = vertices.min(axis=0), vertices.max(axis=0)
        if body is None:
            self.offset[i] = 0.5 * (lower + upper)
            self.mass[i] = 0.0
        else:
            self.offset[i] = body.center
            self.mass[i] = body.mass
            self.inertia[i] = body.inertia
            self.inverse[i] = np.linalg.inv(body.inertia)
        self.radius[i] = float(np.sqrt(((vertices - self.offset[i]) ** 2).sum(axis=1).max()))
        self.thickness[i] = float((upper - lower).min())

    def set_pose(self, i: int, pose: pin.SE3) -> None:
        """Place an object by its mesh frame."""
        self.attitude[i] = pin.Quaternion(pose.rotation).normalized().coeffs()
        matrix(self.attitude[i], self.rotation[i])
        self.center[i] = self.rotation[i] @ self.offset[i] + pose.translation
        self.origin[i] = pose.translation

    def stands_at(self, i: int, pose: pin.SE3) -> bool:
        """Whether `set_pose` with this pose would change nothing, to the bit."""
        return bool(
            (self.origin[i] == pose.translation).all()
            and (self.attitude[i] == pin.Quaternion(pose.rotation).normalized().coeffs()).all()
        )

    def wake(self, i: int) -> None:
        """Wake an object."""
        self.awake[i] = True
        self.quiet[i] = 0.0
        self.steady[i] = False

    def pose(self, i: int) -> pin.SE3:
        """Pose of the mesh frame in the world."""
        return pin.SE3(self.rotation[i].copy(), self.origin[i].copy())

    def homogeneous(self, ids: NDArray[np.int64]) -> Array:
        """(n, 4, 4) poses of the mesh frames in the world."""
        out = np.zeros((len(ids), 4, 4))
        out[:, :3, :3] = self.rotation[ids]
        out[:, :3, 3] = self.origin[ids]
        out[:, 3, 3] = 1.0
        return out


@kernel
def place(ids, center, attitude, offset, rotation, origin):
    """Compute rotation matrices and mesh origins of the bodies `ids` from centres and attitudes, in place."""
    for i in ids:
        matrix(attitude[i], rotation[i])
        for k in range(3):
            origin[i, k] = center[i, k] - (
                rotation[i, k, 0] * offset[i, 0] + rotation[i, k, 1] * offset[i, 1] + rotation[i, k, 2] * offset[i, 2]
            )


@kernel(allocates=True)
def drift(ids, center, attitude, velocity, momentum, inertia, inverse, offset, rotation, origin, h, method):
    """Free flight of the bodies `ids` over h (n,) seconds: straight for the centre, free rotation about it."""
    for row in range(len(ids)):
        i = ids[row]
        for k in range(3):
            center[i, k] += h[row] * velocity[i, k]
        w = velocity[i, 3:6]
        if w[0] == 0.0 and w[1] == 0.0 and w[2] == 0.0:
            continue
        r = rotation[i]
        kept = momentum[i]
        if kept[3] != w[0] or kept[4] != w[1] or kept[5] != w[2]:
            kept[:3] = r @ (inertia[i] @ (r.T @ w))
        fly(attitude[i], kept[:3], inverse[i], h[row], method)
        matrix(attitude[i], r)
        velocity[i, 3:6] = r @ (inverse[i] @ (r.T @ kept[:3]))
        kept[3:] = velocity[i, 3:6]
    place(ids, center, attitude, offset, rotation, origin)


@kernel(allocates=True)
def coast(
    ids, center, attitude, velocity, momentum, mass, inertia, inverse, offset, rotation, origin, wrench, h, method
):  # fmt: skip
    """One step of bodies without contact under constant wrenches (n, 6): half a kick, free flight, half a kick."""
    each = np.full(len(ids), h)
    for turn in range(2):
        for k in range(len(ids)):
            i = ids[k]
            for c in range(3):
                velocity[i, c] += 0.5 * h * wrench[k, c] / mass[i]
            if wrench[k, 3] != 0.0 or wrench[k, 4] != 0.0 or wrench[k, 5] != 0.0:
                r = rotation[i]
                velocity[i, 3:6] += 0.5 * h * (r @ (inverse[i] @ (r.T @ wrench[k, 3:6])))
        if turn == 0:
            drift(ids, center, attitude, velocity, momentum, inertia, inverse, offset, rotation, origin, each, method)


class Saved:
    """Motion of some bodies at one instant, to restore, or to extrapolate (kinematic bodies)."""

    def __init__(self, bodies: Bodies, ids: NDArray[np.int64]) -> None:
        self.ids = ids
        self.center = bodies.center[ids]
        self.attitude = bodies.attitude[ids]
        self.velocity = bodies.velocity[ids]
        self.rotation = bodies.rotation[ids]
        self.origin = bodies.origin[ids]

    def restore(self, bodies: Bodies, chosen: NDArray[np.bool_] | slice = slice(None)) -> None:
        """Restore the bodies, or those of a mask over `ids`."""
        ids = self.ids[chosen]
        bodies.center[ids] = self.center[chosen]
        bodies.attitude[ids] = self.attitude[chosen]
        bodies.velocity[ids] = self.velocity[chosen]
        bodies.rotation[ids] = self.rotation[chosen]
        bodies.origin[ids] = self.origin[chosen]

    def of(self, chosen: NDArray[np.bool_]) -> Saved:
        """The saved motion of the bodies of a mask over `ids`."""
        part = object.__new__(Saved)
        for name in ("ids", "center", "attitude", "velocity", "rotation", "origin"):
            setattr(part, name, getattr(self, name)[chosen])
        return part

    def carry(self, bodies: Bodies, ids: NDArray[np.int64], times: Array) -> None:
        """Move the bodies `ids` to where constant velocity and angular velocity take them in `times` (s)."""
        for i, time in zip(ids, times, strict=True):
            k = int(np.searchsorted(self.ids, i))
            v = self.velocity[k]
            bodies.center[i] = self.center[k] + time * v[:3]
            bodies.attitude[i] = multiply(exponential(*(time * v[3:])), self.attitude[k])
        place(ids, bodies.center, bodies.attitude, bodies.offset, bodies.rotation, bodies.origin)


def followed(v: Array, radius: Array) -> bool:
    """Whether all points of bodies with velocities (n, 6) and radii (n,) are slower than light; False for NaN."""
    return bool((point_speeds(v, radius) < LIGHT).all())


def point_speeds(v: Array, radius: Array) -> Array:
    """(n,) m/s: bounds of the speeds of points of bodies with velocities (n, 6) and radii (n,)."""
    return np.sqrt((v[:, :3] ** 2).sum(axis=1)) + np.sqrt((v[:, 3:] ** 2).sum(axis=1)) * radius
