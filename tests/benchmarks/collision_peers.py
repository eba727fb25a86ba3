"""coal asked for colliding surfaces in the ways one can ask it, and what a bench compares an exact answer with."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from numba import njit
from numpy.typing import NDArray

from collision import SurfaceMesh

Pairs = set[tuple[int, int]]
Query = Callable[[pin.SE3], Any]


def _model(cls: Any, mesh: SurfaceMesh, triangles: NDArray[np.int32]) -> Any:
    used, index = np.unique(triangles, return_inverse=True)
    model = cls()
    model.beginModel(len(triangles), len(used))
    model.addVertices(mesh.vertices[used])
    model.addTriangles(index.reshape(-1, 3).astype(np.int64))
    model.endModel()
    return model


def all_contacts(a: SurfaceMesh, b: SurfaceMesh, tree: str = "BVHModelOBBRSS", gjk: float = 1e-10) -> Query:
    """One model a part, every contact found and its two triangles read."""
    cls = getattr(coal, tree)
    model_a, model_b = _model(cls, a, a.triangles), _model(cls, b, b.triangles)
    surface_a, surface_b = a.surface_of_triangle.tolist(), b.surface_of_triangle.tolist()
    request = coal.CollisionRequest()
    request.num_max_contacts = 1_000_000
    request.enable_contact = True
    request.gjk_tolerance = gjk
    still = coal.Transform3s.Identity()

    def query(pose: pin.SE3) -> Pairs:
        result = coal.CollisionResult()
        coal.collide(model_a, still, model_b, coal.Transform3s(pose.rotation, pose.translation), request, result)
        contacts = [result.getContact(i) for i in range(result.numContacts())]
        return {(surface_a[c.b1], surface_b[c.b2]) for c in contacts}

    return query


class BySurface:
    """Surface pairs whose boxes overlap: what a peer that asks pair by pair is given. Not timed."""

    def __init__(self, a: SurfaceMesh, b: SurfaceMesh) -> None:
        self.boxes = [surface_boxes(mesh) for mesh in (a, b)]

    def near(self, pose: pin.SE3, within: float = 0.0) -> list[tuple[int, int]]:
        """Surface pairs whose boxes come within a distance (m), 0 where they overlap."""
        of_a, of_b = self.boxes
        return sorted(bounding_volumes(of_a + np.array([[-within], [within]]), of_b, pose))


class FirstContacts(BySurface):
    """One model a surface, boxes first, then the first contact of each pair: coal's fastest way to the same answer.

    `query` is the collide calls alone.
    """

    def __init__(self, a: SurfaceMesh, b: SurfaceMesh, gjk: float = 1e-10) -> None:
        super().__init__(a, b)
        self.models = [
            [_model(coal.BVHModelOBBRSS, mesh, mesh.triangles[mesh.triangles_of(s)]) for s in range(mesh.n_surfaces)]
            for mesh in (a, b)
        ]
        self.request = coal.CollisionRequest()
        self.request.gjk_tolerance = gjk
        self.request.enable_contact = False

    def query(self, pose: pin.SE3, near: list[tuple[int, int]]) -> Pairs:
        """The pairs of `near` that coal finds in collision."""
        still, moved = coal.Transform3s.Identity(), coal.Transform3s(pose.rotation, pose.translation)
        of_a, of_b = self.models
        return {
            (s, t)
            for s, t in near
            if coal.collide(of_a[s], still, of_b[t], moved, self.request, coal.CollisionResult())
        }


def _transform(pose: pin.SE3) -> Any:
    return coal.Transform3s(pose.rotation, pose.translation)


def _distance_request() -> Any:
    request = coal.DistanceRequest()
    request.gjk_tolerance = 1e-10
    request.enable_signed_distance = False
    return request


def distance(a: SurfaceMesh, b: SurfaceMesh) -> Query:
    """The least distance of two parts, with the nearest points."""
    models, request = [_model(coal.BVHModelOBBRSS, mesh, mesh.triangles) for mesh in (a, b)], _distance_request()
    still = coal.Transform3s.Identity()

    def query(pose: pin.SE3) -> float:
        return float(coal.distance(models[0], still, models[1], _transform(pose), request, coal.DistanceResult()))

    return query


def first_contact(a: SurfaceMesh, b: SurfaceMesh) -> Query:
    """Whether two parts collide."""
    models, request = [_model(coal.BVHModelOBBRSS, mesh, mesh.triangles) for mesh in (a, b)], coal.CollisionRequest()
    request.gjk_tolerance, request.enable_contact = 1e-10, False
    still = coal.Transform3s.Identity()

    def query(pose: pin.SE3) -> bool:
        return bool(coal.collide(models[0], still, models[1], _transform(pose), request, coal.CollisionResult()))

    return query


class SurfaceDistances(FirstContacts):
    """One model a surface, boxes first (`near`, not timed), then the distance of each pair."""

    def __init__(self, a: SurfaceMesh, b: SurfaceMesh) -> None:
        super().__init__(a, b)
        self.measure = _distance_request()

    def distances(self, pose: pin.SE3, near: list[tuple[int, int]]) -> dict[tuple[int, int], float]:
        """The distances of those pairs, 0 where they meet."""
        still, moved = coal.Transform3s.Identity(), _transform(pose)
        of_a, of_b = self.models
        return {
            (s, t): max(0.0, coal.distance(of_a[s], still, of_b[t], moved, self.measure, coal.DistanceResult()))
            for s, t in near
        }


class SampledDepth:
    """How deep points of either part's triangles, no farther than `spacing` (m) from each other, lie in the other.

    libigl's signed distance, by pseudonormals. Never more than the depth, and less by no more than the spacing.
    """

    def __init__(self, a: SurfaceMesh, b: SurfaceMesh, spacing: float) -> None:
        import igl

        self.signed_distance, self.kind = igl.signed_distance, igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL
        self.meshes = [(mesh.vertices, mesh.triangles.astype(np.int64), _points(mesh, spacing)) for mesh in (a, b)]

    def query(self, pose: pin.SE3) -> float:
        """The greatest depth, m; 0 where nothing lies inside."""
        (vertices_a, triangles_a, points_a), (vertices_b, triangles_b, points_b) = self.meshes
        deepest = 0.0
        for points, vertices, triangles in (
            (points_b @ pose.rotation.T + pose.translation, vertices_a, triangles_a),
            ((points_a - pose.translation) @ pose.rotation, vertices_b, triangles_b),
        ):
            inside = ((points >= vertices.min(axis=0)) & (points <= vertices.max(axis=0))).all(axis=1)
            if inside.any():
                signed = self.signed_distance(points[inside], vertices, triangles, self.kind)[0]
                deepest = max(deepest, -float(np.min(signed)))
        return deepest


def _points(mesh: SurfaceMesh, spacing: float) -> NDArray[np.float64]:
    """Points of the triangles on grids that are no wider than `spacing`."""
    corners = mesh.vertices[mesh.triangles]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    points = []
    for triangle, parts in zip(corners, np.ceil(edges / spacing).astype(int).tolist(), strict=True):
        i, j = np.triu_indices(parts + 1)
        weights = np.stack([i, j - i, parts - j], axis=1) / max(parts, 1)
        points.append(weights @ triangle)
    return np.unique(np.concatenate(points), axis=0)


def surface_boxes(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """(k, 2, 3) least and greatest corner of each surface, in the mesh's frame."""
    corners = mesh.vertices[mesh.triangles]
    return np.array(
        [
            [
                corners[mesh.triangles_of(s)].min(axis=(0, 1)),
                corners[mesh.triangles_of(s)].max(axis=(0, 1)),
            ]
            for s in range(mesh.n_surfaces)
        ]
    )


