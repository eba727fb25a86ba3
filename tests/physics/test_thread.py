"""Friction in threads: a nut on its bolt as the block on an incline that it is, against closed forms."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from physics_meshes import at, box_mesh

from collision import CollisionManager
from constraints.geometry import Cylinder
from constraints.kinds.concentric import Concentric
from constraints.kinds.screw import Screw
from physics import Behaviour, Body, Friction, Gravity, Sleeping, World
from physics.behaviours import STANDARD_GRAVITY as G

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
        self.world.set_joints([Concentric(bodies, features), self.screw] if others else [self.screw])
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


def test_a_thread_below_the_cone_of_friction_holds_exactly():
    """tan λ = 0.9 µ: nothing moves in 10 s, in either path; 1.1 µ: it goes."""
    pitch = 0.9 * 0.15 * 2 * np.pi * RADIUS
    nut = Nut(pitch, 0.15).run(10.0)
    assert abs(nut.height) < 1e-12
    assert np.abs(nut.world.velocity(nut.nut)).max() < 1e-12
    assert Nut(1.3 * pitch, 0.15).run(0.5).height < -1e-4


@pytest.mark.parametrize("others", [True, False], ids=["with concentric", "screw alone"])
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
def test_a_thread_slides_as_the_incline_says(pitch, mu, flank, tilt, torque, others):
    nut = Nut(pitch, mu, flank=flank, tilt=tilt, others=others)
    if torque:
        nut.world.add(nut.nut, nut.body, [Gravity(), Sleeping(False), Friction(mu), Turn(torque, nut.axis)])
    nut.run(0.3)
    expected = 0.5 * 0.3**2 * nut.acceleration(pitch, mu, torque, flank, tilt)
    assert nut.height == pytest.approx(expected, rel=1e-11)
    residual = nut.screw.residual(nut.world.pose(nut.bolt), nut.world.pose(nut.nut))
    assert np.abs(residual).max() < 1e-12
