"""Meshes as boundaries of solids: winding numbers, dipoles of clusters, edges that bodies share."""

import numpy as np
import pytest

from collision import SurfaceMesh
from collision.query.containment import inside
from collision.query.signed_distance import signed_distances
from collision.solid import is_closed
from tests.collision.brute_force import box, hollow, sphere, turned, without_lid


def test_winding_number_of_box_points() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (400, 3))
    assert inside(box(1, 1, 1, 3), points).tolist() == (np.abs(points) < 0.5).all(axis=1).tolist()


def many(*meshes: tuple[SurfaceMesh, tuple[float, float, float]]) -> SurfaceMesh:
    """One mesh of several, each moved."""
    vertices, triangles, n = [], [], 0
    for mesh, shift in meshes:
        vertices.append(mesh.vertices + np.array(shift))
        triangles.append(mesh.triangles + n)
        n += len(mesh.vertices)
    return SurfaceMesh(np.concatenate(vertices), np.concatenate(triangles), name="many")


PIPE = turned([(0, 0.5), (0, 1.0), (2, 1.0), (2, 0.5), (0, 0.5)], 17)


WINDING = {
    "pipe": PIPE,
    "hollow": hollow(1.0, 0.6),
    "fine sphere": sphere(0.7, 48),
    "boxes in each other": many((box(1, 1, 1, 4), (0, 0, 0)), (box(1, 1, 1, 4), (0.5, 0.3, 0.1))),
    "without a lid": without_lid(),
    "pipe without a wall": SurfaceMesh(PIPE.vertices, PIPE.triangles[PIPE.surface_of_triangle != 1]),
}


@pytest.mark.parametrize("case", WINDING)
def test_clusters_of_triangles_wind_about_a_point_as_their_triangles_do(case: str) -> None:
    mesh = WINDING[case]
    points = np.random.default_rng(4).uniform(-1.3, 2.2, (600, 3))
    a, b, c = (mesh.vertices[mesh.triangles[:, k]][None] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=2) for x in (a, b, c))
    dots = [(x * y).sum(axis=2) for x, y in ((a, b), (b, c), (c, a))]
    volume = (a * np.cross(b, c)).sum(axis=2)
    angle = 2.0 * np.arctan2(volume, la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb)
    number = angle.sum(axis=1) / (4.0 * np.pi)
    assert inside(mesh, points).tolist() == (number > (0.5 if is_closed(mesh) else 0.51)).tolist()


@pytest.mark.parametrize("shift", [(1.0, 1.0, 0.0), (1.0, 1.0, 1.0), (1.0, 1.0, 0.5)])
def test_boxes_that_meet_in_an_edge_or_a_corner_are_two(shift: tuple[float, float, float]) -> None:
    """There pseudonormals of both come together, and tell nothing of either."""
    both = many((box(1, 1, 1, 2), (0, 0, 0)), (box(1, 1, 1, 2), shift))
    points = np.random.default_rng(5).uniform(-1.0, 2.0, (2000, 3))
    in_one = [(np.abs(points - s) < 0.5).all(axis=1) for s in ((0, 0, 0), shift)]
    assert ((signed_distances(both, points) < 0.0) == (in_one[0] | in_one[1])).all()
