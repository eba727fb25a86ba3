"""Friction in threads: a nut on its bolt as the block on an incline that it is, against closed forms."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from physics_meshes import at, box_mesh

from collision import CollisionManager
from constraints.geometry.surfaces import Cylinder, Plane
from constraints.kinds.concentric import Concentric
from constraints.kinds.coplanar import Coplanar
from constraints.kinds.screw import Screw
from physics import Behaviour, Body, Friction, Gravity, Motor, ScriptedPath, Sleeping, World
from physics.forces.behaviours import STANDARD_GRAVITY as G
from tests.physics.scenes import goes_on_alike, hinge, run

RADIUS = 0.008
Z = np.array([0.0, 0.0, 1.0])


class Turn(Behaviour):
    """A constant torque about the bolt's axis."""

    constant = True

    def __init__(self, torque: float, axis=Z) -> None:
        self.torque = torque * np.asarray(axis)

    def wrench(self, view):
        return np.concatenate([np.zeros(3), self.torque])


class Nut:
    """A square nut on a bolt of 8 mm radius that is tilted about x."""

    def __init__(self, pitch, mu, *behaviours, flank=0.0, tilt=0.0, others=True):
        manager = CollisionManager()
        base = pin.SE3(pin.exp3(np.array([tilt, 0.0, 0.0])), np.zeros(3))
        self.bolt = manager.add(box_mesh(0.01, 0.01, 0.5), base, movable=False)
        mesh = box_mesh(0.024, 0.024, 0.013)
        self.nut = manager.add(mesh, base * at(z=0.1))
        manager.ignore(self.bolt, self.nut)
        self.world = World(manager)
        self.body = Body.from_mesh(mesh, 7850.0)
        self.axis = base.rotation[:, 2]
        self.world.add(self.nut, self.body, [Gravity(), Sleeping(False), Friction(mu), *behaviours])
        features = (Cylinder(np.zeros(3), Z, RADIUS), Cylinder(np.zeros(3), Z, RADIUS))
        bodies = (self.bolt, self.nut)
        self.screw = Screw(bodies, features, pitch=pitch, flank=flank).engaged(*map(self.world.pose, bodies))
        self.joints = [Concentric(bodies, features), self.screw] if others else [self.screw]
        self.world.set_joints(self.joints)
        self.start = self.world.pose(self.nut)

    def run(self, seconds, dt=0.01):
        for _ in range(round(seconds / dt)):
            self.world.step(dt)
        return self

    @property
    def height(self):
        """m along the bolt since the start."""
        return float(self.axis @ (self.world.pose(self.nut).translation - self.start.translation))

    def acceleration(self, pitch, mu, torque=0.0, flank=0.0, tilt=0.0):
        """m/s² along the bolt while it slides the way it is pulled: (F, T), N and f of the unrolled thread, by hand."""
        h = pitch / (2 * np.pi)
        m, inertia = self.body.mass, self.body.inertia[2, 2]
        turn = np.arctan2(h, RADIUS)
        way = np.sign(torque - m * G * np.cos(tilt) * h)
        side = mu * m * G * abs(np.sin(tilt))  # what it weighs on the bolt
        for bears in (1.0, -1.0):  # the flank it lies on, until N has that sign
            a = np.array(
                [
                    [m * h, -np.cos(turn), -np.sin(turn)],
                    [inertia, RADIUS * np.sin(turn), -RADIUS * np.cos(turn)],
                    [0.0, bears * way * mu / np.cos(flank), 1.0],
                ]
            )
            alpha, load, _ = np.linalg.solve(a, [-m * G * np.cos(tilt), torque, -way * side])
            if load * bears >= 0.0:
                return h * alpha
        raise AssertionError("no flank bears")


def test_a_thread_below_the_cone_of_friction_holds_exactly(way):
    """tan λ = 0.99 μ: nothing moves in 3 s; 1.01 μ: it goes."""
    pitch = 0.15 * 2 * np.pi * RADIUS
    nut = Nut(0.99 * pitch, 0.15).run(3.0)
    assert abs(nut.height) < 3e-13
    assert np.abs(nut.world.velocity(nut.nut)).max() < 1e-12
    assert Nut(1.01 * pitch, 0.15).run(0.1).height < -1e-6


