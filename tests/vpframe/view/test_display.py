"""The drawn form of a part."""

import numpy as np

from tests.vpframe.watching import box, rod
from vpframe.view.display import display_mesh


def test_display_mesh_keeps_the_triangles_of_each_surface():
    for shape in (box(), rod()):
        made, mesh = display_mesh(shape), shape.mesh
        assert made is display_mesh(shape)
        for surface in range(mesh.n_surfaces):
            t0, t1 = made.triangle_start[surface : surface + 2]
            drawn = made.positions[made.triangles[t0:t1]]
            np.testing.assert_array_equal(drawn, mesh.vertices[mesh.triangles[mesh.triangles_of(surface)]].astype("f4"))
            v0, v1 = made.vertex_start[surface : surface + 2]
            assert (made.triangles[t0:t1] >= v0).all() and (made.triangles[t0:t1] < v1).all()


def test_display_normals_follow_the_true_surface():
    made = display_mesh(rod(0.1, 1.0, 64))
    side = slice(*made.vertex_start[:2])
    radial = made.positions[side] * [1, 1, 0] / 0.1
    assert np.einsum("ij,ij->i", made.normals[side], radial).min() > 0.999
    flat = display_mesh(box())
    corner = flat.positions[flat.triangles]
    true = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    assert (
        np.einsum("tci,ti->tc", flat.normals[flat.triangles], true / np.linalg.norm(true, axis=1)[:, None]).min()
        > 0.999
    )


def test_lines_are_the_edges_between_features():
    lines = display_mesh(box()).lines
    assert len(lines) == 12  # no diagonals
    assert {round(float(np.linalg.norm(b - a)), 6) for a, b in lines} == {1.0}
    assert len(display_mesh(rod(sections=32)).lines) == 64  # two rings, no seam