def bounding_volumes(boxes_a: NDArray[np.float64], boxes_b: NDArray[np.float64], pose: pin.SE3) -> Pairs:
    """Surface pairs whose axis-aligned boxes overlap in a's frame: the strawman that takes boxes for surfaces."""
    middle = boxes_b.mean(axis=1) @ pose.rotation.T + pose.translation
    half = 0.5 * (boxes_b[:, 1] - boxes_b[:, 0]) @ np.abs(pose.rotation).T
    apart = (boxes_a[:, None, 0] > (middle + half)[None]) | (boxes_a[:, None, 1] < (middle - half)[None])
    return {(int(s), int(t)) for s, t in np.argwhere(~apart.any(axis=2))}


def float32(a: SurfaceMesh, b: SurfaceMesh) -> Query:
    """The plain algorithm with OAABB in float32 throughout, signs taken as they come out."""
    vertices_a, vertices_b = a.vertices.astype(np.float32), b.vertices.astype(np.float32)
    corner_a, corner_b = a.triangles[a.order], b.triangles[b.order]

    def query(pose: pin.SE3) -> Pairs:
        pairs = _plain32(
            vertices_a, corner_a, a.surface_start, vertices_b, corner_b, b.surface_start,
            pose.rotation.astype(np.float32), pose.translation.astype(np.float32),
        )  # fmt: skip
        return {(int(s), int(t)) for s, t in pairs}

    return query


