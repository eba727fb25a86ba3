"""FCL (python-fcl) asked the questions that `collision_peers` asks coal."""

from __future__ import annotations

from typing import Any

import collision_peers as peers
import pinocchio as pin

from collision import SurfaceMesh

try:
    import fcl

    MISSING = ""
except ImportError:
    MISSING = "FCL is left out: pip install 'python-fcl>=0.7'"

MOST = 1_000_000
"""contacts"""


def _objects(mesh: SurfaceMesh, *triangles: Any) -> list[Any]:
    """A collision object of each set of triangles."""
    objects = []
    for chosen in triangles:
        model = fcl.BVHModel()
        model.beginModel(len(mesh.vertices), len(chosen))
        model.addSubModel(mesh.vertices, chosen)
        model.endModel()
        objects.append(fcl.CollisionObject(model))
    return objects


def _wholes(a: SurfaceMesh, b: SurfaceMesh) -> list[Any]:
    return [_objects(mesh, mesh.triangles)[0] for mesh in (a, b)]


def _transform(pose: pin.SE3) -> Any:
    return fcl.Transform(pose.rotation, pose.translation)


def all_contacts(a: SurfaceMesh, b: SurfaceMesh) -> peers.Query:
    """One model a part, every contact found and its two triangles read."""
    fixed, moved = _wholes(a, b)
    surface_a, surface_b = a.surface_of_triangle.tolist(), b.surface_of_triangle.tolist()
    request = fcl.CollisionRequest(num_max_contacts=MOST, enable_contact=False)

    def query(pose: pin.SE3) -> peers.Pairs:
        moved.setTransform(_transform(pose))
        result = fcl.CollisionResult()
        fcl.collide(fixed, moved, request, result)
        return {(surface_a[c.b1], surface_b[c.b2]) for c in result.contacts}

    return query


def first_contact(a: SurfaceMesh, b: SurfaceMesh) -> peers.Query:
    """Whether two parts collide."""
    fixed, moved = _wholes(a, b)
    request = fcl.CollisionRequest()

    def query(pose: pin.SE3) -> bool:
        moved.setTransform(_transform(pose))
        return bool(fcl.collide(fixed, moved, request, fcl.CollisionResult()))

    return query


def distance(a: SurfaceMesh, b: SurfaceMesh) -> peers.Query:
    """The least distance of two parts, with the nearest points; -1 where they meet."""
    fixed, moved = _wholes(a, b)
    request = fcl.DistanceRequest(enable_nearest_points=True)

    def query(pose: pin.SE3) -> float:
        moved.setTransform(_transform(pose))
        return float(fcl.distance(fixed, moved, request, fcl.DistanceResult()))

    return query


class FirstContacts(peers.BySurface):
    """One model a surface, boxes first (`near`, not timed), then the first contact of each pair."""

    def __init__(self, a: SurfaceMesh, b: SurfaceMesh) -> None:
        super().__init__(a, b)
        self.objects = [
            _objects(mesh, *(mesh.triangles[mesh.triangles_of(s)] for s in range(mesh.n_surfaces))) for mesh in (a, b)
        ]
        self.collide, self.measure = fcl.CollisionRequest(), fcl.DistanceRequest()

    def query(self, pose: pin.SE3, near: list[tuple[int, int]]) -> peers.Pairs:
        """The pairs of `near` that FCL finds in collision."""
        of_a, of_b = self._placed(pose, near)
        return {(s, t) for s, t in near if fcl.collide(of_a[s], of_b[t], self.collide, fcl.CollisionResult())}

    def distances(self, pose: pin.SE3, near: list[tuple[int, int]]) -> dict[tuple[int, int], float]:
        """The distances of those pairs, 0 where they meet."""
        of_a, of_b = self._placed(pose, near)
        return {(s, t): max(0.0, fcl.distance(of_a[s], of_b[t], self.measure, fcl.DistanceResult())) for s, t in near}

    def _placed(self, pose: pin.SE3, near: list[tuple[int, int]]) -> list[list[Any]]:
        """The objects of both parts, those of b in `near` at the pose."""
        moved = _transform(pose)
        for t in {t for _, t in near}:
            self.objects[1][t].setTransform(moved)
        return self.objects
