"""Borders and holes of triangle meshes against definitions and brute force."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vpframe.importers.polyhedron import mass_properties, open_edges, signed_volume, without_flat
from vpframe.scene import modelling as m


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
def test_flat_triangles_go_and_the_mesh_stays_closed(seed, times):
    """Edges of a box are split at points on them, on one side only, and the gaps filled with flat triangles."""
    rng = np.random.default_rng(seed)
    mesh = m.shape(m.box(8.0, 4.0, 2.0)).mesh
    vertices, triangles = mesh.vertices.round(9).tolist(), [tuple(t) for t in mesh.triangles.tolist()]
    flat: set[tuple[int, ...]] = set()
    for _ in range(times):
        i = int(rng.choice([i for i, t in enumerate(triangles) if t not in flat]))
        turn = int(rng.integers(3))
        a, c, d = triangles[i][turn:] + triangles[i][:turn]
        middle = (np.array(vertices[a]) + np.array(vertices[c])) / 2  # exact: the corners are small binary fractions
        if middle.tolist() not in vertices:
            vertices.append(middle.tolist())
        b = vertices.index(middle.tolist())
        triangles[i] = (a, b, d)
        triangles += [(b, c, d), (a, c, b)]
        flat.add((a, c, b))
    points, corners = np.array(vertices), np.array(triangles, np.int32)
    assert not len(open_edges(corners))
    owners = np.arange(len(corners), dtype=np.int32)
    kept, owned = without_flat(points, corners, owners)
    assert not len(open_edges(kept))
    a, b, c = (points[kept[:, k]] for k in range(3))
    assert (np.linalg.norm(np.cross(b - a, c - a), axis=1) > 0.0).all()
    assert mass_properties(points, kept)[0] == pytest.approx(64.0, rel=1e-12)
    normal = np.cross(b - a, c - a)
    before = np.cross(*(points[corners[owned, k]] - points[corners[owned, 0]] for k in (1, 2)))
    assert (np.einsum("ij,ij->i", normal, before) > 0.0).all()  # each piece lies in its owner's plane


def test_a_flat_hole_does_not_change_the_volume():
    shape = m.shape(m.hexagon(0.1, 0.02).translated(1.0, 2.0, 3.0))
    whole = mass_properties(shape.mesh.vertices, shape.mesh.triangles)
    for surface in range(shape.mesh.n_surfaces):
        holed = shape.mesh.triangles[shape.mesh.surface_of_triangle != surface]
        for one, other in zip(mass_properties(shape.mesh.vertices, holed)[:2], whole[:2], strict=True):
            assert one == pytest.approx(other, rel=1e-9)
        for triangles, sign in ((shape.mesh.triangles, 1), (holed, 1), (holed[:, [0, 2, 1]], -1)):
            assert signed_volume(shape.mesh.vertices, triangles) == pytest.approx(sign * whole[0], rel=1e-9)
