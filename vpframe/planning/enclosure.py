"""Whether a closed shell of another part holds a group: the proof that no motion takes it out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from collision import SurfaceMesh, colliding_surfaces
from collision.query.containment import inside
from vpframe.planning.assembly import Assembly


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


def shells(mesh: SurfaceMesh) -> list[SurfaceMesh]:
    """The pieces of a mesh that share no vertex position, each a mesh of one surface."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    positions, at = np.unique(mesh.vertices, axis=0, return_inverse=True)
    triangles = at.reshape(-1)[mesh.triangles]
    n = len(positions)
    rows = np.concatenate([triangles[:, 0], triangles[:, 1]])
    columns = np.concatenate([triangles[:, 1], triangles[:, 2]])
    count, label = connected_components(coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(n, n)), directed=False)
    of = label[triangles[:, 0]]
    return [
        SurfaceMesh(positions, triangles[of == k], np.zeros(int((of == k).sum()), np.int64))
        for k in range(count)
        if (of == k).any()
    ]


def _holds(shell: SurfaceMesh) -> bool:
    """Whether a shell is closed and bounds a room: every edge is met as often one way as the other."""
    return _is_closed(shell.triangles)


def _is_closed(triangles: NDArray[np.integer]) -> bool:
    t = np.asarray(triangles, np.int64)
    edges = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    key = lambda e: np.sort(e[:, 0] * (t.max() + 1) + e[:, 1])  # noqa: E731
    return bool(np.array_equal(key(edges), key(edges[:, ::-1])))


def _inside(assembly: Assembly, shell: SurfaceMesh, i: int, j: int) -> bool:
    pose = assembly.poses[j].actInv(assembly.poses[i])
    mesh = assembly.meshes[i]
    points = mesh.vertices[np.unique(mesh.triangles)] @ pose.rotation.T + pose.translation
    low, high = shell.vertices[shell.triangles].min(axis=(0, 1)), shell.vertices[shell.triangles].max(axis=(0, 1))
    if (points < low).any() or (points > high).any():
        return False
    outward = (
        shell
        if _volume(shell) > 0.0
        else SurfaceMesh(shell.vertices, shell.triangles[:, ::-1], np.zeros(len(shell.triangles), np.int64))
    )
    if not bool(inside(outward, points).all()):
        return False
    return not len(colliding_surfaces(shell, mesh, pose))


def _volume(mesh: SurfaceMesh) -> float:
    """m³, negative for normals that point inwards."""
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)
