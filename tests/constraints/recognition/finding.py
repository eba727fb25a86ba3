"""What recognition finds between bodies."""

from dataclasses import replace

from collision import CollisionManager, Tolerance
from constraints import recognise

EXACT = replace(Tolerance(), reach=0.0, reach_angular=0.0)


def found(bodies, poses, tolerance=EXACT, **options):
    world = CollisionManager(tolerance)
    for body, pose in zip(bodies, poses, strict=True):
        world.add(body.mesh, pose)
    rows = world.contacts(max(tolerance.reach, tolerance.clearance))
    return recognise([b.features for b in bodies], poses, rows, tolerance, **options)
