"""Geometry, surfaces and paths in the form of a recording."""

import numpy as np
import pinocchio as pin

from tests.vpframe.view.recordings import at_step
from tests.vpframe.watching import fake_session, pressing_scene
from vpframe.scene.scene import Part, Scene
from vpframe.view import palette, replay
from vpframe.view.recorder import RerunRecorder


def test_geometry_is_written_once_and_is_that_of_the_parts(recorded):
    _, _, rows = recorded
    for part in pressing_scene().parts:
        for surface in range(part.mesh.n_surfaces):
            found = [r for r in rows[f"parts/{part.name}/surfaces/{surface}"] if "Mesh3D:vertex_positions" in r]
            assert len(found) == 1
            assert "step" not in found[0]  # static
            points = np.array(found[0]["Mesh3D:vertex_positions"])
            drawn = points[np.array(found[0]["Mesh3D:triangle_indices"])]
            true = part.mesh.vertices[part.mesh.triangles[part.mesh.triangles_of(surface)]]
            np.testing.assert_allclose(drawn, true, atol=1e-7)


def test_surfaces_are_highlighted_while_they_collide(recorded):
    _, frames, rows = recorded
    red = [int(v) for v in np.array([round(255 * c) for c in palette.COLLIDING])]
    red = (red[0] << 24) | (red[1] << 16) | (red[2] << 8) | 0xFF
    for name, index in (("plate", 0), ("rod", 1)):
        for surface in range(6 if name == "plate" else 3):
            colors = at_step(rows[f"parts/{name}/surfaces/{surface}"], "Mesh3D:albedo_factor")
            now = None
            for frame in frames:
                now = colors.get(frame.step, now)
                collides = any(tuple(row[2 * index : 2 * index + 2]) == (index, surface) for row in frame.colliding)
                assert (now == [red]) == collides, (name, surface, frame.step)


def test_names_with_slashes_and_spaces_do_not_nest(tmp_path):
    shape = pressing_scene()["rod"].shape
    names = ("a", "a/b", "a b (2)", "größe")
    scene = Scene([Part(name, shape, pin.SE3.Identity()) for name in names])
    recorder = RerunRecorder(tmp_path / "run.rrd")
    recorder.begin(fake_session(scene).scene)
    recorder.end()
    moved = [
        e for e, chunk in replay.tables(tmp_path / "run.rrd") if any("Transform3D:translation" in r for r in chunk)
    ]
    assert len(set(moved)) == len(names)
