"""Sums of wrenches, and what contacts carry."""

import numpy as np
import pytest
from physics_meshes import at, box_mesh, room

from physics import (
    Behaviour,
    BehaviourError,
    Body,
    Buoyancy,
    Drag,
    Elastic,
    Friction,
    Gravity,
    Magnet,
    Motor,
    Sleeping,
    Solidity,
    Spring,
    Wind,
    World,
    force,
)
from physics.forces.behaviours import STANDARD_GRAVITY as G
from tests.physics.scenes import Draught, ball, dropped_box, run


def test_all_behaviours_of_one_object_add_up():
    """One step of all that exert something: the sum of what each does alone."""
    several = [
        Gravity(), Buoyancy(2.0), Drag(area=0.01, linear=0.1, angular=1e-6), Wind([2.0, 0, 0], area=0.01),
        Spring([0.1, 0, 0], 5.0, 0.1, 0.05, [0.01, 0, 0]), Magnet([0, 0.05, 0], 2.0, 0.2), Draught(),
        Motor([0, 0, 1], 5.0, 1.0, 1e-5), Friction(0.3), Elastic(0.5), Solidity(True), Sleeping(False),
    ]  # fmt: skip
    start, h = np.array([0.3, -0.2, 0.1, 1.0, 2.0, 3.0]), 1e-7
    gains = []
    for behaviours in (several, *([b] for b in several)):
        world, i = ball(*behaviours, velocity=start)
        world.step(h)
        gains.append((world.velocity(i) - start) / h)
    assert gains[0] == pytest.approx(np.sum(gains[1:], axis=0), rel=1e-4, abs=1e-4)
    assert np.abs(gains[0]).min() > 1e-3


class Scale(Behaviour):
    """Reads off its contacts what presses on the object, N."""

    def __init__(self, dt):
        self.dt, self.read, self.others = dt, np.zeros(3), set()

    def wrench(self, view):
        self.read = sum((touch.impulse for touch in view.touches), np.zeros(3)) / self.dt
        self.others = {touch.other for touch in view.touches}


def test_a_behaviour_sees_contacts_and_what_they_carry():
    manager, floor = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    world = World(manager)
    ids = [manager.add(mesh, at(z=0.05 + 0.1 * k)) for k in range(2)]
    scales = [Scale(0.01), Scale(0.01)]
    for i, scale in zip(ids, scales, strict=True):
        world.add(i, Body.from_mesh(mesh, 1000.0), [Gravity(), scale, Sleeping(False)])
    run(world, 0.1)
    assert scales[1].read == pytest.approx([0, 0, G], abs=1e-9) and scales[1].others == {ids[0]}
    assert scales[0].read == pytest.approx([0, 0, G], abs=1e-9) and scales[0].others == {floor, ids[1]}


class Faulty(Behaviour):
    def __init__(self, value, after=0.0):
        self.value, self.after = value, after

    def wrench(self, view):
        return self.value if view.time >= self.after else force([0, 0, 0])


@pytest.mark.parametrize("value", [[0, 0, np.nan, 0, 0, 0], [1, 2, 3], "up", [np.inf] * 6])
def test_a_bad_wrench_is_named_before_anything_moves(value):
    world, box = dropped_box(0.5, [Faulty(value, 0.055)])
    for _ in range(5):
        world.step(0.01)
    before = world.pose(box)
    with pytest.raises(BehaviourError, match="Faulty") as caught:
        world.step(0.01)
        world.step(0.01)
    assert caught.value.object_id == box and caught.value.behaviour == "Faulty"
    assert world.pose(box) == before


def test_contact_wrenches_carry_the_stack_above_them():
    manager, floor = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    boxes = [manager.add(mesh, at(x=0.2, z=0.05 + 0.1 * k)) for k in range(3)]
    world = World(manager, gravity=(0.0, 0.0, -G))
    for box in boxes:
        world.add(box, Body.from_mesh(mesh, 1000.0), [Sleeping(False)])
    for _ in range(20):
        world.step(0.01)
    pairs, wrenches = world.contact_wrenches()
    assert pairs.tolist() == [[floor, boxes[0]], [boxes[0], boxes[1]], [boxes[1], boxes[2]]]
    assert wrenches[:, 2] == pytest.approx([-3 * G, -2 * G, -G], rel=1e-9)
    assert wrenches[:, 4] == pytest.approx([0.2 * 3 * G, 0.2 * 2 * G, 0.2 * G], rel=1e-9)  # about the world's origin
    touched = sum((np.cross(t.point, t.impulse) for t in world.touches(boxes[0])), np.zeros(3)) / 0.01
    assert touched == pytest.approx(wrenches[1, 3:] - wrenches[0, 3:], abs=1e-9)
