"""A thread that is real geometry screws in a session: nobody tells its pitch."""

import numpy as np
import pinocchio as pin
import pytest

from collision import SurfaceMesh
from constraints.geometry.surfaces import Freeform
from physics import Friction, Gravity
from tests.constraints.geometry.test_threads import helix
from tests.vpframe.bench_scene import SEAT, scene
from vpframe.errors import TaskError
from vpframe.hands import constraint
from vpframe.scene import modelling
from vpframe.scene.scene import Part, Scene, Shape, Surface
from vpframe.session.session import Session

PITCH, HEIGHT = 2e-3, 4e-3  # m


def part(name: str, mesh: SurfaceMesh, height: float, fixed: bool) -> Part:
    surfaces = tuple(Surface(i, f"{name}/{i}", Freeform(), "free", 0.0, 1.0) for i in range(mesh.n_surfaces))
    pose = pin.SE3(np.eye(3), np.array([0.0, 0.0, height]))
    return Part(name, Shape(mesh, surfaces, (), closed=False), pose, fixed=fixed)


def bolt_and_nut(pitch: float = PITCH) -> Scene:
    here = pin.SE3.Identity()
    bolt, nut = helix(pitch, turns=8.0, pose=here), helix(pitch, turns=3.0, inside=True, pose=here)
    return Scene([part("bolt", bolt, 0.0, True), part("nut", nut, np.sign(pitch) * HEIGHT, False)])


def turned(session: Session) -> tuple[float, float]:
    """How far the nut has gone along z, and about it."""
    pose = session.scene["nut"].pose
    start = session.trail("nut")[0][1].translation[2]
    return float(pose.translation[2] - start), float(pin.log3(pose.rotation)[2])


HANDS = pytest.mark.parametrize("pitch", [PITCH, -PITCH], ids=["right-hand", "left-hand"])


