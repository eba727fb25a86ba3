"""Parts fall into a tray and come to rest: boxes, balls and rods, each with its own friction and rebound.

python examples/physics_tray.py
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from collision import CollisionManager
from physics import Body, Elastic, Friction, Gravity, World
from vpframe.scene import modelling


def tray() -> modelling.Solid:
    """A flat tray 30 cm wide with a rim 5 cm high; its floor is z = 0."""
    outer = modelling.box(0.30, 0.30, 0.06).translated(-0.15, -0.15, -0.01)
    return outer - modelling.box(0.28, 0.28, 0.10).translated(-0.14, -0.14, 0.0)


def main(seconds: float = 1.5, parts: int = 6, seed: int = 1) -> dict[str, object]:
    """Drop the parts, step until `seconds` (s) or until all sleep; what came of it."""
    rng = np.random.default_rng(seed)
    manager = CollisionManager()
    manager.add(modelling.shape(tray(), name="tray").mesh, pin.SE3.Identity(), movable=False)
    world = World(manager)
    solids = [
        (modelling.box(0.03, 0.02, 0.02).translated(-0.015, -0.01, -0.01), "steel", 0.3),
        (modelling.sphere(0.012), "rubber", 0.6),
        (modelling.cylinder(0.006, 0.05).translated(0.0, 0.0, -0.025), "brass", 0.2),
    ]
    ids = []
    for k in range(parts):
        solid, material, rebound = solids[k % len(solids)]
        made = modelling.shape(solid, name=f"part_{k}")
        turn = pin.exp3(rng.normal(size=3))
        place = np.array([*rng.uniform(-0.08, 0.08, 2), 0.06 + 0.05 * k])
        i = manager.add(made.mesh, pin.SE3(turn, place))
        known = {surface.index: surface.geometry for surface in made.surfaces}
        world.add(i, Body.from_mesh(made.mesh, material), [Gravity(), Friction(0.4), Elastic(rebound)], known)
        ids.append(i)
    while world.time < seconds:
        world.step(0.005)
        if not world.awake:
            break
    inside = all(np.abs(world.pose(i).translation[:2]).max() < 0.15 and world.pose(i).translation[2] > 0 for i in ids)
    return {"time": world.time, "inside": inside, "awake": len(world.awake)}


if __name__ == "__main__":
    result = main()
    print(f"after {result['time']:.2f} s: all parts in the tray: {result['inside']}, still moving: {result['awake']}")
