"""Solids against closed forms, and their way out through STEP."""

import numpy as np
import pinocchio as pin
import pytest

import vpframe as vp
from vpframe.scene import modelling as m


@pytest.mark.parametrize(
    ("solid", "volume", "kinds"),
    [
        (m.box(0.1, 0.2, 0.3), 0.006, ["plane"] * 6),
        (m.cylinder(0.01, 0.05), np.pi * 1e-4 * 0.05, ["cylinder", "plane", "plane"]),
        (m.cone(0.02, 0.01, 0.03), np.pi / 3 * 0.03 * 7e-4, ["cone", "plane", "plane"]),
        (m.sphere(0.01), 4 / 3 * np.pi * 1e-6, ["sphere"]),
        (m.torus(0.02, 0.005), 2 * np.pi**2 * 0.02 * 25e-6, ["torus"]),
        (m.hexagon(0.02, 0.01), np.sqrt(3) / 2 * 4e-4 * 0.01, ["plane"] * 8),
        (m.extrude([(0, 0), (0.03, 0), (0, 0.04)], 0.01), 6e-6, ["plane"] * 5),
        (m.revolve([(0, 0), (0.02, 0), (0.02, 0.01), (0, 0.01)]), np.pi * 4e-6, ["cylinder", "plane", "plane"]),
        # Pappus: a triangle of area 5e-5 whose centroid turns half round
        (
            m.revolve([(0.01, 0), (0.02, 0), (0.02, 0.01)], np.pi),
            5e-5 * np.pi * 0.05 / 3,
            ["cone", "cylinder"] + ["plane"] * 3,
        ),
    ],
)
def test_volumes_and_faces(solid, volume, kinds):
    shape = m.shape(solid)
    assert shape.closed
    assert shape.volume == pytest.approx(volume, rel=1e-9)
    assert sorted(s.geometry.kind for s in shape.surfaces) == sorted(kinds)


def test_operations():
    block, pin_ = m.box(0.1, 0.1, 0.02), m.cylinder(0.01, 0.05).translated(0.05, 0.05, 0.0)
    hole = np.pi * 1e-4 * 0.02
    assert m.shape(block - pin_).volume == pytest.approx(2e-4 - hole, rel=1e-9)
    assert m.shape(block & pin_).volume == pytest.approx(hole, rel=1e-9)
    assert m.shape(block + pin_).volume == pytest.approx(2e-4 + np.pi * 1e-4 * 0.03, rel=1e-9)
    bevelled = block.chamfered(0.001, lambda p: p[2] > 0.019)
    assert len(m.shape(bevelled).surfaces) == 10
    rounded = m.shape(block.filleted(0.002))
    assert sorted({s.geometry.kind for s in rounded.surfaces}) == ["cylinder", "plane", "sphere"]
    assert all(s.orientation == "convex" for s in rounded.surfaces if s.geometry.kind != "plane")


def test_moving_a_solid_is_moving_its_surfaces():
    solid = m.cylinder(0.01, 0.05) + m.box(0.03, 0.02, 0.01)
    pose = pin.SE3(pin.exp3(np.array([0.3, -1.0, 2.0])), np.array([0.1, 0.2, -0.3]))
    still, moved = m.shape(solid), m.shape(solid.moved(pose))
    assert moved.center == pytest.approx(pose.act(still.center), abs=1e-12)
    assert moved.inertia == pytest.approx(pose.rotation @ still.inertia @ pose.rotation.T, rel=1e-9, abs=1e-15)
    turned = m.shape(solid.rotated([0.0, 0.0, 2.0], np.pi / 2, [0.1, 0.0, 0.0]))
    x, y, z = still.center
    assert turned.center == pytest.approx([0.1 - y, x - 0.1, z], abs=1e-12)


