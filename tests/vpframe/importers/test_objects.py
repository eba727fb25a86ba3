"""Scenes of what is no CAD file: bytes, other libraries' objects, robot models."""

import numpy as np
import pytest
import trimesh

import vpframe as vp
from tests.vpframe.importers.robots import pose_of
from vpframe.scene import modelling as m


def test_bytes_are_what_their_content_says(tmp_path):
    path = m.write_step(tmp_path / "a.step", {"plate": m.box(0.1, 0.1, 0.01), "pin": m.cylinder(0.004, 0.03)})
    scene = vp.load(path.read_bytes())
    assert scene.names == ("plate", "pin") and scene.source is None
    stl = trimesh.creation.box((1.0, 2.0, 3.0)).export(file_type="stl")
    assert vp.load(stl, unit="mm").parts[0].shape.volume == pytest.approx(6e-9)
    obj = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
    assert vp.load(obj, format="obj", unit="m").parts[0].shape.volume == pytest.approx(1 / 6)
    with pytest.raises(vp.LoadError, match="what format they are in does not show; give format="):
        vp.load(obj)
    with pytest.raises(vp.LoadError, match=r"^bytes: is cut short"):
        vp.load(path.read_bytes()[:-100])


@pytest.mark.parametrize("thing", [3, None, [1], object()])
def test_what_cannot_be_loaded_is_one_clear_line(thing):
    with pytest.raises(vp.LoadError, match="cannot be loaded; give a path, bytes, a trimesh"):
        vp.load(thing)


def test_trimesh_meshes_and_scenes_keep_units_names_poses_and_colours():
    mesh = trimesh.creation.cylinder(radius=5.0, height=20.0, sections=64)
    mesh.units = "mm"
    part = vp.load(mesh).parts[0]
    assert np.ptp(part.mesh.vertices, axis=0) == pytest.approx([0.01, 0.01, 0.02])
    assert sorted(s.geometry.kind for s in part.surfaces) == ["cylinder", "plane", "plane"]
    scene = trimesh.Scene()
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    box.visual.face_colors = (255, 0, 0, 255)
    scene.add_geometry(box, node_name="a", geom_name="box")
    scene.graph.update("b", geometry="box", matrix=trimesh.transformations.translation_matrix([5.0, 0.0, 0.0]))
    loaded = vp.load(scene, unit="cm")
    assert loaded.names == ("a", "b") and loaded["a"].shape is loaded["b"].shape
    assert loaded["b"].pose.translation == pytest.approx([0.05, 0.0, 0.0])
    assert loaded["a"].color == (1.0, 0.0, 0.0, 1.0)
    mesh.units = "parsecs-ish"
    with pytest.raises(vp.LoadError, match="which are unknown; give unit="):
        vp.load(mesh)


def test_a_scene_takes_all_that_load_takes(tmp_path):
    path = m.write_step(tmp_path / "a.step", {"plate": m.box(0.1, 0.1, 0.01), "pin": m.cylinder(0.004, 0.03)})
    scene = vp.Scene()
    assert [p.name for p in scene.add(path)] == ["plate", "pin"]
    lift = pose_of([0.0, 0.0, 0.5], 0.3)
    more = scene.add(path, name="second", pose=lift)
    assert [p.name for p in more] == ["second/plate", "second/pin"]
    assert scene["second/pin"].pose.isApprox(lift)
    assert scene.add(trimesh.creation.box((0.1, 0.1, 0.1)), name="block", unit="m")[0].name == "block"
    with pytest.raises(vp.VpframeError, match="two parts are called 'plate'"):
        scene.add(path)
    assert len(scene) == 5  # nothing of it was added
