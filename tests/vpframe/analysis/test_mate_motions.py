"""Motions that the fits and threads of a scene leave: out along an axis, no deeper, through nothing."""

import numpy as np
import pytest

import vpframe as vp
from tests.vpframe.fitted import key_in_slot, moved, pin_in_bore, wedge_in_plate
from tests.vpframe.planning.cases import CAPTIVE
from vpframe.scene.modelling import scene as scene_of
from vpframe.session import rules

FREED = [(pin_in_bore, "pin", "block"), (key_in_slot, "key", "block"), (wedge_in_plate, "plug", "plate")]


@pytest.mark.parametrize("rule", [rules.leave_all, rules.accept_all])
@pytest.mark.parametrize(("parts", "part", "other"), FREED)
def test_an_authorised_overlap_comes_out_along_its_axis_and_no_other_way(parts, part, other, rule):
    scene = scene_of(parts())
    with vp.Session(scene, rule=rule) as session:
        session.authorise(part, other)
        session.step()
        session.expect_no_clash()
        home = scene[part].pose.translation.copy()
        for way in ((0.002, 0.0, 0.0), (0.0, -0.002, 0.0), (0.001, 0.001, 0.004)):
            outcome = moved(session, part, way)
            assert not outcome and f"{other} stands in its way" in outcome.reason, outcome.reason
            assert np.linalg.norm(scene[part].pose.translation - home) <= 2e-6
        assert moved(session, part, (0.0, 0.0, 0.03))
        assert moved(session, part, (0.03, 0.0, 0.0)), "free of each other"
        fits = parts is pin_in_bore  # any other overlap only shrinks: it is not entered again
        assert moved(session, part, (-0.03, 0.0, 0.0)) and bool(moved(session, part, (0.0, 0.0, -0.03))) is fits
        session.expect_no_clash()
        assert session.ignored == []


@pytest.mark.parametrize(("parts", "part", "other"), FREED[:2])
def test_an_authorised_overlap_is_not_deepened(parts, part, other):
    scene = scene_of(parts())
    with vp.Session(scene, rule=rules.leave_all) as session:
        session.authorise(other, part)
        outcome = moved(session, part, (0.0, 0.0, -0.002))
        assert not outcome and f"{other} stands in its way" in outcome.reason
        assert abs(scene[part].pose.translation[2]) <= 2e-6


@pytest.mark.parametrize(("parts", "part", "other"), CAPTIVE)
def test_a_captive_part_does_not_leave_through_an_authorised_one(parts, part, other):
    scene = scene_of(parts())
    with vp.Session(scene, rule=rules.leave_all) as session:
        session.authorise(part, other)
        for way in ((0.03, 0.0, 0.0), (0.0, 0.0, 0.06), (0.0, 0.0, -0.06)):
            assert not moved(session, part, way)
        session.expect_no_clash()
