"""Constrained motion: the nearest allowed pose, nothing passed at any speed, constraints kept without drift."""

import numpy as np
import pinocchio as pin
import pytest

from constraints import ConstraintsError, Screw
from constraints.geometry.surfaces import Cylinder
from constraints.kinds.stated import stated
from tests.constraints.motion.room import Room, bored
from tests.constraints.shapes import at, box, flanged_shaft, housing, turned


def test_a_free_part_goes_where_the_hand_wants_it():
    room = Room([box(0.1, 0.1, 0.1), box(0.02, 0.03, 0.04)], [at(), at(x=0.5)])
    for target in (at(x=0.3, rpy=(3.0, 0, 0)), at(y=2.0, rpy=(0, 0.2, -2.9)), at(z=-5.0)):
        result = room.move(target)
        assert np.abs(room.poses[1].homogeneous - target.homogeneous).max() < 1e-9
        assert not result.blocked and len(result.contacts) == 0
        assert result.remaining[1] == pytest.approx((0.0, 0.0), abs=1e-8)


@pytest.mark.parametrize("jump", [0.2, 2.0, 200.0])
def test_no_speed_carries_a_part_through_a_thin_wall(jump):
    room = Room([box(1.0, 1.0, 1e-4), box(0.02, 0.03, 0.04)], [at(), at(z=0.1)])
    result = room.move(at(z=0.1 - jump))
    assert result.blocked and set(result.contacts["object_a"].tolist()) == {0}
    assert 0.0 < room.poses[1].translation[2] - 0.02 - 5e-5 < 1e-4
    assert len(room.world.colliding_surfaces()) == 0


def test_it_slides_along_the_wall_under_the_hand():
    room = Room([box(1.0, 1.0, 0.02), box(0.04, 0.04, 0.04)], [at(), at(z=0.05)])
    for x in np.linspace(0.0, 0.3, 31):
        room.move(at(x=x, y=-0.5 * x, z=0.0))
        assert room.poses[1].translation[:2] == pytest.approx([x, -0.5 * x], abs=1e-6)
        assert 0.0 <= room.poses[1].translation[2] - 0.03 < 1e-4
        assert np.abs(pin.log3(room.poses[1].rotation)).max() < 1e-3


def test_what_starts_in_contact_slides_and_lifts():
    room = Room([box(1.0, 1.0, 0.02), box(0.04, 0.04, 0.04)], [at(), at(z=0.03)], accept=False)
    room.move(at(x=0.05, z=0.02))
    assert room.poses[1].translation == pytest.approx([0.05, 0.0, 0.03], abs=3e-5)
    assert len(room.world.colliding_surfaces()) == 0
    room.move(at(x=0.05, z=0.08))
    assert room.poses[1].translation == pytest.approx([0.05, 0.0, 0.08], abs=1e-9)


def test_a_shaking_hand_in_a_cage_never_gets_out():
    """A box in a closed cage, wanted anywhere within a metre: no two surfaces ever meet."""
    rng = np.random.default_rng(7)
    cage = turned([(0.0, 0.0), (0.1, 0.0), (0.1, 0.1), (0.0, 0.1)][::-1], n=12)  # a hollow drum, normals inward
    room = Room([cage, box(0.03, 0.05, 0.07)], [at(), at(z=0.05)])
    for _ in range(60):
        room.move(at(*rng.uniform(-1, 1, 3), rpy=rng.uniform(-3, 3, 3)))
        assert len(room.world.colliding_surfaces()) == 0
        assert np.abs(room.poses[1].translation - [0, 0, 0.05]).max() < 0.1


def test_a_hand_that_goes_straight_skips_the_turns_of_a_thread_that_is_drawn_plain():
    room = Room([housing(0.0105), flanged_shaft(phase=0.05)], [at(), at(z=0.03)], accept=False)
    axis = Cylinder([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], 0.01)
    screw = Screw((0, 1), (axis, axis), pitch=1e-3).engaged(*room.poses)
    room.manager.impose(stated(screw, room.poses, room.manager.recogniser.features, 0, "a thread"))
    for z in np.arange(0.03, 0.045, 8.5e-4):
        result = room.move(at(z=z))
        assert not result.blocked and result.residual < 1e-9
        assert abs(room.poses[1].translation[2] - z) <= 5e-4 + 1e-9
        assert np.abs(pin.log3(room.poses[1].rotation)).max() < 0.01