def test_bores_are_concave_shafts_convex_and_normals_point_out():
    shape = m.shape(m.box(0.1, 0.1, 0.02) - m.cylinder(0.01, 0.02).translated(0.05, 0.05, 0.0))
    bore = next(s for s in shape.surfaces if s.geometry.kind == "cylinder")
    assert bore.orientation == "concave"
    assert m.shape(m.cylinder(0.01, 0.02)).surfaces[0].orientation == "convex"
    for s in shape.surfaces:
        if s.geometry.kind == "plane":
            assert s.orientation == "flat"
            assert (s.geometry.distance(shape.mesh.vertices) <= 1e-12).all()
    circles = [e.circle for e in shape.edges if e.circle is not None]
    assert len(circles) == 2
    assert all(c[2] == pytest.approx(0.01) and abs(c[1][2]) == 1.0 for c in circles)


def test_what_cannot_be_built_is_refused_in_one_line():
    block = m.box(0.1, 0.1, 0.02)
    for build, word in (
        (lambda: m.box(0.1, -0.1, 0.1), "positive"),
        (lambda: m.cylinder(float("nan"), 0.1), "radius"),
        (lambda: block.filleted(0.5), "cannot be built"),
        (lambda: m.cone(0.01, 0.01, 0.1), "cylinder"),
        (lambda: m.cone(-0.01, 0.01, 0.1), "radius_bottom"),
        (lambda: m.extrude([(0, 0), (1, 0)], 0.1), "three"),
        (lambda: m.extrude([(0, 0), (1, 1), (2, 2)], 0.1), "polygon"),
        (lambda: block.filleted(0.001, lambda p: False), "no edge chosen"),
        (lambda: block & block.translated(1.0), "nothing is left"),
    ):
        with pytest.raises(m.ModellingError, match=word) as error:
            build()
        assert "\n" not in str(error.value)


def test_an_assembly_comes_back_from_its_file(tmp_path, capfd):
    plate, bolt = m.box(0.1, 0.1, 0.01), m.cylinder(0.004, 0.03)
    place = pin.SE3(pin.exp3(np.array([0.0, 0.4, 0.1])), np.array([0.01, 0.02, 0.03]))
    inner = pin.SE3(pin.exp3(np.array([0.5, 0.0, 0.0])), np.array([0.0, 0.0, 0.01]))
    pair = {"bolt_1": bolt, "bolt_2": (bolt, inner)}
    parts = {"plate": (plate, None, (1.0, 0.0, 0.0), 7850.0), "left": (pair, None), "right": (pair, place)}
    scene = vp.load(m.write_step(tmp_path / "a.step", parts))
    assert scene.names == ("plate", "left/bolt_1", "left/bolt_2", "right/bolt_1", "right/bolt_2")
    assert len({id(p.shape) for p in scene.parts}) == 2
    assert scene["right/bolt_2"].pose.isApprox(place * inner, 1e-9)
    assert scene["plate"].color == pytest.approx((1.0, 0.0, 0.0, 1.0), abs=1e-6)
    assert scene["plate"].density == pytest.approx(7850.0)
    assert scene["left/bolt_1"].density is None
    assert scene.notes == ()
    assert capfd.readouterr().out == ""


def test_a_scene_without_a_file_is_the_scene_of_the_file(tmp_path):
    parts = {
        "plate": m.box(0.1, 0.1, 0.01) - m.cylinder(0.004, 0.01),
        "pin": (m.cylinder(0.004, 0.03), pin.SE3.Identity()),
    }
    direct, read = m.scene(parts), vp.load(m.write_step(tmp_path / "a.step", parts))
    for name in parts:
        a, b = direct[name], read[name]
        assert [s.geometry.kind for s in a.surfaces] == [s.geometry.kind for s in b.surfaces]
        assert a.mesh.vertices == pytest.approx(b.mesh.vertices, abs=1e-9)
        assert a.shape.volume == pytest.approx(b.shape.volume, rel=1e-9)


def test_a_path_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(m.ModellingError, match="nowhere"):
        m.write_step(tmp_path / "nowhere" / "a.step", {"box": m.box(1.0, 1.0, 1.0)})
