"""Behaviours against closed forms, a user's own, and what strangers do with them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from physics_meshes import at, ball_mesh, box_mesh, room

from collision import CollisionManager
from constraints.geometry.surfaces import Cylinder, Plane
from constraints.kinds.concentric import Concentric
from constraints.kinds.coplanar import Coplanar
from physics import (
    Behaviour,
    BehaviourError,
    Body,
    BodyError,
    Buoyancy,
    Drag,
    Elastic,
    Friction,
    Gravity,
    Magnet,
    Motor,
    PhysicsError,
    Reaction,
    ScriptedPath,
    Sleeping,
    Solidity,
    Spring,
    Wind,
    World,
    WorldError,
    force,
)
from physics.forces.behaviours import STANDARD_GRAVITY as G

Z = np.array([0.0, 0.0, 1.0])


def ball(*behaviours, mass=0.1, velocity=(0.0,) * 6, pose=None):
    """A ball of 2 cm in empty space."""
    manager = CollisionManager()
    i = manager.add(ball_mesh(0.02, 4), at() if pose is None else pose)
    world = World(manager)
    world.add(i, Body.sphere(0.02, mass), behaviours, velocity=velocity)
    return world, i


def run(world, seconds, dt=0.01):
    for _ in range(round(seconds / dt)):
        world.step(dt)


def test_drag_tends_to_terminal_speed():
    """v = v∞ tanh(g t / v∞)."""
    area = 0.05
    world, i = ball(Gravity(), Drag(area=area))
    terminal = np.sqrt(2 * 0.1 * G / (1.204 * 0.47 * area))
    run(world, 0.3)
    assert world.velocity(i)[2] == pytest.approx(-terminal * np.tanh(G * 0.3 / terminal), rel=1e-9)
    run(world, 3.2)
    assert world.velocity(i)[2] == pytest.approx(-terminal * np.tanh(G * 3.5 / terminal), rel=1e-9)


def test_linear_drag_decays_as_an_exponential():
    world, i = ball(Drag(linear=0.05), velocity=[2.0, 0, 0, 0, 0, 0])
    run(world, 1.0)
    assert world.velocity(i)[0] == pytest.approx(2.0 * np.exp(-0.5), rel=1e-9)
    assert world.pose(i).translation[0] == pytest.approx(2.0 / 0.5 * (1 - np.exp(-0.5)), rel=1e-9)


def test_wind_carries_along():
    world, i = ball(Wind([3.0, 0.0, 0.0], area=0.05), mass=0.01)
    run(world, 5.0)
    v = world.velocity(i)
    rate = 0.5 * 1.204 * 0.05 / 0.01  # u' = -rate u² of u = 3 - v
    assert v[0] == pytest.approx(3.0 - 3.0 / (1 + 3.0 * rate * 5.0), rel=1e-9)
    assert v[1:] == pytest.approx(np.zeros(5), abs=1e-15)


def test_a_spring_swings_at_its_frequency():
    world, i = ball(Spring([0, 0, 0], stiffness=10.0), pose=at(x=0.1))
    run(world, 2.0)
    assert world.pose(i).translation[0] == pytest.approx(0.1 * np.cos(2.0 * np.sqrt(10.0 / 0.1)), abs=1e-9)


def test_a_magnet_snaps_within_its_reach_and_not_beyond():
    magnet = Magnet([0, 0, 0], strength=2.0, reach=0.1, damping=0.5)
    world, i = ball(magnet, pose=at(x=0.09))
    run(world, 6.0)
    assert world.pose(i).translation == pytest.approx(np.zeros(3), abs=1e-6)
    world, i = ball(magnet, pose=at(x=0.11))
    run(world, 1.0)
    assert world.pose(i).translation[0] == 0.11


def test_a_motor_governs_its_speed():
    world, i = ball(Motor([0, 0, 2.0], speed=5.0, limit=1.0, gain=1e-4))
    run(world, 5.0)
    assert world.velocity(i)[3:] == pytest.approx([0, 0, 5.0], rel=1e-6)


def test_a_motor_drives_a_recognised_joint():
    manager, _ = room()
    mesh = box_mesh(0.2, 0.02, 0.02)
    post, arm = manager.add(box_mesh(0.02, 0.02, 0.02), at(z=1.0)), manager.add(mesh, at(z=1.05))
    eye = np.array([0.1, 0.0, 0.0])
    hinge = [
        Concentric((post, arm), (Cylinder(np.array([0, 0, 0.05]), Z, 0.004), Cylinder(-eye, Z, 0.004))),
        Coplanar((post, arm), (Plane(np.array([0, 0, 0.05]), Z), Plane(np.zeros(3), Z))),
    ]
    manager.set_pose(arm, at(x=0.1, z=1.05))
    world = World(manager)
    world.add(arm, Body.from_mesh(mesh, 1000.0), [Gravity(), Motor.on(hinge[0], arm, 4.0, limit=1.0, gain=1e-2)])
    world.set_joints(hinge)
    run(world, 2.0)
    assert world.velocity(arm)[5] == pytest.approx(4.0, rel=1e-6)
    assert world.pose(arm).act(-eye) == pytest.approx([0.0, 0.0, 1.05], abs=1e-12)
    with pytest.raises(BehaviourError, match="is not on"):
        Motor.on(hinge[0], 17, 4.0, limit=1.0, gain=1e-2)
    with pytest.raises(BehaviourError, match="no axis"):
        Motor.on(hinge[1], arm, 4.0, limit=1.0, gain=1e-2)


def test_a_scripted_path_is_followed_to_the_bit_of_its_poses():
    path = [(0.0, at()), (0.5, at(x=0.2, turn=(0, 0, 1.0))), (1.0, at(x=0.2, z=0.3))]
    world, i = ball(ScriptedPath(path))
    run(world, 0.5)
    assert world.pose(i).isApprox(path[1][1], 1e-12)
    run(world, 0.7)
    assert world.pose(i).isApprox(path[2][1], 1e-12)
    assert world.velocity(i) == pytest.approx(np.zeros(6), abs=1e-12)
    with pytest.raises(BehaviourError, match="rising"):
        ScriptedPath([(1.0, at()), (0.5, at())])


class Draught(Behaviour):
    def wrench(self, view):
        return force([0.005 * np.sin(np.pi * view.time), 0.0, 0.0])


def test_a_users_behaviour_in_a_few_lines():
    world, i = ball(Draught())
    run(world, 2.0)
    assert world.velocity(i)[0] == pytest.approx(0.0, abs=1e-12)
    assert world.pose(i).translation[0] == pytest.approx(0.05 * 2.0 / np.pi, rel=1e-9)


class Strange(Behaviour):
    """CheckedBehaviours one of the three questions as it is told to, from a time on."""

    def __init__(self, after=0.025, wrench=None, reaction=None, pose=None):
        self.after, self.told = after, (wrench, reaction, pose)

    def wrench(self, view):
        return self.told[0]() if self.told[0] and view.time >= self.after else None

    def reaction(self, reaction):
        return self.told[1]() if self.told[1] else reaction

    def pose(self, time):
        return self.told[2]() if self.told[2] and time >= self.after else None


def scaled(factor):
    pose = at()
    pose.rotation = np.diag(factor) * 1.0
    return pose


STRANGE = {
    "raises": {"wrench": lambda: 1 / 0},
    "huge": {"wrench": lambda: [1e300] * 6},
    "object": {"wrench": object},
    "complex": {"wrench": lambda: [1j] * 6},
    "pose raises": {"pose": lambda: 1 / 0},
    "scaled": {"pose": lambda: scaled([2.0, 2.0, 2.0])},
    "mirrored": {"pose": lambda: scaled([1.0, 1.0, -1.0])},
    "nan pose": {"pose": lambda: at(x=np.nan)},
    "no pose": {"pose": lambda: "there"},
}


@pytest.mark.parametrize("how", STRANGE)
def test_what_a_users_behaviour_does_wrong_is_named_and_moves_nothing(how):
    """Neither its own object nor others, to the bit; without it all go on."""
    manager, _ = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    world = World(manager)
    ids = [manager.add(mesh, at(x=0.3 * k, z=0.05 + 0.1 * k, turn=(0.2 * k, 0, 0))) for k in range(3)]
    body = Body.from_mesh(mesh, 1000.0, "valve")
    for i in ids[:2]:
        world.add(i, body, [Gravity(), Elastic(0.3)])
    world.add(ids[2], body, [Gravity(), Strange(**STRANGE[how])], velocity=[0.1, 0, 0, 1, 2, 3])
    world.hold(ids[0], at(z=0.06))
    run(world, 0.02)
    before = world.save()
    with pytest.raises(PhysicsError, match="valve") as caught:
        run(world, 0.05)
    assert caught.value.object_id == ids[2] and "\n" not in str(caught.value)
    after = world.save()
    assert after["time"] >= before["time"]
    for name in ("center", "attitude", "velocity", "rate", "steady"):
        if after["time"] == before["time"]:
            assert np.array_equal(after[name], before[name]), name
    assert all(manager.pose(i) == world.pose(i) for i in ids)
    now = world.save()
    with pytest.raises(PhysicsError):
        world.step(0.01)
    again = world.save()
    assert all(np.array_equal(again[name], now[name]) for name in ("center", "attitude", "velocity", "rate", "steady"))
    world.add(ids[2], body, [Gravity()])
    run(world, 0.05)
    assert world.time > now["time"] and np.isfinite(world.pose(ids[2]).homogeneous).all()


@pytest.mark.parametrize(
    "reaction",
    [lambda: 1 / 0, lambda: None, lambda: Reaction(restitution=1.2), lambda: Reaction(restitution="a"),
     lambda: Reaction(restitution=np.nan), lambda: Reaction(friction="a"), lambda: Reaction(friction=np.inf)],
)  # fmt: skip
def test_a_strange_reaction_is_refused_and_leaves_the_object_as_it_was(reaction):
    world, i = ball(Gravity())
    with pytest.raises(BehaviourError, match=f"object {i} .*Strange"):
        world.add(i, Body.sphere(0.02, 5.0), [Strange(reaction=reaction)], velocity=[1.0] * 6)
    with pytest.raises(BehaviourError, match=f"object {i} .*Constant"):
        world.add(i, Body.sphere(0.02, 5.0), [Constant()], velocity=[1.0] * 6)
    world.step(0.01)
    assert world.velocity(i) == pytest.approx([0, 0, -0.01 * G, 0, 0, 0], abs=1e-15)


class Constant(Behaviour):
    constant = True

    def wrench(self, view):
        return [np.nan] * 6


@pytest.mark.parametrize("wrong", [lambda: Friction("a"), lambda: Gravity("down"), lambda: Gravity([[1, 2, 3]]),
                                   lambda: ScriptedPath([(0.0, "here")]), lambda: ScriptedPath([(np.nan, at())]),
                                   lambda: Motor([0, 0, 0], 1.0, 1.0, 1.0), lambda: Elastic(None)])  # fmt: skip
def test_parameters_that_are_no_numbers(wrong):
    with pytest.raises(BehaviourError):
        wrong()


class Lift(Behaviour):
    """Carries up for half a second, then lets go."""

    def pose(self, time):
        return at(z=2.0 * time) if time < 0.505 else None


def test_a_path_that_ends_leaves_the_object_free_with_its_speed():
    world, i = ball(Gravity(), Lift())
    run(world, 0.5)
    assert world.pose(i).translation[2] == pytest.approx(1.0, abs=1e-12)
    run(world, 0.3)
    assert world.pose(i).translation[2] == pytest.approx(1.0 + 2.0 * 0.3 - 0.5 * G * 0.09, abs=1e-12)


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


@pytest.mark.parametrize("dt", [0.0, -0.01, np.nan, np.inf])
def test_bad_time_steps(dt):
    world, i = ball(Gravity())
    with pytest.raises(WorldError, match="dt"):
        world.step(dt)
    assert world.time == 0.0 and not world.pose(i).translation.any()


def test_bad_bodies_and_laws_before_anything_moves():
    world, i = ball(Gravity())
    with pytest.raises(BodyError, match="mass"):
        world.add(i, Body.sphere(0.02, 0.0))
    with pytest.raises(BehaviourError, match="restitution"):
        world.add(i, Body.sphere(0.02, 1.0), [Elastic(1.2)])
    with pytest.raises(BehaviourError, match="no Behaviour"):
        world.add(i, Body.sphere(0.02, 1.0), [Gravity])
    world.step(0.01)
    assert world.velocity(i)[2] == pytest.approx(-0.01 * G)


def test_behaviours_are_swapped_while_it_runs():
    manager, _ = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    box = manager.add(mesh, at(z=0.05))
    world = World(manager)
    body = Body.from_mesh(mesh, 1000.0)
    world.add(box, body, [Gravity(), Friction(0.5)])
    run(world, 0.7)
    assert world.awake == ()
    world.add(box, body, [Gravity(), Friction(0.5), Solidity(False)])
    run(world, 0.2)
    assert world.pose(box).translation[2] == pytest.approx(0.05 - 0.5 * G * 0.04, abs=1e-9)
    world.add(box, body, [Gravity([0, 0, 0]), Sleeping(False)], velocity=[0, 0, 1.0, 0, 0, 0])
    run(world, 0.1)
    assert np.isfinite(world.pose(box).homogeneous).all()


def test_a_support_that_is_removed_lets_fall_what_slept_on_it():
    manager, _ = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    world = World(manager)
    ids = [manager.add(mesh, at(z=0.05 + 0.1 * k)) for k in range(2)]
    for i in ids:
        world.add(i, Body.from_mesh(mesh, 1000.0), [Gravity(), Friction(0.5)])
    run(world, 0.7)
    assert world.awake == ()
    world.remove(ids[0])
    manager.remove(ids[0])
    run(world, 1.0)
    assert world.pose(ids[1]).translation == pytest.approx([0, 0, 0.05], abs=1e-9)


def test_many_that_start_in_one_another_part_without_an_explosion():
    """A pyramid, each 5 mm deep in the one below: no faster than a fall through all that overlap."""
    manager, _ = room()
    world = World(manager)
    sides = [0.16, 0.12, 0.08]
    ids, expected = [], []
    for k, side in enumerate(sides):
        expected.append(sum(sides[:k]) + side / 2)
        ids.append(manager.add(box_mesh(side, side, side), at(z=expected[-1] - 0.005 * k)))
        world.add(ids[-1], Body.box([side] * 3, 1.0), [Gravity(), Friction(0.5)])
    for _ in range(60):
        world.step(0.01)
        assert max(np.abs(world.velocity(i)[:3]).max() for i in ids) < np.sqrt(2 * G * 0.015)
    assert [world.pose(i).translation[2] for i in ids] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("side", [0.06, 0.1, 0.14])
@pytest.mark.parametrize("sunk", [1e-4, 5e-3, 0.017])
def test_boxes_that_start_flush_in_one_another_are_lifted_apart(side, sunk):
    """The sunk corners lie on the lower box's sides, or nearer to them than to its top: they came through the top."""
    manager, _ = room()
    world = World(manager)
    ids = []
    for size, x, z in ((0.1, 0.0, 0.05), (side, 0.5 * (0.1 - side), 0.1 + 0.5 * side - sunk)):
        ids.append(manager.add(box_mesh(size, size, size), at(x=x, z=z)))
        world.add(ids[-1], Body.box([size] * 3, 1.0), [Gravity(), Friction(0.5)])
    for _ in range(40):
        world.step(0.01)
        assert max(np.abs(world.velocity(i)).max() for i in ids) < G * 0.01  # no faster than a fall of one step
    assert [world.pose(i).translation[2] for i in ids] == pytest.approx([0.05, 0.1 + 0.5 * side], abs=1e-9)


