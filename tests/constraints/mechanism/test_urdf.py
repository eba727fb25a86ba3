"""URDF and back: a screw mimics its turn to its own hand; masses and meshes."""

import numpy as np
import pinocchio as pin
import pytest

from constraints import Screw
from constraints.freedom.graph import AssemblyGraph
from constraints.geometry.surfaces import Cylinder
from constraints.mechanism.model import mechanism
from constraints.mechanism.urdf import load_urdf, to_urdf
from tests.constraints.mechanism.joints import CASES, Z, both, frames
from tests.constraints.shapes import at


@pytest.mark.parametrize("pitch", [2e-3, -2e-3])
@pytest.mark.parametrize("down", [False, True])
def test_a_turn_of_an_exported_screw_advances_it_by_its_pitch_to_its_own_hand(pitch, down, tmp_path):
    """Positive is right-hand, and the axis may point either way."""
    axis = -Z if down else Z
    thread = Cylinder([0, 0, 0], axis, 0.01)
    made = mechanism(
        AssemblyGraph.of([Screw((0, 1), (thread, thread), pitch=pitch)], [at(), at()], [0], ["nut", "bolt"])
    )
    for model, _ in both(made, tmp_path / "screw.urdf"):
        bolt = frames(model, np.array([1.0]))["bolt"]
        turn = pin.log3(bolt.rotation)[2]
        assert abs(turn) == pytest.approx(1.0) and bolt.translation[2] == pytest.approx(pitch * turn / (2 * np.pi))


def test_masses_and_meshes_reach_the_file(tmp_path):
    poses = [at(), at(x=0.1)]
    made = mechanism(AssemblyGraph.of(CASES["revolute"], poses, [0], ["base", "arm & <hand>"]))
    inertia = pin.Inertia(2.0, np.array([0.01, 0.02, 0.03]), np.diag([0.1, 0.2, 0.25]))
    path = tmp_path / "m.urdf"
    path.write_text(to_urdf(made, inertias={1: inertia}, meshes={1: "arm.stl"}), encoding="utf-8")
    model, _ = load_urdf(path)
    mine, _ = made.model(inertias={1: inertia})
    for m in (model, mine):
        q = np.array([0.7])
        assert pin.computeTotalMass(m) == pytest.approx(2.0)
        assert pin.crba(m, m.createData(), q)[0, 0] == pytest.approx(0.25 + 2.0 * (0.01**2 + 0.02**2))
    assert path.read_text(encoding="utf-8").count('filename="arm.stl"') == 2
