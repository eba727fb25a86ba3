"""`Gear`: two wheels in mesh."""

import numpy as np
import pinocchio as pin
import pytest

from constraints.geometry.surfaces import Cylinder
from constraints.kinds import Belt, Gear
from tests.constraints.kinds.properties import AB, CYLINDERS, KindProperties


class TestGear(KindProperties):
    cases = (
        ("gear", Gear(AB, CYLINDERS, teeth_a=2, teeth_b=3), 5),
        ("gear internal", Gear(AB, CYLINDERS, teeth_a=2, teeth_b=3, sense=-1), 5),
    )


def test_a_gear_pair_turns_by_its_teeth_and_a_planet_rolls_on_its_carrier() -> None:
    wheels = Cylinder([0, 0, 0], [0, 0, 1], 0.02), Cylinder([0, 0, 0], [0, 0, 1], 0.01)
    b0 = pin.SE3(np.eye(3), np.array([0.03, 0, 0]))
    gear = Gear(AB, wheels, teeth_a=40, teeth_b=20).engaged(pin.SE3.Identity(), b0)
    spin = lambda angle: pin.SE3(pin.exp3(np.array([0, 0, angle])), np.zeros(3))  # noqa: E731
    for turn in (0.02, 0.3, 2.0, 7.0):
        assert gear.residual(spin(turn), b0 * spin(-2 * turn))[0] == pytest.approx(0, abs=1e-12)
        assert gear.residual(spin(0.0), spin(turn) * b0 * spin(2 * turn))[0] == pytest.approx(0, abs=1e-12)
    assert abs(gear.residual(spin(0.02), b0)[0]) == pytest.approx(0.02, abs=1e-12)
    belt = Belt(AB, wheels, teeth_a=40, teeth_b=20).engaged(pin.SE3.Identity(), b0)
    assert belt.residual(spin(0.3), b0 * spin(0.6))[0] == pytest.approx(0, abs=1e-12)