@pytest.mark.parametrize(
    "others",
    [pytest.param(True, id="with concentric"), pytest.param(False, id="screw alone", marks=pytest.mark.slow)],
)
@pytest.mark.parametrize(
    ("pitch", "mu", "flank", "tilt", "torque"),
    [
        (0.05, 0.1, 0.0, 0.0, 0.0),
        (0.05, 0.1, 0.0, 0.4, 0.0),
        (0.05, 0.1, np.pi / 6, 0.0, 0.0),
        (-0.05, 0.1, 0.0, 0.0, 0.0),
        (0.002, 0.02, 0.0, 0.0, 0.0),
        (0.002, 0.15, np.pi / 6, 0.0, 0.01),
        (0.002, 0.15, np.pi / 6, 0.0, -0.01),
        (-0.002, 0.15, np.pi / 6, 0.3, -0.01),
        (0.002, 0.15, np.pi / 6, np.pi, 0.01),
    ],
)
def test_a_thread_slides_as_the_incline_says(pitch, mu, flank, tilt, torque, others, way):
    nut = Nut(pitch, mu, flank=flank, tilt=tilt, others=others)
    if torque:
        nut.world.add(nut.nut, nut.body, [Gravity(), Sleeping(False), Friction(mu), Turn(torque, nut.axis)])
    nut.run(0.3)
    expected = 0.5 * 0.3**2 * nut.acceleration(pitch, mu, torque, flank, tilt)
    assert nut.height == pytest.approx(expected, rel=1e-11)
    residual = nut.screw.residual(nut.world.pose(nut.bolt), nut.world.pose(nut.nut))
    assert np.abs(residual).max() < 1e-12


@pytest.mark.parametrize("pitch", [0.002, -0.002])
def test_the_torque_that_raises_and_the_one_that_lowers(pitch, way):
    """W r tan(φ + λ) and W r tan(φ - λ), to 1e-9 of them: less moves nothing, more does."""
    mu, flank = 0.15, np.pi / 6
    angle, phi = np.arctan2(abs(pitch), 2 * np.pi * RADIUS), np.arctan(mu / np.cos(flank))
    hand = np.sign(pitch)
    for sense in (1.0, -1.0):
        nut = Nut(pitch, mu, flank=flank)
        torque = sense * hand * nut.body.mass * G * RADIUS * np.tan(phi + sense * angle)
        for part, moves in ((1.0 - 1e-9, False), (1.0 + 1e-9, True)):
            nut = Nut(pitch, mu, Turn(part * torque), flank=flank).run(0.2)
            speed = sense * nut.world.velocity(nut.nut)[2]
            assert speed > 1e-12 if moves else abs(nut.height) < 1e-15


def test_a_spun_nut_stops_where_its_energy_is_spent_and_stays(way):
    pitch, mu, spin = 0.002, 0.15, 20.0
    lead = pitch / (2 * np.pi)
    nut = Nut(pitch, mu)
    nut.world.set_velocity(nut.nut, [0, 0, lead * spin, 0, 0, spin])
    up = np.arctan2(lead, RADIUS)
    a = [
        [nut.body.mass * lead, -np.cos(up), -np.sin(up)],
        [nut.body.inertia[2, 2], RADIUS * np.sin(up), -RADIUS * np.cos(up)],
        [0.0, mu, 1.0],
    ]
    alpha = np.linalg.solve(a, [-nut.body.mass * G, 0.0, 0.0])[0]
    energy, stop = np.inf, -spin / alpha
    for _ in range(int(np.ceil(stop / 0.01)) + 1):
        nut.world.step(0.01)
        now = nut.world.energy(nut.nut) + nut.body.mass * G * nut.world.pose(nut.nut).translation[2]
        assert now <= energy + 1e-15
        energy = now
    height = nut.height
    exact = 0.5 * lead * spin * stop
    assert height == pytest.approx(exact, abs=1e-13 if way == "coordinates" else abs(alpha) * lead * 0.01**2)
    nut.run(1.0)
    assert nut.height == pytest.approx(height, abs=1e-15)


