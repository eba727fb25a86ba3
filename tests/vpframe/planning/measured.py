"""Removals measured pose by pose."""

from itertools import pairwise

import numpy as np
import pinocchio as pin

from collision import CollisionManager, Tolerance
from vpframe.planning import tree, ways
from vpframe.planning.assembly import Assembly, Budget


def angle_of(removal):
    """rad: the greatest turn of the way from where the part stands."""
    return max(float(np.linalg.norm(pin.log3(k.rotation))) for k in removal.way.knots)


def deepest_beyond(scene, removal, poses=60):
    """m: by how much any surfaces reach deeper into each other on the way than where the parts stand, but for those
    that a fit or thread excuses; poses between the knots a leg."""
    assembly = Assembly(scene)
    out = 0.0
    for name in removal.parts:
        i = scene.index(name)
        for j in set(range(len(scene))) - {scene.index(n) for n in removal.parts}:
            world = CollisionManager(Tolerance(linear=1e-13, depth=1e-2))  # depths are found to within 1e-15 m
            world.add(scene.parts[i].mesh, assembly.poses[i])
            world.add(scene.parts[j].mesh, assembly.poses[j])
            for mine, theirs in assembly.excused(i, j):
                world.ignore_surfaces(0, mine, 1, theirs)
            known = {(r["surface_a"], r["surface_b"]): r["depth"] for r in world.penetration(0, 1)}
            for a, b in pairwise(removal.way.knots):
                way = pin.log6(a.actInv(b))
                for s in np.linspace(0.0, 1.0, poses):
                    world.set_pose(0, a * pin.exp6(way * s) * assembly.poses[i])
                    if len(world.colliding_surfaces()):
                        for r in world.penetration(0, 1):
                            out = max(out, r["depth"] - known.get((r["surface_a"], r["surface_b"]), 0.0))
    return out


def is_clear(scene, removal):
    """Whether a plane across its last direction parts what came out from all that stays."""
    parts = {scene.index(n) for n in removal.parts}
    d, end = removal.way.direction, removal.way.knots[-1]
    assembly = Assembly(scene)
    mine = min(((assembly.sweeps.corners(i) @ end.rotation.T + end.translation) @ d).min() for i in parts)
    return mine > max((assembly.sweeps.corners(j) @ d).max() for j in range(len(scene)) if j not in parts)


def sampled(scene, part, seed=0, seconds=60.0):
    """What the tree alone finds, without straight ways and pushes; by its questions, not by the clock."""
    assembly, i = Assembly(scene), scene.index(part)
    others = [j for j in range(len(scene)) if j != i]
    cone, _ = ways.cone_of(assembly, (i,), others)
    return tree.search(assembly, (i,), others, cone, Budget(seconds, clock=lambda: 0.0), seed)
