"""Mechanisms as Pinocchio models and URDF: both move alike, and as the constraints say."""

import numpy as np
import pinocchio as pin
import pytest

from constraints import solve
from constraints.freedom.graph import AssemblyGraph
from constraints.geometry.surfaces import Plane, Sphere
from constraints.kinds import Tangent
from constraints.mechanism.model import mechanism
from tests.constraints.mechanism.joints import CASES, Z, against, both, concentric, frames, hinge
from tests.constraints.shapes import at


@pytest.mark.parametrize("name", CASES)
def test_each_lower_pair_moves_alike_in_model_urdf_and_constraints(name, tmp_path):
    poses = [at(rpy=(0.3, -0.2, 0.5)), at(rpy=(0.3, -0.2, 0.5)) * at(x=0.1)]
    made = mechanism(AssemblyGraph.of(CASES[name], poses, [0], ["base", "part"]))
    assert [j.lower_pair for j in made.joints] == [name.split(" ")[0]] and made.loops == () and made.notes == ()
    assert len(made.joints[0].axes) == made.freedom
    (model, _), (loaded, _) = both(made, tmp_path / "m.urdf")
    assert model.nq == made.freedom == loaded.nq
    rng = np.random.default_rng(1)
    zero = frames(model, np.zeros(model.nq))
    assert zero["part"].isApprox(poses[1], 1e-12) and zero["base"].isApprox(poses[0], 1e-12)
    for _ in range(10):
        q = rng.uniform(-1, 1, model.nq)
        mine, theirs = frames(model, q), frames(loaded, q)
        for part in ("base", "part"):
            assert np.abs(mine[part].homogeneous - theirs[part].homogeneous).max() < 1e-12
        for c in CASES[name]:
            assert np.abs(c.residual(mine["base"], mine["part"])).max() < 1e-12


def four_bar():
    """Ground 0, crank 1, coupler 2, rocker 3, in the plane z = 0."""
    a, b, c, d = np.array([0, 0, 0.0]), np.array([0.03, 0.04, 0]), np.array([0.13, 0.08, 0]), np.array([0.1, 0, 0])
    poses = [at(), at(*a), at(*b), at(*d)]
    constraints = hinge(0, 1, a) + hinge(1, 2, b - a) + hinge(2, 3, c - b, c - d) + hinge(0, 3, d)
    return constraints, poses


def test_four_bar_has_one_loop_and_closes_as_the_solver_says(tmp_path):
    constraints, poses = four_bar()
    made = mechanism(AssemblyGraph.of(constraints, poses, [0], ["ground", "crank", "coupler", "rocker"]))
    assert made.freedom == 1 and len(made.joints) == 3 and len(made.loops) == 1
    assert {j.lower_pair for j in made.joints + made.loops} == {"revolute"}
    (model, welds), (loaded, again) = both(made, tmp_path / "bar.urdf")
    assert model.nq == loaded.nq == 4 and len(welds) == len(again) == 1
    copy = made.loop_name(0)
    original = made.link_name(made.loops[0].child)
    for angle in (0.1, 0.3, -0.4):
        crank = poses[1] * at(rpy=(0, 0, angle))
        moved = solve([*constraints], [poses[0], crank, *poses[2:]], [2, 3])
        assert moved.converged
        target = {"crank": crank, "coupler": moved.poses[2], "rocker": moved.poses[3]}
        q = coordinates(model, {**target, copy: target[original]})
        for m, weld in ((model, welds[0]), (loaded, again[0])):
            p = renamed(model, m, q)
            got = frames(m, p)
            for name, pose in target.items():
                assert np.abs(got[name].homogeneous - pose.homogeneous).max() < 1e-9
            closes = got[copy].actInv(got[original])
            assert np.abs(pin.log6(closes).vector).max() < 1e-9
            data = m.createData()
            pin.forwardKinematics(m, data, p)
            first = data.oMi[weld.joint1_id] * weld.joint1_placement
            second = data.oMi[weld.joint2_id] * weld.joint2_placement
            assert np.abs(pin.log6(first.actInv(second)).vector).max() < 1e-9


def renamed(model, other, q):
    """The coordinates of `model` in the order of `other`, which goes by the same joint names."""
    p = np.zeros(other.nq)
    for name in list(model.names)[1:]:
        p[other.joints[other.getJointId(name)].idx_q] = q[model.joints[model.getJointId(name)].idx_q]
    return p


def coordinates(model, target):
    """Newton on the frames' poses."""
    q = np.zeros(model.nq)
    data = model.createData()
    for _ in range(30):
        error, jacobian = [], []
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        for name, pose in target.items():
            i = model.getFrameId(name)
            error.append(pin.log6(data.oMf[i].actInv(pose)).vector)
            jacobian.append(pin.getFrameJacobian(model, data, i, pin.LOCAL))
        q = q + np.linalg.lstsq(np.vstack(jacobian), np.concatenate(error), rcond=None)[0]
    return q


def test_a_nut_between_axis_and_face_turns_and_needs_no_loop():
    """Rod 1 slides and turns in base 0; nut 2 sits on the rod and against the base."""
    constraints = [concentric(0, 1, [0.1, 0, 0]), concentric(1, 2, [0, 0, 0]), against(0, 2)]
    made = mechanism(AssemblyGraph.of(constraints, [at(), at(x=0.1), at(x=0.1)], [0], ["base", "rod", "nut"]))
    assert sorted(j.lower_pair for j in made.joints) == ["cylindrical", "revolute"]
    assert made.freedom == 3 and made.loops == ()


def test_a_coupler_turns_about_no_lasting_axis():
    """The coupler of a four-bar has an instantaneous axis against the ground: no joint may be made of it."""
    constraints, poses = four_bar()
    constraints = [*constraints, against(0, 2)]  # a contact of coupler and ground that the loop makes redundant
    made = mechanism(AssemblyGraph.of(constraints, poses, [0], ["ground", "crank", "coupler", "rocker"]))
    names = {j.name: j.lower_pair for j in made.joints + made.loops}
    assert names.get("ground--coupler", "planar") == "planar"
    assert made.freedom == 1


def test_what_is_no_lower_pair_is_left_out_and_noted():
    rolls = Tangent((0, 1), (Plane([0, 0, 0], Z), Sphere([0, 0, 0], 0.02)))
    made = mechanism(AssemblyGraph.of([rolls], [at(), at(z=0.02)], [0], ["plate", "ball"]))
    assert [j.lower_pair for j in made.joints] == ["free"]
    assert "plate--ball: tangent" in made.notes[0] and "left out" in made.notes[0]
