"""A balloon rises in the air until it reaches the room's ceiling; a behaviour of the user's own makes it flutter.

python examples/physics_balloon.py
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from collision import CollisionManager
from physics import Behaviour, Body, Buoyancy, Drag, Gravity, World, force
from vpframe.scene import modelling


class Draught(Behaviour):
    """Air that pushes to and fro along x."""

    def __init__(self, strength: float, period: float) -> None:
        self.strength, self.period = strength, period

    def wrench(self, view):
        return force([self.strength * np.sin(2 * np.pi * view.time / self.period), 0.0, 0.0])


def main(height: float = 2.5) -> dict[str, float]:
    """Let the balloon go 0.3 m above the floor of a room of `height` (m); when and where it stops."""
    radius, mass = 0.15, 0.008
    manager = CollisionManager()
    manager.add(
        modelling.shape(modelling.box(4, 4, 0.2).translated(-2, -2, height)).mesh,
        pin.SE3.Identity(),
        movable=False,
    )
    made = modelling.shape(modelling.sphere(radius), deflection=2e-3)
    balloon = manager.add(made.mesh, pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.3])))
    world = World(manager)
    behaviours = [Gravity(), Buoyancy(1.204), Drag(area=np.pi * radius**2), Draught(0.005, 2.0)]
    known = {surface.index: surface.geometry for surface in made.surfaces}
    world.add(balloon, Body.sphere(radius, mass), behaviours, known)
    fastest, touched = 0.0, 0.0
    while world.time < 5.0:
        world.step(0.02)
        fastest = max(fastest, world.velocity(balloon)[2])
        if not touched and world.touches(balloon):
            touched = world.time
    return {"touched": touched, "fastest": float(fastest), "top": float(world.pose(balloon).translation[2] + radius)}


if __name__ == "__main__":
    result = main()
    print(f"reached the ceiling after {result['touched']:.2f} s, at most {result['fastest']:.3f} m/s")
    print(f"its top rests at {result['top']:.9f} m")
