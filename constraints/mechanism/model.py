"""`Mechanism`: an assembly as rigid links, a tree of joints and loops closed by welds; exports a Pinocchio model.

Every joint is a chain of one-degree axes (a cylindrical one a slide and a turn, a spherical one three turns), so that a
Pinocchio model and a URDF file hold the same coordinates under the same names, all zero where the assembly stood. A
pair of links beside the tree gets a chain too, which ends in a massless copy of the second link; the loop is that copy
welded to the original (`pin.FrameAnchorConstraintModel`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from constraints.freedom.graph import AssemblyGraph
from constraints.freedom.lower_pairs import SUBGROUPS, frame_along, joint_model
from constraints.freedom.mobility import Freedom, Mobility, mobility
from constraints.kinds import Constraint
from constraints.solve.solver import solve
from constraints.solve.system import systems

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Axis:
    """One degree of freedom: rotation about a line, translation along it, or a screw motion on it."""

    kind: str
    """"revolute", "prismatic" or "screw\""""
    origin: Array
    """(3,) m, in the world where the assembly stood"""
    direction: Array
    """(3,) unit, world"""
    pitch: float = 0.0
    """m/rad, of a screw"""

    @property
    def twist(self) -> Array:
        """(6,) unit motion about the world's origin, linear first."""
        if self.kind == "prismatic":
            return np.concatenate([self.direction, np.zeros(3)])
        return np.concatenate([np.cross(self.origin, self.direction) + self.pitch * self.direction, self.direction])

    @property
    def frame(self) -> pin.SE3:
        """World frame with its z along the axis."""
        return frame_along(self.direction, self.origin)


@dataclass(frozen=True, eq=False)
class Joint:
    """A chain of axes from one link to another."""

    name: str
    parent: int
    child: int
    """places in `Mechanism.links`"""
    axes: tuple[Axis, ...]
    lower_pair: str


@dataclass(frozen=True, eq=False)
class Mechanism:
    """Links and joints of an assembly."""

    links: tuple[tuple[int, ...], ...]
    """body ids of each link; link 0 is the base"""
    names: Mapping[int, str]
    """of each body"""
    poses: Mapping[int, pin.SE3]
    """world pose of each body where the assembly stood"""
    joints: tuple[Joint, ...]
    """of the spanning tree, parents before children"""
    loops: tuple[Joint, ...]
    """joints beyond the tree, each closing a loop"""
    freedom: int
    """degrees of freedom of the assembly at those poses"""
    notes: tuple[str, ...] = ()
    """contacts that no joint represents"""

    def link_name(self, link: int) -> str:
        """Name of a link: that of its first body."""
        return self.names[self.links[link][0]]

    def loop_name(self, k: int) -> str:
        """Name of the massless copy that closes loop k."""
        return f"{self.link_name(self.loops[k].child)}__loop_{k}"

    def model(
        self, inertias: Mapping[int, pin.Inertia] | None = None
    ) -> tuple[pin.Model, list[pin.FrameAnchorConstraintModel]]:
        """Pinocchio model of tree and loop chains, a frame named after each body, and the welds that close the loops.

        inertias: of each body, in its frame; massless where missing.
        """
        model = pin.Model()
        model.name = self.link_name(0)
        at = {0: (0, pin.SE3.Identity())}
        for joint in self.joints:
            at[joint.child] = self._chain(model, joint, at[joint.parent])
        for link, group in enumerate(self.links):
            joint_id, frame = at[link]
            for body in group:
                placement = frame.actInv(self.poses[body])
                inertia = (inertias or {}).get(body)
                if inertia is not None and joint_id:
                    model.appendBodyToJoint(joint_id, inertia, placement)
                model.addFrame(pin.Frame(self.names[body], joint_id, placement, pin.FrameType.BODY))
        welds = []
        for k, loop in enumerate(self.loops):
            copy_id, copy_frame = self._chain(model, loop, at[loop.parent])
            pose = self.poses[self.links[loop.child][0]]
            model.addFrame(pin.Frame(self.loop_name(k), copy_id, copy_frame.actInv(pose), pin.FrameType.BODY))
            welds.append((at[loop.child], (copy_id, copy_frame), pose))
        return model, [
            pin.FrameAnchorConstraintModel(model, i, fi.actInv(pose), j, fj.actInv(pose))
            for (i, fi), (j, fj), pose in welds
        ]

    @staticmethod
    def _chain(model: pin.Model, joint: Joint, start: tuple[int, pin.SE3]) -> tuple[int, pin.SE3]:
        joint_id, frame = start
        for k, axis in enumerate(joint.axes):
            kind = joint_model(axis.kind, axis.pitch)
            joint_id = model.addJoint(joint_id, kind, frame.actInv(axis.frame), axis_name(joint, k))
            frame = axis.frame
        return joint_id, frame