def test_an_m16_nut_stays_on_its_bolt_either_way_up_for_a_minute(way):
    for tilt in (0.0, np.pi):
        nut = Nut(0.002, 0.15, flank=np.pi / 6, tilt=tilt)
        nut.run(60.0, 0.1)
        assert abs(nut.height) < (1e-15 if way == "coordinates" else 1e-13)


def test_a_nut_that_holds_itself_sleeps_and_wakes_when_it_is_turned():
    nut = Nut(0.002, 0.15)
    nut.world.add(nut.nut, nut.body, [Gravity(), Friction(0.15)])
    nut.run(1.5)
    assert nut.world.awake == ()
    torque = nut.body.mass * G * RADIUS * np.tan(np.arctan(0.15) + np.arctan2(0.002, 2 * np.pi * RADIUS))
    nut.world.add(nut.nut, nut.body, [Gravity(), Friction(0.15), Turn(0.9 * torque)])
    assert nut.world.awake == (nut.nut,)
    nut.run(1.5)
    assert nut.world.awake == () and nut.height == 0.0
    nut.world.add(nut.nut, nut.body, [Gravity(), Friction(0.15), Motor(Z, speed=10.0, limit=9 * torque, gain=1e-3)])
    nut.run(1.0)
    assert nut.world.velocity(nut.nut)[5] == pytest.approx(10.0 - torque / 1e-3, rel=1e-9)
    assert nut.world.awake == (nut.nut,)


def test_a_steep_thread_with_little_friction_runs_down(way):
    """A ball screw of 20 mm lead, μ = 0.005: it is back-driven almost as without friction."""
    nut = Nut(0.02, 0.005).run(0.3)
    lead = 0.02 / (2 * np.pi)
    free = G / (1 + nut.body.inertia[2, 2] / (nut.body.mass * lead**2))
    assert 0.95 * free < -2 * nut.height / 0.3**2 < free


def test_the_same_bits_after_a_snapshot_while_a_nut_slides_and_stops(way):
    nut, fresh = (Nut(0.002, 0.05, flank=np.pi / 6, tilt=0.3) for _ in range(2))
    nut.world.set_velocity(nut.nut, [*(0.002 / (2 * np.pi) * 30.0 * nut.axis), *(30.0 * nut.axis)])
    run(nut.world, 0.05)
    assert np.abs(nut.world.velocity(nut.nut)).max() > 1.0
    goes_on_alike(nut.world, 60, fresh=fresh.world)
    assert np.abs(nut.world.velocity(nut.nut)).max() < 1e-15


def test_a_nut_stays_on_a_bolt_that_is_thrown(way):
    """In free flight its own spin loads it: 4 turns a second about an axis across the bolt, and friction that holds.

    As rows, two bodies that fly stay together to second order in the step; in joint coordinates, exactly.
    """
    manager = CollisionManager()
    bolt_mesh, nut_mesh = box_mesh(0.01, 0.01, 0.1), box_mesh(0.024, 0.024, 0.013)
    bolt, nut = manager.add(bolt_mesh, at()), manager.add(nut_mesh, at(z=0.03))
    manager.ignore(bolt, nut)
    world = World(manager)
    spin = np.array([25.0, 0.0, 0.0])
    for i, mesh in ((bolt, bolt_mesh), (nut, nut_mesh)):
        velocity = np.cross(spin, world.collision.pose(i).translation)
        world.add(i, Body.from_mesh(mesh, 7850.0), [Gravity(), Friction(0.2)], velocity=[*velocity, *spin])
    thread = (Cylinder(np.zeros(3), Z, RADIUS), Cylinder(np.zeros(3), Z, RADIUS))
    world.set_joints([Screw((bolt, nut), thread, pitch=0.002).engaged(world.pose(bolt), world.pose(nut))])
    start = world.pose(bolt).actInv(world.pose(nut))
    for _ in range(50):
        world.step(0.01)
    assert world.pose(nut).translation[2] < -1.0
    moved = start.actInv(world.pose(bolt).actInv(world.pose(nut)))
    assert np.abs(moved.translation).max() < (1e-13 if way == "coordinates" else 2e-6)
    assert np.abs(pin.log3(moved.rotation)).max() < (1e-11 if way == "coordinates" else 5e-3)


