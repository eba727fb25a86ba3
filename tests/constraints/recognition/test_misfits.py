"""Shafts and bores that overlap and are no fit."""

import numpy as np
import pinocchio as pin
import pytest

from vpframe import Part, Scene, Session
from vpframe.errors import TaskError
from vpframe.scene import modelling
from vpframe.scene.modelling import box, cylinder
from vpframe.session import rules

HERE = pin.SE3.Identity()


def out_and_back(
    scene: Scene, held: str, way: tuple[float, float, float], rule: rules.Rule = rules.accept_all
) -> float:
    """Deviation (m and rad) of a part after it was moved by `way`, m, and back."""
    start = pin.SE3(scene[held].pose)
    with Session(scene, rule=rule) as session:
        hand = session.hand()
        hand.grab(held)
        assert hand.move_by(way)
        back = hand.move_to(start)
        assert back.reason == "arrived"
        off = start.actInv(scene[held].pose)
        return float(np.linalg.norm(off.translation) + np.linalg.norm(pin.log3(off.rotation)))


@pytest.mark.parametrize("rule", [rules.leave_all, rules.accept_all])
@pytest.mark.parametrize("off", [3e-6, 6e-6])
def test_a_cover_with_holes_beside_its_pins_comes_back_to_where_it_was_drawn(off: float, rule: rules.Rule) -> None:
    """No pose satisfies both fits; as drawn they hold. Pins reach into their holes by facets that lie parallel."""
    assert out_and_back(cover_on_pins(off), "cover", (0.0, 0.0, 0.03), rule) < 1e-12


@pytest.mark.parametrize("rule", [rules.leave_all, rules.accept_all])
def test_a_cover_whose_holes_are_beside_its_pins_by_more_than_a_press_fit_stays(rule: rules.Rule) -> None:
    with pytest.raises(TaskError, match=r"cover and plate overlap by 0\.0283 mm as drawn"):
        out_and_back(cover_on_pins(2e-5), "cover", (0.0, 0.0, 0.03), rule)


def cover_on_pins(off: float) -> Scene:
    """A fixed plate with two pins, and a cover whose holes lie beside them by √2 · off (m)."""
    plate, cover = box(0.06, 0.03, 0.005).translated(-0.03, -0.015, -0.005), box(0.06, 0.03, 0.005)
    cover = cover.translated(-0.03, -0.015)
    for x in (-0.02, 0.02):
        plate = plate + cylinder(0.003, 0.01).translated(x)
        cover = cover - cylinder(0.003, 0.01).translated(x + np.sign(x) * off, off)
    parts = [Part("plate", modelling.shape(plate), HERE), Part("cover", modelling.shape(cover), HERE)]
    parts[0].fixed = True
    return Scene(parts)
