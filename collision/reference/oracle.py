"""coal behind the same interface: a reference for exact results, and the queries of shapes without triangles.

coal tests triangles in floating point by GJK. Its tolerance is set to 1e-10: at its default of 1e-6 it reports contacts
of triangles that do not touch. Meshes are checked when they are made, and poses by `collision.poses`, before they reach
coal, where a bad index would crash the interpreter, and a pose with NaN would count as a collision.
"""

from __future__ import annotations

import hashlib
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from collision.bvh.build import bvh_of
from collision.contact import CONTACT_DTYPE
from collision.errors import CollisionError
from collision.mesh import SurfaceMesh
from collision.poses import pack
from collision.reference.shape import ShapeMesh
from collision.tolerance import DEFAULT, Tolerance

ROUNDING: Final = 64.0 * 2.0**-53
"""1: bound of the rounding error of a box moved by a pose, per unit of its coordinates"""


class OracleError(CollisionError):
    """Two answers that differ: `ours`, `theirs` (k, 2), and the `path` of a file from which to reproduce them."""

    def __init__(self, message: str, ours: NDArray[np.int32], theirs: NDArray[np.int32], path: Path) -> None:
        super().__init__(message)
        self.ours = ours
        self.theirs = theirs
        self.path = path


def colliding_surfaces(
    mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose_ab: Any, tolerance: Tolerance = DEFAULT
) -> NDArray[np.int32]:
    """Return (k, 2) int32, sorted, as `methods.colliding_surfaces`: the pairs of surfaces in collision by coal."""
    import coal

    pose = pack(pose_ab, f"pose of {mesh_b.name} in {mesh_a.name}", rigid=tolerance.rigid)
    request = coal.CollisionRequest()
    request.gjk_tolerance = tolerance.gjk
    still, moved = coal.Transform3s.Identity(), coal.Transform3s(pose[:9].reshape(3, 3), pose[9:])
    found = []
    for s, t in _near(mesh_a, mesh_b, pose, 0.0):
        a, b = _surface(mesh_a, s), _surface(mesh_b, t)
        if coal.collide(a, still, b, moved, request, coal.CollisionResult()) > 0:
            found.append((s, t))
    return np.array(found, np.int32).reshape(-1, 2)


def surface_contacts(
    mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose_ab: Any, within: float, enabled: NDArray[np.uint8] | None = None,
    tolerance: Tolerance = DEFAULT,
) -> NDArray[Any]:  # fmt: skip
    """Return the rows of `query.distance.contacts_at` by coal; triangles are -1 where a surface has none."""
    import coal

    pose = pack(pose_ab, f"pose of {mesh_b.name} in {mesh_a.name}", rigid=tolerance.rigid)
    request = coal.DistanceRequest()
    request.gjk_tolerance = tolerance.gjk
    request.enable_signed_distance = False
    still, moved = coal.Transform3s.Identity(), coal.Transform3s(pose[:9].reshape(3, 3), pose[9:])
    colliding = {(int(s), int(t)) for s, t in colliding_surfaces(mesh_a, mesh_b, pose_ab, tolerance)}
    rows = []
    for s, t in _near(mesh_a, mesh_b, pose, within):
        if enabled is not None and enabled[s, t] == 0:
            continue
        result = coal.DistanceResult()
        a, b = _surface(mesh_a, s), _surface(mesh_b, t)
        distance = coal.distance(a, still, b, moved, request, result)
        meet = (s, t) in colliding
        if not meet and distance > within:
            continue
        point_a, point_b = np.array(result.getNearestPoint1()), np.array(result.getNearestPoint2())
        if isinstance(b, coal.OcTree) != isinstance(a, coal.OcTree):  # coal puts the octree first
            triangle, swapped = (result.b2, isinstance(b, coal.OcTree))
            point_a, point_b = (point_b, point_a) if swapped else (point_a, point_b)
            place_a, place_b = (triangle, -1) if swapped else (-1, triangle)
        else:
            place_a, place_b = result.b1, result.b2
        row = np.zeros((), CONTACT_DTYPE)
        row["object_b"], row["surface_a"], row["surface_b"] = 1, s, t
        row["distance"] = 0.0 if meet else max(distance, np.finfo(np.float64).tiny)
        row["point_a"], row["point_b"] = (point_a, point_b) if not meet else ((point_a + point_b) / 2,) * 2
        row["triangle_a"], row["triangle_b"] = _triangle(mesh_a, s, place_a), _triangle(mesh_b, t, place_b)
        rows.append(row)
    return np.array(rows, CONTACT_DTYPE)


def clearance(
    mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose_ab: Any, surface_a: int | None = None, surface_b: int | None = None,
    tolerance: Tolerance = DEFAULT,
) -> NDArray[Any]:  # fmt: skip
    """Return the row of least distance of `surface_contacts`, of two meshes or of a surface of either."""
    rows = surface_contacts(mesh_a, mesh_b, pose_ab, np.inf, tolerance=tolerance)
    for name, surface in (("surface_a", surface_a), ("surface_b", surface_b)):
        if surface is not None:
            rows = rows[rows[name] == surface]
    return rows[[int(np.argmin(rows["distance"]))]]


