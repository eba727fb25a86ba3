"""What a behaviour of a script does wrong is named with its object, and moves nothing."""

import numpy as np
import pytest
from physics_meshes import at, box_mesh, room

from physics import (
    Behaviour,
    BehaviourError,
    Body,
    Elastic,
    Friction,
    Gravity,
    Motor,
    PhysicsError,
    Reaction,
    ScriptedPath,
    World,
)
from physics.forces.behaviours import STANDARD_GRAVITY as G
from tests.physics.scenes import ball, run


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