def axis_name(joint: Joint, k: int) -> str:
    """Name of axis k of a joint."""
    return joint.name if len(joint.axes) == 1 else f"{joint.name}_{k}"


def mechanism(graph: AssemblyGraph) -> Mechanism:
    """Links and joints of an assembly with a base.

    The joint of two links is the lower pair that their own constraints leave; where other parts narrow it to a smaller
    pair that is the same at neighbouring poses, it is the smaller one (a nut between its bolt's axis and a plate can
    only turn). A contact that is no lower pair (a ball rolling on a plate) is left out and noted.
    """
    links = graph.links
    frames = tuple(pin.SE3(graph.poses[group[0]]) for group in links)
    reduced = _between_links(graph, links, frames)
    whole = mobility(reduced, frames, [0], graph.tolerance)
    nearby = _nearby(reduced, frames, graph)
    between: dict[tuple[int, int], list[Constraint]] = {}
    for c in reduced:
        a, b = sorted(c.bodies)
        between.setdefault((a, b), []).append(c)
    joints, notes = {}, []
    for (a, b), own in sorted(between.items()):
        name = f"{graph.label(links[a][0])}--{graph.label(links[b][0])}"
        freedom = _joint(own, (a, b), frames, whole, nearby, graph)
        if freedom.joint in SUBGROUPS:
            joints[a, b] = Joint(name, a, b, _axes(freedom, frames[b]), freedom.joint)
        else:
            kinds = ", ".join(sorted({c.kind for c in own}))
            notes.append(f"{name}: {kinds} leaves a {freedom.joint} joint, which is no lower pair; left out")
    tree, rest = _spanning_tree(graph, links, joints)
    freedom_of_all = _freedom(reduced, frames, graph)
    return Mechanism(
        links=links,
        names={b: graph.label(b) for b in graph.bodies},
        poses={b: pin.SE3(graph.poses[b]) for b in graph.bodies},
        joints=tuple(tree),
        loops=tuple(_needed(tree, rest, len(links))),
        freedom=freedom_of_all,
        notes=tuple(notes),
    )


def _between_links(
    graph: AssemblyGraph, links: tuple[tuple[int, ...], ...], frames: tuple[pin.SE3, ...]
) -> tuple[Constraint, ...]:
    """The constraints between different links, seen as constraints of the links."""
    of = {b: i for i, group in enumerate(links) for b in group}
    out = []
    for c in graph.constraints:
        a, b = (of[x] for x in c.bodies)
        if a != b:
            shift = [frames[i].actInv(graph.poses[x]) for i, x in zip((a, b), c.bodies, strict=True)]
            features = (c.features[0].transformed(shift[0]), c.features[1].transformed(shift[1]))
            out.append(replace(c, bodies=(a, b), features=features))
    return tuple(out)


def _freedom(reduced: Sequence[Constraint], frames: Sequence[pin.SE3], graph: AssemblyGraph) -> int:
    """Degrees of freedom of the assembly; links without constraints count six."""
    held = systems(tuple(reduced), frozenset(range(1, len(frames))))
    total = 6 * (len(frames) - 1 - sum(len(s.movable) for s in held))
    for system in held:
        _, jacobian = system.dense(*system.gather(frames, graph.tolerance.rigid))
        s = np.linalg.svd(jacobian, compute_uv=False)
        total += jacobian.shape[1] - int(np.sum(s > 10.0 * graph.tolerance.rank * s[0]))
    return total


def _nearby(reduced: Sequence[Constraint], frames: Sequence[pin.SE3], graph: AssemblyGraph) -> list[Mobility]:
    """Mobility at up to two poses near the given one that satisfy the constraints."""
    rng = np.random.default_rng(0)
    sizes = [max((c.size for c in reduced if i in c.bodies), default=1.0) for i in range(len(frames))]
    out = []
    for _ in range(2):
        moved = [
            frame * pin.exp6(rng.uniform(-0.1, 0.1, 6) * np.array([size] * 3 + [1.0] * 3)) if i else frame
            for i, (frame, size) in enumerate(zip(frames, sizes, strict=True))
        ]
        solution = solve(reduced, moved, range(1, len(frames)), graph.tolerance)
        if solution.residual <= graph.tolerance.satisfied:
            there = [solution.poses.get(i, pose) for i, pose in enumerate(moved)]
            out.append(mobility(reduced, there, [0], graph.tolerance))
    return out


def _joint(
    own: Sequence[Constraint],
    pair: tuple[int, int],
    frames: Sequence[pin.SE3],
    whole: Mobility,
    nearby: Sequence[Mobility],
    graph: AssemblyGraph,
) -> Freedom:
    """Freedom of link b relative to link a."""
    a, b = pair
    alone = mobility(own, {a: frames[a], b: frames[b]}, [a], graph.tolerance).parts[b]
    narrow = whole.pairs[pair]
    if narrow.freedom >= alone.freedom or narrow.joint not in SUBGROUPS or not nearby:
        return alone
    # the instantaneous axis of a closed loop wanders, a joint's does not
    lasting = all(_same_space(m.pairs[pair].twists, narrow.twists) for m in nearby)
    return narrow if lasting else alone


