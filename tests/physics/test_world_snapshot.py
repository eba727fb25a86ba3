"""Marks and rollback: what fails in the middle of a step, or is undone, leaves the same future as if it never was."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from physics_meshes import at, ball_mesh, box_mesh, room

from constraints.geometry.surfaces import Cylinder, Plane, Sphere
from constraints.kinds.concentric import Concentric
from constraints.kinds.coplanar import Coplanar
from physics import Behaviour, BehaviourError, Body, Elastic, Friction, Gravity, ScriptedPath, SpringHand, World, force


class FailsOnce(Behaviour):
    """A weak force; raises at the n-th time that it is asked from `arm` on."""

    def __init__(self):
        self.left = -1

    def arm(self, n):
        self.left = n

    def wrench(self, view):
        self.left -= 1
        if self.left == 0:
            raise RuntimeError("the battery is empty")
        return force([0.01 * np.sin(view.time), 0.0, 0.0])


def scene(seed):
    """A floor; loose boxes and balls, one on a hinge, one on a path, one held by a pose and one by a spring."""
    rng = np.random.default_rng(seed)
    manager, _ = room()
    box, ball, arm = box_mesh(0.1, 0.1, 0.1), ball_mesh(0.05, 4), box_mesh(0.02, 0.02, 0.02)
    hub = manager.add(box_mesh(0.01, 0.01, 0.01), at(x=1.3, z=1.0), movable=False)
    world = World(manager)
    fails = FailsOnce()
    loose = []
    for k in range(5):
        turn = pin.SE3(pin.exp3(rng.normal(size=3)), np.array([*rng.uniform(-0.1, 0.1, 2), 0.15 + 0.15 * k]))
        i = manager.add(box if k % 2 else ball, turn)
        known = {} if k % 2 else {0: Sphere(np.zeros(3), 0.05)}
        body = Body.from_mesh(box, 1000.0) if k % 2 else Body.sphere(0.05, 0.5)
        world.add(i, body, [Gravity(), Friction(0.4), Elastic(0.3), *([fails] if k == 3 else [])], known)
        world.set_velocity(i, rng.normal(size=6))
        loose.append(i)
    hinged, led, held, sprung = (manager.add(arm, at(x=x, z=1.0)) for x in (1.0, -1.0, 0.6, -0.6))
    body = Body.from_mesh(arm, 7850.0)
    world.add(hinged, body, [Gravity()])
    axis = np.array([0.0, 1.0, 0.0])
    world.set_joints(
        [
            Concentric(
                (hub, hinged), (Cylinder(np.zeros(3), axis, 0.002), Cylinder(np.array([0.3, 0, 0]), axis, 0.002))
            ),
            Coplanar((hub, hinged), (Plane(np.zeros(3), axis), Plane(np.array([0.3, 0, 0]), axis))),
        ]
    )
    world.add(led, body, [ScriptedPath([(0.0, at(x=-1.0, z=1.0)), (0.3, at(x=-1.0, z=0.8))])])
    world.add(held, body, [Gravity()])
    world.add(sprung, body, [Gravity()])
    world.hold(held, at(x=0.61, z=1.0))
    world.hold(sprung, SpringHand(at(x=-0.6, z=1.05)))
    return world, fails, loose, held


def bits(world):
    """All of the state of a world and of its objects' poses in the collision manager, as bytes."""

    def flat(value):
        if isinstance(value, np.ndarray):
            return value.tobytes()
        if isinstance(value, dict):
            return b"".join(flat(v) for _, v in sorted(value.items()))
        if isinstance(value, tuple | list):
            return b"".join(map(flat, value))
        if isinstance(value, pin.SE3):
            return value.homogeneous.tobytes()
        if isinstance(value, SpringHand):
            return flat(value.target)
        return repr(value).encode()

    poses = [world.collision.pose(i).homogeneous.tobytes() for i in world.collision.objects]
    return flat(world.save()) + b"".join(poses)


