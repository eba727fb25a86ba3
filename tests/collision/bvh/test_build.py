"""The hierarchy of a mesh: every box and packet against what the mesh says."""

import numpy as np
import pytest

from collision import SurfaceMesh
from collision.bvh.build import build, bvh_of
from collision.bvh.layout import Bvh, nbytes
from tests.collision import shapes


def random_mesh(triangles: int, surfaces: int, seed: int) -> SurfaceMesh:
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(max(3, triangles), 3)).round(1)  # rounded: equal centres, flat triangles
    surface = np.concatenate([np.arange(surfaces), rng.integers(0, surfaces, triangles - surfaces)])
    rng.shuffle(surface)
    return SurfaceMesh(vertices, rng.integers(0, len(vertices), (triangles, 3)), surface)


def below(bvh: Bvh, lane: int) -> list[int]:
    """The triangles, in leaf order, below the box in a lane; every box on the way holds them."""
    child = int(bvh.child[lane])
    if child < 0:
        inside = list(range(bvh.first[~child], bvh.first[~child + 1]))
        assert 1 <= len(inside) <= 8
    else:
        boxes = bvh.boxes.reshape(-1, 6, 8)[child]
        filled = np.flatnonzero(boxes[0] <= boxes[3])
        assert filled.tolist() == list(range(len(filled))) and np.isinf(boxes[:, len(filled) :]).all()
        inside = [t for k in filled for t in below(bvh, 8 * child + int(k))]
    points = bvh.vertices.reshape(-1, 3)[bvh.corner.reshape(-1, 3)[inside]].reshape(-1, 3) - bvh.frame[:3]
    box = bvh.boxes.reshape(-1, 6, 8)[lane // 8, :, lane % 8].astype(np.float64)
    assert (box[:3] <= points.min(0)).all() and (points.max(0) <= box[3:]).all()
    assert np.allclose(box, [*points.min(0), *points.max(0)], atol=1e-5)
    assert np.isclose(bvh.size[lane], (box[3:] - box[:3]).sum(), rtol=1e-5)
    if child < 0:
        centre = 0.5 * (box[:3] + box[3:])
        packet = bvh.packets.reshape(-1, 3, 3, 8)[~child]
        assert np.allclose(packet[:, :, : len(inside)].transpose(2, 0, 1).reshape(-1, 3), points - centre, atol=1e-6)
        assert np.isinf(packet[:, :, len(inside) :]).all()
    return inside


@pytest.mark.parametrize(
    ("triangles", "surfaces"), [(1, 1), (5, 5), (9, 9), (37, 3), (70, 3), (700, 100), (5000, 2), (9000, 7), (9000, 1)]
)
def test_every_box_holds_what_is_below_it(triangles: int, surfaces: int) -> None:
    mesh = random_mesh(triangles, surfaces, triangles + surfaces)
    bvh = bvh_of(mesh)
    assert bvh_of(mesh) is bvh
    assert sorted(bvh.order.tolist()) == list(range(triangles))
    assert np.array_equal(bvh.corner.reshape(-1, 3), mesh.triangles[bvh.order])
    assert sorted(below(bvh, 0)) == list(range(triangles))
    for s, lane in enumerate(bvh.root.tolist()):
        assert bvh.surface[lane] == s
        assert sorted(bvh.order[below(bvh, lane)].tolist()) == mesh.triangles_of(s).tolist()
    assert not any(array.flags.writeable for array in bvh)


def test_the_hierarchy_does_not_depend_on_threads_or_company(monkeypatch: pytest.MonkeyPatch) -> None:
    alone = bvh_of(random_mesh(9000, 7, 1))
    monkeypatch.setattr("collision.bvh.build.THREADS", 1)
    mesh = random_mesh(9000, 7, 1)
    build([random_mesh(50, 2, 2), mesh, mesh])
    for mine, other in zip(bvh_of(mesh), alone, strict=True):
        assert np.array_equal(mine, other)


def test_memory_a_triangle() -> None:
    """On a box of 12,288 triangles: mesh and hierarchy together."""
    mesh = shapes.box(cells=32)
    held = sum(getattr(mesh, name).nbytes for name in ("vertices", "triangles", "surface_of_triangle", "order"))
    held += nbytes(bvh_of(mesh))
    assert 60 * mesh.n_triangles < held <= 107 * mesh.n_triangles