def test_a_bolt_that_a_hand_turns_takes_its_nut_along():
    """A bolt on a path turns at 5 rad/s: the nut slips until it is as fast, then rides along."""
    nut = Nut(0.002, 0.15)
    shape = box_mesh(0.01, 0.01, 0.5)
    path = ScriptedPath(lambda t: pin.SE3(pin.exp3(np.array([0.0, 0.0, 5.0 * t])), np.zeros(3)))
    nut.world.add(nut.bolt, Body.from_mesh(shape, 7850.0), [path])
    nut.run(1.0)
    assert nut.world.velocity(nut.nut)[5] == pytest.approx(5.0, abs=1e-9)
    height = nut.height
    nut.run(0.5)
    assert nut.height == pytest.approx(height, abs=1e-12)
    residual = nut.screw.residual(nut.world.pose(nut.bolt), nut.world.pose(nut.nut))
    assert np.abs(residual).max() < 1e-12


@pytest.mark.parametrize(("part", "moves"), [(0.999, False), (1.001, True)])
def test_a_lead_screw_lifts_its_carriage_at_the_torque_of_the_formula(part, moves):
    """A screw in bearings, a carriage on a guide: a loop that only rows can hold."""
    manager = CollisionManager()
    manager.add(box_mesh(0.02, 0.02, 0.02), at(y=1.0), movable=False)
    screw_mesh, carriage_mesh = box_mesh(0.02, 0.02, 0.4), box_mesh(0.1, 0.1, 0.05)
    screw, carriage = manager.add(screw_mesh, at()), manager.add(carriage_mesh, at(z=0.05))
    for i in range(3):
        for j in range(i):
            manager.ignore(i, j)
    world = World(manager)
    load, pitch, mu = Body.from_mesh(carriage_mesh, 7850.0), 0.004, 0.12
    torque = load.mass * G * RADIUS * np.tan(np.arctan(mu) + np.arctan2(pitch, 2 * np.pi * RADIUS))
    quiet = [Gravity(), Sleeping(False), Friction(mu)]
    world.add(screw, Body.from_mesh(screw_mesh, 7850.0), [*quiet, Turn(-part * torque)])
    world.add(carriage, load, quiet)
    thread = (Cylinder(np.zeros(3), Z, RADIUS), Cylinder(np.zeros(3), Z, RADIUS))
    side = Coplanar((0, carriage), (Plane(np.zeros(3), [1, 0, 0]), Plane(np.zeros(3), [1, 0, 0])))
    front = Coplanar((0, carriage), (Plane([0, -1, 0], [0, 1, 0]), Plane(np.zeros(3), [0, 1, 0])))
    bearing = hinge(0, screw, np.array([0.0, -1.0, 0.0]), np.zeros(3), Z)
    world.set_joints([*bearing, side, front, Screw((screw, carriage), thread, pitch=pitch).engaged(at(), at(z=0.05))])
    for _ in range(20):
        world.step(0.01)
    climbed = world.pose(carriage).translation[2] - 0.05
    assert climbed > 1e-9 if moves else abs(climbed) < 1e-14


def test_where_sliding_would_jam_what_rests_stays_and_what_moves_stops(way):
    """A nut of little inertia on a rough thread (Painlevé): sliding has no one solution, so it stops within a step."""
    nut = Nut(0.002, 0.3)
    light = replace(nut.body, inertia=1e-3 * nut.body.inertia)
    nut.world.add(nut.nut, light, [Gravity(), Sleeping(False), Friction(0.3)])
    nut.world.set_joints(nut.joints)
    nut.run(0.2)
    assert abs(nut.height) < 1e-15
    lead = 0.002 / (2 * np.pi)
    nut.world.set_velocity(nut.nut, [0, 0, -20.0 * lead, 0, 0, -20.0])
    nut.run(0.2)
    assert abs(nut.height) < 20.0 * lead * 0.01
    assert np.abs(nut.world.velocity(nut.nut)).max() < 1e-14
