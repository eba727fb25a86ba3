"""Nothing falls through anything: made solids dropped on fixed ones, from many heights, attitudes and speeds.

The oracle is independent of the contact points: signed distances of each part's vertices, edges and triangle middles
to the other's mesh, after every step.
"""

import numpy as np
import pinocchio as pin
import pytest
from physics_meshes import at, box_mesh, room, tube_mesh

from collision import CollisionManager, SurfaceMesh
from collision.query.signed_distance import signed_distances
from physics import Body, Elastic, Friction, Gravity, Sleeping, World
from physics.forces.behaviours import STANDARD_GRAVITY as G
from vpframe.scene import modelling

DEEPEST = 1e-9
"""m: penetration that a step may leave"""


def ring():
    return tube_mesh(0.00402, 0.008, 0.024, 48)


def tube():
    return tube_mesh(0.012, 0.014, 0.03, 32)


def wide_tube():
    return tube_mesh(0.0145, 0.018, 0.05, 32)


def sheet():
    return box_mesh(0.08, 0.05, 0.0005)


def block():
    return box_mesh(0.03, 0.03, 0.03)


def _mesh(solid: modelling.Solid) -> SurfaceMesh:
    return modelling.shape(solid, deflection=3e-4).mesh


def plate():
    return _mesh(modelling.box(0.06, 0.06, 0.004).translated(-0.03, -0.03) - modelling.cylinder(0.0055, 0.004))


def peg():
    return _mesh(modelling.box(0.08, 0.08, 0.01).translated(-0.04, -0.04, -0.01) + modelling.cylinder(0.005, 0.03))


def roof():
    prism = modelling.extrude([(-0.05, 0.0), (0.05, 0.0), (0.0, 0.03)], 0.1)
    return _mesh(prism.rotated([1, 0, 0], np.pi / 2).translated(0.0, 0.05, 0.0))


def gear():
    flanks = ((-0.35, 0.85), (-0.2, 1.0), (0.2, 1.0), (0.35, 0.85))
    angles = [(2 * np.pi * (k + turn) / 12, 0.02 * r) for k in range(12) for turn, r in flanks]
    outline = [(r * np.cos(a), r * np.sin(a)) for a, r in angles]
    return _mesh(modelling.extrude(outline, 0.006) - modelling.cylinder(0.005, 0.006))


def angle():
    corners = [(0.0, 0.0), (0.04, 0.0), (0.04, 0.006), (0.006, 0.006), (0.006, 0.04), (0.0, 0.04)]
    return _mesh(modelling.extrude(corners, 0.02))


def tray():
    hollow = modelling.box(0.116, 0.116, 0.03).translated(-0.058, -0.058, 0.002)
    return _mesh(modelling.box(0.12, 0.12, 0.03).translated(-0.06, -0.06) - hollow)


PAIRS = [
    (ring, ring), (plate, peg), (block, roof), (tube, wide_tube), (sheet, roof), (gear, plate), (gear, gear),
    (angle, angle), (angle, tray), (tray, peg), (ring, tray), (sheet, tray),
]  # fmt: skip


def points_of(mesh: SurfaceMesh) -> np.ndarray:
    corners = mesh.vertices[mesh.triangles]
    middles = 0.5 * (corners + np.roll(corners, 1, axis=1))
    return np.vstack([mesh.vertices, corners.mean(axis=1), middles.reshape(-1, 3)])


def depth(mesh_a, pose_a, mesh_b, pose_b) -> float:
    """m by which points of either part are inside the other."""
    deepest = 0.0
    for one, at_one, other, at_other in ((mesh_a, pose_a, mesh_b, pose_b), (mesh_b, pose_b, mesh_a, pose_a)):
        move = at_other.actInv(at_one)
        points = points_of(one) @ move.rotation.T + move.translation
        low, high = other.vertices.min(axis=0), other.vertices.max(axis=0)
        points = points[((points > low) & (points < high)).all(axis=1)]
        if len(points):
            deepest = max(deepest, -float(signed_distances(other, points).min()))
    return deepest