@njit(cache=True)
def _boxes32(vertices, corner, start, box, group):
    for s in range(len(start) - 1):
        for d in range(3):
            group[s, d], group[s, d + 3] = np.float32(np.inf), np.float32(-np.inf)
        for i in range(start[s], start[s + 1]):
            for d in range(3):
                x, y, z = vertices[corner[i, 0], d], vertices[corner[i, 1], d], vertices[corner[i, 2], d]
                box[i, d], box[i, d + 3] = min(x, y, z), max(x, y, z)
                group[s, d], group[s, d + 3] = min(group[s, d], box[i, d]), max(group[s, d + 3], box[i, d + 3])


@njit(cache=True)
def _overlap32(a, b):
    return (
        a[0] <= b[3] and b[0] <= a[3] and a[1] <= b[4] and b[1] <= a[4] and a[2] <= b[5] and b[2] <= a[5]
    )  # fmt: skip


@njit(cache=True)
def _side32(a, b, c, d):
    ax, ay, az = a[0] - d[0], a[1] - d[1], a[2] - d[2]
    bx, by, bz = b[0] - d[0], b[1] - d[1], b[2] - d[2]
    cx, cy, cz = c[0] - d[0], c[1] - d[1], c[2] - d[2]
    return ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)


@njit(cache=True)
def _pierces32(p, q, a, b, c):
    if _side32(a, b, c, p) * _side32(a, b, c, q) > 0:
        return False
    u, v, w = _side32(p, q, a, b), _side32(p, q, b, c), _side32(p, q, c, a)
    return (u >= 0 and v >= 0 and w >= 0) or (u <= 0 and v <= 0 and w <= 0)


@njit(cache=True)
def _meet32(va, ca, vb, cb):
    for k in range(3):
        if _pierces32(va[ca[k]], va[ca[(k + 1) % 3]], vb[cb[0]], vb[cb[1]], vb[cb[2]]):
            return True
        if _pierces32(vb[cb[k]], vb[cb[(k + 1) % 3]], va[ca[0]], va[ca[1]], va[ca[2]]):
            return True
    return False


@njit(cache=True)
def _plain32(vertices_a, corner_a, start_a, vertices_b, corner_b, start_b, rotation, translation):
    moved = np.empty_like(vertices_b)
    for i in range(len(vertices_b)):
        for d in range(3):
            moved[i, d] = (
                rotation[d, 0] * vertices_b[i, 0]
                + rotation[d, 1] * vertices_b[i, 1]
                + rotation[d, 2] * vertices_b[i, 2]
                + translation[d]
            )
    ka, kb = len(start_a) - 1, len(start_b) - 1
    box_a, group_a = np.empty((len(corner_a), 6), np.float32), np.empty((ka, 6), np.float32)
    box_b, group_b = np.empty((len(corner_b), 6), np.float32), np.empty((kb, 6), np.float32)
    _boxes32(vertices_a, corner_a, start_a, box_a, group_a)
    _boxes32(moved, corner_b, start_b, box_b, group_b)
    pairs = np.empty((ka * kb, 2), np.int32)
    common = np.empty(6, np.float32)
    inside = np.empty(len(corner_b), np.int64)
    n = 0
    for s in range(ka):
        for t in range(kb):
            if not _overlap32(group_a[s], group_b[t]):
                continue
            for d in range(3):
                common[d] = max(group_a[s, d], group_b[t, d])
                common[d + 3] = min(group_a[s, d + 3], group_b[t, d + 3])
            m = 0
            for j in range(start_b[t], start_b[t + 1]):
                if _overlap32(box_b[j], common):
                    inside[m] = j
                    m += 1
            hit = False
            for i in range(start_a[s], start_a[s + 1]):
                if hit:
                    break
                if _overlap32(box_a[i], common):
                    for j in inside[:m]:
                        if _overlap32(box_a[i], box_b[j]) and _meet32(vertices_a, corner_a[i], moved, corner_b[j]):
                            hit = True
                            break
            if hit:
                pairs[n, 0], pairs[n, 1] = s, t
                n += 1
    return pairs[:n]
