"""?"""

import io
import struct
import zlib

import numpy as np
import pinocchio as pin
import pytest
from PIL import Image

from tests.vpframe.watching import box, place, pressing_frames, pressing_scene
from vpframe.scene.scene import Part, Scene
from vpframe.view import palette, snapshot
from vpframe.view.camera import Camera, frame_scene, look_at
from vpframe.view.snapshot import Look
from vpframe.view.symbols import frame_symbols


def near(image, color, within=0.13):
    """(h, w) pixels whose hue is that of `color`: of the same direction in RGB."""
    rgb = image.astype(float) / 255
    unit = rgb / np.maximum(np.linalg.norm(rgb, axis=2, keepdims=True), 1e-9)
    return np.linalg.norm(unit - np.array(color) / np.linalg.norm(color), axis=2) < within


def test_highlighted_surface_is_red_and_nothing_else_is():
    scene = pressing_scene()
    without, marked = snapshot.render(scene), snapshot.render(scene, highlight=[("plate", 5)])
    assert near(without, palette.COLLIDING).sum() == 0
    red = near(marked, palette.COLLIDING)
    assert red.mean() > 0.1
    changed = (without != marked).any(axis=2)
    assert (changed | ~red).all()
    assert changed.sum() < 1.2 * red.sum()


def test_a_face_seen_square_on_covers_its_share_of_the_picture():
    scene = Scene([Part("box", box((2.0, 1.0, 0.5)), place())])
    camera = Camera(np.array([0.0, 0.0, 10.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), radius=1.5)
    image = snapshot.render(scene, highlight=[("box", 5)], size=(300, 300), camera=camera)
    share = near(image, palette.COLLIDING).mean()
    assert share == pytest.approx(2.0 / 9.0, rel=0.03)  # the lines around it are dark


def test_nearer_part_hides_the_farther_one_and_opacity_lets_it_through():
    scene = Scene([Part("far", box(), place(z=-2)), Part("near", box(), place(z=2))])
    camera = Camera(np.array([0.0, 0.0, 10.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), radius=1.0)

    def seen(opacity):
        image = snapshot.render(scene, None, [("far", 5)], (80, 80), camera, look=Look(opacity))
        return near(image, palette.COLLIDING, 0.3).mean()

    assert seen({}) == 0.0
    assert seen({"near": 0.0}) > 0.2
    assert seen({"near": 0.2}) > 0.2


def test_a_ghost_is_drawn_as_if_it_were_the_only_one():
    """Ghosts share their buffers: what one leaves must not be seen in the next."""
    scene = Scene([Part("left", box(), place(x=-2)), Part("middle", box(), place()), Part("right", box(), place(x=2))])
    camera = Camera(np.array([0.0, 0.0, 10.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), radius=2.0)
    none = dict.fromkeys(scene.names, 0.0)
    seen = {
        name: snapshot.render(scene, None, [], (160, 80), camera, look=Look({**none, name: 0.4}))
        for name in scene.names
    }
    together = snapshot.render(scene, None, [], (160, 80), camera, look=Look(dict.fromkeys(scene.names, 0.4)))
    for name, columns in zip(scene.names, (slice(0, 55), slice(55, 105), slice(105, 160)), strict=True):
        np.testing.assert_array_equal(together[:, columns], seen[name][:, columns])


def test_section_opens_a_solid_and_fills_the_cut():
    tints = {"box": (0.2, 0.3, 0.9)}
    scene = Scene([Part("box", box(), place())])
    camera = Camera(np.array([0.0, -10.0, 0.0]), np.zeros(3), np.array([0.0, 0.0, 1.0]), radius=1.0)
    cut = ([0.0, 0.0, 0.25], [0.0, 0.0, 1.0])
    whole = snapshot.render(scene, size=(80, 80), camera=camera, look=Look(colors=tints))
    lower = snapshot.render(scene, size=(80, 80), camera=camera, look=Look(colors=tints, section=cut))
    blue = [near(image, tints["box"], 0.25) for image in (whole, lower)]
    assert blue[1].sum() / blue[0].sum() == pytest.approx(0.75, abs=0.05)
    facing = ([0.0, 0.0, 0.0], [0.0, -1.0, 0.0])  # the half towards the eye is taken away: its fill is seen instead
    filled = snapshot.render(scene, size=(80, 80), camera=camera, look=Look(colors=tints, section=facing))
    assert near(filled, tints["box"], 0.25).sum() == pytest.approx(blue[0].sum(), rel=0.1)


def test_a_filled_cut_hides_what_is_inside_the_solid_behind_it():
    inner = Part("inner", box((0.3, 0.3, 0.3)), place(y=0.25))
    scene = Scene([Part("block", box((1, 1, 1)), place()), inner])
    camera = Camera(np.array([0.0, -10.0, 0.0]), np.zeros(3), np.array([0.0, 0.0, 1.0]), radius=1.0)
    colors = {"block": (0.2, 0.3, 0.9), "inner": (0.9, 0.8, 0.1)}

    def seen(y):
        cut = ([0.0, y, 0.0], [0.0, -1.0, 0.0])
        image = snapshot.render(scene, size=(100, 100), camera=camera, look=Look(colors=colors, section=cut))
        return near(image, colors["block"], 0.25)[50, 30], near(image, colors["inner"], 0.25)[50, 50]

    assert seen(0.0) == (True, False)  # the plane passes in front of the inner part
    assert seen(0.25) == (True, True)  # and through it


def test_symbols_are_drawn_in_their_colours():
    scene, frame = pressing_scene(), pressing_frames()[32]
    symbols = frame_symbols(frame)
    assert {s.color for s in symbols} == {palette.ACTIVE, palette.FREEDOM}
    image = snapshot.render(scene, frame.poses, symbols=symbols)
    assert near(image, palette.FREEDOM, 0.1).sum() > 300
    assert near(image, palette.ACTIVE, 0.15).sum() > 50


def test_same_scene_same_picture():
    scene = pressing_scene()
    np.testing.assert_array_equal(snapshot.render(scene), snapshot.render(scene))


def test_png_is_read_back_by_another_library():
    rng = np.random.default_rng(1)
    for shape in ((1, 1), (3, 7), (64, 48)):
        image = rng.integers(0, 256, (*shape, 3), dtype=np.uint8)
        read = np.asarray(Image.open(io.BytesIO(snapshot.png(image))))
        np.testing.assert_array_equal(read, image)


def test_png_chunks_carry_their_checksums(tmp_path):
    path = snapshot.save_png(np.zeros((4, 4, 3), np.uint8), tmp_path / "black.png")
    data, at, kinds = path.read_bytes()[8:], 0, []
    while at < len(data):
        (size,) = struct.unpack(">I", data[at : at + 4])
        body = data[at + 4 : at + 8 + size]
        assert struct.unpack(">I", data[at + 8 + size : at + 12 + size])[0] == zlib.crc32(body)
        kinds.append(body[:4])
        at += 12 + size
    assert kinds == [b"IHDR", b"IDAT", b"IEND"]


@pytest.mark.parametrize("direction", [(1, 1, 1), (0, 0, 1), (0, -1, 0), (0.3, -2, 0.1)])
def test_camera_sees_all_points(direction):
    points = np.random.default_rng(3).normal(size=(200, 3)) * [3, 1, 0.2] + [5, 6, 7]
    camera = look_at(points, direction)
    at = snapshot.project(points, camera, (600, 800))
    assert at[:, 0].min() > 0 and at[:, 0].max() < 800
    assert at[:, 1].min() > 0 and at[:, 1].max() < 600
    assert max(np.ptp(at[:, 0]) / 800, np.ptp(at[:, 1]) / 600) > 0.85
    axes = camera.axes()
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)


def test_camera_of_a_moved_part_follows_the_pose_given():
    scene = pressing_scene()
    far = pin.SE3(np.eye(3), np.array([0.0, 0.0, 1.0]))
    assert frame_scene(scene, {"rod": far}).radius > 3 * frame_scene(scene).radius
    assert frame_scene(Scene()).radius > 0


@pytest.mark.parametrize("section", [None, ([0.0, 0.0, 0.0], [0.0, 1.0, 0.0])])
def test_what_is_out_of_the_picture_changes_nothing_in_it(section):
    scene = pressing_scene()
    camera, marked = frame_scene(scene), [("rod", 1), ("plate", 5)]
    alone = snapshot.render(scene, {}, marked, (120, 90), camera, look=Look({"plate": 0.4}, section=section))
    for k, corner in enumerate(np.array([[1, 1, 0], [-1, 1, 0], [0, -1, 1], [0, 0, -1]]) * 20 * camera.radius):
        scene.add(Part(f"far_{k}", box((0.05, 0.05, 0.05)), place(*corner)))
    faint = {"plate": 0.4, "far_0": 0.5, "far_1": 0.5}
    among = snapshot.render(scene, {}, [*marked, ("far_2", 3)], (120, 90), camera, look=Look(faint, section=section))
    np.testing.assert_array_equal(among, alone)
