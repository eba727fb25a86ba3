"""`mobility`: the freedom that is left to each part and each pair, and the joint it amounts to."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from collision import Tolerance
from constraints.kinds.base import Constraint
from constraints.lower_pairs import name_joint, orthonormal
from constraints.system import Array, Poses, System, systems


@dataclass(frozen=True, eq=False)
class Freedom:
    """What motion is left to a part (against the fixed ones), or to a part against another."""

    freedom: int
    """degrees of freedom at this pose"""
    twists: Array
    """(6, freedom) orthonormal twists that span it, in the part's local frame, linear first"""
    joint: str
    """"rigid", "revolute", "prismatic", "screw", "cylindrical", "planar", "spherical", …, "free" or "n-dof\""""


@dataclass(frozen=True, eq=False)
class Mobility:
    """Freedom at a pose."""

    parts: Mapping[int, Freedom]
    """by body id; each body that a constraint or `poses` names and that is not fixed"""
    pairs: Mapping[tuple[int, int], Freedom]
    """of the second body in the first one's eyes, by (a, b) as the constraints name them, a < b"""


def mobility(
    constraints: Sequence[Constraint],
    poses: Poses,
    fixed: Iterable[int],
    tolerance: Tolerance | None = None,
) -> Mobility:
    """Freedom of each part and pair at poses that satisfy the constraints."""
    tol = tolerance or Tolerance()
    held = set(fixed)
    named = {b for c in constraints for b in c.bodies}
    named |= set(poses) if isinstance(poses, Mapping) else set(range(len(poses)))
    parts = {b: Freedom(6, np.eye(6), "free") for b in sorted(named - held)}
    pairs: dict[tuple[int, int], Freedom] = {}
    for system in systems(tuple(constraints), frozenset(named - held)):
        rotation, translation = system.gather(poses)
        r, jacobian = system.dense(rotation, translation)
        _, s, vt = np.linalg.svd(jacobian)
        threshold = max(tol.rank, 8.0 * float(np.abs(r).max()) / system.length) * s[0]
        null = vt[int(np.sum(s > threshold)) :].T.reshape(len(system.movable), 6, -1)
        world = [_world(system, null, i, rotation, translation) for i in range(len(system.bodies))]
        for i, b in enumerate(system.bodies):
            if system.slot[i] >= 0:
                parts[b] = _freedom(world[i], poses[b], system.extent[i])
        for a, b in sorted({(min(c.bodies), max(c.bodies)) for c in system.constraints}):
            i, j = system.bodies.index(a), system.bodies.index(b)
            pairs[a, b] = _freedom(world[j] - world[i], poses[b], min(system.extent[i], system.extent[j]))
    return Mobility(parts, pairs)


def _world(system: System, null: Array, i: int, rotation: Array, translation: Array) -> Array:
    """World twists (6, k) about the world's origin of body i for each null vector of the system."""
    if system.slot[i] < 0:
        return np.zeros((6, null.shape[2]))
    local = null[system.slot[i]].copy()
    local[3:] /= system.extent[i]
    return pin.SE3(rotation[i], translation[i]).action @ local


def _freedom(world: Array, pose: pin.SE3, length: float) -> Freedom:
    """Freedom from world twists (6, k), seen in the frame of `pose`."""
    local = pose.inverse().action @ world
    scale = np.array([1.0 / length] * 3 + [1.0] * 3)[:, None]
    basis = orthonormal(local * scale, 1e-6) / scale
    basis = np.linalg.qr(basis)[0]
    return Freedom(basis.shape[1], basis, name_joint(basis, length))
