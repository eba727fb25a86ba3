"""Impacts make no energy, whatever restitution and friction; and are Newton's where that makes none either."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from physics_meshes import at, box_mesh, room

from constraints.geometry.surfaces import Cylinder, Plane
from constraints.kinds.concentric import Concentric
from constraints.kinds.coplanar import Coplanar
from physics import Body, Elastic, Friction, Gravity, Sleeping, World
from physics.contact.impact_energy import gained, share
from physics.stepping import step as stepping
from tests.physics.scenes import end_of_rod, rod_after_blow

SHAPES = {"cube": (0.1, 0.1, 0.1), "sheet": (0.08, 0.05, 0.001), "rod": (0.3, 0.01, 0.01), "slab": (0.1, 0.06, 0.02)}


def random_turn(rng):
    q = rng.normal(size=4)
    return pin.Quaternion(q / np.linalg.norm(q)).toRotationMatrix()


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    e=st.floats(0.0, 1.0), mu=st.floats(0.0, 2.0),
    names=st.lists(st.sampled_from(sorted(SHAPES)), min_size=1, max_size=3),
    seed=st.integers(0, 2**32 - 1), corner=st.booleans(),
)  # fmt: skip
def test_kinetic_energy_never_rises_without_forces(e, mu, names, seed, corner):
    """Parts thrown at a floor (and a wall), and at one another, where nothing but impacts acts."""
    rng = np.random.default_rng(seed)
    manager, _ = room()
    if corner:
        manager.add(box_mesh(0.2, 4.0, 4.0), at(x=-0.3), movable=False)
    world = World(manager)
    ids = []
    for k, name in enumerate(names):
        mesh = box_mesh(*SHAPES[name])
        i = manager.add(mesh, pin.SE3(random_turn(rng), np.array([0.0, 0.0, 0.2 + 0.35 * k])))
        velocity = [*rng.normal(size=2), -rng.uniform(1.0, 5.0) * (1 + k), *(10.0 * rng.normal(size=3))]
        density = 10.0 ** rng.uniform(2, 4)
        world.add(i, Body.from_mesh(mesh, density), [Friction(mu), Elastic(e), Sleeping(False)], velocity=velocity)
        ids.append(i)
    first = last = sum(map(world.energy, ids))
    for _ in range(25):
        world.step(0.01)
        now = sum(map(world.energy, ids))
        assert now - last <= 1e-9 * first
        last = now


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1))
def test_the_greatest_share_that_makes_no_energy(seed):
    """Against bisection of the gain, on random inverse masses at the contacts, in three groups."""
    rng = np.random.default_rng(seed)
    size = rng.integers(1, 5, 3)
    group = np.repeat(np.arange(3), size)
    before = rng.normal(size=(len(group), 3))
    least, law = np.empty_like(before), np.empty_like(before)
    least_after, after = np.empty_like(before), np.empty_like(before)
    for k in range(3):
        mine = group == k
        root = rng.normal(size=(3 * size[k],) * 2)
        mobility = root @ root.T + 0.1 * np.eye(3 * size[k])
        start = before[mine].ravel()
        stuck = np.linalg.solve(mobility, -start)  # ends at rest: loses energy
        push = stuck * 1.2 + 0.5 * rng.normal(size=3 * size[k])
        least[mine], law[mine] = stuck.reshape(-1, 3), push.reshape(-1, 3)
        least_after[mine] = 0.0
        after[mine] = (start + mobility @ push).reshape(-1, 3)

    def gain(k, sigma):
        mine = group == k
        impulse = least[mine] + sigma * (law[mine] - least[mine])
        return 0.5 * (impulse * (least_after[mine] + sigma * (after - least_after)[mine] + before[mine])).sum()

    wrong = gained(law, before, after, group, 3)
    sigma = share(law, least, before, after, least_after, group, 3)
    for k in range(3):
        assert wrong[k] == (gain(k, 1.0) > 0.0)
        if not wrong[k]:
            assert sigma[k] == 1.0
            continue
        low, high = 0.0, 1.0
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if gain(k, middle) > 0.0 else (middle, high)
        assert sigma[k] == pytest.approx(low, abs=1e-9)


def most_of_a_rod(angle, slide):
    """m/s, closed form: the greatest speed at which an end that sticks can part, when no energy is lost.

    λ · (s⁺ + s⁻) = 0 with s⁺ - s⁻ = W λ is s⁺ · W⁻¹ s⁺ = s⁻ · W⁻¹ s⁻ (W: inverse mass at the end, in the plane).
    """
    w = np.linalg.inv(end_of_rod(angle)[0])
    start = np.array([slide, -1.0])
    return np.sqrt(start @ w @ start / w[1, 1])


@pytest.mark.parametrize(("e", "mu"), [(0.9, 0.3), (0.9, 1.0), (1.0, 0.6)])
def test_a_rod_whose_end_reverses_keeps_its_energy(e, mu):
    """Newton's law makes energy here (4.9 % for e = 0.9, 17 % for e = 1)."""
    angle, slide = np.pi / 3, -0.5
    _, energy, end = rod_after_blow(Elastic(e), mu, angle, slide)
    assert energy == pytest.approx(1.0, rel=1e-9)
    bound = most_of_a_rod(angle, slide)
    assert bound < e
    assert end == pytest.approx(bound, abs=1e-3)  # the rod turns on a little before the step ends