def drop(upper: SurfaceMesh, lower: SurfaceMesh, seed: int, steps: int):
    """Deepest penetration (m) and largest rise of energy above the start (of kinetic energy and a fall of 5 cm)."""
    rng = np.random.default_rng(seed)
    manager = CollisionManager()
    ground = box_mesh(2.0, 2.0, 0.1)
    fixed = {manager.add(ground, at(z=-0.15), movable=False): ground, manager.add(lower, at(), movable=False): lower}
    kind = rng.integers(3)
    turn = np.eye(3)
    if kind == 1:
        turn = pin.exp3(np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]))
    elif kind == 2:
        q = rng.normal(size=4)
        turn = pin.Quaternion(q / np.linalg.norm(q)).toRotationMatrix()
    aside = rng.uniform(-0.02, 0.02, 2) * (rng.random() < 0.6)
    height = lower.vertices[:, 2].max() - (upper.vertices @ turn.T)[:, 2].min() + rng.choice([1e-6, 1e-3, 0.01, 0.05])
    part = manager.add(upper, pin.SE3(turn, np.array([*aside, height])))
    velocity = np.zeros(6)
    velocity[2] = -rng.choice([0.0, 1.0, 5.0])
    velocity[:2] = rng.normal(size=2) * rng.choice([0.0, 0.5])
    velocity[3:] = rng.normal(size=3) * rng.choice([0.0, 5.0, 30.0])
    world = World(manager)
    body = Body.from_mesh(upper, 1000.0)
    friction, bounce = rng.choice([0.0, 0.3, 0.8]), rng.choice([0.0, 0.3, 0.8])
    behaviours = [Gravity(), Friction(friction), Elastic(bounce), Sleeping(False)]
    world.add(part, body, behaviours, velocity=velocity)

    def energy():
        return world.energy(part) + body.mass * G * world.pose(part).act(np.array(body.center))[2]

    start, scale = energy(), world.energy(part) + body.mass * G * 0.05
    worst, most = 0.0, 0.0
    for _ in range(steps):
        world.step(1 / 60)
        pose = world.pose(part)
        worst = max(worst, *(depth(upper, pose, mesh, manager.pose(i)) for i, mesh in fixed.items()))
        most = max(most, (energy() - start) / scale)
    return worst, most


def dropped():
    """Each pair dropped in three ways, of which one is quick enough for every run of the tests."""
    for i, pair in enumerate(PAIRS):
        for seed in (1, 2, 3):
            yield pytest.param(*pair, seed, marks=[pytest.mark.slow] if seed != 1 + i % 3 else [])


@pytest.mark.parametrize("upper, lower, seed", list(dropped()))
def test_what_is_dropped_stays_outside(upper, lower, seed):
    worst, most = drop(upper(), lower(), seed, 25)
    assert worst < DEEPEST
    assert most < 1e-3


def test_a_box_turned_a_little_rests_on_its_like():
    """Its corners are over no face then, and its edges cross at an angle as small as the turn."""
    mesh = box_mesh(0.1, 0.1, 0.1)
    for turn in (0.0, 1e-12, 1e-9, 3e-8, 1e-6, 1e-4, 5e-4, 1e-3, 0.1):
        manager, _ = room()
        manager.add(mesh, at(z=0.05), movable=False)
        box = manager.add(mesh, at(z=0.16, turn=(0.0, 0.0, turn)))
        world = World(manager)
        world.add(box, Body.from_mesh(mesh, 1000.0), [Gravity(), Friction(0.3), Sleeping(False)])
        for _ in range(20):
            world.step(1 / 60)
        assert world.pose(box).translation[2] == pytest.approx(0.15, abs=1e-9), turn


@pytest.mark.parametrize("force", [1e3, 1e5])
def test_a_strong_push_from_rest_carries_nothing_through_a_sheet(force):
    """The speed at the start of the step is nought: what limits the step is how far the part has come."""
    from physics import Behaviour

    class Push(Behaviour):
        constant = True

        def wrench(self, view):
            return np.array([0.0, 0.0, -force, 0.0, 0.0, 0.0])

    manager = CollisionManager()
    manager.add(box_mesh(0.5, 0.5, 0.001), at(), movable=False)
    mesh = box_mesh(0.02, 0.02, 0.02)
    box = manager.add(mesh, at(z=0.0125))
    world = World(manager)
    world.add(box, Body.from_mesh(mesh, 1000.0), [Push(), Friction(0.3), Sleeping(False)])
    for _ in range(10):
        world.step(0.01)
    assert world.pose(box).translation[2] == pytest.approx(0.0105, abs=1e-9)
