"""Whether other parts hold a group inside: proofs that no motion takes it out.

One closed shell around all of the group is a proof. So is a ball that fits into the group and finds no way out between
surface points of the others: the cells of a grid in which its centre may be are flooded from where it is, and the flood
stays inside. A cell is closed to it only if wherever the centre is in the cell, the ball reaches over a surface point.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from collision import SurfaceMesh, colliding_surfaces, inside
from collision.solid import is_closed
from physics.model.body import polyhedron
from vpframe.analysis.bodies import shells
from vpframe.planning.assembly import Array, Assembly

FINENESS: Final = 3.0
"""cells of the grid a radius of the ball"""
MOST_CELLS: Final = 60_000
"""cells that are flooded at most; a larger room is not looked at"""
MOST_GRID: Final = 1 << 28
"""cells of the grid at most"""
MOST_SAMPLES: Final = 400_000
INSIDE: Final = 12
"""places a side of a part's box at which a ball is tried"""
NEIGHBOURS: Final = np.array([d for d in product((-1, 0, 1), repeat=3) if any(d)], np.int64)
"""cells that share a face, an edge or a corner"""


def enclosed_by(assembly: Assembly, group: Sequence[int], others: Iterable[int]) -> int | None:
    """A part of which one closed shell has all of the group inside, no surface of the group meeting it; None without.

    A rigid body that is inside a closed surface and does not meet it leaves it only by crossing it. A body that
    touches the shell is not claimed to be enclosed.
    """
    for j in others:
        for shell in shells(assembly.meshes[j]):
            if _holds(shell) and all(_inside(assembly, shell, i, j) for i in group):
                return j
    return None


def _holds(shell: SurfaceMesh) -> bool:
    """Whether a shell is closed and bounds a room: every edge is met as often one way as the other."""
    return is_closed(shell)


def _inside(assembly: Assembly, shell: SurfaceMesh, i: int, j: int) -> bool:
    pose = assembly.poses[j].actInv(assembly.poses[i])
    mesh = assembly.meshes[i]
    points = mesh.vertices[np.unique(mesh.triangles)] @ pose.rotation.T + pose.translation
    low, high = shell.vertices[shell.triangles].min(axis=(0, 1)), shell.vertices[shell.triangles].max(axis=(0, 1))
    if (points < low).any() or (points > high).any():
        return False
    outward = (
        shell
        if polyhedron(shell.vertices[shell.triangles])[0] > 0.0
        else SurfaceMesh(shell.vertices, shell.triangles[:, ::-1], np.zeros(len(shell.triangles), np.int64))
    )
    if not bool(inside(outward, points).all()):
        return False
    return not len(colliding_surfaces(shell, mesh, pose))


def caged_by(assembly: Assembly, group: Sequence[int], others: Iterable[int]) -> tuple[int, ...] | None:
    """Parts between which a ball inside the group finds no way out, in the order of the scene; None without a proof.

    Parts that motions may pass through do not count: those that are ignored, fitted to the group, or overlap it.
    """
    from scipy.spatial import cKDTree

    solid = [j for j in others if not any(_may_pass(assembly, i, j) for i in group)]
    ball = max((_ball(assembly, i) for i in group), key=lambda b: b[1])
    center, radius = ball[0], ball[1] - 2.0 * assembly.tolerance.linear
    if not solid or radius < 20.0 * assembly.tolerance.linear:
        return None
    boxes = [assembly.sweeps.corners(j) for j in solid]
    low = np.min([c.min(axis=0) for c in boxes], axis=0) - radius
    high = np.max([c.max(axis=0) for c in boxes], axis=0) + radius
    points: list[Array] = []
    owners = []
    for j in solid:
        mesh, pose = assembly.meshes[j], assembly.poses[j]
        found = _surface_points(mesh.vertices @ pose.rotation.T + pose.translation, mesh.triangles, radius / 4.0)
        if found is None or sum(map(len, points)) + len(found) > MOST_SAMPLES:
            return None
        points.append(found)
        owners.append(np.full(len(found), j))
    tree, owner = cKDTree(np.concatenate(points)), np.concatenate(owners)
    size = radius / FINENESS
    reach = radius - 0.5 * np.sqrt(3.0) * size * (1.0 + 1e-9)
    shape = np.ceil((high - low) / size).astype(np.int64) + 2
    first = np.floor((center - low) / size).astype(np.int64)
    if (first < 0).any() or (first >= shape).any() or shape.prod(dtype=float) > MOST_GRID:
        return None
    # cells by their place in the flat grid
    strides = np.array([shape[1] * shape[2], shape[2], 1])
    fresh, seen, free = np.array([first @ strides]), np.zeros(int(shape.prod()), bool), 1
    seen[fresh] = True
    held = set[int]()
    while len(fresh):
        cells = np.stack(np.unravel_index(fresh, shape), axis=1)
        if free > MOST_CELLS or (cells <= 0).any() or (cells >= shape - 1).any():
            return None
        near = np.unique(fresh[:, None] + NEIGHBOURS @ strides)
        near = near[~seen[near]]
        seen[near] = True
        middles = low + (np.stack(np.unravel_index(near, shape), axis=1) + 0.5) * size
        distance, at = tree.query(middles, distance_upper_bound=reach)
        closed = distance < reach
        held |= set(owner[at[closed]].tolist())
        fresh = near[~closed]
        free += len(fresh)
    return tuple(sorted(held))


def _may_pass(assembly: Assembly, i: int, j: int) -> bool:
    """Whether a motion of part i may go through part j: ignored, excused as fits are, or overlapping already, by
    more than a touch."""
    return bool(frozenset((i, j)) in assembly.ignored or assembly.mates_of(i, j)) or assembly.pressed(i, j)


def _ball(assembly: Assembly, i: int) -> tuple[Array, float]:
    """(centre, radius) of a large ball inside part i where it stands, m; radius 0 of one that is not closed."""
    from scipy.spatial import cKDTree

    mesh, pose = assembly.meshes[i], assembly.poses[i]
    corners = mesh.vertices[np.unique(mesh.triangles)]
    low, high = corners.min(axis=0), corners.max(axis=0)
    spacing = float((high - low).max()) / (4 * INSIDE)
    surface = _surface_points(mesh.vertices, mesh.triangles, spacing)
    if surface is None or not assembly.scene.parts[i].shape.closed:
        return pose.translation, 0.0
    sides = [np.linspace(a, b, INSIDE + 2)[1:-1] for a, b in zip(low, high, strict=True)]
    places = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
    places = places[inside(mesh, places)]
    if not len(places):
        return pose.translation, 0.0
    distance = cKDTree(surface).query(places)[0]
    k = int(np.argmax(distance))
    return np.asarray(pose.act(places[k])), max(0.0, float(distance[k]) - spacing)


def _surface_points(vertices: Array, triangles: NDArray[np.integer], spacing: float) -> Array | None:
    """(n, 3) points of triangles, of which each point of them is within `spacing` of one; None if they were too many.

    The corners of as many equal pieces a side as make each no longer than that.
    """
    corners = vertices[triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    pieces = np.maximum(1, np.ceil(longest / spacing)).astype(np.int64)
    if int(((pieces + 1) * (pieces + 2) // 2).sum()) > MOST_SAMPLES:
        return None
    out = []
    for n in np.unique(pieces).tolist():
        weights = np.array([(a, b, n - a - b) for a in range(n + 1) for b in range(n + 1 - a)]) / n
        out.append(np.einsum("kc,tcd->tkd", weights, corners[pieces == n]).reshape(-1, 3))
    return np.concatenate(out)
