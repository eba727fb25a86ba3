"""Surfaces that a constraint in force keeps out of collision."""

from constraints.recognition.mated import adjacent_surfaces
from tests.constraints.motion.room import bored
from tests.constraints.shapes import at, box, flanged_shaft, shaft


def test_removing_a_constraint_in_the_middle_of_a_motion_makes_its_surfaces_solid_again():
    room = bored(clearance=1e-4)
    (id,) = room.manager.accepted
    room.move(at(z=0.025))
    assert room.world.ignored_surfaces(0, 1)
    room.manager.remove(id)
    room.manager.rules.clear()
    room.move(at(x=0.05, z=0.025))
    assert not room.world.ignored_surfaces(0, 1)
    assert abs(room.poses[1].translation[0]) < 3e-4  # the bore holds it
    assert len(room.world.colliding_surfaces()) == 0


def test_adjacent_surfaces_of_a_turned_part():
    mesh = flanged_shaft().mesh
    assert adjacent_surfaces(mesh, [1]) == (0, 2)
    assert adjacent_surfaces(mesh, [0, 1]) == (2,)
    assert adjacent_surfaces(box(1, 1, 1).mesh, [0]) == (2, 3, 4, 5)
    assert adjacent_surfaces(shaft().mesh, [0, 1, 2]) == ()
