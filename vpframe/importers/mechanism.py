"""Links and joints of a model (URDF, MJCF, Pinocchio) as constraints between parts.

Links without geometry are no parts: the chain of joints through them becomes one joint, the lower pair that its axes
span. Chains that span none, and joints to a ground without geometry, are named and left out.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from constraints.freedom.graph import components
from constraints.freedom.lower_pairs import lower_pair
from vpframe.importers.raw import Array, RawJoint
from vpframe.scene.joints import Statement, statements
from vpframe.scene.scene import Scene

ACROSS = 1e-6
"""tolerance, rad and relative to the size, for parallel and intersecting axes"""


def impose(scene: Scene, links: list[list[str]], joints: Iterable[RawJoint]) -> None:
    """Add the statements of a mechanism's joints to a scene, and notes on joints that are left out.

    links: names of the parts of each link; link 0 is the ground, whose parts become fixed.
    """
    joints = list(joints)
    rigid = [joint.links for joint in joints if not joint.axes and not joint.free]
    groups = components(range(len(links)), rigid)
    group_of = {link: g for g, group in enumerate(groups) for link in group}
    parts = [[name for link in group for name in links[link]] for group in groups]
    ground = group_of[0]
    for name in parts[ground]:
        scene[name].fixed = True
    made: list[Statement] = []
    notes = [f"joint {joint.name}: {joint.note}" for joint in joints if joint.note]
    for g, names in enumerate(parts):
        if g != ground:
            for other in names[1:]:
                made += statements("fixed", (names[0], other), (scene[names[0]].pose, scene[other].pose), np.zeros(3))
    edges: dict[int, list[tuple[int, RawJoint]]] = {g: [] for g in range(len(groups))}
    for joint in joints:
        a, b = (group_of[link] for link in joint.links)
        if a != b and joint.axes:
            edges[a].append((b, joint))
            edges[b].append((a, joint))
    for start in range(len(groups)):
        if not parts[start] and start != ground:
            continue
        for end, chain in _chains(start, edges, {g for g in range(len(groups)) if parts[g] or g == ground}):
            if end <= start:
                continue
            called = ", ".join(joint.name for joint in chain)
            if not (parts[start] and parts[end]):
                held = (parts[start] or parts[end])[0]
                notes.append(f"joint {called} holds {held} to a ground without geometry: left out")
                continue
            pair = (parts[start][0], parts[end][0])
            own = _pair(scene, pair, chain)
            if own is None:
                notes.append(f"joint {called} of {pair[0]} and {pair[1]} is no lower pair: left out")
            else:
                made += own
    scene.statements += tuple(made)
    scene.notes += tuple(notes)


def _chains(
    start: int, edges: dict[int, list[tuple[int, RawJoint]]], solid: set[int]
) -> Iterable[tuple[int, list[RawJoint]]]:
    """Yield the groups with parts that chains of joints through groups without parts lead to, with the chains."""
    stack: list[tuple[int, list[RawJoint]]] = [(start, [])]
    while stack:
        group, chain = stack.pop()
        for other, joint in edges[group]:
            if joint in chain:
                continue
            if other in solid:
                yield other, [*chain, joint]
            else:
                stack.append((other, [*chain, joint]))


def _pair(scene: Scene, parts: tuple[str, str], chain: list[RawJoint]) -> tuple[Statement, ...] | None:
    poses = (scene[parts[0]].pose, scene[parts[1]].pose)
    origin = chain[0].axes[0][1]
    columns = []
    for kind, point, axis in (axis for joint in chain for axis in joint.axes):
        lever: Array = np.cross(point - origin, axis)
        columns.append(np.concatenate([axis, np.zeros(3)] if kind == "prismatic" else [lever, axis]))
    twists = np.stack(columns, axis=1)
    twists = np.linalg.svd(twists, full_matrices=False)[0][:, : np.linalg.matrix_rank(twists, tol=ACROSS)]
    size = max(float(np.ptp(scene[name].mesh.vertices, axis=0).max()) for name in parts)
    pair = lower_pair(twists, max(size, 1e-3), ACROSS)
    if pair is None:
        return None
    if pair.name == "free":
        return ()
    axis = pair.frame.rotation[:, 2]
    return statements(pair.name, parts, poses, origin + pair.frame.translation, axis, 2.0 * np.pi * pair.pitch)
