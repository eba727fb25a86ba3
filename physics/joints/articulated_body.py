"""`ArticulatedBody`: bodies and joints of an island as one Pinocchio model; its state is read from the bodies.

Constraints between two bodies are read as the lower pair they leave (`lower_pair`). Pairs that span the bodies become
tree joints, whose constraints then hold by construction; a pair that closes a loop becomes point anchors (two on a
revolute axis). Other kinds of pairs, moving ground and contacts have no such model: `joints.rows` treats them in world
coordinates, at second order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from constraints.freedom.lower_pairs import LowerPair, joint_model
from physics.joints.lower_pair import pair_between
from physics.joints.rows import JointConstraint
from physics.joints.thread import ThreadFriction
from physics.model.bodies import FREE, Bodies

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(eq=False)
class Link:
    """One body of the tree, with the joint to its parent."""

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


class ArticulatedBody:
    """Model of joined bodies, made by `build`. Holds no state: joint coordinates are computed from the poses."""

    def __init__(
        self, links: list[Link], model: pin.Model, loops: list, bodies: Bodies, threads: dict[int, ThreadFriction]
    ) -> None:
        self.links = links
        self.model = model
        self.data = model.createData()
        self.loops = loops
        """((joint, placement), (joint, placement)): coincident anchors, each in its joint's frame, turned as that is"""
        self.center = [_at(link.frame.actInv(bodies.offset[link.body])) for link in links]
        """placement of each link's centre of mass in its joint's frame, turned as that is"""
        self.flat = all(link.pair.name not in ("spherical", "planar", "free") for link in links)
        self.ids = np.array([link.body for link in links], dtype=np.int64)
        self.threads = [threads[link.body] for link in links if link.body in threads]
        self.screws = [link for link in links if link.body in threads]

    # --- building -----------------------------------------------------------------------------------------------------

    @classmethod
    def build(
        cls, ids: Ints, joints: Sequence[JointConstraint], bodies: Bodies, poses: Mapping[int, pin.SE3]
    ) -> ArticulatedBody | None:
        """Model of the free bodies `ids` under constraints, read at `poses`; None if they cannot be modelled."""
        by_pair: dict[tuple[int, int], list[JointConstraint]] = {}
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
        links: list[Link] = []
        threads: dict[int, ThreadFriction] = {}
        placed: dict[int, Link] = {}
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
            between = open_pairs.pop(ways[0])
            pair = _pair_between(between, child, poses)
            if pair is None:
                return None
            thread = next((t for joint in between if (t := ThreadFriction.of(joint)) is not None), None)
            if pair.name == "screw" and thread is not None:
                threads[child] = thread
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
        made = cls(links, model, loops, bodies, threads)
        return made if made._true(joints, poses) else None

    def _true(self, joints: Sequence[JointConstraint], poses: Mapping[int, pin.SE3]) -> bool:
        """Whether the constraints also hold at other joint coordinates: at one pose a pair may look like another."""
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
        """Joint coordinates (nq,) and velocities (nv,) at the bodies' present poses."""
        q = np.empty(self.model.nq)
        v = np.empty(self.model.nv)
        frames = {-1: pin.SE3.Identity()}
        twists = {-1: pin.Motion.Zero()}
        for link in self.links:
            i = link.body
            frame = bodies.pose(i) * link.frame
            frames[i] = frame
            twists[i] = _at(bodies.center[i]).act(pin.Motion(bodies.velocity[i]))
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
        """Set poses and velocities of the bodies from joint coordinates (nq,) and velocities (nv,)."""
        pin.forwardKinematics(self.model, self.data, q, v)
        for link, center in zip(self.links, self.center, strict=True):
            frame, twist = self.data.oMi[link.joint], self.data.v[link.joint]
            i = link.body
            bodies.set_pose(i, frame * link.frame.inverse())
            bodies.velocity[i, :3] = frame.rotation @ center.actInv(twist).linear
            bodies.velocity[i, 3:] = frame.rotation @ twist.angular


def _at(point: Array) -> pin.SE3:
    """The translation by `point` (3,)."""
    return pin.SE3(np.eye(3), point)


def _pair_between(joints: Sequence[JointConstraint], child: int, poses: Mapping[int, pin.SE3]) -> LowerPair | None:
    a, b = joints[0].bodies
    parent = b if a == child else a
    return pair_between(joints, child, poses[parent], poses[child])


def _add_link(model, body, parent, pair, placed, poses, bodies) -> Link:
    up = placed[parent] if parent >= 0 else None
    above = poses[parent] * up.frame if up is not None else pin.SE3.Identity()
    joint = up.joint if up is not None else 0
    if pair.name == "rigid":  # it moves with the parent's joint
        frame = poses[body].actInv(above)
        placement = pin.SE3.Identity()
    else:
        frame = pair.frame
        placement = above.actInv(poses[body] * frame)
        joint = model.addJoint(joint, joint_model(pair.name, pair.pitch), placement, str(body))
    rotation = frame.rotation
    inertia = pin.Inertia(
        float(bodies.mass[body]), frame.actInv(bodies.offset[body]), rotation.T @ bodies.inertia[body] @ rotation
    )
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    return Link(body, parent, joint, pair, placement, frame)


def _anchors(model, a, b, constraints, placed, poses):
    """Point anchors for a pair that closes a loop; None if its kind has none."""
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
            ends.append((link.joint if link is not None else 0, _at(of.actInv(point))))
        out.append((ends[0], ends[1]))
    return out
