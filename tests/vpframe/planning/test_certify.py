"""Paths are certified: their least clearance is that of dense samples, and a hand keeps to them."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

import vpframe as vp
from collision import CollisionManager
from tests.vpframe.planning import cases
from tests.vpframe.planning.measured import deepest_beyond
from vpframe.planning.assembly import Assembly
from vpframe.planning.certify import STRAY, least_clearance
from vpframe.scene.modelling import box, cylinder
from vpframe.scene.modelling import scene as scene_of

LONG = 600.0


@pytest.mark.parametrize("gap", [1e-4, 5e-4, 1e-3])
def test_the_least_clearance_is_that_of_dense_samples_where_surfaces_only_pass_each_other(gap):
    post, mover = cylinder(0.003, 0.03), (box(0.01, 0.01, 0.01), cases.at(-0.03, -0.013 - gap, 0.01))
    assembly = Assembly(scene_of({"post": post, "mover": mover}))
    knots = pin.SE3.Identity(), cases.at(0.06)
    found = least_clearance(assembly, (1,), (0,), knots)
    world = CollisionManager()
    for mesh, pose in zip(assembly.meshes, assembly.poses, strict=True):
        world.add(mesh, pose)
    sampled = []
    for x in np.linspace(0.0, 0.06, 601):
        world.set_pose(1, cases.at(x) * assembly.poses[1])
        sampled += world.contacts(within=2.0 * gap)["distance"].tolist()
    assert 0.9 * min(sampled) <= found.distance <= min(sampled)
    assert found.parts == (1, 0)


def test_the_least_clearance_of_a_way_of_many_legs_is_that_of_dense_samples():
    post, mover = cylinder(0.003, 0.03), (box(0.01, 0.01, 0.01), cases.at(-0.03, -0.0135, 0.01))
    assembly = Assembly(scene_of({"post": post, "mover": mover}))
    knots = [pin.SE3.Identity()]  # past the post, nearer and farther with every leg
    for k in range(1, 25):
        knots.append(pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.01 * (k % 3)])), np.array([0.0025 * k, 1e-4 * (k % 2), 0])))
    found = least_clearance(assembly, (1,), (0,), tuple(knots))
    sampled = [
        assembly.sweeps.near(1, 0, a * pin.exp6(pin.log6(a.actInv(b)) * t), b, 0.01)["distance"].min(initial=0.01)
        for a, b in pairwise(knots)
        for t in np.linspace(0.0, 1.0, 40)
    ]
    assert 0.995 * min(sampled) <= found.distance <= min(sampled)


def test_a_peg_comes_out_of_ten_micrometres_and_its_clearance_is_told():
    scene = cases.peg(1e-5)
    found = vp.planning.removal(scene, "peg", budget=LONG)
    assert found.verdict == "removable"
    assert found.clearance.distance == pytest.approx(1e-5, rel=0.06)
    assert deepest_beyond(scene, found) == 0.0
    wider = vp.planning.removal(scene, "peg", budget=LONG, clearance=9e-6)
    assert wider.verdict == "removable"


def test_the_clearance_of_a_way_that_leaves_a_fit_at_once_is_that_of_its_surfaces():
    shell = box(0.01, 0.016, 0.01).translated(-0.015, -0.008, 0.0) - cylinder(0.01005, 0.01)
    scene = scene_of({"post": cylinder(0.01, 0.03), "shell": (shell, cases.at(0.0, 0.0, 0.01))})
    assembly = Assembly(scene)
    assert assembly.mates_of(0, 1)
    near = assembly.sweeps.near(1, 0, pin.SE3.Identity(), cases.at(-0.001), 0.001)["distance"].min()
    found = least_clearance(assembly, (1,), (0,), (pin.SE3.Identity(), cases.at(-0.02)))
    assert 0.99 * near <= found.distance <= near
    along = least_clearance(assembly, (1,), (0,), (pin.SE3.Identity(), cases.at(0.0, 0.0, 0.03)))
    assert along.distance > 10.0 * near


def test_the_track_is_what_a_hand_follows_and_keeps_to_the_certified_way():
    scene = cases.bayonet()
    found = vp.planning.removal(scene, "plug", budget=LONG)
    track, pose = found.track, Assembly(scene).poses[scene.index("plug")]
    assert track.poses[0].isApprox(pose)
    assert track.poses[-1].isApprox(found.way.knots[-1] * pose, 1e-9)
    lines = track.text().splitlines()
    assert lines[0] == "t,x,y,z,qx,qy,qz,qw" and len(lines) == len(track.times) + 1
    fine = [
        a * pin.exp6(pin.log6(a.actInv(b)) * s) * pose
        for a, b in pairwise(found.way.knots)
        for s in np.linspace(0, 1, 200)
    ]
    points = scene["plug"].mesh.vertices[:5]
    for a, b in pairwise(track.poses):
        middle = pin.SE3(
            a.rotation @ pin.exp3(0.5 * pin.log3(a.rotation.T @ b.rotation)), 0.5 * (a.translation + b.translation)
        )
        way = min(np.abs([middle.act(p) - f.act(p) for p in points]).max() for f in fine)
        assert way < STRAY + 2e-4  # the fine poses are as far apart as that