def _same_space(first: Array, second: Array) -> bool:
    """Whether two sets of local twists (6, f) span the same space."""
    if first.shape != second.shape:
        return False
    both = np.linalg.svd(np.hstack([first, second]), compute_uv=False)
    return bool(np.all(both[first.shape[1] :] < 1e-6 * both[0]))


def _axes(freedom: Freedom, pose: pin.SE3) -> tuple[Axis, ...]:
    """The chain of axes that spans a lower pair, given by local twists at `pose`: slides first, then turns."""
    here = pose.translation
    twists = pin.SE3(np.eye(3), -here).action @ pose.action @ freedom.twists  # world axes, about the link's origin
    linear, angular = twists[:3], twists[3:]
    u, s, vt = np.linalg.svd(angular)
    rank = int(np.sum(s > 1e-7)) if s.size else 0
    slides = [_signed(v) for v in np.linalg.svd(linear @ vt[rank:].T)[0].T[: freedom.freedom - rank]]
    chain = [Axis("prismatic", here, d) for d in slides]
    if rank == 1:
        axis = _signed(u[:, 0])
        turn = twists @ vt[0]
        moment = turn[:3] / (turn[3:] @ axis)
        for d in slides:  # a slide beside it lets any pitch and any parallel axis do
            moment = moment - (moment @ d) * d
        pitch = float(moment @ axis) if freedom.joint == "screw" else 0.0
        chain.append(Axis("screw" if pitch else "revolute", here + np.cross(axis, moment), axis, pitch))
    elif rank == 3:
        turning = twists @ vt[:3].T
        across = np.eye(3) - sum((np.outer(d, d) for d in slides), np.zeros((3, 3)))
        rows = np.vstack([across @ -pin.skew(w) for w in turning[3:].T])
        center = np.linalg.lstsq(rows, np.concatenate([across @ v for v in turning[:3].T]), rcond=None)[0]
        chain += [Axis("revolute", here + center, d) for d in np.eye(3)]
    return tuple(chain)


def _signed(v: Array) -> Array:
    """A direction with its first large component positive: the same joint gets the same axis each time."""
    return np.asarray(v * np.sign(v[int(np.argmax(np.abs(v) > 0.5 * np.abs(v).max()))]))


def _spanning_tree(
    graph: AssemblyGraph, links: tuple[tuple[int, ...], ...], joints: Mapping[tuple[int, int], Joint]
) -> tuple[list[Joint], list[Joint]]:
    """Spanning tree from link 0, joints of least freedom first (Prim), and the joints beside it.

    Links without a joint get a free one.
    """
    joined, tree, left = {0}, [], dict(joints)
    while len(joined) < len(links):
        edges = [(len(j.axes), pair) for pair, j in left.items() if len(joined & set(pair)) == 1]
        if edges:
            _, pair = min(edges)
            joint = left.pop(pair)
            if joint.parent not in joined:
                joint = replace(joint, parent=joint.child, child=joint.parent)
        else:
            link = min(set(range(len(links))) - joined)
            pose = graph.poses[links[link][0]]
            joint = Joint(f"{graph.label(links[link][0])}--free", 0, link, _axes(_FREE, pose), "free")
        tree.append(joint)
        joined.add(joint.child)
    return tree, list(left.values())


_FREE = Freedom(6, 6, np.eye(6), "free")


def _needed(tree: Sequence[Joint], rest: Sequence[Joint], n_links: int) -> list[Joint]:
    """The joints beside the tree that reduce its freedom, each further than those before it."""
    start = np.concatenate([[0], np.cumsum([len(j.axes) for j in tree])])
    motion = np.zeros((n_links, 6, int(start[-1])))
    for j, k in zip(tree, start[:-1], strict=True):
        motion[j.child] = motion[j.parent]
        motion[j.child, :, k : k + len(j.axes)] += np.stack([a.twist for a in j.axes], axis=1)
    kept: list[Joint] = []
    rows = np.zeros((0, int(start[-1])))
    rank = 0
    for loop in rest:
        allowed = np.linalg.qr(np.stack([a.twist for a in loop.axes], axis=1))[0]
        barred = np.eye(6) - allowed @ allowed.T
        more = np.vstack([rows, barred @ (motion[loop.child] - motion[loop.parent])])
        found = int(np.linalg.matrix_rank(more, tol=1e-9 * max(1.0, float(np.abs(motion).max()))))
        if found > rank:
            kept, rows, rank = [*kept, loop], more, found
    return kept
