"""Bodies joined by recognised joints, in joint coordinates: one small Pinocchio model a mechanism.

Constraints between two bodies are read as the lower pair they leave (revolute, prismatic, screw, cylindrical, planar,
spherical, rigid). Pairs that span the bodies become tree joints, whose constraints then hold by construction; a pair
that closes a loop becomes point anchors (two on a revolute axis). Motion is integrated with the eighth-order method of
Dormand and Prince (Hairer, Nørsett & Wanner, "Solving Ordinary Differential Equations I", II.5) in the tangent space
at the step's start (Munthe-Kaas). What no such model can say (other kinds of pairs, moving ground, contacts that press)
is left to the rows of `joints` in the world's coordinates, at second order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.integrate import DOP853

from physics.bodies import FREE, Bodies
from physics.joints import Joint

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_A, _B = np.ascontiguousarray(DOP853.A), np.ascontiguousarray(DOP853.B)
_STAGES = len(_B)
RANK = 1e-10
"""1: singular values of a loop's Jacobian below this times the largest are redundancy"""
TURN = 0.15
"""rad: a step over which some joint would turn by more is split"""


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


def _model_of(pair: LowerPair) -> pin.JointModel:
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


@dataclass(eq=False)
class _Link:
    body: int
    parent: int
    """the parent body's id, or -1 for ground"""
    joint: int
    """Pinocchio's joint id"""
    pair: LowerPair
    placement: pin.SE3
    """joint frame at q = 0, in the parent's joint frame"""
    frame: pin.SE3
    """joint frame in the body's mesh frame"""