def cross_check(
    mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose_ab: Any, ours: NDArray[np.int32],
    directory: str | Path | None = None, tolerance: Tolerance = DEFAULT, enabled: NDArray[np.uint8] | None = None,
) -> None:  # fmt: skip
    """Compare a result with coal's.

    ours: (k, 2), as `colliding_surfaces`. enabled: (ka, kb), 0 for pairs of surfaces to leave out. Pairs of surfaces
    whose signed distance is within coal's error bound (`tolerance.oracle` of the parts' size) may differ.

    Raises
    ------
    OracleError: the answers differ; `reproduce` reads both meshes and the pose from the file it names, in `directory`
        or else in the folder for temporary files.
    """
    theirs = colliding_surfaces(mesh_a, mesh_b, pose_ab, tolerance)
    if enabled is not None:
        theirs = theirs[enabled[theirs[:, 0], theirs[:, 1]] != 0]
    one, other = ({(int(s), int(t)) for s, t in pairs} for pairs in (ours, theirs))
    differ = sorted(pair for pair in one ^ other if not _within_error(mesh_a, mesh_b, pose_ab, pair, tolerance))
    if not differ:
        return
    matrix = np.asarray(getattr(pose_ab, "homogeneous", pose_ab))
    arrays = {
        "pose": matrix, "ours": np.asarray(ours, np.int32), "theirs": theirs,
        **{f"{name}_a": getattr(mesh_a, name) for name in ("vertices", "triangles", "surface_of_triangle")},
        **{f"{name}_b": getattr(mesh_b, name) for name in ("vertices", "triangles", "surface_of_triangle")},
    }  # fmt: skip
    digest = hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays.values())).hexdigest()[:12]
    path = Path(directory if directory is not None else tempfile.gettempdir()) / f"collision-differs-{digest}.npz"
    np.savez_compressed(path, **arrays)  # type: ignore[arg-type]
    raise OracleError(
        f"{mesh_a.name} and {mesh_b.name}: {len(one)} colliding pairs of surfaces here, {len(other)} by coal; "
        f"they differ in {differ[:4]}{' …' if len(differ) > 4 else ''}; reproduce from {path}",
        arrays["ours"], theirs, path,
    )  # fmt: skip


def reproduce(path: str | Path) -> tuple[SurfaceMesh, SurfaceMesh, NDArray[np.float64]]:
    """Read the two meshes and the (4, 4) pose of the second in the first's frame from the file of an `OracleError`."""
    with np.load(path) as data:
        meshes = [
            SurfaceMesh(data[f"vertices_{k}"], data[f"triangles_{k}"], data[f"surface_of_triangle_{k}"], name=k)
            for k in ("a", "b")
        ]
        return meshes[0], meshes[1], np.array(data["pose"])


def _within_error(
    mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose_ab: Any, pair: tuple[int, int], tolerance: Tolerance
) -> bool:  # fmt: skip
    from collision.query.signed_distance import signed_distances_of

    if isinstance(mesh_a, ShapeMesh) or isinstance(mesh_b, ShapeMesh):
        return False
    pose, error = pack(pose_ab, "pose", rigid=tolerance.rigid), tolerance.oracle
    size = max(float(np.ptp(mesh.vertices, axis=0).max()) for mesh in (mesh_a, mesh_b))
    (signed,) = signed_distances_of(
        bvh_of(mesh_a), bvh_of(mesh_b), pose, np.array([pair], np.int64), 2.0 * error * size
    )  # fmt: skip
    return bool(abs(signed) <= error * size)


def _surface(mesh: SurfaceMesh, surface: int) -> Any:
    """coal's geometry of one surface, kept on the mesh."""
    import coal

    if isinstance(mesh, ShapeMesh):
        return mesh.shape
    models = mesh._cache.setdefault("coal", {})
    if surface not in models:
        used, index = np.unique(mesh.triangles[mesh.triangles_of(surface)], return_inverse=True)
        model = coal.BVHModelOBBRSS()
        model.beginModel(len(index) // 3, len(used))
        model.addVertices(mesh.vertices[used])
        model.addTriangles(index.reshape(-1, 3).astype(np.int64))
        model.endModel()
        models[surface] = model
    return models[surface]


def _triangle(mesh: SurfaceMesh, surface: int, place: int) -> int:
    return -1 if isinstance(mesh, ShapeMesh) or place < 0 else int(mesh.triangles_of(surface)[place])


def _near(mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose: NDArray[np.float64], within: float) -> list[tuple[int, int]]:
    """Pairs of surfaces whose boxes come within `within`."""
    (low_a, high_a), (low_b, high_b) = _boxes(mesh_a), _boxes(mesh_b)
    rotation = pose[:9].reshape(3, 3)
    center = 0.5 * (low_b + high_b) @ rotation.T + pose[9:]
    half = 0.5 * (high_b - low_b) @ np.abs(rotation).T
    half += within + ROUNDING * (np.abs(center) + half)
    apart = (low_a[:, None] > (center + half)[None]) | (high_a[:, None] < (center - half)[None])
    return [(int(s), int(t)) for s, t in np.argwhere(~apart.any(axis=2))]


def _boxes(mesh: SurfaceMesh) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(k, 3) least and (k, 3) greatest x, y, z of each surface, kept on the mesh."""
    boxes: tuple[NDArray[np.float64], NDArray[np.float64]] | None = mesh._cache.get("surface boxes")
    if boxes is None:
        corners = mesh.vertices[mesh.triangles[mesh.order]]
        start = mesh.surface_start[:-1]
        boxes = mesh._cache["surface boxes"] = (
            np.minimum.reduceat(corners.min(axis=1), start), np.maximum.reduceat(corners.max(axis=1), start),
        )  # fmt: skip
    return boxes
