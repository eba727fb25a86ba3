import io
import struct
import zlib

import numpy as np
import pinocchio as pin
import pytest
from PIL import Image

from tests.vpframe.watching import box, place, pressing_frames, pressing_scene, rod
from vpframe.scene.scene import Part, Scene
from vpframe.view import palette, snapshot
from vpframe.view.camera import Camera, frame_scene, look_at
from vpframe.view.display import display_mesh
from vpframe.view.raster import fill_triangles, shade_faces
from vpframe.view.snapshot import Look
from vpframe.view.symbols import frame_symbols


def plain_fill(xy, z, keep, width, height):
    """Depth and triangle of every pixel, one pixel and one triangle at a time."""
    depth, face = np.full((height, width), -np.inf), np.full((height, width), -1)
    for row in range(height):
        for column in range(width):
            p = np.array([column + 0.5, row + 0.5])
            for t, (a, b, c) in enumerate(xy):
                m = np.array([b - a, c - a]).T
                if np.linalg.det(m) == 0.0:
                    continue
                b1, b2 = np.linalg.solve(m, p - a)
                w = np.array([1 - b1 - b2, b1, b2])
                if w.min() < 0 or w @ keep[t] > 0:
                    continue
                if w @ z[t] > depth[row, column]:
                    depth[row, column], face[row, column] = w @ z[t], t
    return depth, face


@pytest.mark.parametrize("seed", range(4))
def test_rasteriser_agrees_with_pixel_by_pixel(seed):
    rng = np.random.default_rng(seed)
    width, height, count = 24, 18, 12
    xy = rng.uniform(-6, 30, (count, 3, 2))
    xy[0, 2] = xy[0, 1]  # a needle without area
    xy[1] = [[-2.0, 8.4999], [26.0, 8.5], [26.0, 8.5001]]  # and two that lie along a row of pixels
    xy[2] = [[3.2, 4.5], [21.7, 4.5], [9.0, 5.75]]
    z, keep = rng.uniform(-1, 1, (count, 3)), rng.uniform(-1, 0.4, (count, 3))
    depth, face = np.full((height, width), -np.inf), np.full((height, width), -1, np.int32)
    weight = np.zeros((height, width, 2), np.float32)
    fill_triangles(xy, z, keep, depth, face, weight)
    slow_depth, slow_face = plain_fill(xy, z, keep, width, height)
    assert (face >= 0).any()
    np.testing.assert_array_equal(face, slow_face)
    np.testing.assert_allclose(depth[face >= 0], slow_depth[face >= 0], atol=1e-12)


def plain_shade(face, weight, normals, color, label, filled, alpha, image):
    """The picture, one pixel at a time."""
    out = image.astype(np.float64)
    for row, column in zip(*np.nonzero(face >= 0), strict=True):
        t = face[row, column]
        b = weight[row, column].astype(float)
        n = np.array([1.0 - b.sum(), *b]) @ normals[t]
        n /= np.linalg.norm(n)
        n = -n if n[2] < 0 else n
        half = snapshot.KEY_LIGHT + np.array([0.0, 0.0, 1.0])
        shine = max(n @ (half / np.linalg.norm(half)), 0.0) ** 40
        light = 0.5 + 0.5 * max(n @ snapshot.KEY_LIGHT, 0.0) + 0.18 * max(n @ snapshot.FILL_LIGHT, 0.0)
        shaded = color[t] * light + 0.13 * shine
        if filled[t]:
            shaded = color[t] * (0.62 if (row + column) // 5 % 3 == 0 else 0.80)
        value = image[row, column] + alpha * (shaded - image[row, column])
        sides = [(row - 1, column), (row, column - 1), (row + 1, column), (row, column + 1)]
        there = [(r, c) for r, c in sides if 0 <= r < face.shape[0] and 0 <= c < face.shape[1]]
        bare = any(face[place] < 0 for place in there)
        other = any(face[p] >= 0 and label[face[p]] != label[t] for p in there if p in sides[:2])
        out[row, column] = value * (1.0 - 0.75 * alpha) if bare or other else value
    return out


@pytest.mark.parametrize("alpha", [1.0, 0.3])
def test_shading_agrees_with_pixel_by_pixel(alpha):
    rng = np.random.default_rng(5)
    shape, count = (17, 23), 6
    face = rng.integers(-1, count, shape).repeat(2, axis=0).repeat(2, axis=1).astype(np.int32)
    weight = rng.uniform(0, 0.5, (*face.shape, 2)).astype(np.float32)
    normals, color = rng.normal(size=(count, 3, 3)), rng.uniform(size=(count, 3))
    label, filled = np.array([0, 0, 1, 1, 2, 3]), np.array([False, False, False, False, False, True])
    image = rng.uniform(size=(*face.shape, 3)).astype(np.float32)
    half = snapshot.KEY_LIGHT + np.array([0.0, 0.0, 1.0])
    lights = np.stack([snapshot.KEY_LIGHT, half / np.linalg.norm(half), snapshot.FILL_LIGHT])
    expected = plain_shade(face, weight, normals, color, label, filled, alpha, image)
    window = np.array([0, face.shape[0], 0, face.shape[1]])
    drawn = image.copy()
    shade_faces(window, face, weight, normals, color, label, filled, lights, alpha, drawn)
    np.testing.assert_allclose(drawn, expected, atol=1e-5)
    part = image.copy()
    shade_faces(np.array([3, 9, 4, 20]), face, weight, normals, color, label, filled, lights, alpha, part)
    np.testing.assert_array_equal(part[3:9, 4:20], drawn[3:9, 4:20])
    part[3:9, 4:20] = image[3:9, 4:20]
    np.testing.assert_array_equal(part, image)


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
