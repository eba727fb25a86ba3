"""A hinge: a hand holds the leaf beside its post until the pin is in; then it swings, and falls when the pin is drawn.

python examples/physics_hinge.py
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from collision import CollisionManager
from constraints.geometry.surfaces import Cylinder, Plane
from constraints.kinds.concentric import Concentric
from constraints.kinds.coplanar import Coplanar
from physics import Body, Gravity, Sleeping, World
from vpframe.scene import modelling


def main(seconds: float = 2.0) -> dict[str, float]:
    """Hold the leaf level, put the pin in, let go; how far the joint opened, and where the leaf would be without it."""
    manager = CollisionManager()
    rod = modelling.cylinder(0.004, 0.044).rotated((1.0, 0.0, 0.0), np.pi / 2).translated(0.012, 0.032, 0.0)
    post_solid = modelling.box(0.04, 0.02, 0.3).translated(-0.008, 0.0105, -0.15) - rod
    leaf_shape = modelling.shape(modelling.box(0.2, 0.02, 0.02).translated(0.0, -0.01, -0.01) - rod, name="leaf")
    drawn = pin.SE3(np.eye(3), np.array([0.0, -0.08, 0.0]))
    post = manager.add(modelling.shape(post_solid, name="post").mesh, pin.SE3.Identity(), movable=False)
    leaf = manager.add(leaf_shape.mesh, pin.SE3.Identity())
    hinge_pin = manager.add(modelling.shape(rod, name="pin").mesh, drawn)
    manager.ignore(hinge_pin, post)  # it fits without play: facets would meet
    manager.ignore(hinge_pin, leaf)
    world = World(manager)
    world.add(hinge_pin)
    world.add(leaf, Body.from_mesh(leaf_shape.mesh, "aluminium"), [Gravity(), Sleeping(False)])

    world.hold(leaf, pin.SE3.Identity())
    for _ in range(10):
        world.step(0.01)
    weight = float(world.wrench(leaf)[2])

    axis, eye = np.array([0.0, 1.0, 0.0]), np.array([0.012, 0.0, 0.0])
    pin_joint = [
        Concentric((post, leaf), (Cylinder(eye, axis, 0.004), Cylinder(eye, axis, 0.004))),
        Coplanar((post, leaf), (Plane(eye, axis), Plane(eye, axis))),
    ]
    world.set_pose(hinge_pin, pin.SE3.Identity())
    world.set_joints(pin_joint)
    world.let_go(leaf)
    opened, lowest = 0.0, 0.0
    while world.time < seconds:
        world.step(0.01)
        opened = max(opened, *(float(np.abs(j.residual(world.pose(post), world.pose(leaf))).max()) for j in pin_joint))
        lowest = min(lowest, float(world.pose(leaf).act(np.array([0.2, 0.0, 0.0]))[2]))

    world.set_pose(hinge_pin, drawn)
    world.set_joints([])  # the pin is drawn: the leaf falls
    before = float(world.pose(leaf).translation[2])
    for _ in range(20):
        world.step(0.01)
    return {
        "weight": weight,
        "opened": opened,
        "lowest": lowest,
        "fell": before - float(world.pose(leaf).translation[2]),
    }


if __name__ == "__main__":
    result = main()
    print(f"the hand felt {result['weight']:.3f} N; the tip swung down to {result['lowest']:.3f} m")
    print(f"the joint opened by {result['opened']:.1e}; without its pin the leaf fell {result['fell']:.2f} m")
