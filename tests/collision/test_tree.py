"""The packed hierarchy: every node's box and triangles against what the mesh says."""

import numpy as np
import pytest

from collision import SurfaceMesh
from collision.tree import LEAF, MeshTree, build_trees, tree_of
from collision.wide import BOXES, INFO, TRIANGLES, wide_tree_of
from tests.collision import shapes


def random_mesh(triangles: int, surfaces: int, seed: int) -> SurfaceMesh:
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(max(3, triangles), 3)).round(1)  # rounded: equal centres, flat triangles
    surface = np.concatenate([np.arange(surfaces), rng.integers(0, surfaces, triangles - surfaces)])
    rng.shuffle(surface)
    return SurfaceMesh(vertices, rng.integers(0, len(vertices), (triangles, 3)), surface)


@pytest.mark.parametrize(
    ("triangles", "surfaces"), [(1, 1), (4, 1), (5, 1), (5, 5), (37, 3), (1000, 40), (9000, 7), (9000, 1)]
)
def test_every_node_is_what_it_says(triangles: int, surfaces: int) -> None:
    mesh = random_mesh(triangles, surfaces, triangles + surfaces)
    tree = tree_of(mesh)
    assert tree_of(mesh) is tree
    assert sorted(tree.order.tolist()) == list(range(triangles))
    assert np.array_equal(tree.corner, mesh.triangles[tree.order])
    assert tree.count[0] == triangles and tree.past[0] == len(tree.second)
    for i in range(len(tree.second)):
        inside = tree.order[tree.first[i] : tree.first[i] + tree.count[i]]
        points = mesh.vertices[mesh.triangles[inside]].reshape(-1, 3)
        assert np.array_equal(tree.box[i], np.concatenate([points.min(0), points.max(0)]))
        if tree.surface[i] >= 0:
            assert (mesh.surface_of_triangle[inside] == tree.surface[i]).all()
        if tree.second[i] < 0:
            assert 1 <= tree.count[i] <= LEAF and tree.past[i] == i + 1
        else:
            a, b = i + 1, tree.second[i]
            assert (tree.past[a], tree.past[b]) == (b, tree.past[i])
            assert tree.first[a] == tree.first[i] and tree.first[b] == tree.first[a] + tree.count[a]
            assert tree.count[a] + tree.count[b] == tree.count[i]
    for s, node in enumerate(tree.root):
        assert tree.surface[node] == s and tree.count[node] == len(mesh.triangles_of(s))


def test_the_tree_does_not_depend_on_threads_or_company(monkeypatch: pytest.MonkeyPatch) -> None:
    alone = tree_of(random_mesh(9000, 7, 1))
    monkeypatch.setattr("collision.tree.THREADS", 1)
    mesh = random_mesh(9000, 7, 1)
    build_trees([random_mesh(50, 2, 2), mesh, mesh])
    for name in MeshTree.__slots__:
        assert np.array_equal(getattr(tree_of(mesh), name), getattr(alone, name))


def test_memory_a_triangle() -> None:
    """On a box of 12,288 triangles: mesh, tree and wide tree together."""
    mesh = shapes.box(cells=32)
    held = sum(getattr(mesh, name).nbytes for name in ("vertices", "triangles", "surface_of_triangle", "order"))
    held += tree_of(mesh).nbytes + wide_tree_of(mesh).nbytes
    assert 60 * mesh.n_triangles < held <= 120 * mesh.n_triangles


@pytest.mark.parametrize(("triangles", "surfaces"), [(1, 1), (9, 9), (70, 3), (700, 20), (5000, 2)])
def test_wide_nodes_hold_what_is_below_them(triangles: int, surfaces: int) -> None:
    mesh = random_mesh(triangles, surfaces, triangles)
    wide, tree = wide_tree_of(mesh), tree_of(mesh)
    centre = wide.frame[:3]
    seen: list[int] = []
    for place, (surface, first, count, top, leaves, *above) in enumerate(wide.info.reshape(-1, INFO)[:-1].tolist()):
        points = mesh.vertices[mesh.triangles[mesh.triangles_of(surface)]].reshape(-1, 3) - centre
        assert [leaves, *above][top] == BOXES * (place // 8) + place % 8
        box = wide.nodes[BOXES * (place // 8) :][:BOXES].reshape(6, 8)[:, place % 8]
        assert (box[:3] <= points.min(0)).all() and (points.max(0) <= box[3:]).all()
        assert np.allclose(box, [*points.min(0), *points.max(0)], atol=1e-5)
        assert count == len(mesh.triangles_of(surface))
        seen += tree.order[first : first + count].tolist()
        for i in range(count):
            rows = wide.nodes[leaves + TRIANGLES * (i // 8) :][:TRIANGLES].reshape(3, 3, 8)[:, :, i % 8]
            corners = mesh.vertices[wide.corner.reshape(-1, 3)[first + i]]
            assert np.allclose(rows - rows[0], corners - corners[0], atol=1e-5)
    assert sorted(seen) == list(range(triangles))
