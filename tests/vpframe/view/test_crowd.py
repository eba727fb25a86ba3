"""Crowds: parts that stand still as instances of their shape."""

import numpy as np
import pinocchio as pin

from vpframe.view.display import display_mesh

RED = [0xE6292400 | 0xFF]


def test_a_crowd_is_drawn_where_and_as_each_of_its_parts_is(crowded):
    scene, frames, _, rows = crowded
    still = {e: r for e, r in rows.items() if e.startswith("still/")}
    members = {e: next(row["parts"] for row in r if "parts" in row) for e, r in still.items()}
    assert sum(map(len, members.values())) == 220  # all but the one that moved in the first step
    now, own, tints = {}, {}, {}
    for frame in (None, *frames):
        step = 0 if frame is None else frame.step
        for e, r in still.items():
            now[e] = next(
                (row for row in r if row.get("step") == step and "Mesh3D:vertex_positions" not in row), now.get(e)
            )
        for name in scene.names:
            entity = "parts/" + name.replace("/", "\\/")
            for row in rows.get(entity, ()):
                if row.get("step") == step and "Transform3D:translation" in row:
                    own[name] = (row["Transform3D:translation"][0], row["Transform3D:quaternion"][0])
            for s in range(scene[name].mesh.n_surfaces):
                for row in rows.get(f"{entity}/surfaces/{s}", ()):
                    if row.get("step") == step and "Mesh3D:albedo_factor" in row:
                        tints[name, s] = row["Mesh3D:albedo_factor"]
        drawn = [*own.items()]
        for e, row in now.items():
            there = [n for n in members[e] if n not in own]
            if "Clear:is_recursive" in row:
                assert not there
                continue
            places = zip(row["InstancePoses3D:translations"], row["InstancePoses3D:quaternions"], strict=True)
            drawn += zip(there, places, strict=True)
        assert sorted(name for name, _ in drawn) == sorted(scene.names), step
        for name, (place, turn) in drawn:
            pose = scene[name].pose if frame is None else frame.poses[name]
            np.testing.assert_allclose(place, pose.translation, atol=1e-6)
            np.testing.assert_allclose(pin.Quaternion(np.array(turn, float)).matrix(), pose.rotation, atol=1e-6)
        if frame is None:
            continue
        meeting = {(scene.names[o], s) for row in frame.colliding for o, s in (row[:2], row[2:])}
        red = {key for key, color in tints.items() if color == RED}
        for e in still:
            mesh = next(row for row in still[e] if "Mesh3D:vertex_positions" in row)
            shape = display_mesh(scene[members[e][0]].shape)
            colors = np.array(mesh.get("Mesh3D:vertex_colors", np.zeros(len(shape.positions))))
            marked = [
                s for s in range(shape.n_surfaces) if (colors[slice(*shape.vertex_start[s : s + 2])] == RED).all()
            ]
            np.testing.assert_array_equal(mesh["Mesh3D:vertex_positions"], shape.positions)
            red |= {(name, s) for name in members[e] if name not in own for s in marked}
        assert red == meeting, step


def test_what_leaves_a_crowd_is_drawn_from_then_on_with_its_geometry(crowded):
    scene, _, _, rows = crowded
    for name, step in (("row/7", 0), ("row/8", 11), ("row/9", 6), ("row/11", 21), ("row/12", 21), ("row/22", 15)):
        for s in range(scene[name].mesh.n_surfaces):
            entity = "parts/" + name.replace("/", "\\/") + f"/surfaces/{s}"
            (mesh,) = [row for row in rows[entity] if "Mesh3D:vertex_positions" in row]
            assert mesh["step"] == step
            true = scene[name].mesh.vertices[scene[name].mesh.triangles[scene[name].mesh.triangles_of(s)]]
            drawn = np.array(mesh["Mesh3D:vertex_positions"])[np.array(mesh["Mesh3D:triangle_indices"])]
            np.testing.assert_allclose(drawn, true, atol=1e-7)
    assert not any(r"row\/13" in e for e in rows)
