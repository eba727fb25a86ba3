"""Walls: facing planes, round walls in facets, the distance kept."""

import numpy as np
import pinocchio as pin
import pytest

from collision import CollisionManager, Tolerance
from constraints import Motion
from tests.constraints.motion.room import Room, bored
from tests.constraints.shapes import at, box


@pytest.mark.parametrize("clearance", [2e-5, 1e-4, 0.0])
def test_a_shaft_turns_and_slides_freely_in_its_bore_whatever_the_facets(clearance):
    room = bored(clearance)
    assert [c.kind for c in room.manager.constraints] == ["concentric"]
    for k in range(1, 40):
        z, turn = 0.03 + 0.02 * np.sin(0.3 * k), 0.2 * k
        result = room.move(at(x=0.01 * np.sin(k), z=z, rpy=(0.02 * np.cos(k), 0.0, turn)))
        pose = room.poses[1]
        assert result.residual < 1e-9 and not result.blocked
        assert pose.translation[2] == pytest.approx(z, abs=1e-3)
        assert abs(pin.log3(pose.rotation.T @ pin.rpy.rpyToMatrix(0, 0, turn))[2]) < 0.02


def test_tolerance_sets_the_distance_kept():
    room = Room([box(1.0, 1.0, 0.02), box(0.04, 0.04, 0.04)], [at(), at(z=0.05)])
    room.world = CollisionManager(Tolerance(linear=1e-4))
    for body, pose in ((box(1.0, 1.0, 0.02), at()), (box(0.04, 0.04, 0.04), at(z=0.05))):
        room.world.add(body.mesh, pose)
    room.motion = Motion(room.world, room.manager, Tolerance(linear=1e-4))
    room.move(at(z=0.0))
    assert 4e-5 < room.poses[1].translation[2] - 0.03 < 4e-4


def test_back_faces_of_thin_plates_do_not_count_as_facing():
    room = Room([box(0.3, 0.3, 1e-3), box(0.1, 0.1, 1e-3)], [at(), at(z=0.0012)], accept=False)
    for x in np.linspace(0.0, 0.05, 6):
        room.move(at(x=x, z=0.0))
        assert room.poses[1].translation == pytest.approx([x, 0.0, 0.00102], abs=2e-6)
