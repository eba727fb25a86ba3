"""Lower pairs: what the twists that constraints leave are called, and their frames."""

from math import inf

import numpy as np
import pinocchio as pin
import pytest

from constraints.freedom.lower_pairs import name_joint
from constraints.freedom.mobility import mobility
from constraints.geometry.surfaces import Cone, Cylinder, Plane, Sphere, Torus
from constraints.kinds import (
    Against,
    Concentric,
    Conical,
    Constraint,
    Contact,
    Distance,
    Fixed,
    Line,
    Offset,
    Parallel,
    Point,
    Screw,
    Spherical,
    Toroidal,
)
from tests.constraints.problems import hinge

AB = (0, 1)


HOME = pin.SE3.Identity()


X, Y, Z = np.eye(3)


ORIGIN = np.zeros(3)


SHAFT = Cylinder(ORIGIN, Z, 0.01)


UP, DOWN = Plane(ORIGIN, Z), Plane(ORIGIN, -Z)


ASIDE = Plane(ORIGIN, X)


JOINTS = [
    ("rigid", [Fixed(AB, (Point(ORIGIN), Point(ORIGIN)))]),
    ("rigid", [Concentric(AB, (SHAFT, SHAFT)), Against(AB, (UP, DOWN)), Parallel(AB, (ASIDE, ASIDE))]),
    ("revolute", [Concentric(AB, (SHAFT, SHAFT)), Against(AB, (UP, DOWN))]),
    ("revolute", [Conical(AB, (Cone(ORIGIN, Z, 0.3), Cone(ORIGIN, Z, 0.3)))]),
    ("revolute", [Toroidal(AB, (Torus(ORIGIN, Z, 0.05, 0.01), Torus(ORIGIN, Z, 0.05, 0.01)))]),
    ("prismatic", [Concentric(AB, (SHAFT, SHAFT)), Parallel(AB, (ASIDE, ASIDE))]),
    ("prismatic", [Against(AB, (UP, DOWN)), Against(AB, (ASIDE, Plane(ORIGIN, -X)))]),
    ("screw", [Screw(AB, (SHAFT, SHAFT), pitch=2e-3)]),
    ("cylindrical", [Concentric(AB, (SHAFT, SHAFT))]),
    ("planar", [Against(AB, (UP, DOWN))]),
    ("planar", [Offset(AB, (UP, DOWN), at=0.0)]),
    ("spherical", [Spherical(AB, (Sphere(ORIGIN, 0.01), Sphere(ORIGIN, 0.01)))]),
    ("translational", [Parallel(AB, (UP, UP)), Parallel(AB, (ASIDE, ASIDE))]),
    ("2-dof", [Against(AB, (UP, DOWN)), Contact(AB, (Plane(ORIGIN, X), Point(ORIGIN)))]),
    ("4-dof", [Contact(AB, (Line(ORIGIN, X), Point(ORIGIN)))]),
    ("4-dof", [Parallel(AB, (UP, UP))]),
    ("5-dof", [Contact(AB, (UP, Point(ORIGIN)))]),
    ("free", [Distance(AB, (UP, Point(ORIGIN)), at=(-inf, 0.1))]),
]


@pytest.mark.parametrize(("joint", "constraints"), JOINTS, ids=[f"{j} {i}" for i, (j, _) in enumerate(JOINTS)])
def test_a_pair_is_named(joint: str, constraints: list[Constraint]) -> None:
    """Wherever the pair stands in the world, and for either of the two bodies held."""
    everywhere = pin.SE3(pin.exp3(np.array([0.4, -1.0, 0.3])), np.array([3.0, -2.0, 1.0]))
    degrees = {"rigid": 0, "revolute": 1, "prismatic": 1, "screw": 1, "cylindrical": 2}
    freedom = degrees.get(joint, 6 if joint == "free" else 3 if joint[1] != "-" else int(joint[0]))
    for fixed, moving in ((0, 1), (1, 0)):
        for base in (HOME, everywhere):
            found = mobility(constraints, [base, base], [fixed])
            part = found.parts[moving]
            assert (part.joint, part.freedom, part.finite) == (joint, freedom, freedom)
            assert found.freedom == found.finite == (freedom if joint != "free" else 0)
            if joint != "free":
                assert found.pairs[AB].joint == joint
            for constraint in constraints:
                if constraint.freedom == 6:
                    continue
                moved = constraint.jacobian(base, base)[moving] @ part.twists
                assert np.abs(moved).max(initial=0.0) < 1e-9  # the twists are allowed