@HANDS
def test_a_nut_that_is_turned_goes_along_its_thread(pitch: float) -> None:
    session = Session(bolt_and_nut(pitch))
    hand = session.hand(at=(0.0, 0.0, 0.05))
    hand.grab("nut")
    assert [c.kind for c in session.constraints] == ["screw"]
    assert session.pitch_of("nut") == pytest.approx(pitch, rel=2e-3)
    hand.turn(0.8 * np.pi, about=((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), required=False)
    along, about = turned(session)
    assert about == pytest.approx(0.8 * np.pi, abs=0.02)
    assert along == pytest.approx(pitch * about / (2.0 * np.pi), abs=2e-6)
    session.expect_freedom("nut", 1)
    assert session.joint("nut") == "screw"


@HANDS
def test_unscrewing_by_a_turn_leads_out_by_the_pitch_and_screwing_back(pitch: float) -> None:
    """Half a turn and a quarter: the sense of turning is the thread's, the advance pitch·angle/2π to 2e-6 m."""
    session = Session(bolt_and_nut(pitch))
    hand = session.hand(at=(0.0, 0.0, np.sign(pitch) * 0.05))
    hand.grab("nut")
    assert hand.unscrew(turns=0.4)
    out, about = turned(session)
    assert abs(about) == pytest.approx(0.8 * np.pi, abs=1e-3)
    assert out == pytest.approx(pitch * about / (2.0 * np.pi), abs=2e-6)
    assert out * np.sign(out_of(session)) > 0.0
    assert hand.screw(turns=0.4)
    assert turned(session) == pytest.approx((0.0, 0.0), abs=1e-5)


def out_of(session: Session) -> float:
    """Along z, from the bolt's middle to the nut's."""
    middles = []
    for name in ("bolt", "nut"):
        p = session.scene[name]
        z = p.mesh.vertices[:, 2] + p.pose.translation[2]
        middles.append(0.5 * (z.min() + z.max()))
    return float(middles[1] - middles[0])


@HANDS
def test_the_script_tells_the_hand_of_a_thread_that_is_no_geometry(pitch: float) -> None:
    """A smooth peg in a smooth bore: `thread` says the pitch, or the verb does; closed-form advance either way."""
    for told in (True, False):
        with Session(scene()) as session:
            peg = session.scene["peg"]
            hand = session.hand(at=peg.pose.translation + np.array([0.0, 0.0, 0.03]))
            hand.grab("peg")
            hand.move_to(SEAT + np.array([0.0, 0.0, 0.014]))
            hand.slide("down", until=constraint("concentric"))
            begin = peg.pose.copy()
            if told:
                session.thread("peg", pitch)
            assert hand.screw(turns=0.3, pitch=None if told else pitch)
            angle = pin.log3(begin.rotation.T @ peg.pose.rotation)[2]
            assert angle == pytest.approx(np.sign(-pitch) * 0.6 * np.pi, abs=1e-3)  # it goes down, against z
            advance = peg.pose.translation[2] - begin.translation[2]
            assert advance == pytest.approx(pitch * angle / (2.0 * np.pi), abs=1e-6) and advance < 0.0


def test_what_is_no_thread_is_said_to_be_none() -> None:
    with Session(scene()) as session:
        hand = session.hand(at=session.scene["peg"].pose.translation + np.array([0.0, 0.0, 0.03]))
        hand.grab("peg")
        with pytest.raises(TaskError, match="has no axis to go by"):
            hand.unscrew(pitch=PITCH)
        with pytest.raises(TaskError, match="no recognised thread holds peg"):
            hand.unscrew()
        for bad in ({"pitch": 0.0}, {"pitch": np.nan}, {"rate": 0.0}, {"turns": -1.0}, {"turns": np.inf}):
            with pytest.raises(TaskError, match="give"):
                hand.screw(**{"pitch": PITCH, **bad})
        for pitch in (0.0, np.nan, np.inf):
            with pytest.raises(TaskError, match="negative for a left-hand"):
                session.thread("peg", pitch)


@HANDS
def test_a_nut_unscrews_off_its_thread_by_itself(pitch: float) -> None:
    session = Session(bolt_and_nut(pitch))
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


@pytest.mark.parametrize(("friction", "stays"), [((Friction(0.15),), True), ((), True), ((Friction(0.01),), False)])
def test_a_nut_that_is_let_go_stays_if_friction_holds_it(friction: tuple[Friction, ...], stays: bool) -> None:
    """Put on by hand, turned, let go under gravity: a part that says nothing has μ = 0.5, as in contact."""
    bolt = modelling.shape(modelling.cylinder(0.008, 0.1), name="bolt")
    nut = modelling.shape(modelling.hexagon(0.024, 0.013) - modelling.cylinder(0.0081, 0.013), name="nut")
    above, on = (pin.SE3(np.eye(3), np.array([0.0, 0.0, z])) for z in (0.12, 0.08))
    scene = Scene([Part("bolt", bolt, pin.SE3.Identity(), fixed=True), Part("nut", nut, above)])
    shaft, bore = (next(s.index for s in scene[n].surfaces if s.geometry.kind == "cylinder") for n in ("bolt", "nut"))
    with Session(scene) as session:
        hand = session.hand()
        hand.grab("nut")
        hand.move_to(on, duration=0.5)
        session.constrain("screw", ("bolt", shaft), ("nut", bore), pitch=PITCH, flank=np.radians(30.0))
        hand.turn(np.pi, about=((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), required=False)
        assert session.scene["nut"].pose.translation[2] == pytest.approx(0.081, abs=1e-5)
        session.behave("nut", Gravity(), *friction)
        hand.release()
        before = session.scene["nut"].pose
        session.run(1.0)
        moved = before.actInv(session.scene["nut"].pose)
        if stays:
            assert np.array_equal(session.scene["nut"].pose.homogeneous, before.homogeneous)
            assert [e.kind for e in session.events][-1] == "landed"
        else:
            assert moved.translation[2] < -1e-3
            about = np.unwrap([0.0, float(pin.log3(moved.rotation)[2])])[1]
            turns = moved.translation[2] / PITCH - about / (2.0 * np.pi)
            assert turns == pytest.approx(round(turns), abs=1e-9)
        session.expect_freedom("nut", 1)
