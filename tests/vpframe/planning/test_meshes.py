"""Bare meshes are planned without searching their surfaces, unless another part is near enough for fits."""

import pytest

import vpframe as vp
from tests.vpframe.planning import cases
from vpframe.importers import cache, meshes
from vpframe.planning.assembly import Assembly
from vpframe.scene.modelling import box


def loaded(folder, parts):
    """A scene of OBJ files, one a part, at poses."""
    scene = vp.Scene()
    for name, (solid, pose) in parts.items():
        mesh = cases.scene({name: solid})[name].mesh
        rows = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
        rows += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.triangles.tolist()]
        (folder / f"{name}.obj").write_text("\n".join(rows))
        scene.add(folder / f"{name}.obj", name, pose, unit="m")
    return scene


def hook(gap):
    """A slider in a slot that is open at one end, `gap` m of clearance on each side."""
    slot = box(0.04, 0.01 + 2.0 * gap, 0.01 + 2.0 * gap).translated(0.01, 0.01 - gap, 0.01 - gap)
    return {
        "block": (box(0.05, 0.03, 0.03) - slot, cases.at()),
        "slider": (box(0.03, 0.01, 0.01), cases.at(0.015, 0.01, 0.01)),
    }


@pytest.fixture
def segmented(monkeypatch):
    """How many meshes were segmented, without a cache."""
    found = []
    of_module = meshes.segmented
    monkeypatch.setattr(meshes, "segmented", lambda raw: found.append(raw) or of_module(raw))
    monkeypatch.setattr(cache, "find", lambda key: None)
    return found


def test_a_way_out_needs_no_surfaces(tmp_path, segmented):
    scene = loaded(tmp_path, hook(5e-4))
    segmented.clear()
    found = vp.planning.removal(scene, "slider")
    assert found.verdict == "removable" and found.way.text == "straight along (1, 0, 0)"
    assert found.clearance.distance == pytest.approx(5e-4, rel=1e-2)
    plan = vp.planning.disassembly(scene, "slider", base=["block"])
    assert plan.verdict == "removable" and len(plan.steps) == 1
    assert not segmented


def test_a_turned_scene_needs_none_either(tmp_path, segmented):
    """The directions are those of the triangles."""
    turn = cases.pin.SE3(cases.pin.exp3(cases.np.array([0.3, 0.5, -0.2])), cases.np.zeros(3))
    scene = loaded(tmp_path, {name: (solid, turn * pose) for name, (solid, pose) in hook(5e-4).items()})
    segmented.clear()
    found = vp.planning.removal(scene, "slider", motion="straight")
    assert found.verdict == "removable" and not segmented


def test_parts_near_each_other_have_their_surfaces(tmp_path, segmented):
    scene = loaded(tmp_path, hook(5e-5))
    segmented.clear()
    assert [p.shape.faceted for p in Assembly(scene).scene.parts] == [False, False]
    assert vp.planning.removal(scene, "slider").verdict == "removable" and len(segmented) == 2