class Mechanism:
    """A model of joined bodies. Made by `build`; it holds no state, joint coordinates are read off the poses."""

    def __init__(self, links: list[_Link], model: pin.Model, loops: list, bodies: Bodies) -> None:
        self.links = links
        self.model = model
        self.data = model.createData()
        self.loops = loops
        """((joint, point), (joint, point)): anchors that coincide, each in its joint's frame"""
        self.center = [link.frame.actInv(bodies.offset[link.body]) for link in links]
        self.flat = all(link.pair.name not in ("spherical", "planar", "free") for link in links)
        self.ids = np.array([link.body for link in links], dtype=np.int64)

    # --- building -----------------------------------------------------------------------------------------------------

    @classmethod
    def build(
        cls, ids: Ints, joints: Sequence[Joint], bodies: Bodies, poses: Mapping[int, pin.SE3]
    ) -> Mechanism | None:
        """The model of the free bodies `ids` and their constraints, read at `poses`; None if there is none."""
        by_pair: dict[tuple[int, int], list[Joint]] = {}
        members = set(ids.tolist())
        for joint in joints:
            a, b = (i if i in members else -1 for i in joint.bodies)
            if any(bodies.kind[i] not in (1, FREE) for i in joint.bodies):
                return None  # ground that moves
            by_pair.setdefault((min(a, b), max(a, b)), []).append(joint)
        if any(len({i for j in js for i in j.bodies}) > 2 for js in by_pair.values()):
            return None  # one body to two grounds: a loop through the ground, left to rows
        model = pin.Model()
        model.gravity = pin.Motion.Zero()
        links: list[_Link] = []
        placed: dict[int, _Link] = {}
        open_pairs = dict(sorted(by_pair.items()))
        path = [-1]  # depth first: Pinocchio wants the joints of a subtree to follow one another
        while len(placed) < len(members):
            if not path:  # a part with no way to ground floats
                root = min(members - placed.keys())
                link = _add_link(model, root, -1, LowerPair("free", pin.SE3.Identity()), placed, poses, bodies)
                links.append(link)
                placed[root] = link
                path = [root]
            parent = path[-1]
            ways = [p for p in open_pairs if parent in p and (c := p[0] + p[1] - parent) != -1 and c not in placed]
            if not ways:
                path.pop()
                continue
            child = sum(ways[0]) - parent
            pair = _pair_between(open_pairs.pop(ways[0]), child, poses)
            if pair is None:
                return None
            link = _add_link(model, child, parent, pair, placed, poses, bodies)
            links.append(link)
            placed[child] = link
            path.append(child)
        loops: list = []
        for (a, b), constraints in open_pairs.items():
            anchors = _anchors(model, a, b, constraints, placed, poses)
            if anchors is None:
                return None
            loops += anchors
        made = cls(links, model, loops, bodies)
        return made if made._true(joints, poses) else None

    def _true(self, joints: Sequence[Joint], poses: Mapping[int, pin.SE3]) -> bool:
        """Whether the tree's constraints hold away from where they were read: a pair may look like another there."""
        if self.loops:
            return True
        q = pin.neutral(self.model)
        for k in (1, 2):
            moved = pin.integrate(self.model, q, 0.3 * np.sin(np.arange(1, self.model.nv + 1) * k))
            pin.forwardKinematics(self.model, self.data, moved)
            now = dict(poses) | {link.body: self.data.oMi[link.joint] * link.frame.inverse() for link in self.links}
            for joint in joints:
                a, b = joint.bodies
                if np.abs(joint.residual(now[a], now[b])).max(initial=0.0) > 1e-9 + 10 * np.abs(
                    joint.residual(poses[a], poses[b])
                ).max(initial=0.0):
                    return False
        return True

    # --- coordinates --------------------------------------------------------------------------------------------------

    def read(self, bodies: Bodies) -> tuple[Array, Array]:
        """Joint coordinates and velocities of the bodies as they stand."""
        q = np.empty(self.model.nq)
        v = np.empty(self.model.nv)
        frames = {-1: pin.SE3.Identity()}
        twists = {-1: pin.Motion.Zero()}
        for link in self.links:
            i = link.body
            frame = bodies.pose(i) * link.frame
            frames[i] = frame
            omega = bodies.velocity[i, 3:]
            twists[i] = pin.Motion(bodies.velocity[i, :3] - np.cross(omega, bodies.center[i]), omega.copy())
            if link.pair.name == "rigid":
                continue
            m = (frames[link.parent] * link.placement).actInv(frame)
            rel = frame.actInv(twists[i] - twists[link.parent]).vector
            iq, iv = self.model.idx_qs[link.joint], self.model.idx_vs[link.joint]
            angle = float(np.arctan2(m.rotation[1, 0] - m.rotation[0, 1], m.rotation[0, 0] + m.rotation[1, 1]))
            name = link.pair.name
            if name == "revolute":
                q[iq], v[iv] = angle, rel[5]
            elif name == "prismatic":
                q[iq], v[iv] = m.translation[2], rel[2]
            elif name == "screw":
                turns = np.round((m.translation[2] / link.pair.pitch - angle) / (2 * np.pi))
                q[iq], v[iv] = angle + 2 * np.pi * turns, rel[5]
            elif name == "cylindrical":
                q[iq : iq + 2], v[iv : iv + 2] = (m.translation[2], angle), (rel[2], rel[5])
            elif name == "planar":
                q[iq : iq + 4] = m.translation[0], m.translation[1], np.cos(angle), np.sin(angle)
                v[iv : iv + 3] = rel[0], rel[1], rel[5]
            elif name == "spherical":
                q[iq : iq + 4], v[iv : iv + 3] = pin.Quaternion(m.rotation).coeffs(), rel[3:]
            else:
                q[iq : iq + 7], v[iv : iv + 6] = pin.SE3ToXYZQUAT(m), rel
        return q, v

    def write(self, q: Array, v: Array, bodies: Bodies) -> None:
        """Put the bodies where these joint coordinates say."""
        pin.forwardKinematics(self.model, self.data, q, v)
        for link, center in zip(self.links, self.center, strict=True):
            frame, twist = self.data.oMi[link.joint], self.data.v[link.joint]
            i = link.body
            bodies.set_pose(i, frame * link.frame.inverse())
            bodies.velocity[i, :3] = frame.rotation @ (twist.linear + np.cross(twist.angular, center))
            bodies.velocity[i, 3:] = frame.rotation @ twist.angular

    # --- motion -------------------------------------------------------------------------------------------------------

    def advance(
        self, bodies: Bodies, time: float, dt: float, wrench: Callable[[Ints, float], Array], constant: bool
    ) -> None:
        """Move the bodies by `dt` seconds. `constant`: the wrenches depend on nothing (as gravity's)."""
        q, v = self.read(bodies)
        steps = max(1, int(np.ceil(dt * float(np.abs(v).max(initial=0.0)) / TURN)))
        h = dt / steps
        fixed = wrench(self.ids, time) if constant else None
        if fixed is not None:
            field = self._field(fixed, bodies)
            self.model.gravity.linear = field if field is not None else np.zeros(3)
            if field is not None:
                fixed = np.zeros_like(fixed)
        else:
            self.model.gravity.linear = np.zeros(3)
        for k in range(steps):
            q, v = self._step(q, v, h, time + k * h, wrench, fixed, bodies)
        if self.loops:
            q, v = self._close(q, v)
        self.write(q, v, bodies)

    def _field(self, w: Array, bodies: Bodies) -> Array | None:
        """The one acceleration (3,) that explains all wrenches, if there is one: then it is the model's gravity."""
        a = w[:, :3] / bodies.mass[self.ids][:, None]
        if w[:, 3:].any() or np.abs(a - a[0]).max() > 1e-15 * np.abs(a[0]).max():
            return None
        return a[0]

    def _acceleration(self, q, v, time, wrench, fixed, bodies) -> Array:
        model, data = self.model, self.data
        tau = np.zeros(model.nv)
        if fixed is None:
            self.write(q, v, bodies)
            w = wrench(self.ids, time)
        else:
            w = fixed
        if w.any():
            if fixed is not None:
                pin.forwardKinematics(model, data, q)
            forces = pin.StdVec_Force()
            forces.extend([pin.Force.Zero() for _ in range(model.njoints)])
            for k, link in enumerate(self.links):
                frame = data.oMi[link.joint]
                linear = frame.rotation.T @ w[k, :3]
                forces[link.joint] += pin.Force(linear, frame.rotation.T @ w[k, 3:] + np.cross(self.center[k], linear))
            gravity = model.gravity.linear.copy()
            model.gravity.linear = np.zeros(3)
            tau = -pin.rnea(model, data, q, np.zeros(model.nv), np.zeros(model.nv), forces)
            model.gravity.linear = gravity
        if model.nv == 0:
            return np.zeros(0)
        a = pin.aba(model, data, q, v, tau).copy()
        if not self.loops:
            return a
        # Gauss's principle: the least change of `a` (mass metric) that leaves the anchors no relative acceleration
        drift = self._drift(q, v)
        _, jacobian = self._gaps(q)
        lower = np.linalg.cholesky(pin.crba(model, data, q, pin.Convention.WORLD))
        scaled = np.linalg.solve(lower, jacobian.T).T
        return a - np.linalg.solve(lower.T, np.linalg.lstsq(scaled, drift + jacobian @ a, rcond=RANK)[0])

    def _step(self, q, v, h, time, wrench, fixed, bodies):
        nv = self.model.nv
        k = np.empty((_STAGES, 2 * nv))
        y = np.concatenate([np.zeros(nv), v])
        for i in range(_STAGES):
            at = y + h * (_A[i, :i] @ k[:i]) if i else y
            u, vi = at[:nv], at[nv:]
            qi = q + u if self.flat else pin.integrate(self.model, q, u)
            k[i, nv:] = self._acceleration(qi, vi, time + DOP853.C[i] * h, wrench, fixed, bodies)
            if self.flat:
                k[i, :nv] = vi
            else:  # u' = (∂(q ⊕ u)/∂u)⁻¹ v
                k[i, :nv] = np.linalg.solve(pin.dIntegrate(self.model, q, u, pin.ARG1), vi)
        y = y + h * (_B @ k)
        return (q + y[:nv] if self.flat else pin.integrate(self.model, q, y[:nv])), y[nv:]

    def _close(self, q, v):
        """Bring loops back to closure: Newton on the anchors, then the velocities that keep them."""
        for _ in range(4):
            gap, jacobian = self._gaps(q)
            if np.abs(gap).max() < 1e-15:
                break
            q = pin.integrate(self.model, q, -np.linalg.lstsq(jacobian, gap, rcond=RANK)[0])
        _, jacobian = self._gaps(q)
        return q, v - np.linalg.lstsq(jacobian, jacobian @ v, rcond=RANK)[0]

    def _drift(self, q, v):
        """(3k,) relative acceleration of the anchors when the joint accelerations are zero, world axes."""
        model, data = self.model, self.data
        pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
        out = []
        for loop in self.loops:
            ends = []
            for joint, point in loop:
                if joint == 0:
                    ends.append(np.zeros(3))
                    continue
                a, w = data.a[joint], data.v[joint]
                local = (
                    a.linear + np.cross(a.angular, point) + np.cross(w.angular, w.linear + np.cross(w.angular, point))
                )
                ends.append(data.oMi[joint].rotation @ local)
            out.append(ends[1] - ends[0])
        return np.concatenate(out)

    def _gaps(self, q):
        """Distances (3k,) between the anchors of each loop and their Jacobian (3k, nv), world axes."""
        model, data = self.model, self.data
        pin.computeJointJacobians(model, data, q)
        gaps, rows = [], []
        for loop in self.loops:
            ends = []
            for joint, local in loop:
                point = data.oMi[joint].act(local)
                if joint == 0:
                    ends.append((point, np.zeros((3, model.nv))))
                    continue
                j = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
                ends.append((point, j[:3] - pin.skew(point - data.oMi[joint].translation) @ j[3:]))
            gaps.append(ends[1][0] - ends[0][0])
            rows.append(ends[1][1] - ends[0][1])
        return np.concatenate(gaps), np.concatenate(rows)