def test_the_flange_stops_at_the_face_and_seats_when_accepted():
    room = bored()
    result = room.move(at(z=-0.05))
    assert result.blocked and 0.0 < room.poses[1].translation[2] - 0.01 < 1e-4
    assert (0, 2, 1, 2) in {tuple(r)[:4] for r in result.contacts.tolist()}
    assert ("accepted", "against") in room.update()
    room.move(at(z=-0.05))
    assert room.poses[1].translation == pytest.approx([0, 0, 0.01], abs=1e-12)
    assert ("satisfied", "against") in room.update({1: at(z=-0.05)})
    assert room.update({1: at(z=0.02)}) == [("removed", "against")]
    room.move(at(z=0.02))
    assert room.poses[1].translation == pytest.approx([0, 0, 0.02], abs=1e-9)


def test_accepting_snaps_the_part_into_place():
    room = Room([housing(0.0101), flanged_shaft(phase=0.05)], [at(), at(x=5e-5, z=0.0105, rpy=(0.0005, 0, 0))])
    room.update()
    assert len(room.manager.accepted) == 2
    result = room.move(room.poses[1])
    assert result.residual < 1e-9
    assert room.poses[1].translation == pytest.approx([0, 0, 0.01], abs=1e-9)


def test_a_subassembly_is_stopped_by_what_its_other_end_hits():
    ring = housing(0.01, 0.01, 0.02)
    wall = box(0.2, 0.2, 0.02)
    room = Room([wall, flanged_shaft(), ring], [at(z=-0.1), at(), at(z=0.04)])
    room.update()
    result = room.move(at(z=-0.5), held=2)
    assert result.blocked
    assert 0.0 < room.poses[1].translation[2] + 0.09 < 1e-4  # the shaft's end, on the wall
    assert room.poses[2].translation[2] == pytest.approx(room.poses[1].translation[2] + 0.04, abs=1e-9)


@pytest.mark.parametrize("accept", [False, True])
def test_what_is_carried_does_not_drift_when_it_is_blocked(accept):
    """Two boxes side by side, held by one: the other runs into a wall, is pressed on it and slides, as one piece."""
    bodies = [box(1.0, 1.0, 0.02), box(0.04, 0.04, 0.04), box(0.04, 0.04, 0.06), box(0.03, 0.03, 0.03)]
    room = Room(bodies, [at(), at(z=0.06), at(x=0.04, z=0.06), at(x=0.3, z=0.2)], accept=accept)
    room.update()
    start = [room.poses[1].actInv(room.poses[i]) for i in (2, 3)]
    rng = np.random.default_rng(3)
    blocked = 0
    for k in range(60):
        wish = at(x=0.006 * k, y=0.01 * np.sin(k), z=0.02, rpy=rng.uniform(-0.4, 0.4, 3))
        result = room.move(wish, carried=(2, 3))
        blocked += result.blocked
        assert set(result.poses) == {1, 2, 3}
        for i, relative in zip((2, 3), start, strict=True):
            off = relative.actInv(room.poses[1].actInv(room.poses[i]))
            assert np.abs(pin.log6(off).vector).max() < 1e-9
    # 1 and 2 touch all along, to the last bit or not; what counts is that neither gets into the wall
    assert blocked > 45 and not (room.world.colliding_surfaces([2, 3])[:, 0] == 0).any()
    room.move(at(z=0.3))
    assert (room.poses[2].translation[2] < 0.2) != accept  # let go of, it comes only if its constraints bring it


def test_same_input_same_bits():
    def run():
        room = bored(clearance=1e-4)
        for k in range(25):
            room.move(at(x=0.01, z=0.03 - 0.002 * k, rpy=(0.01, 0.02, 0.3 * k)))
        return room.poses[1].homogeneous.tobytes()

    assert run() == run()


def steps(count):
    """Greatest distance from the constraints over many steps of a shaft that turns and slides in its bore."""
    room = bored()
    (constraint,) = room.manager.constraints
    worst = 0.0
    for k in range(count):
        room.move(at(x=0.003, z=0.03 + 0.015 * np.sin(0.01 * k), rpy=(0.01, 0.0, 0.05 * k)))
        if k % max(1, count // 1000) == 0:
            worst = max(worst, float(np.abs(constraint.residual(*room.poses)).max()))
    rotation = room.poses[1].rotation
    return max(worst, float(np.abs(rotation.T @ rotation - np.eye(3)).max()))


def test_no_drift():
    assert steps(2000) < 1e-9


@pytest.mark.slow
@pytest.mark.timeout(3000)
def test_no_drift_in_a_million_steps():
    assert steps(1_000_000) < 1e-9


def test_poses_that_are_none_are_refused_before_anything_moves():
    room = bored()
    before = room.world.pose(1)
    bad = at()
    bad.translation = np.array([0.0, np.nan, 0.0])
    with pytest.raises(ConstraintsError, match="body 1 is not finite"):
        room.move(bad)
    assert room.world.pose(1) == before


def test_a_hand_that_holds_nothing_moves_nothing():
    room = bored()
    result = room.motion.step({}, room.poses, room.movable)
    assert result.poses == {} and not result.blocked
