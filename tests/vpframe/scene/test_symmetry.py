"""What can be seen of a rotation: known groups, and a part turned where it lies."""

import numpy as np
import pinocchio as pin
import pytest

from vpframe.errors import TaskError
from vpframe.scene import modelling as m
from vpframe.scene.scene import Part, Scene
from vpframe.scene.symmetry import symmetry_of
from vpframe.session.session import Session


def prism(n: int, radius: float, height: float):
    angles = 2.0 * np.pi * np.arange(n) / n
    return m.extrude([(radius * np.cos(a), radius * np.sin(a)) for a in angles], height)


def nut():
    return prism(6, 0.010, 0.008) - m.cylinder(0.005, 0.008)


def keyed():
    """A shaft with a key of 0.5 mm."""
    return m.cylinder(0.01, 0.05) + m.box(0.0005, 0.003, 0.05).translated(0.0099, -0.0015, 0.0)


def slotted():
    """A screw whose slot runs through the middle of its head."""
    head = m.cylinder(0.005, 0.003) - m.box(0.02, 0.001, 0.001).translated(-0.01, -0.0005, 0.002)
    return head + m.cylinder(0.0025, 0.02).translated(0.0, 0.0, -0.02)


def plate(holes: int):
    made = m.box(0.08, 0.08, 0.005).translated(-0.04, -0.04, 0.0)
    for k in range(holes):
        a = 0.5 * np.pi * k + 0.25 * np.pi
        made = made - m.cylinder(0.003, 0.005).translated(0.03 * np.cos(a), 0.03 * np.sin(a), 0.0)
    return made


TILT = pin.exp3(np.array([0.4, -0.9, 0.3]))
GROUPS = {
    "box": (lambda: m.box(0.01, 0.02, 0.03), 4, 0),
    "cube": (lambda: m.box(0.02, 0.02, 0.02), 24, 0),
    "square plate": (lambda: m.box(0.02, 0.02, 0.004), 8, 0),
    "nut": (nut, 12, 0),
    "seven-sided": (lambda: prism(7, 0.01, 0.03), 14, 0),
    "cylinder": (lambda: m.cylinder(0.01, 0.05), 2, 1),
    "ring with fillets": (
        lambda: (m.cylinder(0.019, 0.009) - m.cylinder(0.015, 0.009)).filleted(
            0.0006, lambda p: np.hypot(p[0], p[1]) > 0.018
        ),
        2,
        1,
    ),
    "cone": (lambda: m.revolve([(0.0, 0.0), (0.01, 0.0), (0.004, 0.02), (0.0, 0.02)]), 1, 1),
    "ball": (lambda: m.sphere(0.01), 1, 2),
    "keyed shaft": (keyed, 2, 0),
    "slotted screw": (slotted, 2, 0),
    "plate, four holes": (lambda: plate(4), 8, 0),
    "plate, three holes": (lambda: plate(3), 2, 0),
    "plate, one hole": (lambda: plate(1), 2, 0),
    "wedge": (lambda: m.extrude([(0.0, 0.0), (0.03, 0.0), (0.0, 0.01)], 0.02), 1, 0),
    "box with a chip off": (
        lambda: m.box(0.01, 0.02, 0.03) - m.box(0.002, 0.003, 0.004).translated(0.008, 0.017, 0.026),
        1,
        0,
    ),
}


@pytest.mark.parametrize("tilted", [False, True])
@pytest.mark.parametrize("name", GROUPS)
def test_the_group_of_a_part_is_known(name: str, tilted: bool) -> None:
    make, order, axes = GROUPS[name]
    solid = make()
    if tilted:
        solid = solid.moved(pin.SE3(TILT, np.array([0.1, 0.2, -0.3])))
    found = symmetry_of(m.shape(solid, name=name))
    assert (len(found.axes), len(found.rotations) if len(found.axes) < 2 else 1) == (axes, order)
    for rotation in found.rotations:
        assert found.angle(rotation) < 1e-6
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)


def test_the_angle_is_the_least_that_shows() -> None:
    found = symmetry_of(m.shape(nut(), name="nut"))
    for degrees, seen in ((60.0, 0.0), (96.0, 24.0), (80.0, 20.0), (-30.0, 30.0), (180.0, 0.0)):
        turned = pin.exp3(np.array([0.0, 0.0, np.radians(degrees)]))
        assert np.degrees(found.angle(turned)) == pytest.approx(seen, abs=1e-6)
    shaft = symmetry_of(m.shape(m.cylinder(0.01, 0.05), name="shaft"))
    for axis, seen in (
        ((0.0, 0.0, 1.3), 0.0),
        ((0.7, 0.0, 0.0), 0.7),
        ((np.pi, 0.0, 0.0), 0.0),
        ((3.0, 0.0, 0.0), np.pi - 3.0),
    ):
        assert shaft.angle(pin.exp3(np.array(axis))) == pytest.approx(seen, abs=1e-9)


def at_home() -> tuple[Session, pin.SE3]:
    """A nut whose file has its origin 25 mm beside its axis."""
    shape = m.shape(nut().translated(0.025, 0.0, 0.0), name="nut")
    session = Session(Scene([Part("nut", shape, pin.SE3(TILT, np.array([0.1, 0.0, 0.0])))]))
    session.step()
    session.close()  # so that its pose can be set
    return session, pin.SE3(session.scene["nut"].pose)


def turned(home: pin.SE3, degrees: float) -> pin.SE3:
    """The nut turned about its own axis."""
    centre = np.array([0.025, 0.0, 0.004])
    about = pin.exp3(np.array([0.0, 0.0, np.radians(degrees)]))
    return home * pin.SE3(about, centre - about @ centre)


def test_a_nut_turned_on_its_own_axis_is_where_it_was() -> None:
    session, home = at_home()
    session.scene["nut"].pose = turned(home, 96.0)
    assert np.linalg.norm(turned(home, 96.0).translation - home.translation) > 0.03, "its origin is not"
    session.expect_at("nut", home, within=1e-9, angle=np.radians(24.001))
    session.expect_at("nut", home.translation, within=1e-9)
    text = r"centre is 0\.000 mm off, it is turned by 24\.00° from the nearest pose that looks the same\)"
    with pytest.raises(TaskError, match=text):
        session.expect_at("nut", home)
    session.scene["nut"].pose = turned(home, 120.0)
    session.expect_at("nut", home, within=1e-9)


def test_a_part_that_is_elsewhere_or_turned_is_told() -> None:
    session, home = at_home()
    session.scene["nut"].pose = pin.SE3(home.rotation, home.translation + np.array([0.0, 0.0, 0.002]))
    with pytest.raises(
        TaskError, match=r"nut within 1 mm of its place \(its centre is 2\.000 mm off, it is turned by 0\.00°\)"
    ):
        session.expect_at("nut", home)
    with pytest.raises(TaskError, match=r"its centre is 2\.000 mm off; rotation is not compared\)"):
        session.expect_at("nut", home.translation)
    session.scene["nut"].pose = home * pin.SE3(pin.exp3(np.array([0.3, 0.0, 0.0])), np.zeros(3))
    with pytest.raises(TaskError, match=r"it is turned by 17\.19°"):
        session.expect_at("nut", home, within=1.0)
