"""The volume that a moved part sweeps, as a closed mesh, and its collisions.

Every voxel that the part's surface passes through, or that such voxels enclose, belongs to the volume. It is never too
small and deviates from the true volume by at most the diagonal of a voxel; enclosed cavities count as swept. The mesh
consists of the voxels' outer faces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CollisionManager, SurfaceMesh
from collision.numeric.kernel import kernel
from vpframe.scene.scene import Part

VOXELS = 96
"""default number of voxels along the longest side of the volume"""


@dataclass(frozen=True, eq=False)
class SweptVolume:
    """The volume that a part swept, world frame."""

    part: str
    vertices: NDArray[np.float64]
    """(n, 3) m"""
    triangles: NDArray[np.int32]
    """(m, 3)"""
    error: float
    """maximum distance of the mesh from the true volume, m"""
    clashes: tuple[str, ...] = ()
    """parts that the volume collides with"""


def swept_volume(
    part: Part, poses: Sequence[pin.SE3], rest: Sequence[Part] = (), resolution: float | None = None
) -> SweptVolume:
    """Return the volume that `part` sweeps on its way through `poses` (screw motions between neighbours).

    Parameters
    ----------
    rest: parts, at their present poses, that are checked for collisions with the volume.
    resolution: side of a voxel, m.
    """
    mesh = part.mesh
    box = _bounds(mesh, poses)
    side = float(resolution or (box[1] - box[0]).max() / VOXELS)
    origin = box[0] - 1.5 * side
    shape = np.ceil((box[1] - origin) / side).astype(np.int64) + 2
    grid = np.zeros(tuple(shape), np.bool_)
    corners = mesh.vertices[mesh.triangles]
    for pose in _dense(poses, mesh, 0.5 * side):
        placed = corners @ pose.rotation.T + pose.translation
        _mark(grid, (placed - origin) / side)
    vertices, triangles = _outer_faces(~_outside(grid))
    vertices = vertices * side + origin
    volume = SurfaceMesh(vertices, triangles, name=f"swept volume of {part.name}")
    return SweptVolume(
        part=part.name,
        vertices=vertices,
        triangles=triangles,
        error=float(np.sqrt(3.0) * side),
        clashes=_clashes(volume, rest),
    )


def _bounds(mesh: SurfaceMesh, poses: Sequence[pin.SE3]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    used = mesh.vertices[np.unique(mesh.triangles)]
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for pose in poses:
        placed = used @ pose.rotation.T + pose.translation
        low, high = np.minimum(low, placed.min(0)), np.maximum(high, placed.max(0))
    return low, high


def _dense(poses: Sequence[pin.SE3], mesh: SurfaceMesh, step: float) -> list[pin.SE3]:
    """Insert poses so that no point of the mesh moves farther than `step` from one to the next."""
    arm = float(np.linalg.norm(mesh.vertices, axis=1).max())
    out = [poses[0]]
    for a, b in pairwise(poses):
        way = a.actInv(b)
        far = float(np.linalg.norm(way.translation)) + arm * float(np.linalg.norm(pin.log3(way.rotation)))
        n = int(np.ceil(far / step))
        out += [pin.SE3.Interpolate(a, b, k / n) for k in range(1, n)]
        if n:
            out.append(b)
    return out


@kernel
def _mark(grid, triangles):  # type: ignore[no-untyped-def]
    """Mark the voxels of points on the triangles (m, 3, 3), in voxels, at most half a voxel apart."""
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        longest = 0.0
        for p, q in ((a, b), (b, c), (c, a)):
            longest = max(longest, np.sqrt((q[0] - p[0]) ** 2 + (q[1] - p[1]) ** 2 + (q[2] - p[2]) ** 2))
        n = max(int(np.ceil(2.0 * longest)), 1)
        for i in range(n + 1):
            for j in range(n + 1 - i):
                u, v = i / n, j / n
                w = 1.0 - u - v
                x = w * a[0] + u * b[0] + v * c[0]
                y = w * a[1] + u * b[1] + v * c[1]
                z = w * a[2] + u * b[2] + v * c[2]
                grid[int(x), int(y), int(z)] = True


def _outside(grid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the empty voxels connected to the corner of the grid."""
    from scipy.ndimage import label

    names, _ = label(~grid)
    return np.asarray(names == names[0, 0, 0])


def _outer_faces(solid: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return vertices (in voxels) and outward triangles of the faces between solid and empty voxels."""
    quads = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (0, 1):
            shifted = np.roll(solid, 1 if side == 0 else -1, axis=axis)
            cells = np.argwhere(solid & ~shifted)
            base = cells.astype(np.int64)
            base[:, axis] += side
            corner = np.repeat(base[:, None], 4, axis=1)
            for k, (du, dv) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
                corner[:, k, u] += du
                corner[:, k, v] += dv
            quads.append(corner if side == 1 else corner[:, ::-1])
    quad = np.concatenate(quads)
    points, index = np.unique(quad.reshape(-1, 3), axis=0, return_inverse=True)
    index = index.reshape(-1, 4)
    triangles = np.concatenate([index[:, [0, 1, 2]], index[:, [0, 2, 3]]]).astype(np.int32)
    return points.astype(np.float64), triangles


def _clashes(volume: SurfaceMesh, rest: Sequence[Part]) -> tuple[str, ...]:
    manager = CollisionManager()
    manager.add(volume, pin.SE3.Identity())
    for part in rest:
        manager.add(part.mesh, part.pose, movable=False)
    hit = {int(row[2]) for row in manager.colliding_surfaces([0])}
    hit |= {i for i in range(1, len(rest) + 1) if i not in hit and manager.contains(0, i)}
    return tuple(rest[i - 1].name for i in sorted(hit))
