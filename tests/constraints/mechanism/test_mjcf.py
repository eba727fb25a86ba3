"""Mechanisms as MJCF: MuJoCo moves them as Pinocchio does."""

import numpy as np
import pinocchio as pin
import pytest

from constraints import solve
from constraints.freedom.graph import AssemblyGraph
from constraints.mechanism.mjcf import ADVANCE, to_mjcf
from constraints.mechanism.model import axis_name, mechanism
from tests.constraints.mechanism.joints import CASES, frames
from tests.constraints.mechanism.test_model import coordinates, four_bar
from tests.constraints.shapes import at

mujoco = pytest.importorskip("mujoco")


def moved(made, model, q):
    """World poses of MuJoCo's bodies at the coordinates of Pinocchio's model, a screw's slide with its turn."""
    theirs = mujoco.MjModel.from_xml_string(to_mjcf(made))
    data = mujoco.MjData(theirs)
    for joint in (*made.joints, *made.loops):
        for k, axis in enumerate(joint.axes):
            name = axis_name(joint, k)
            value = q[model.joints[model.getJointId(name)].idx_q]
            data.qpos[theirs.joint(name).qposadr[0]] = value
            if axis.kind == "screw":
                data.qpos[theirs.joint(name + ADVANCE).qposadr[0]] = axis.pitch * value
    mujoco.mj_kinematics(theirs, data)
    return {
        theirs.body(i).name: pin.SE3(data.xmat[i].reshape(3, 3).copy(), data.xpos[i].copy())
        for i in range(1, theirs.nbody)
    }, (theirs, data)


@pytest.mark.parametrize("name", CASES)
def test_each_lower_pair_moves_in_mujoco_as_in_pinocchio_joint_by_joint(name):
    poses = [at(rpy=(0.3, -0.2, 0.5)), at(rpy=(0.3, -0.2, 0.5)) * at(x=0.1)]
    made = mechanism(AssemblyGraph.of(CASES[name], poses, [0], ["base", "part"]))
    model, _ = made.model()
    rng = np.random.default_rng(1)
    ways = [*np.eye(model.nq), np.zeros(model.nq), *rng.uniform(-1, 1, (5, model.nq))]
    for q in ways:
        mine, (theirs, _) = frames(model, q), moved(made, model, q)[1]
        got = moved(made, model, q)[0]
        assert theirs.njnt == model.nq + sum(a.kind == "screw" for j in made.joints for a in j.axes)
        for part in ("base", "part"):
            assert np.abs(mine[part].homogeneous - got[part].homogeneous).max() < 1e-9


def test_a_loop_closes_in_mujoco_too():
    constraints, poses = four_bar()
    made = mechanism(AssemblyGraph.of(constraints, poses, [0], ["ground", "crank", "coupler", "rocker"]))
    model, _ = made.model()
    copy, original = made.loop_name(0), made.link_name(made.loops[0].child)
    crank = poses[1] * at(rpy=(0, 0, 0.3))
    solution = solve([*constraints], [poses[0], crank, *poses[2:]], [2, 3])
    target = {"crank": crank, "coupler": solution.poses[2], "rocker": solution.poses[3]}
    q = coordinates(model, {**target, copy: target[original]})
    got, (theirs, data) = moved(made, model, q)
    for name, pose in target.items():
        assert np.abs(got[name].homogeneous - pose.homogeneous).max() < 1e-9
    mujoco.mj_forward(theirs, data)
    assert theirs.neq == 1 and np.abs(data.efc_pos[: data.ne]).max() < 1e-9  # the weld is met
