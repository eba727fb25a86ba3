"""Threads found by slippage: axis, pitch and hand of made ones, and nothing where there is none."""

import numpy as np
import pinocchio as pin
import pytest

from collision import CollisionManager, SurfaceMesh, Tolerance
from constraints import recognise
from constraints.geometry.threads import find_threads, threaded
from tests.constraints.shapes import housing, shaft, turned

POSE = pin.SE3(pin.rpy.rpyToMatrix(0.4, -0.3, 0.2), np.array([0.1, -0.2, 0.05]))


def helix(pitch=2e-3, radius=7.35e-3, depth=5e-4, turns=5.0, inside=False, pose=POSE):
    """The two flanks of a thread about z, seen from `pose`; wound outward, or inward in a nut."""
    n = int(48 * turns)
    a = np.linspace(0.0, 2 * np.pi * turns, n)
    vertices, triangles, surface = [], [], []
    for k, (low, high) in enumerate((((-depth, 0.0), (depth, 0.5)), ((depth, 0.5), (-depth, 1.0)))):
        start = len(vertices) * n
        for dr, share in (low, high):
            r, z = radius + dr, pitch * a / (2 * np.pi) + share * abs(pitch)
            vertices.append(np.stack([r * np.cos(a), r * np.sin(a), z], axis=1))
        for j in range(n - 1):
            p, q = start + j, start + n + j
            triangles += [[p, p + 1, q + 1], [p, q + 1, q]]
            surface += [k, k]
    v = np.vstack(vertices) @ pose.rotation.T + pose.translation
    t = np.array(triangles)
    return SurfaceMesh(v, t[:, ::-1] if inside else t, surface, "thread")


@pytest.mark.parametrize("pitch", [2e-3, -1.25e-3])
@pytest.mark.parametrize("inside", [False, True])
def test_axis_pitch_hand_and_sense(pitch, inside):
    (thread,) = find_threads(helix(pitch, inside=inside), [0, 1])
    assert thread.surfaces == (0, 1)
    assert thread.pitch == pytest.approx(pitch, rel=2e-3)
    assert abs(thread.axis @ POSE.rotation[:, 2]) == pytest.approx(1.0, abs=1e-6)
    assert np.linalg.norm(np.cross(thread.origin - POSE.translation, POSE.rotation[:, 2])) < 1e-5
    assert thread.radius == pytest.approx(7.35e-3, rel=5e-3)
    assert thread.sense == (-1 if inside else 1)


def test_two_threads_of_one_part_stay_two():
    a, b = helix(2e-3), helix(1.5e-3, radius=5e-3, pose=pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.2])))
    both = SurfaceMesh(
        np.vstack([a.vertices, b.vertices]),
        np.vstack([a.triangles, b.triangles + len(a.vertices)]),
        np.concatenate([a.surface_of_triangle, b.surface_of_triangle + 2]),
    )
    found = find_threads(both, range(4))
    assert [t.surfaces for t in found] == [(0, 1), (2, 3)]
    assert [round(1e3 * t.pitch, 2) for t in found] == [2.0, 1.5]


@pytest.mark.parametrize(
    "body",
    [
        shaft(),
        housing(),
        turned([(0, -0.02, ("ball", 0.0)), (0, 0.02)]),
        turned([(0.05, 0.0, ("ring", 0.04, 0.0)), (0.03, 0.0)]),
    ],
)
def test_surfaces_of_revolution_and_planes_are_no_threads(body):
    assert find_threads(body.mesh, range(body.mesh.n_surfaces)) == ()


def test_crumpled_surfaces_are_no_threads():
    rng = np.random.default_rng(0)
    mesh = helix()
    crumpled = SurfaceMesh(mesh.vertices + rng.normal(0, 5e-4, mesh.vertices.shape), mesh.triangles)
    assert find_threads(crumpled, [0]) == ()


def test_a_nut_on_its_bolt_is_one_screw():
    bolt, nut = helix(turns=8.0, pose=pin.SE3.Identity()), helix(turns=3.0, inside=True, pose=pin.SE3.Identity())
    turn = 2.0
    lead = pin.SE3(pin.exp3(np.array([0.0, 0.0, turn])), np.array([0.0, 0.0, 2e-3 * (2 + turn / (2 * np.pi))]))
    poses = [pin.SE3.Identity(), lead]
    world = CollisionManager()
    features, threads = [], {}
    for i, mesh in enumerate((bolt, nut)):
        world.add(mesh, poses[i])
        own, pitches = threaded(mesh, ())
        features.append(own)
        threads |= {(i, place): pitch for place, pitch in pitches.items()}
    found = recognise(features, poses, world.contacts(1e-4), Tolerance(), threads=threads)
    assert [c.kind for c in found] == ["screw"]
    (screw,) = found
    assert screw.pitch == pytest.approx(2e-3, rel=2e-3) and "threads on one axis" in screw.why
    further = pin.SE3(pin.exp3(np.array([0.0, 0.0, 1.0])), np.array([0.0, 0.0, screw.pitch / (2 * np.pi)]))
    assert np.abs(screw.constraint.residual(poses[0], further * lead)).max() < 1e-5


def test_threads_of_different_pitch_do_not_screw():
    bolt, nut = helix(2e-3, pose=pin.SE3.Identity()), helix(1.5e-3, inside=True, pose=pin.SE3.Identity())
    world = CollisionManager()
    features, threads = [], {}
    for i, mesh in enumerate((bolt, nut)):
        world.add(mesh, pin.SE3.Identity())
        own, pitches = threaded(mesh, ())
        features.append(own)
        threads |= {(i, place): pitch for place, pitch in pitches.items()}
    found = recognise(features, [pin.SE3.Identity()] * 2, world.contacts(1e-3), Tolerance(), threads=threads)
    assert [c.kind for c in found] == ["concentric"]
