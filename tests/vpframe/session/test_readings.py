"""Gravity of a session; velocities and contacts that it tells."""

import numpy as np
import pinocchio as pin
import pytest

import vpframe as vp
from vpframe.scene import modelling

G = np.array([0.0, 0.0, -9.81])


def made() -> vp.Scene:
    at = [pin.SE3(np.eye(3), np.array([x, 0.0, z])) for x, z in ((0.0, -0.1), (0.0, 0.0), (0.3, 1.0), (0.6, 0.2))]
    box = modelling.box(0.06, 0.05, 0.04)
    scene = modelling.scene(
        {
            "floor": (modelling.box(2.0, 1.0, 0.1).translated(-1.0, -0.5, 0.0), at[0]),
            "box": (box, at[1]),
            "stone": (modelling.sphere(0.03), at[2]),
            "tool": (box, at[3]),
        },
        deflection=1e-3,
    )
    scene["floor"].fixed = True
    return scene


def test_gravity_pulls_what_has_mass_and_no_gravity_of_its_own() -> None:
    with vp.Session(made(), gravity=G) as session:
        session.behave("stone")
        session.behave("tool", vp.Gravity((0.0, 0.0, 0.0)))
        high = session.scene["stone"].pose.translation[2]
        session.run(0.2)
        np.testing.assert_allclose(session.velocity("stone").linear, G * 0.2, rtol=1e-12)
        np.testing.assert_allclose(session.scene["stone"].pose.translation[2] - high, 0.5 * G[2] * 0.04, rtol=1e-9)
        assert session.velocity("tool") == pin.Motion.Zero()
        assert session.scene["box"].pose.translation[2] == 0.0, "it was given no mass"


def test_there_is_no_gravity_unless_it_is_given() -> None:
    with vp.Session(made()) as session:
        session.behave("stone")
        session.run(0.1)
        assert session.velocity("stone") == pin.Motion.Zero()
    for wrong in ("down", (0.0, 1.0), (0.0, 0.0, np.nan)):
        with pytest.raises(vp.TaskError, match="gravity takes three finite numbers"):
            vp.Session(made(), gravity=wrong)


def test_a_box_on_the_floor_feels_its_weight() -> None:
    with vp.Session(made(), gravity=G, rule=vp.leave_all) as session:
        session.behave("box", vp.Friction(0.5), mass=2.0)
        session.run(0.1)
        contacts = session.contacts("box")
        assert {c.other for c in contacts} == {"floor"}
        np.testing.assert_allclose(sum(c.force for c in contacts), -2.0 * G, rtol=1e-6, atol=1e-6)
        for contact in contacts:
            np.testing.assert_allclose(contact.normal, (0.0, 0.0, 1.0), atol=1e-9)
            assert abs(contact.point[2]) < 1e-6


def test_what_a_hand_carries_has_its_velocity() -> None:
    with vp.Session(made(), rule=vp.leave_all) as session:
        hand = session.hand(at=(0.63, 0.025, 0.3))
        hand.grab("tool")
        seen = []
        session.on_event(lambda event: None)
        hand.move_by(
            (0.1, 0.0, 0.0), duration=1.0, until=vp.Condition("", lambda s, h: seen.append(0) or len(seen) > 30)
        )
        v = session.velocity("tool")
        before, now = (pose.translation for _, pose in session.trail("tool")[-2:])
        np.testing.assert_allclose(v.linear, (now - before) / session.dt, atol=1e-12)
        assert v.linear[0] > 0.1
        assert np.abs(v.angular).max() < 1e-9
        assert session.contacts("tool") == ()
        saved = session.save()
        session.run(0.1)
        assert session.velocity("tool") != v
        session.restore(saved)
        assert session.velocity("tool") == v


def test_what_a_hand_presses_down_touches_without_a_force() -> None:
    with vp.Session(made(), rule=vp.leave_all) as session:
        hand = session.hand(at=(0.63, 0.025, 0.3))
        hand.grab("tool")
        hand.slide("down", until=vp.contact)
        contacts = session.contacts("tool")
        assert {c.other for c in contacts} == {"floor"}
        assert all(c.force is None and c.normal @ (0.0, 0.0, 1.0) > 0.999 for c in contacts)


def test_a_material_says_how_a_part_rubs() -> None:
    tilted = (9.81 * np.sin(0.3), 0.0, -9.81 * np.cos(0.3))  # as on a slope of 0.3 rad, whose tangent is 0.309
    ends = []
    for friction in (0.2, 0.4):
        with vp.Session(made(), gravity=tilted, rule=vp.leave_all) as session:
            session.behave("box", material=vp.Material("felt", friction=friction, density=500.0))
            session.run(0.3)
            ends.append(session.scene["box"].pose.translation[0])
    assert ends[0] == pytest.approx(0.5 * 9.81 * (np.sin(0.3) - 0.2 * np.cos(0.3)) * 0.3**2, rel=1e-3)
    assert abs(ends[1]) < 1e-9
