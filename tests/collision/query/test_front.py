"""Legs of objects that overlap as drawn: the overlap only shrinks, whatever the shapes, the surfaces and the motion."""

from itertools import product

import numpy as np
import pinocchio as pin
import pytest

from collision import SurfaceMesh, Tolerance
from collision.query.blocking import Sweeps
from collision.query.front import buried, front_of

TOLERANCE = Tolerance(linear=1e-6, slop=1e-6)
POSES = 60
"""of a leg, at which the common volume is computed"""
HOME = pin.SE3.Identity()


def at(x=0.0, y=0.0, z=0.0):
    return pin.SE3(np.eye(3), np.array([x, y, z]))


def blocks(*boxes, surfaces="one"):
    """Boxes (least corner, greatest corner), m, as one mesh; one surface in all, or one for each normal."""
    vertices, triangles, normals = [], [], []
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    for low, high in boxes:
        first = len(vertices)
        vertices += list(product(*zip(low, high, strict=True)))
        triangles += [(first + a, first + b, first + c) for p, q, r, s in quads for a, b, c in ((p, q, r), (p, r, s))]
        normals += [k // 2 for k in range(12)]
    return SurfaceMesh(vertices, triangles, normals if surfaces == "normal" else np.zeros(len(triangles), int))


def stop(a, b, end, *more):
    """Where b, standing at the origin, stops a, which begins there, on its way; None if it does not."""
    return Sweeps([a, b], [HOME, HOME], TOLERANCE).stop(0, 1, (HOME, end, *more))


@pytest.mark.parametrize("surfaces", ["one", "normal"])
@pytest.mark.parametrize("second", [1e-4, 4.1e-4, 4.2e-4, 4.9e-4])
def test_an_overlap_that_is_left_is_not_entered_again_elsewhere(surfaces, second):
    """A slider begins 0.42 mm inside the first of two ribs and goes over a gap to the other: as deep, less, more."""
    slider = blocks(((0.0, 0.0, 0.0), (0.01, 0.02, 0.01)), surfaces=surfaces)
    ribs = ((-0.02, -0.01, -0.01), (0.009, 0.03, 4.2e-4)), ((0.03, -0.01, -0.01), (0.04, 0.03, second))
    found = stop(slider, blocks(*ribs, surfaces=surfaces), at(0.06))
    assert found is not None and 0.02 - 2e-6 <= found.t * 0.06 <= 0.02
    assert stop(slider, blocks(ribs[0], surfaces=surfaces), at(0.06)) is None, "the first rib alone lets it off"
    lifted = at(0.0, 0.0, 0.01)
    assert stop(slider, blocks(*ribs, surfaces=surfaces), lifted, lifted * at(0.06)) is None, "over both"


def test_an_overlap_that_is_left_is_not_entered_again_on_a_turn():
    """An arm begins 0.3 mm inside a post beside it, turns out of it, and half a turn later meets another post."""
    arm = blocks(((0.0, -0.002, 0.0), (0.02, 0.002, 0.002)))
    posts = ((0.016, -0.012, 0.0), (0.019, -0.0017, 0.002)), ((-0.019, 0.0, 0.0), (-0.016, 0.0025, 0.002))
    turn = pin.SE3(pin.exp3(np.array([0.0, 0.0, 3.0])), np.zeros(3))
    found = stop(arm, blocks(*posts), turn)
    assert found is not None and 0.5 < found.t < 1.0
    assert stop(arm, blocks(posts[0]), turn) is None
    assert stop(arm, blocks(posts[0]), turn.inverse()).t == 0.0, "it would go deeper at once"


def test_a_key_comes_out_of_its_slot_and_goes_no_farther_in():
    """A slot 0.1 mm too narrow on either side, and a key half way in: farther in, as deep, more of it would overlap."""
    slot = blocks(((0.0, -0.01, 0.0), (0.02, -0.0019, 0.01)), ((0.0, 0.0019, 0.0), (0.02, 0.01, 0.01)))
    key = blocks(((0.01, -0.002, 0.002), (0.03, 0.002, 0.008)))
    assert stop(key, slot, at(0.03)) is None
    found = stop(key, slot, at(-0.002))
    assert found is not None and found.t == 0.0 and len(found.contacts)
    through = blocks(((-0.01, -0.002, 0.002), (0.03, 0.002, 0.008)))  # longer than the slot: as much overlaps
    assert stop(through, slot, at(-0.005)) is None and stop(through, slot, at(0.05)) is None
    short = blocks(((0.005, -0.002, 0.002), (0.015, 0.002, 0.008)))
    assert stop(short, slot, at(-0.004)) is None and stop(short, slot, at(0.05)) is None


def test_a_foot_that_is_drawn_into_the_ground_is_pulled_out_and_not_pushed_in():
    """Its sole is inside, far from all surfaces: nothing that sweeps only what meets would stop it."""
    ground = blocks(((-0.05, -0.05, -0.02), (0.05, 0.05, 0.0)), surfaces="normal")
    foot = blocks(((0.0, 0.0, -4.2e-4), (0.01, 0.01, 0.02)), surfaces="normal")
    assert stop(foot, ground, at(0.0, 0.0, 0.03)) is None
    assert stop(foot, ground, at(0.02, 0.0, 0.03)) is None
    assert stop(foot, ground, at(0.02, 0.0, 0.0)) is None, "it slides, as deep and as much of it"
    for way in (at(0.0, 0.0, -1e-4), at(0.02, 0.0, -1e-4)):
        found = stop(foot, ground, way)
        assert found is not None and found.t == 0.0
    assert stop(foot, ground, at(0.06)) is None, "and over the edge"


def test_the_front_of_an_open_mesh_is_all_of_it():
    box = blocks(((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), surfaces="normal")
    up = np.array([0.0, 0.0, 1.0])
    assert {int(box.surface_of_triangle[t]) for t in front_of(box, up, np.zeros(3), 0.0)} == {5}
    sheet = SurfaceMesh(box.vertices, box.triangles[:-1], box.surface_of_triangle[:-1])
    assert len(front_of(sheet, up, np.zeros(3), 0.0)) == 11


def test_what_is_buried_behind_an_excused_surface_is_not_reported():
    ground = blocks(((-1.0, -1.0, -1.0), (1.0, 1.0, 0.0)), surfaces="normal")
    foot = blocks(((0.0, 0.0, -0.1), (0.2, 0.2, 0.5)), surfaces="normal")
    assert 4 in buried(foot, ground, HOME, 1e-3) and 5 not in buried(foot, ground, HOME, 1e-3)
    assert 4 not in buried(foot, ground, HOME, 1e-3, [((4,), (5,))])
    assert 4 in buried(foot, ground, HOME, 1e-3, [((4,), (0, 4)), ((0,), (5,))])
    assert 4 not in buried(foot, ground, HOME, 0.11)


# --- random legs, held to the common volume that manifold3d computes --------------------------------------------------


def manifold(mesh, pose):
    manifold3d = pytest.importorskip("manifold3d")
    vertices = np.ascontiguousarray(mesh.vertices @ pose.rotation.T + pose.translation)
    return manifold3d.Manifold(manifold3d.Mesh64(vertices, mesh.triangles.astype(np.uint64)))


def moved(solid, pose):
    return solid.transform(pose.homogeneous[:3])


def shape(random):
    """A box, an L, a cone's stump or a plate with two holes, its triangles in one surface, by normal, or each alone."""
    solid = pytest.importorskip("manifold3d").Manifold
    size, kind = random.uniform(4e-3, 2e-2, 3), random.integers(4)
    out = solid.cube(size, True)
    if kind == 1:
        out -= out.translate(size * random.uniform(0.3, 0.7, 3) * [1, 1, 0])
    elif kind == 2:
        radii = 0.5 * size[1] * np.array([1.0, random.choice([1.0, random.uniform(0.5, 1.0)])])
        out = solid.cylinder(size[0], *radii, int(random.integers(8, 24)), True)
    elif kind == 3:
        hole = solid.cylinder(1.0, 0.25 * size[0], 0.25 * size[0], 12, True)
        out = solid.cube(size * [2.0, 1.0, 0.3], True)
        for side in (-0.4, 0.4):
            out -= hole.translate([side * size[0], 0.0, 0.0])
    mesh = out.to_mesh64()
    vertices, triangles = np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts, np.int64)
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = np.round(normal / np.linalg.norm(normal, axis=1, keepdims=True), 6)
    surfaces = (
        np.zeros(len(triangles), int),
        np.unique(normal, axis=0, return_inverse=True)[1].reshape(-1),
        np.arange(len(triangles)),
    )
    return SurfaceMesh(vertices, triangles, surfaces[random.integers(3)])


def leg(random):
    """(6,) a twist: along an axis, askew, or a screw."""
    direction = np.eye(3)[random.integers(3)] * random.choice([-1, 1])
    if random.random() < 0.4:
        direction = random.normal(size=3)
    turn = np.eye(3)[random.integers(3)] if random.random() < 0.5 else random.normal(size=3)
    kind = random.random()
    way = direction / np.linalg.norm(direction) * random.uniform(1e-3, 4e-2) * (0.3 if kind < 0.2 else 1.0)
    turn = turn / np.linalg.norm(turn) * random.uniform(-1.5, 1.5) * (kind < 0.4)
    return np.concatenate([way, turn])


def grown(seed):
    """(legs that go somewhere, a text for each on which an overlap grows) of one random pair.

    It grows if its volume does, or if it is not a part of what it was a pose before: seen from the standing object all
    along the leg, or from the moving one all along.
    """
    random = np.random.default_rng(seed)
    a, b = shape(random), shape(random)
    for _ in range(50):
        turned = pin.exp3(random.normal(size=3)) if random.random() < 0.3 else np.eye(3)
        pose = pin.SE3(turned, random.uniform(-1.5e-2, 1.5e-2, 3))
        standing = manifold(b, pose)
        drawn = (manifold(a, HOME) ^ standing).volume()
        if drawn > 1e-11:
            break
    area = min(manifold(a, HOME).surface_area(), standing.surface_area())
    sweeps, went, wrong = Sweeps([a, b], [HOME, pose], TOLERANCE), 0, []
    for k in range(4):
        twist = leg(random)
        if k < 2:  # away
            x = -pose.translation * (1.0 if k else np.abs(pose.translation) == np.abs(pose.translation).max())
            twist[:3] = x / np.linalg.norm(x) * np.linalg.norm(twist[:3])
        found = sweeps.stop(0, 1, (HOME, pin.exp6(twist)))
        until = 1.0 if found is None else found.t
        went += until > 0.0
        before, volume, fresh = None, 0.0, np.zeros(2)
        for t in np.linspace(0.0, until, POSES if until > 0.0 else 0):
            here = pin.exp6(twist * t)
            common = manifold(a, here) ^ standing
            seen = common, moved(common, here.inverse())
            if before is not None:
                fresh = np.maximum(fresh, [(now - then).volume() for now, then in zip(seen, before, strict=True)])
            volume, before = max(volume, common.volume()), seen
        more = max(volume - drawn, fresh.min())
        if more > TOLERANCE.linear * area:
            wrong.append(f"seed {seed}, leg {k}, to {until:.4f}: {more:.3g} m³ more")
    return went, wrong


def test_random_overlaps_never_grow():
    counts, wrong = zip(*(grown(seed) for seed in range(40)), strict=True)
    assert not [text for texts in wrong for text in texts]
    assert sum(counts) >= 20, "legs that go somewhere"


@pytest.mark.slow
@pytest.mark.parametrize("first", range(40, 440, 40))
def test_more_than_a_thousand_random_overlaps_never_grow(first):
    """1,600 legs, of which a third go somewhere."""
    counts, wrong = zip(*(grown(seed) for seed in range(first, first + 40)), strict=True)
    assert not [text for texts in wrong for text in texts]
    assert sum(counts) >= 40
