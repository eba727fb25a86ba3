"""A thread that is real geometry screws in a session: nobody tells its pitch."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from collision import SurfaceMesh
from constraints.geometry import Freeform
from tests.constraints.test_threads import helix
from vpframe.scene import Part, Scene, Shape, Surface
from vpframe.session import Session

PITCH, HEIGHT = 2e-3, 4e-3  # m


def part(name: str, mesh: SurfaceMesh, height: float, fixed: bool) -> Part:
    surfaces = tuple(Surface(i, f"{name}/{i}", Freeform(), "free", 0.0, 1.0) for i in range(mesh.n_surfaces))
    pose = pin.SE3(np.eye(3), np.array([0.0, 0.0, height]))
    return Part(name, Shape(mesh, surfaces, (), closed=False), pose, fixed=fixed)


def bolt_and_nut() -> Scene:
    here = pin.SE3.Identity()
    bolt, nut = helix(PITCH, turns=8.0, pose=here), helix(PITCH, turns=3.0, inside=True, pose=here)
    return Scene([part("bolt", bolt, 0.0, True), part("nut", nut, HEIGHT, False)])


def turned(session: Session) -> tuple[float, float]:
    """How far the nut has gone along z, and about it."""
    pose = session.scene["nut"].pose
    return float(pose.translation[2]) - HEIGHT, float(pin.log3(pose.rotation)[2])


def test_a_nut_that_is_turned_goes_along_its_thread() -> None:
    session = Session(bolt_and_nut())
    hand = session.hand(at=(0.0, 0.0, 0.05))
    hand.grab("nut")
    assert sorted(c.kind for c in session.constraints) == ["concentric", "screw"]
    assert session.pitch_of("nut") == pytest.approx(PITCH, rel=2e-3)
    hand.turn(0.8 * np.pi, about=((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), required=False)
    along, about = turned(session)
    assert about == pytest.approx(0.8 * np.pi, abs=0.02)
    assert along == pytest.approx(PITCH * about / (2.0 * np.pi), abs=2e-6)
    session.expect_freedom("nut", 1)
    assert session.joint("nut") == "screw"


def test_a_nut_unscrews_off_its_thread_by_itself() -> None:
    session = Session(bolt_and_nut())
    hand = session.hand(at=(0.0, 0.0, 0.05))
    hand.grab("nut")
    assert hand.unscrew(until="free")
    along, _ = turned(session)
    assert abs(along) > 9e-3  # its three turns are off the bolt's eight
    session.expect_freedom("nut", 6)


def test_a_part_without_threads_has_no_pitch() -> None:
    scene = bolt_and_nut()
    smooth = SurfaceMesh(np.eye(3), np.array([[0, 1, 2]]), np.zeros(1, dtype=np.int32))
    session = Session(Scene([scene["bolt"], part("shim", smooth, 1.0, False)]))
    session.step()
    assert session.pitch_of("shim") is None
