"""GLB files."""

import json

import numpy as np
import pinocchio as pin
import pytest
import trimesh

from tests.vpframe.exporters.moving import model, moving


def test_glb_holds_tree_colours_poses_and_the_motion(tmp_path):
    scene = model()
    left = scene.export(tmp_path / "out.glb", moving(scene))
    assert left == ("exact surfaces: GLB has triangles only", "densities and inertias")
    data = (tmp_path / "out.glb").read_bytes()
    header = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    nodes = header["nodes"]
    by_path = {node["extras"]["path"]: node for node in nodes if "extras" in node}
    assert set(by_path) == set(scene.names)
    for part in scene.parts:
        row = pin.SE3ToXYZQUAT(part.pose).tolist()
        assert by_path[part.name]["translation"] == pytest.approx(row[:3], abs=1e-15)
        assert by_path[part.name]["rotation"] == pytest.approx(row[3:], abs=1e-15)
    assert [nodes[i]["name"] for i in nodes[0]["children"]] == ["base", "ball"]
    (animation,) = header["animations"]
    assert {nodes[c["target"]["node"]]["name"] for c in animation["channels"]} == {"ball"}
    keys = header["accessors"][animation["samplers"][0]["input"]]
    assert keys["min"] == [0.0] and keys["max"] == pytest.approx([1.5])
    read = trimesh.load_scene(tmp_path / "out.glb")
    up = pin.SE3(pin.exp3(np.array([-np.pi / 2, 0.0, 0.0])), np.zeros(3))  # z up to y up
    there = sorted((read.graph[node][0] for node in read.graph.nodes_geometry), key=lambda t: t[:3, 3].tolist())
    here = sorted(((up * p.pose).homogeneous for p in scene.parts), key=lambda t: t[:3, 3].tolist())
    assert np.abs(np.array(there) - np.array(here)).max() < 1e-9
    for mesh in read.geometry.values():
        assert trimesh.Trimesh(mesh.vertices, mesh.faces, process=True, merge_norm=True).volume > 0.0