def _pair_between(joints: Sequence[Joint], child: int, poses: Mapping[int, pin.SE3]) -> LowerPair | None:
    a, b = joints[0].bodies
    parent = b if a == child else a
    return lower_pair(joints, child, poses[parent], poses[child])


def _add_link(model, body, parent, pair, placed, poses, bodies) -> _Link:
    up = placed[parent] if parent >= 0 else None
    above = poses[parent] * up.frame if up is not None else pin.SE3.Identity()
    joint = up.joint if up is not None else 0
    if pair.name == "rigid":  # it moves with the parent's joint
        frame = poses[body].actInv(above)
        placement = pin.SE3.Identity()
    else:
        frame = pair.frame
        placement = above.actInv(poses[body] * frame)
        joint = model.addJoint(joint, _model_of(pair), placement, str(body))
    rotation = frame.rotation
    inertia = pin.Inertia(
        float(bodies.mass[body]), frame.actInv(bodies.offset[body]), rotation.T @ bodies.inertia[body] @ rotation
    )
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    return _Link(body, parent, joint, pair, placement, frame)


def _anchors(model, a, b, constraints, placed, poses):
    """Point anchors for a pair that closes a loop, or None if its kind has none."""
    if b == -1 or (a >= 0 and a not in placed) or b not in placed:
        return None
    pair = _pair_between(constraints, b, poses)
    if pair is None or pair.name not in ("revolute", "spherical"):
        return None
    frame = poses[b] * pair.frame
    radius = 0.05  # m, half the distance of the two anchors: any will do
    points = [frame.translation]
    if pair.name == "revolute":
        axis = frame.rotation[:, 2]
        points = [frame.translation - radius * axis, frame.translation + radius * axis]
    out = []
    for point in points:
        ends = []
        for body in (a, b):
            link = placed[body] if body >= 0 else None
            of = poses[body] * link.frame if link is not None else pin.SE3.Identity()
            ends.append((link.joint if link is not None else 0, of.actInv(point)))
        out.append((ends[0], ends[1]))
    return out