@pytest.mark.parametrize("seed", range(3))
def test_a_step_that_raises_in_the_middle_never_was(seed):
    world, fails, *_ = scene(seed)
    twin = scene(seed)[0]
    rng = np.random.default_rng(seed)
    raised = 0
    for _ in range(40):
        fails.arm(int(rng.integers(1, 12)))
        before = bits(world)
        try:
            world.step(0.01)
        except BehaviourError:
            raised += 1
            assert bits(world) == before
            fails.arm(-1)
            world.step(0.01)
        twin.step(0.01)
        assert bits(world) == bits(twin)
    assert raised > 5


def test_an_interrupt_anywhere_leaves_the_world_as_it_was(monkeypatch):
    world, *_ = scene(1)
    twin = scene(1)[0]
    for _ in range(30):
        world.step(0.01)
        twin.step(0.01)
    before = bits(world)
    stages = [
        (world._kinematic_bodies, "begin"), (world._kinematic_bodies, "end"), (world._neighbours, "renew"),
        (world._stepper, "advance"), (world._contact_set, "kick"), (world._contact_set, "solve"),
        (world.collision, "set_poses"), (world, "_check"),
    ]  # fmt: skip
    for owner, name in stages:
        real = getattr(owner, name)

        def interrupted(*args, real=real, **named):
            real(*args, **named)
            raise KeyboardInterrupt

        world._neighbours.stale = twin._neighbours.stale = name == "renew"
        world._motion = None
        before = bits(world)
        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            patch.setattr(owner, name, interrupted, raising=True)
            if name == "set_poses":  # undoing takes it too
                patch.setattr(owner, name, lambda *a, r=real, c=[]: (r(*a), c.append(1), len(c) == 1 and _interrupt()))
            world.step(0.01)
        assert bits(world) == before, name
        world.step(0.01)
        twin.step(0.01)
        assert bits(world) == bits(twin), name


def _interrupt():
    raise KeyboardInterrupt


OPERATIONS = ("step", "pose", "velocity", "hold", "spring", "let go", "wake", "add", "remove", "joints", "static")


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 2), before=st.integers(0, 12), does=st.lists(st.sampled_from(OPERATIONS), max_size=8))
def test_whatever_is_done_is_undone(seed, before, does):
    world, _, loose, held = scene(seed)
    newcomer = world.collision.add(box_mesh(0.03, 0.03, 0.03), at(x=0.3, z=0.4))
    for _ in range(before):
        world.step(0.02)
    saved, poses = bits(world), {i: world.collision.pose(i).homogeneous for i in world.collision.objects}
    mark = world.snapshot
    for _ in range(2):  # a mark is good more than once
        grip = True
        for what in does:
            if what == "step":
                world.step(0.02)
            elif what == "pose":
                world.set_pose(loose[0], at(x=0.5, z=0.3))
            elif what == "velocity":
                world.set_velocity(loose[1], np.ones(6))
            elif what == "hold":
                world.hold(held, at(x=0.6, z=1.1))
                grip = True
            elif what == "spring":
                world.hold(loose[2], SpringHand(at(z=0.5)))
            elif what == "let go" and grip:
                world.let_go(held)
                grip = False
            elif what == "wake":
                world.wake(loose[4])
            elif what == "add":
                world.add(newcomer, Body.box([0.03] * 3, 0.1), [Gravity()])
            elif what == "remove" and loose[3] in world.poses:
                world.remove(loose[3])
            elif what == "joints":
                world.set_joints([])
            elif what == "static":
                world.set_pose(0, at(z=-0.3))
        world.snapshot = mark
        assert bits(world) == saved
        assert all((world.collision.pose(i).homogeneous == pose).all() for i, pose in poses.items())
    world.step(0.02)


def test_a_mark_of_a_world_at_rest_costs_nothing():
    manager, _ = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    world = World(manager)
    for k in range(3):
        world.add(manager.add(mesh, at(x=k, z=0.05)), Body.from_mesh(mesh, 1000.0), [Gravity(), Friction(0.5)])
    for _ in range(80):
        world.step(0.01)
    assert world.awake == ()
    first = world.snapshot
    world.step(0.01)
    second = world.snapshot
    assert second.motion is first.motion and second.model is first.model and second.time > first.time
