"""An M16 nut on its bolt: on a free-running thread it spins down as its pitch allows, and stays when it does not move.

The thread is a screw constraint of 2 mm pitch between smooth cylinders; of friction it knows nothing, so what keeps a
screwed-in nut in place is a torque of the user's: a brake.

    python examples/physics_nut.py
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from collision import CollisionManager
from constraints.geometry import Cylinder
from constraints.kinds.concentric import Concentric
from constraints.kinds.screw import Screw
from physics import Behaviour, Body, Gravity, Motor, Sleeping, World
from vpframe.modelling import cylinder, hexagon, shape

PITCH, RADIUS = 0.002, 0.008


def main(seconds: float = 1.0) -> dict[str, float]:
    """Run the nut down freely, then screw it up again with a motor; heights against the closed form."""
    manager = CollisionManager()
    bolt = manager.add(shape(cylinder(RADIUS - 1e-4, 0.2), name="bolt").mesh, pin.SE3.Identity(), movable=False)
    nut_solid = hexagon(0.024, 0.013) - cylinder(RADIUS, 0.013)
    made = shape(nut_solid, name="nut")
    start = 0.15
    nut = manager.add(made.mesh, pin.SE3(np.eye(3), np.array([0.0, 0.0, start])))
    manager.ignore(bolt, nut)
    world = World(manager)
    body = Body.from_mesh(made.mesh, "steel")

    def fit(*behaviours: Behaviour) -> None:
        world.add(nut, body, [Gravity(), Sleeping(False), *behaviours])
        z = np.array([0.0, 0.0, 1.0])
        thread = (Cylinder(np.zeros(3), z, RADIUS), Cylinder(np.zeros(3), z, RADIUS))
        screw = Screw((bolt, nut), thread, pitch=PITCH).engaged(world.pose(bolt), world.pose(nut))
        world.set_joints([Concentric((bolt, nut), thread), screw])

    fit()
    while world.time < seconds - 1e-9:
        world.step(0.01)
    lead = PITCH / (2 * np.pi)
    moment = body.inertia[2, 2]
    expected = start - 0.5 * 9.80665 / (1 + moment / (body.mass * lead**2)) * seconds**2
    down = float(world.pose(nut).translation[2])

    fit(Motor([0, 0, 1], speed=20.0, limit=0.1, gain=1e-3))
    for _ in range(100):
        world.step(0.01)
    return {"down": down, "expected": float(expected), "up": float(world.pose(nut).translation[2])}


if __name__ == "__main__":
    result = main()
    print(f"after a second the nut is at {result['down']:.12f} m, by the closed form {result['expected']:.12f} m")
    print(f"a motor of 20 rad/s took it up to {result['up']:.6f} m in another")
