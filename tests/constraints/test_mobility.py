"""Freedom of single joints against what the textbook says of them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from constraints.geometry import Cylinder, Plane
from constraints.kinds import Against, Concentric
from constraints.mobility import mobility

BORE = Cylinder([0.1, 0.0, 0.0], [0, 0, 1], 0.01)


def test_a_shaft_in_a_bore_is_cylindrical_and_its_flange_makes_it_revolute() -> None:
    poses = [pin.SE3.Identity(), pin.SE3.Identity()]
    concentric = Concentric((0, 1), (BORE, BORE))
    against = Against((0, 1), (Plane([0, 0, 0], [0, 0, 1]), Plane([0, 0, 0], [0, 0, -1])))
    assert mobility([], poses, [0]).parts[1].joint == "free"
    planar = mobility([against], poses, [0]).parts[1]
    assert (planar.freedom, planar.joint) == (3, "planar")
    cylindrical = mobility([concentric], poses, [0])
    assert (cylindrical.parts[1].freedom, cylindrical.parts[1].joint) == (2, "cylindrical")
    revolute = mobility([concentric, against], poses, [0])
    assert (revolute.parts[1].freedom, revolute.parts[1].joint) == (1, "revolute")
    assert revolute.pairs[0, 1].joint == "revolute"
    twist = revolute.parts[1].twists[:, 0]
    twist = twist / twist[5]
    assert np.allclose(twist, [0, -0.1, 0, 0, 0, 1])  # about z through x = 0.1
