"""Constrained motion where it is hard: turned over beside a wall, wedged, cornered, on a rim, in coarse bores."""

import numpy as np
import pinocchio as pin
import pytest

from tests.constraints.motion.room import Room
from tests.constraints.shapes import Builder, arc_face, at, box, flanged_shaft, housing, shaft, turned

LINEAR = 1e-5


def least(room, i=1):
    """Least height of body i over z = 0, m."""
    pose = room.poses[i]
    return float((room.world.mesh(i).vertices @ pose.rotation.T + pose.translation)[:, 2].min())


@pytest.mark.parametrize("axis", [[1.0, 0.0, 0.0], [0.3, -1.0, 0.0], [1.0, 1.0, 1.0]])
def test_turned_over_in_one_step_beside_a_wall_it_goes_round_without_touching_through(axis):
    """A bar flat on a floor whose half length is ten times its height: half a turn in one wish, then in thirty."""
    for steps in (1, 30):
        room = Room([box(1.0, 1.0, 0.02), box(0.02, 0.2, 0.02)], [at(z=-0.01), at(z=0.0101)], accept=False)
        turn = pin.exp3(np.pi * np.array(axis) / np.linalg.norm(axis))
        for k in range(1, steps + 1):
            part = pin.exp3(pin.log3(turn) * k / steps)
            room.move(pin.SE3(part, np.array([0.0, 0.0, 0.0101])))
            assert least(room) > 0.0
            assert len(room.world.colliding_surfaces()) == 0


@pytest.mark.parametrize("thickness", [1e-3, 1e-5])
def test_no_turn_in_one_step_carries_an_end_through_a_foil(thickness):
    """The far end of a bar would pass through a foil that stands beside it."""
    foil, bar = box(thickness, 1.0, 1.0), box(0.2, 0.01, 0.01)
    room = Room([foil, bar], [at(x=0.05), at(y=0.0, x=-0.0505 - thickness)], accept=False)
    for turn in (np.pi / 2, np.pi, -3.0):
        room.move(at(x=-0.04, rpy=(0, 0, turn)))
        pose = room.poses[1]
        x = (room.world.mesh(1).vertices @ pose.rotation.T + pose.translation)[:, 0]
        assert x.max() < 0.05 - 0.5 * thickness
        assert len(room.world.colliding_surfaces()) == 0


def wedge(angle):
    """Two walls that meet in a V along y at the origin, opening upwards by twice `angle`."""
    length, thick = 0.4, 0.02
    poses = []
    for sign in (-1.0, 1.0):
        turn = pin.rpy.rpyToMatrix(0.0, sign * angle, 0.0)
        poses.append(pin.SE3(turn, turn @ np.array([sign * 0.5 * thick, 0.0, 0.5 * length])))
    return [box(thick, 0.4, length)] * 2, poses


@pytest.mark.parametrize("angle", [0.8, 0.4, 0.15])
def test_pressed_into_a_wedge_it_rests_and_comes_out_again(angle):
    """A roller sinks to r / sin(angle), stays there under the same wish, and is lifted out freely."""
    walls, poses = wedge(angle)
    roller = turned([(0.0, -0.05), (0.02, -0.05), (0.02, 0.05), (0.0, 0.05)], n=48)
    lying = pin.rpy.rpyToMatrix(np.pi / 2, 0.0, 0.0)
    bodies = [*walls, roller]
    deep = 0.02 / np.sin(angle)
    room = Room(bodies, [*poses, pin.SE3(lying, np.array([0.0, 0.0, deep + 0.05]))], accept=False)
    for _ in range(30):
        result = room.move(pin.SE3(lying, np.array([0.001, 0.0, 0.0])), held=2, movable=[2])
    sag = 0.02 * (1.0 - np.cos(np.pi / 48)) / np.sin(angle)
    assert result.blocked and {0, 1} <= set(result.contacts["object_a"].tolist())
    assert deep - sag - 1e-6 < room.poses[2].translation[2] < deep + 10 * LINEAR / np.sin(angle)
    assert len(room.world.colliding_surfaces([2])) == 0
    rest = room.poses[2]
    room.move(pin.SE3(lying, np.array([0.001, 0.0, 0.0])), held=2, movable=[2])
    assert np.abs(rest.translation - room.poses[2].translation).max() < LINEAR
    out = pin.SE3(lying, np.array([0.0, 0.0, 0.3]))
    room.move(out, held=2, movable=[2])
    assert np.abs(room.poses[2].homogeneous - out.homogeneous).max() < 1e-9


def test_pressed_into_a_corner_of_three_walls():
    """A cube goes to the corner from anywhere, keeps `2·linear` off each wall, and slides along an edge when asked."""
    walls = [box(0.02, 1.0, 1.0), box(1.0, 0.02, 1.0), box(1.0, 1.0, 0.02)]
    places = [at(x=-0.01), at(y=-0.01), at(z=-0.01)]
    rng = np.random.default_rng(5)
    for _ in range(6):
        room = Room([*walls, box(0.04, 0.05, 0.06)], [*places, at(*rng.uniform(0.1, 0.3, 3))], accept=False)
        for _ in range(8):
            result = room.move(at(*rng.uniform(-0.2, -0.05, 3)), held=3, movable=[3])
        assert result.blocked and set(result.contacts["object_a"].tolist()) == {0, 1, 2}
        gap = room.poses[3].translation - [0.02, 0.025, 0.03]
        assert (gap > 0.0).all() and (gap < 5 * LINEAR).all()
        room.move(at(x=-0.1, y=0.2, z=-0.1), held=3, movable=[3])
        assert room.poses[3].translation == pytest.approx([0.02, 0.2, 0.03], abs=5 * LINEAR)
        assert len(room.world.colliding_surfaces([3])) == 0