@pytest.mark.parametrize(("e", "mu", "slide"), [(0.5, 0.3, -0.5), (0.7, 1.0, 2.0), (0.9, 0.0, -0.5), (1.0, 0.0, 0.5)])
def test_newtons_law_stands_where_it_makes_no_energy(e, mu, slide):
    _, energy, end = rod_after_blow(Elastic(e), mu, np.pi / 3, slide)
    assert end == pytest.approx(e, abs=2e-3)
    if mu == 0.0 and e == 1.0:
        assert energy == pytest.approx(1.0, rel=1e-13)
    else:
        assert energy < 1.0


@pytest.mark.parametrize("mu", [0.0, 0.2, 0.5, 1.0])
@pytest.mark.parametrize("e", [0.5, 0.8, 1.0])
def test_a_double_pendulum_that_strikes_a_floor_makes_no_energy(e, mu):
    """Kane & Levinson's example: two hinged rods, the lower one's end strikes the floor."""
    manager, _ = room()
    post = manager.add(box_mesh(0.02, 0.02, 0.02), at(y=0.5, z=0.9), movable=False)
    length = 0.5
    mesh = box_mesh(0.01, 0.01, length)
    axis = np.array([0.0, 1.0, 0.0])
    world = World(manager)
    place, carried, ids = np.array([0.0, 0.0, 0.9]), np.zeros(3), []
    for angle, rate in ((-0.35, 1.5), (-0.7, 3.0)):
        turn = pin.exp3(angle * axis)
        low = place + turn @ [0.0, 0.0, -length]
        i = manager.add(mesh, pin.SE3(turn, 0.5 * (place + low)))
        speed = np.cross(rate * axis, 0.5 * (low - place)) + carried
        world.add(i, Body.from_mesh(mesh, 1000.0), [Friction(mu), Elastic(e), Sleeping(False)],
                  velocity=[*speed, *(rate * axis)])  # fmt: skip
        carried = carried + np.cross(rate * axis, low - place)
        place = low
        ids.append(i)
    joints = []
    for a, b in ((post, ids[0]), (ids[0], ids[1])):
        on_b = np.array([0.0, 0.0, 0.5 * length])
        on_a = world.pose(a).actInv(world.pose(b).act(on_b))
        joints += [
            Concentric((a, b), (Cylinder(on_a, axis, 0.002), Cylinder(on_b, axis, 0.002))),
            Coplanar((a, b), (Plane(on_a, axis), Plane(on_b, axis))),
        ]
        manager.ignore(a, b)
    world.set_joints(joints)
    first = last = sum(map(world.energy, ids))
    struck = False
    for _ in range(100):
        rate = world.velocity(ids[1])[4]
        world.step(0.002)
        now = sum(map(world.energy, ids))
        assert now - last <= 1e-7 * first
        struck |= abs(world.velocity(ids[1])[4] - rate) > 1.0
        last = now
    assert struck


@pytest.mark.parametrize("law", ["newton", "poisson"])
def test_what_lies_does_not_rebound_from_its_weight(monkeypatch, law):
    """In steps of one piece too: a box that has 1 µm to fall comes at 4 mm/s, not with what gravity gives in a step."""
    monkeypatch.setattr(stepping, "IMPACTS", 0)
    manager, _ = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    box = manager.add(mesh, at(z=0.05 + 1e-6))
    world = World(manager)
    world.add(box, Body.from_mesh(mesh, 1000.0), [Gravity(), Elastic(0.8, law), Sleeping(False)])
    for _ in range(10):
        world.step(0.01)
        assert world.energy(box) < 1.1 * 9.81 * 1e-6 * 1.0
        assert -1e-9 < world.pose(box).translation[2] - 0.05 < 2e-6 + 0.01 * 0.0045
