"""Newton's cradle: five balls on hinged rods; what swings in on one side swings out on the other.

python examples/physics_newtons_cradle.py
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from collision import CollisionManager
from constraints.geometry.surfaces import Cylinder, Plane, Sphere
from constraints.kinds.concentric import Concentric
from constraints.kinds.coplanar import Coplanar
from physics import Body, Elastic, Friction, Gravity, World
from physics.forces.behaviours import STANDARD_GRAVITY
from vpframe.scene import modelling


def main(seconds: float = 3.0, balls: int = 5, angle: float = 0.5) -> dict[str, list[float]]:
    """Let the first ball go at `angle` (rad); each ball's greatest angle to either side, and the energy (J) at both
    ends of the run, above that of five balls hanging still.
    """
    radius, arm, mass = 0.02, 0.3, 0.26
    manager = CollisionManager()
    bar = manager.add(
        modelling.shape(modelling.box(0.4, 0.02, 0.02)).mesh,
        pin.SE3(np.eye(3), np.array([-0.2, -0.01, 0.05])),
        movable=False,
    )
    world = World(manager)
    made = modelling.shape(modelling.sphere(radius), deflection=5e-4)
    known = {s.index: Sphere(np.zeros(3), radius) for s in made.surfaces}
    axis = np.array([0.0, 1.0, 0.0])
    ids, joints = [], []
    for k in range(balls):
        pivot = np.array([2 * radius * (k - (balls - 1) / 2), 0.0, 0.0])
        turn = pin.exp3(np.array([0.0, angle if k == 0 else 0.0, 0.0]))
        i = manager.add(made.mesh, pin.SE3(turn, pivot + turn @ [0.0, 0.0, -arm]))
        world.add(i, Body.sphere(radius, mass), [Gravity(), Elastic(1.0), Friction(0.0)], known)
        on_bar = world.pose(bar).actInv(pivot)
        on_ball = np.array([0.0, 0.0, arm])
        joints += [
            Concentric((bar, i), (Cylinder(on_bar, axis, 0.002), Cylinder(on_ball, axis, 0.002))),
            Coplanar((bar, i), (Plane(on_bar, axis), Plane(on_ball, axis))),
        ]
        manager.ignore(bar, i)
        ids.append(i)
    world.set_joints(joints)

    def energy() -> float:
        return sum(world.energy(i) + mass * STANDARD_GRAVITY * (world.pose(i).translation[2] + arm) for i in ids)

    first = energy()
    least, most = np.zeros(balls), np.zeros(balls)
    while world.time < seconds:
        world.step(0.005)
        for k, i in enumerate(ids):
            down = -world.pose(i).rotation[:, 2]
            swing = np.arctan2(-down[0], -down[2])
            least[k], most[k] = min(least[k], swing), max(most[k], swing)
    return {"least": least.tolist(), "most": most.tolist(), "energy": [first, energy()]}


if __name__ == "__main__":
    result = main()
    for k, (least, most) in enumerate(zip(result["least"], result["most"], strict=True)):
        print(f"ball {k}: from {least:+.4f} to {most:+.4f} rad")
    print(f"energy: {result['energy'][0]:.5f} J, at the end {result['energy'][1]:.5f} J")