def test_a_plate_pressed_on_a_round_rim_slides_over_it():
    """On the mouth of a tube, pressed and tilted by the hand: it slides across, off the rim and down beside it."""
    room = Room([housing(0.03, 0.05, 0.04, n=48), box(0.05, 0.05, 0.01)], [at(), at(z=0.06)], accept=False)
    for k in range(41):
        wish = at(x=0.002 * k, z=0.04, rpy=(0.1 * np.sin(k), 0.1 * np.cos(k), 0.05 * k))
        room.move(wish)
        assert len(room.world.colliding_surfaces()) == 0
        if k < 15:
            assert room.poses[1].translation[2] > 0.055 - 1e-6
    for _ in range(5):
        room.move(at(x=0.1, z=0.02))
    assert room.poses[1].translation == pytest.approx([0.1, 0.0, 0.02], abs=1e-9)


def test_rod_on_rod_crossed():
    """Two facetted cylinders at right angles touch in a point: pressed and rolled, neither enters the other."""
    rod = turned([(0.0, -0.1), (0.01, -0.1), (0.01, 0.1), (0.0, 0.1)], n=24)
    across = pin.rpy.rpyToMatrix(np.pi / 2, 0.0, 0.0)
    along = pin.rpy.rpyToMatrix(0.0, np.pi / 2, 0.0)
    room = Room([rod, rod], [pin.SE3(across, np.zeros(3)), pin.SE3(along, np.array([0.0, 0.0, 0.03]))], accept=False)
    for k in range(30):
        turned_by = along @ pin.rpy.rpyToMatrix(0.0, 0.0, 0.1 * k)
        result = room.move(pin.SE3(turned_by, np.array([0.001 * k, 0.002 * k, 0.0])))
        assert len(room.world.colliding_surfaces()) == 0 and result.blocked
        normal = np.cross(room.poses[0].rotation[:, 2], room.poses[1].rotation[:, 2])
        apart = abs(room.poses[1].translation @ normal) / np.linalg.norm(normal)
        assert 0.02 * np.cos(np.pi / 24) < apart < 0.02 + 5 * LINEAR


@pytest.mark.parametrize("n", [(8, 8), (8, 64), (64, 8), (13, 32), (48, 48)])
def test_a_shaft_blocked_in_its_bore_at_any_tessellation(n):
    """20 µm of clearance: it turns, slides, and is stopped by its flange where the solid says, not its facets."""
    bodies = [housing(0.01002, n=n[0]), flanged_shaft(n=n[1], phase=0.1)]
    room = Room(bodies, [at(), at(z=0.03)])
    room.world.contacts(room.manager.within)
    room.mate()
    assert [c.kind for c in room.manager.constraints] == ["concentric"]
    room.manager.rules.clear()
    for k in range(25):
        z = 0.03 - 0.0015 * k
        result = room.move(at(x=0.004 * np.sin(k), z=z, rpy=(0.05 * np.cos(k), 0.0, 0.2 * k)))
        pose = room.poses[1]
        assert result.residual < 1e-9 and np.abs(pose.translation[:2]).max() < 1e-9
        assert abs(pin.log3(pose.rotation.T @ pin.rpy.rpyToMatrix(0, 0, 0.2 * k))[2]) < 0.02
        if z > 0.0101:
            assert pose.translation[2] == pytest.approx(z, abs=1e-3) and not result.blocked
    assert result.blocked and 0.01 < room.poses[1].translation[2] < 0.0101


@pytest.mark.parametrize("n", [8, 32, 64])
def test_interference_of_20_micrometres_is_told_as_such(n):
    room = Room([housing(0.00998, n=n), flanged_shaft(n=n)], [at(), at(z=0.03)], accept=False)
    room.update()
    (offer,) = [c for c in room.manager.candidates.values() if c.kind == "concentric"]
    assert offer.match.fit == pytest.approx(-2e-5, abs=1e-9)
    assert "20 µm radial interference" in offer.why


def test_a_half_bore_holds_the_shaft_on_its_side_and_lets_it_out_on_the_other():
    """A shaft pressed into a trough slides along it as far as the hand goes; pulled up it comes out."""
    builder = Builder()
    arc_face(builder, 0.0101, np.pi, 2.0 * np.pi, -0.05, 0.05, sense=-1, n=33)
    trough = builder.body("trough")
    room = Room([trough, shaft(0.01, 0.04)], [at(), at(y=0.05, z=-0.02)], accept=False)
    for k in range(10):
        room.move(at(x=0.002, y=-0.02, z=-0.02 + 0.002 * k))
        assert len(room.world.colliding_surfaces()) == 0
        assert room.poses[1].translation[2] == pytest.approx(-0.02 + 0.002 * k, abs=1e-4)
        assert np.hypot(*room.poses[1].translation[:2]) < 3e-4
    room.move(at(y=0.05))
    assert room.poses[1].translation == pytest.approx([0.0, 0.05, 0.0], abs=1e-9)
