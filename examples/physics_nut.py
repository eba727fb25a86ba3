"""An M16 nut on its bolt: friction in the thread holds it, a wrench turns it, and where it is left it stays.

The thread is a screw constraint of 2 mm pitch, with flanks of 30° and μ = 0.15. What the wrench must give to turn the
nut up and down is looked for and compared with the formula for power screws; then the nut is driven down on a plate and
up again.

    python examples/physics_nut.py
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from collision import CollisionManager
from constraints.geometry.surfaces import Cylinder
from constraints.kinds.concentric import Concentric
from constraints.kinds.screw import Screw
from physics import Behaviour, Body, Friction, Gravity, Motor, View, World
from physics.forces.behaviours import STANDARD_GRAVITY
from vpframe.scene import modelling

PITCH, FLANK, MU = 0.002, np.radians(30.0), 0.15
RADIUS = 0.5 * 0.014701  # m, of the pitch cylinder
PLATE, START = 0.125, 0.15  # m, heights of the plate's face and of the nut's
Z = np.array([0.0, 0.0, 1.0])


class Wrench(Behaviour):
    """A torque about the bolt."""

    constant = True

    def __init__(self, torque: float) -> None:
        self.torque = torque

    def wrench(self, view: View) -> np.ndarray:
        return np.concatenate([np.zeros(3), self.torque * Z])


class Bench:
    """A bolt that stands upright through a plate, with its nut."""

    def __init__(self) -> None:
        manager = CollisionManager()
        bolt = manager.add(
            modelling.shape(modelling.cylinder(0.008, 0.2), name="bolt").mesh, pin.SE3.Identity(), movable=False
        )
        plate = modelling.shape(modelling.cylinder(0.04, 0.01) - modelling.cylinder(0.009, 0.01), name="plate").mesh
        manager.add(plate, pin.SE3(np.eye(3), (PLATE - 0.01) * Z), movable=False)
        solid = modelling.shape(modelling.hexagon(0.024, 0.013) - modelling.cylinder(0.008, 0.013), name="nut")
        self.nut = manager.add(solid.mesh, pin.SE3(np.eye(3), START * Z))
        manager.ignore(bolt, self.nut)
        self.world = World(manager)
        self.body = Body.from_mesh(solid.mesh, "steel")
        self.turn()
        thread = (Cylinder(np.zeros(3), Z, RADIUS), Cylinder(np.zeros(3), Z, RADIUS))
        screw = Screw((bolt, self.nut), thread, pitch=PITCH, flank=FLANK)
        screw = screw.engaged(self.world.pose(bolt), self.world.pose(self.nut))
        self.world.set_joints([Concentric((bolt, self.nut), thread), screw])

    def turn(self, *by: Behaviour) -> None:
        """What turns the nut from now on, besides its weight."""
        self.world.add(self.nut, self.body, [Gravity(), Friction(MU), *by])

    def run(self, seconds: float) -> float:
        """Let that much time pass; the nut's height in metres."""
        end = self.world.time + seconds
        while self.world.time < end - 1e-9:
            self.world.step(0.01)
        return float(self.world.pose(self.nut).translation[2])


def breakaway(sense: float) -> float:
    """The least torque, N·m, that turns the nut: up (1) or down (-1), by bisection."""

    def moves(torque: float) -> bool:
        bench = Bench()
        bench.turn(Wrench(sense * torque))
        return bench.run(0.02) != START

    return _least(moves, 0.0, 0.01)


def _least(true: Callable[[float], bool], low: float, high: float) -> float:
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if true(middle) else (middle, high)
    return high


def main(seconds: float = 10.0) -> dict[str, float]:
    """Find what turns the nut; leave it for some seconds, drive it down on the plate and up, leave it each time."""
    bench = Bench()
    weight = bench.body.mass * STANDARD_GRAVITY
    lead, friction = np.arctan(PITCH / (2 * np.pi * RADIUS)), np.arctan(MU / np.cos(FLANK))
    result = {}
    for name, sense in (("raise", 1.0), ("lower", -1.0)):
        result[name] = breakaway(sense)
        result[f"{name} exact"] = float(weight * RADIUS * np.tan(friction + sense * lead))
    bench = Bench()
    result["left"] = START - bench.run(seconds)
    bench.turn(Motor(Z, speed=-80.0, limit=0.05, gain=1e-3))
    result["seat"] = bench.run(1.5) - PLATE
    bench.turn()
    result["down"] = bench.run(1.0) - PLATE
    bench.turn(Motor(Z, speed=80.0, limit=0.05, gain=1e-3))
    result["up"] = bench.run(1.0)
    bench.turn()
    stopped = bench.run(0.5)
    result["after"] = bench.run(1.0) - stopped
    return result


if __name__ == "__main__":
    result = main()
    print(f"left alone for ten seconds the nut has gone down by {result['left']:.1e} m")
    for name in ("raise", "lower"):
        print(f"to {name} it takes {result[name]:.9f} N·m, by the formula {result[f'{name} exact']:.9f} N·m")
    print(f"driven down, it sits {result['seat']:.1e} m above the plate, a second later {result['down']:.1e} m")
    print(f"driven up to {1e3 * result['up']:.3f} mm and left, it stops and then moves {result['after']:.1e} m")