def test_a_revolute_joint_tells_its_axis() -> None:
    bore = Cylinder([0.1, 0, 0], Z, 0.01)
    found = mobility([Concentric(AB, (bore, bore)), Against(AB, (UP, DOWN))], [HOME, HOME], [0])
    twist = found.parts[1].twists[:, 0]
    assert twist / twist[5] == pytest.approx([0, -0.1, 0, 0, 0, 1])


def test_a_universal_joint_is_two_hinges_that_meet_and_two_that_do_not_are_not() -> None:
    for offset, joint in ((0.0, "universal"), (0.02, "2-dof")):
        at = np.array([0.0, 0.0, offset])
        cross = hinge(0, 1, HOME, HOME, ORIGIN, X, 0.1) + hinge(1, 2, HOME, HOME, at, Y, 0.1)
        assert mobility(cross, [HOME] * 3, [0]).parts[2].joint == joint


def test_hinges_in_series_make_the_lower_pair_that_they_make() -> None:
    """Three parallel hinges: planar. Three that meet: spherical. Two parallel ones: nothing with a name."""
    points = [np.array(p) for p in ([0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0])]
    parallel = [c for i, p in enumerate(points) for c in hinge(i, i + 1, HOME, HOME, p, Z, 0.1)]
    found = mobility(parallel, [HOME] * 4, [0])
    assert [found.parts[b].joint for b in (1, 2, 3)] == ["revolute", "2-dof", "planar"]
    wrist = [c for i, d in enumerate((X, Y, Z)) for c in hinge(i, i + 1, HOME, HOME, ORIGIN, d, 0.1)]
    assert mobility(wrist, [HOME] * 4, [0]).parts[3].joint == "spherical"


def test_name_joint_of_spaces_of_twists() -> None:
    def space(*twists: list[float]) -> np.ndarray:
        return np.array(twists, dtype=float).T

    turn = [0, 0, 0, 0, 0, 1.0]
    assert name_joint(np.zeros((6, 0)), 1.0, 1e-6) == "rigid"
    assert name_joint(np.eye(6), 1.0, 1e-6) == "free"
    assert name_joint(space([1, 0, 0, 0, 0, 1]), 1.0, 1e-6) == "revolute"  # about an axis off the origin
    assert name_joint(space([0, 0, 0.1, 0, 0, 1]), 1.0, 1e-6) == "screw"
    assert name_joint(space([0, 0, 1, 0, 0, 0]), 1.0, 1e-6) == "prismatic"
    assert name_joint(space(turn, [0, 0, 1, 0, 0, 0]), 1.0, 1e-6) == "cylindrical"
    assert name_joint(space([0, 0, 0.3, 0, 0, 1], [0, 0, 1, 0, 0, 0]), 1.0, 1e-6) == "cylindrical"
    assert name_joint(space(turn, [1, 0, 0, 0, 0, 0]), 1.0, 1e-6) == "2-dof"
    assert name_joint(space([0, 0, 0.3, 0, 0, 1], [1, 0, 0, 0, 0, 0]), 1.0, 1e-6) == "2-dof"
    assert name_joint(space([1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0]), 1.0, 1e-6) == "2-dof"
    assert name_joint(space(turn, [1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0]), 1.0, 1e-6) == "planar"
    assert name_joint(space([0, 0, 0.3, 0, 0, 1], [1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0]), 1.0, 1e-6) == "3-dof"
    assert name_joint(space(turn, [0, 0, 0, 1, 0, 0]), 1.0, 1e-6) == "universal"
    assert name_joint(space(turn, [0, 0, 0.1, 1, 0, 0]), 1.0, 1e-6) == "2-dof"
    assert name_joint(space(turn, [0, 0, 0, 1, 0, 0], [0, 0, 0, 0, 1, 0]), 1.0, 1e-6) == "spherical"
