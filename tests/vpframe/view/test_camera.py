"""What pictures frame: what moves and its neighbours; a wire does not decide."""

import numpy as np
import pinocchio as pin
import pytest

from tests.vpframe.watching import box, place, rod
from vpframe.scene.scene import Part, Scene
from vpframe.view.camera import first_view, frame_scene, slender
from vpframe.view.snapshot import project

SHAPE = (600, 800)


def head(wire: float) -> Scene:
    """Three blocks of 50 mm, and a wire Ø4 of that length (m) hanging from them."""
    block = box((0.05, 0.05, 0.05))
    blocks = [Part(f"block_{k}", block, place(x=0.05 * k)) for k in range(3)]
    return Scene([*blocks, Part("wire", rod(0.002, wire), place(z=-wire / 2))])


def share(scene: Scene, camera, name: str, poses=None) -> float:
    """Of the picture's height or width, which is greater, what a part takes up."""
    part = scene[name]
    pose = (poses or {}).get(name, part.pose)
    seen = project(part.mesh.vertices @ pose.rotation.T + pose.translation, camera, SHAPE)
    return max(np.ptp(seen[:, 0]) / SHAPE[1], np.ptp(seen[:, 1]) / SHAPE[0])


@pytest.mark.parametrize("wire", [1.3, 5.0])
@pytest.mark.parametrize("view", [frame_scene, first_view])
def test_a_wire_does_not_decide_the_camera_however_long_it_is(wire, view):
    scene = head(wire)
    without = Scene([part for part in scene.parts if part.name != "wire"])
    assert view(scene).radius < 1.4 * view(without).radius
    assert share(scene, view(scene), "block_0") > 0.2


def test_a_wire_that_ends_among_the_others_and_one_that_is_all_there_is_are_seen_whole():
    short = head(0.03)
    assert frame_scene(short).radius == pytest.approx(frame_scene(Scene(short.parts[:3])).radius, rel=0.05)
    alone = Scene([Part("wire", rod(0.002, 1.3), place())])
    assert 0.8 < share(alone, frame_scene(alone), "wire") <= 1.0
    broom = Scene([Part("stick", rod(0.01, 1.3), place()), Part("clamp", box((0.03, 0.03, 0.03)), place())])
    assert slender(broom["stick"]) and 0.8 < share(broom, frame_scene(broom), "stick") <= 1.0


def test_sheet_and_stout_bars_are_not_slender():
    assert not slender(Part("sheet", box((1.0, 1.0, 1e-4)), place()))
    assert not slender(Part("bar", rod(0.01, 0.4), place()))
    assert slender(Part("wire", rod(0.002, 1.3), place()))


def test_a_frame_of_tubes_is_seen_whole():
    tubes = [Part(f"tube_{k}", rod(0.005, 1.0), place(x=0.3 * k)) for k in range(4)]
    nodes = [Part(f"node_{k}", box((0.03, 0.03, 0.03)), place(x=0.3 * k)) for k in range(4)]
    scene = Scene([*tubes, *nodes])
    assert share(scene, frame_scene(scene), "tube_1") > 0.4


def machine() -> Scene:
    """A bed of 2 m, a screw in its middle with a nut on it, and a cover far off."""
    return Scene(
        [
            Part("bed", box((2.0, 1.0, 0.1)), place(z=-0.05), fixed=True),
            Part("nut", box((0.02, 0.02, 0.01)), place(z=0.005)),
            Part("screw", rod(0.004, 0.03), place(z=0.015)),
            Part("cover", box((0.3, 0.3, 0.3)), place(x=0.8, z=0.15)),
        ]
    )


def test_what_moves_and_its_neighbours_fill_the_picture():
    scene = machine()
    way = [{"nut": place(z=0.005 + 0.001 * k), "screw": scene["screw"].pose} for k in range(60)]
    camera = frame_scene(scene, {p.name: p.pose.copy() for p in scene.parts}, *way)
    assert camera.radius < 0.15 < frame_scene(scene).radius
    for pose in (way[0]["nut"], way[-1]["nut"]):
        seen = project(scene["nut"].mesh.vertices + pose.translation, camera, SHAPE)
        assert (seen[:, :2] > 0).all() and (seen[:, :2] < SHAPE[::-1]).all()
    assert share(scene, camera, "screw") > 0.1


@pytest.mark.parametrize("wire", [1.3, 5.0])
def test_a_wire_beside_what_moves_does_not_decide_either(wire):
    scene = head(wire)
    far = {"block_0": place(x=-0.2)}
    camera, bare = frame_scene(scene, {}, far), frame_scene(Scene(scene.parts[:3]), {}, far)
    assert camera.radius < 1.1 * bare.radius
    assert share(scene, camera, "block_0", far) > 0.1


def test_a_copy_of_a_pose_is_no_movement():
    scene = machine()
    same = [{p.name: p.pose.copy() for p in scene.parts} for _ in range(3)]
    assert frame_scene(scene, *same).radius == frame_scene(scene).radius


def test_all_that_moves_is_seen_at_each_pose():
    scene = Scene([Part("a", box(), place()), Part("b", box(), place(x=2.0))])
    far = {"a": place(z=5.0), "b": place(x=2.0, z=5.0)}
    camera = frame_scene(scene, {}, far)
    for poses in ({}, far):
        for part in scene.parts:
            pose = poses.get(part.name, part.pose)
            seen = project(part.mesh.vertices + pose.translation, camera, SHAPE)
            assert (seen[:, :2] > 0).all() and (seen[:, :2] < SHAPE[::-1]).all()


def test_a_part_that_only_turns_moves():
    scene = machine()
    turned = pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.5])), scene["nut"].pose.translation)
    assert frame_scene(scene, {}, {"nut": turned}).radius < 0.15
