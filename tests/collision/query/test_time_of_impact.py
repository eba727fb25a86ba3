"""Time of impact against sub-sampling, closed forms, and what a hand does to walls, bores and thin plates."""

import numpy as np
import pinocchio as pin
import pytest
from numba import njit

from collision import CollisionError, CollisionManager, PoseError, SurfaceMesh, UnknownObjectError, colliding_surfaces
from collision.numeric.rigid_transforms import screw_pose
from collision.query.time_of_impact import time_of_impact
from tests.collision.brute_force import box, random_soup, signed_distances, sphere, turned

TOLERANCE = 1e-5


def at(x: float, y: float = 0.0, z: float = 0.0, turn: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> pin.SE3:
    return pin.SE3(pin.exp3(np.array(turn)), np.array([x, y, z], float))


def along(start: pin.SE3, target: pin.SE3, t: float) -> pin.SE3:
    return start * pin.exp6(pin.Motion(t * pin.log6(start.actInv(target)).vector))


def assert_first_contact(world: CollisionManager, moves: dict[int, pin.SE3], samples: int = 200) -> float:
    """Never late, early by no more than the tolerance; the time."""
    found = time_of_impact(world, moves)
    starts = {i: world.pose(i) for i in world.objects}
    targets = starts | moves

    def collide(t: float) -> bool:
        poses = {i: along(starts[i], targets[i], t) for i in starts}
        return any(
            len(colliding_surfaces(world.mesh(i), world.mesh(j), poses[i].actInv(poses[j])))
            for i in starts
            for j in starts
            if i < j and (i in moves or j in moves)
        )

    until = found.t if found.hit else 1.0
    assert not any(collide(t) for t in np.linspace(0.0, until, samples))
    if found.hit:
        assert 0.0 < found.t < 1.0
        assert found.contacts["distance"].min() <= TOLERANCE
        for i, pose in found.poses.items():
            np.testing.assert_allclose(pose.homogeneous, along(starts[i], targets[i], found.t).homogeneous, atol=1e-12)
        for row in found.contacts:
            gap = np.linalg.norm(row["point_a"] - row["point_b"])
            assert gap == pytest.approx(row["distance"], abs=1e-12)
    else:
        assert found.t == 1.0
    return found.t


def test_poses_of_the_kernel_are_those_of_pinocchio() -> None:
    rng = np.random.default_rng(0)
    found = np.empty(12)
    pose_at = njit(lambda screw, t, out: screw_pose(screw, t, out))
    for size in (0.0, 1e-9, 1e-5, 1e-3, 0.3, 3.0):
        start = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        twist = np.concatenate([rng.normal(size=3), size * rng.normal(size=3)])
        pose_at(np.concatenate([start.rotation.ravel(), start.translation, twist]), 0.7, found)
        expected = start * pin.exp6(pin.Motion(0.7 * twist))
        np.testing.assert_allclose(found[:9].reshape(3, 3), expected.rotation, atol=1e-14)
        np.testing.assert_allclose(found[9:], expected.translation, atol=1e-13)


@pytest.mark.parametrize("seed", range(15))
def test_random_screws_against_sub_sampling(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = CollisionManager()
    world.add(random_soup(rng, 12, 3), at(0.0))
    world.add(random_soup(rng, 12, 3), at(6.0))
    turn = tuple(rng.normal(size=3) * rng.choice([0.0, 0.3, 1.5]))
    assert_first_contact(world, {1: at(*rng.normal(size=3) * 1.5, turn=turn)})


@pytest.mark.slow
def test_many_random_screws_against_finer_sub_sampling() -> None:
    hits = 0
    for seed in range(300):
        rng = np.random.default_rng(1000 + seed)
        world = CollisionManager()
        world.add(random_soup(rng, 20, 3), at(0.0))
        world.add(random_soup(rng, 20, 3), at(6.0))
        turn = tuple(rng.normal(size=3) * rng.choice([0.0, 0.3, 1.5, 3.0]))
        hits += assert_first_contact(world, {1: at(*rng.normal(size=3) * 1.5, turn=turn)}, samples=1000) < 1.0
    assert hits > 200


@pytest.mark.parametrize("seed", range(10))
def test_several_objects_move_at_once(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    world = CollisionManager()
    for k in range(3):
        world.add(random_soup(rng, 8, 2), at(5.0 * np.cos(2.1 * k), 5.0 * np.sin(2.1 * k)))
    moves = {k: at(*rng.normal(size=3), turn=tuple(rng.normal(size=3))) for k in (0, 2)}
    assert_first_contact(world, moves)


@pytest.mark.parametrize("speed", [1.0, 1e3, 1e6])
def test_nothing_thin_is_passed_at_any_speed(speed: float) -> None:
    world = CollisionManager()
    sheet = SurfaceMesh([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]], name="sheet")
    world.add(sheet, at(0.0), movable=False)
    world.add(sphere(0.1, 12), at(0.0, 0.0, 0.35))
    found = time_of_impact(world, {1: at(0.0, 0.0, 0.35 - speed, turn=(0.4, 0.0, 0.1))})
    assert found.hit
    height = found.poses[1].translation[2]
    lowest = (world.mesh(1).vertices @ found.poses[1].rotation.T)[:, 2].min() + height
    assert 0.0 < lowest <= TOLERANCE
    assert found.rows.tolist() == [[0, 0, 1, 0]]


def test_a_bar_swings_into_a_post_at_the_angle_of_the_closed_form() -> None:
    world = CollisionManager()
    world.add(box(2.0, 0.2, 0.1), at(0.0))
    world.add(box(0.1, 0.1, 1.0), at(0.0, 0.8, 0.0), movable=False)
    t = assert_first_contact(world, {0: at(0.0, turn=(0.0, 0.0, 3.0))})
    # the bar's side, 0.1 off its axis, meets the post's corner (0.05, 0.75)
    corner = np.array([0.05, 0.75])
    angle = np.arctan2(corner[1], corner[0]) - np.arcsin(0.1 / np.linalg.norm(corner))
    assert 3.0 * t == pytest.approx(angle, abs=2 * TOLERANCE / 0.7)
    assert 3.0 * t <= angle


def test_objects_that_move_together_do_not_stop_each_other() -> None:
    world = CollisionManager()
    world.add(box(1.0, 1.0, 1.0), at(0.0))
    world.add(box(1.0, 1.0, 1.0), at(0.0, 0.0, 1.0))
    world.add(box(1.0, 1.0, 1.0), at(0.0, 0.0, 2.0 + 1e-3))
    screw = at(4.0, 1.0, 0.5, turn=(0.3, 0.2, 2.0))
    found = time_of_impact(world, {k: screw * world.pose(k) for k in range(3)})
    assert not found.hit and found.t == 1.0


def resting(gap: float = 0.0) -> CollisionManager:
    world = CollisionManager()
    world.add(box(4.0, 4.0, 1e-3, 2), at(0.0, 0.0, -0.5e-3), movable=False)
    world.add(box(0.2, 0.2, 0.2), at(0.0, 0.0, 0.1 + gap))
    return world


@pytest.mark.parametrize("gap", [0.0, 0.4e-5])
def test_from_contact_a_part_lifts_slides_and_turns_but_is_not_pressed_in(gap: float) -> None:
    world = resting(gap)
    z = 0.1 + gap
    for free in (at(0, 0, 1.0), at(0.7, 0.3, z), at(0, 0, z, turn=(0, 0, 2.0)), at(0.5, 0, z, turn=(0, 0, -1.0))):
        assert time_of_impact(world, {1: free}).t == 1.0
    for pressed in (at(0, 0, z - 1e-3), at(0.5, 0, z - 1e-2), at(0, 0, -50.0), at(0, 0, z, turn=(0.3, 0, 0))):
        found = time_of_impact(world, {1: pressed})
        assert found.t < 1e-3 and found.hit
        assert {tuple(row[[0, 2]]) for row in found.rows} == {(0, 1)}


def test_pressing_on_and_on_gets_no_deeper_than_the_tolerance() -> None:
    world = resting()
    for k in range(200):
        pose = world.pose(1)
        push = at(pose.translation[0] + 1e-4, 0.0, pose.translation[2] - (1e-3 if k % 2 else 0.9e-6))
        world.set_pose(1, time_of_impact(world, {1: push}).poses[1])
    assert world.pose(1).translation[2] >= 0.1 - 1.1 * TOLERANCE


def test_a_hand_slides_along_one_wall_and_stops_at_the_next() -> None:
    world = resting()
    wall = world.add(box(0.01, 4.0, 1.0), at(1.0, 0.0, 0.5 + 1e-4), movable=False)
    found = time_of_impact(world, {1: at(3.0, 0.0, 0.1)})
    assert found.poses[1].translation[0] == pytest.approx(1.0 - 0.005 - 0.1, abs=TOLERANCE)
    assert {int(row[2]) for row in found.rows} == {wall}
    assert (1, 1, wall, 0) in [tuple(row) for row in found.rows.tolist()]


def test_ignored_surfaces_and_objects_stop_nothing() -> None:
    world = resting(0.3)
    down = {1: at(0.0, 0.0, -1.0)}
    assert time_of_impact(world, down).hit
    world.ignore_surfaces(0, range(6), 1, [4])
    sides = time_of_impact(world, down)
    assert sides.hit and 4 not in sides.rows[:, 3]
    world.ignore(0, 1)
    assert time_of_impact(world, down).t == 1.0


def test_a_faceted_shaft_slides_in_its_bore_within_the_deflection() -> None:
    radius, sectors = 0.005, 16
    sag = radius * (1 - np.cos(np.pi / sectors))
    bore = turned([(0, radius), (0, 0.02), (0.01, 0.02), (0.01, radius), (0, radius)], sectors)
    shaft = turned([(-0.002, 0), (-0.002, radius), (0.02, radius), (0.02, 0)], sectors)
    world = CollisionManager()
    world.add(bore, at(0.0), movable=False)
    world.add(shaft, at(0.0, turn=(0.0, 0.0, 0.1)))
    out = at(0.0, 0.0, 0.0015, turn=(0.0, 0.0, 0.1))  # its ends stay outside
    assert time_of_impact(world, {1: out}, deflection=1.1 * sag).t == 1.0
    aside = time_of_impact(world, {1: at(0.002)}, deflection=1.1 * sag)
    assert aside.hit and aside.t < 0.1


def test_a_motion_that_needs_too_many_advancements_stops_rather_than_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    from collision.query import time_of_impact as module

    world = CollisionManager()
    world.add(box(1.0, 1.0, 1.0), at(0.0), movable=False)
    world.add(box(0.2, 0.2, 0.2), at(0.0, 0.0, 1.0))
    past = {1: at(0.9, 0.0, 0.0, turn=(0.5, 2.0, 0.0))}
    full = time_of_impact(world, past)
    monkeypatch.setattr(module, "STEPS", 2)
    short = time_of_impact(world, past)
    assert short.hit and 0.0 < short.t <= full.t
    assert short.contacts["distance"].min() > TOLERANCE


def test_bad_moves_are_named() -> None:
    world = resting()
    with pytest.raises(UnknownObjectError, match="object 7"):
        time_of_impact(world, {7: at(0.0)})
    with pytest.raises(PoseError, match="target of object 1"):
        time_of_impact(world, {1: np.full((4, 4), np.nan)})
    with pytest.raises(CollisionError, match="deflection"):
        time_of_impact(world, {1: at(0.0)}, deflection=-1.0)


SLOP = 0.1 * TOLERANCE


def signed_by_surfaces(world: CollisionManager, i: int, j: int, poses: dict[int, pin.SE3]) -> np.ndarray:
    """(ka, kb) least signed distance of every pair of surfaces, all triangles against all."""
    a, b = world.mesh(i), world.mesh(j)
    pose = poses[i].actInv(poses[j])
    corners_b = (b.vertices @ pose.rotation.T + pose.translation)[b.triangles]
    every = signed_distances(a.vertices[a.triangles], corners_b)
    out = np.full((a.n_surfaces, b.n_surfaces), np.inf)
    np.minimum.at(out, (a.surface_of_triangle[:, None], b.surface_of_triangle[None]), every)
    return out


def shaft_in_bore(sectors: int) -> CollisionManager:
    world = CollisionManager()
    world.add(turned([(0, 0.005), (0, 0.012), (0.01, 0.012), (0.01, 0.005), (0, 0.005)], sectors), at(0.0))
    world.add(turned([(-0.002, 0), (-0.002, 0.005), (0.015, 0.005), (0.015, 0)], sectors), at(0, 0, 0, (0, 0, 0.1)))
    return world


def sphere_in_a_corner() -> CollisionManager:
    world = CollisionManager()
    world.add(box(2.0, 2.0, 0.1), at(0.0, 0.0, -0.05))
    world.add(box(0.1, 2.0, 1.0), at(0.3, 0.0, 0.5))
    world.add(sphere(0.25, 8), at(0.0, 0.0, 0.25))
    return world


def shaft_in_bore_on_a_floor() -> CollisionManager:
    """The floor is asked first: what it leaves of the motion is too short for the bore to matter."""
    world = CollisionManager()
    world.add(box(0.1, 0.1, 0.01), at(0.0, 0.0, -0.007))
    bore = shaft_in_bore(6)
    for i in bore.objects:
        world.add(bore.mesh(i), bore.pose(i))
    return world


STARTS = {
    "in a bore on a floor": (shaft_in_bore_on_a_floor, 2, 4e-4, 5e-4),
    "in a bore on a floor without leave": (shaft_in_bore_on_a_floor, 2, 4e-4, 0.0),
    "on a floor": (lambda: resting(), 1, 0.02, 0.0),
    "just above a floor": (lambda: resting(0.4e-5), 1, 0.02, 0.0),
    "in a bore": (lambda: shaft_in_bore(6), 1, 4e-4, 5e-4),
    "in a bore without leave": (lambda: shaft_in_bore(6), 1, 4e-4, 0.0),
    "in a corner": (sphere_in_a_corner, 2, 0.02, 0.0),
}


@pytest.mark.parametrize("start", STARTS)
def test_from_contact_nothing_goes_deeper_than_allowed_and_nothing_stops_early(start: str) -> None:
    make, moved, size, deflection = STARTS[start]
    rng = np.random.default_rng(11)
    stopped = 0
    for _ in range(3):
        world = make()
        here = world.pose(moved)
        target = here * at(*size * rng.normal(size=3), turn=tuple(rng.choice([0.0, 0.1]) * rng.normal(size=3)))
        found = time_of_impact(world, {moved: target}, deflection)
        for i in world.objects:
            if i == moved:
                continue
            first = signed_by_surfaces(world, *sorted((i, moved)), {k: world.pose(k) for k in world.objects})
            lowest = np.where(first > SLOP - TOLERANCE, np.maximum(first - SLOP, -TOLERANCE), first - 0.01 * SLOP)
            lowest = np.minimum(lowest, -deflection) if deflection else lowest
            level = np.where(first <= TOLERANCE, lowest, TOLERANCE)
            for t in np.linspace(0.0, found.t, 5):
                poses = {k: world.pose(k) for k in world.objects} | {moved: along(here, target, t)}
                now = signed_by_surfaces(world, *sorted((i, moved)), poses)
                assert (now >= np.where(first <= TOLERANCE, level - 0.5 * SLOP, 0.0) - 1e-12).all()
            stopping = [row for row in found.rows.tolist() if i in row[::2]]
            if stopping:
                stopped += 1
                at_rest = [now[s, u] - level[s, u] for _, s, _, u in stopping]
                assert min(at_rest) <= 1.5 * SLOP + 1e-12
    assert stopped > 0


def test_the_first_impact_of_many_is_the_first_of_any_pair_alone() -> None:
    """Whatever the order in which pairs are advanced: all of them, to the end, one at a time."""
    rng = np.random.default_rng(12)
    hits = at_once = 0
    for k in range(40):
        world = CollisionManager()
        for _ in range(5):
            place = rng.normal(size=3) * (0.12 if k % 2 else 0.3)
            world.add(box(*rng.uniform(0.05, 0.2, 3)), at(*place, turn=tuple(rng.normal(size=3))))
        moves = {0: at(*rng.normal(size=3) * 0.5, turn=tuple(rng.normal(size=3)))}
        if k % 3 == 0:
            moves[3] = world.pose(3) * at(*rng.normal(size=3) * 10.0 ** rng.uniform(-6.0, 0.0))
        alone = {}
        for i in range(5):
            for j in range(i + 1, 5):
                if i in moves or j in moves:
                    two = CollisionManager()
                    two.add(world.mesh(i), world.pose(i)), two.add(world.mesh(j), world.pose(j))
                    found = time_of_impact(two, {n: moves[m] for n, m in enumerate((i, j)) if m in moves})
                    alone[i, j] = found.t if found.hit else np.inf
        found = time_of_impact(world, moves)
        assert found.hit == (min(alone.values()) <= 1.0)
        if found.hit:
            # steps that aim at a nearer end differ by what an impact may be early
            assert found.t == pytest.approx(min(alone.values()), abs=1e-4)
            i, j = (int(found.contacts[name][0]) for name in ("object_a", "object_b"))
            assert alone[i, j] == pytest.approx(found.t, abs=1e-4)
            hits, at_once = hits + 1, at_once + (found.t == 0.0)
    assert hits > 15 and at_once > 3 and hits - at_once > 3


def test_a_pair_that_parts_and_comes_back_is_not_stopped_far_away() -> None:
    world = CollisionManager()
    world.add(box(4.0, 4.0, 0.1), at(0.0, 0.0, -0.05), movable=False)
    world.add(sphere(0.1, 24), at(-0.5, 0.0, 0.1))
    axis = at(0.0, 0.0, 0.03)
    over = axis * at(0.0, turn=(0.0, 3.1, 0.0)) * axis.inverse() * world.pose(1)
    found = time_of_impact(world, {1: over})
    assert found.hit and 0.5 < found.t < 1.0
    assert lowest_point(world, found.poses[1]) == pytest.approx(0.0, abs=TOLERANCE)


def lowest_point(world: CollisionManager, pose: pin.SE3) -> float:
    return float((world.mesh(1).vertices @ pose.rotation.T)[:, 2].min() + pose.translation[2])