@pytest.mark.parametrize("what", ["tumbling", "sleeping", "hand"])
def test_restored_states_have_the_same_future(what):
    from physics import SpringHand

    manager, _ = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    world = World(manager)
    ids = [manager.add(mesh, at(x=0.01 * k, z=0.06 + 0.12 * k)) for k in range(3)]
    spin = [0.3, 0, 0, 2.0, 3.0, 1.0] if what == "tumbling" else [0.0] * 6
    for i in ids:
        world.add(i, Body.from_mesh(mesh, 1000.0), [Gravity(), Friction(0.4), Elastic(0.3)], velocity=spin)
    run(world, 1.5 if what == "sleeping" else 0.3)
    if what == "hand":
        world.hold(ids[2], SpringHand(at(x=0.3, z=0.4)))
        run(world, 0.1)
    if what == "sleeping":
        assert world.awake == ()
    saved = world.save()
    futures = []
    for _ in range(2):
        world.load(saved)
        world.set_velocity(ids[0], [0.5, 0, 0, 0, 0, 0])
        future = []
        for _ in range(25):
            world.step(0.01)
            future += [world.pose(i).homogeneous.tobytes() + world.velocity(i).tobytes() for i in ids]
        futures.append(future)
    assert futures[0] == futures[1]
    assert isinstance(world.pose(ids[0]), pin.SE3)
