"""What a stranger to the package may get wrong: one clear line that names the culprit, and never a wrong answer."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from collision import CONTACT_DTYPE, Tolerance
from constraints import (
    Against,
    Angle,
    Concentric,
    ConstraintManager,
    ConstraintsError,
    Distance,
    Gear,
    GeometryError,
    Parallel,
    Point,
    RackAndPinion,
    Screw,
    recognise,
    solve,
)
from constraints.freedom.graph import AssemblyGraph
from constraints.freedom.mobility import mobility
from constraints.geometry.surfaces import Cylinder, Freeform, Plane

Z = [0.0, 0.0, 1.0]
UP, DOWN = Plane([0, 0, 0], Z), Plane([0, 0, 0], [0, 0, -1.0])
PIN = Cylinder([0, 0, 0], Z, 0.01)
POINTS = (Point([0, 0, 0]), Point([0, 0, 0]))
HOME = pin.SE3.Identity()
FACES = Against((0, 1), (UP, DOWN))
NONE = np.zeros(0, dtype=CONTACT_DTYPE)
MADE = {
    "a body without an id": (lambda: Against((0, -1), (UP, DOWN)), "bodies are"),
    "three bodies": (lambda: Against((0, 1, 2), (UP, DOWN)), "bodies are"),
    "a body by half": (lambda: Against((0, 1.5), (UP, DOWN)), "bodies are"),
    "a body with itself": (lambda: Against((1, 1), (UP, DOWN)), "with itself"),
    "one feature": (lambda: Against((0, 1), (UP,)), "features are"),
    "three features": (lambda: Against((0, 1), (UP, DOWN, UP)), "features are"),
    "a feature that is none": (lambda: Against((0, 1), (UP, "face")), "feature b is 'face'; give a plane"),
    "a feature of no type": (lambda: Against((0, 1), (UP, Freeform())), "feature b is a freeform; give a plane"),
    "no radius": (lambda: Cylinder([0, 0, 0], Z, 0.0), "radius is 0.0"),
    "a radius in words": (lambda: Cylinder([0, 0, 0], Z, "10 mm"), "radius is '10 mm'"),
    "a radius that is none": (lambda: Cylinder([0, 0, 0], Z, None), "radius is None"),
    "an axis without direction": (lambda: Cylinder([0, 0, 0], [0, 0, 0], 0.01), "axis is the zero vector"),
    "an origin in words": (lambda: Plane("here", Z), "origin is 'here'"),
    "an origin of two": (lambda: Plane([0, 0], Z), "origin is"),
    "a size in words": (lambda: Against((0, 1), (UP, DOWN), size="big"), "size is 'big'"),
    "no size": (lambda: Against((0, 1), (UP, DOWN), size=0.0), "size is 0.0"),
    "a distance in words": (lambda: Distance((0, 1), POINTS, at="far"), "parameter is not a number"),
    "an infinite distance": (lambda: Distance((0, 1), POINTS, at=np.inf), "not a finite number"),
    "limits as a list": (lambda: Distance((0, 1), (UP, POINTS[1]), at=[1.0, 2.0]), "limits are"),
    "an angle beyond a half turn": (lambda: Angle((0, 1), (UP, UP), at=10.0), "between 0 and π"),
    "a sense in words": (lambda: Parallel((0, 1), (UP, UP), sense="up"), "sense is 'up'"),
    "an infinite pitch": (lambda: Screw((0, 1), (PIN, PIN), pitch=np.inf), "not a finite number"),
    "a pitch in words": (lambda: Screw((0, 1), (PIN, PIN), pitch="M16"), "not a number"),
    "teeth that are no number": (lambda: Gear((0, 1), (PIN, PIN), teeth_a=np.nan), "not a number"),
    "a distance beyond the stars": (lambda: Distance((0, 1), POINTS, at=1e154), "a parameter is 1e.154; give one of"),
    "a pitch beyond the stars": (lambda: Screw((0, 1), (PIN, PIN), pitch=-1e200), "a parameter is 1e.200; give one of"),
    "limits beyond the stars": (
        lambda: Distance((0, 1), POINTS, at=(0.0, 1e160)),
        "a parameter is 1e.160; give one of",
    ),
    "a radius beyond the stars": (lambda: Cylinder([0, 0, 0], Z, 1e155), "radius is 1e.155; give one of at most"),
    "an origin beyond the stars": (lambda: Plane([0, 1e300, 0], Z), "origin is .* give coordinates of at most"),
    "a point beyond the stars": (lambda: Point([0, -1e154, 0]), "origin is|center is|position is|point is"),
    "a size beyond the stars": (lambda: Against((0, 1), (UP, DOWN), size=1e200), "size is 1e.200; give one of"),
    "half a tooth": (lambda: RackAndPinion((0, 1), (PIN, UP), teeth=7.5), "whole number of teeth"),
}


@pytest.mark.parametrize("name", MADE)
def test_what_makes_no_constraint(name: str) -> None:
    make, words = MADE[name]
    with pytest.raises(GeometryError, match=words):
        make()


def at(*point: float) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array(point))


POSES = {
    "not a number": (at(0, np.nan, 0), "body 1 is not finite"),
    "infinite": (at(0, np.inf, 0), "body 1 is not finite"),
    "scaled": (pin.SE3(2.0 * np.eye(3), np.zeros(3)), "body 1 is no rigid motion"),
    "mirrored": (pin.SE3(np.diag([1.0, 1.0, -1.0]), np.zeros(3)), "body 1 is no rigid motion"),
    "a matrix": (np.eye(4), "body 1 is a ndarray; pass a pinocchio.SE3"),
    "missing": (None, "body 1 is a NoneType"),
    "beyond the stars": (at(0, 1e160, 0), "body 1 is farther away than"),
}


@pytest.mark.parametrize("name", POSES)
@pytest.mark.parametrize("movable", [0, 1])
def test_a_pose_that_is_none(name: str, movable: int) -> None:
    pose, words = POSES[name]
    for call in (
        lambda: solve([FACES], [HOME, pose], [movable]),
        lambda: mobility([FACES], [HOME, pose], [1 - movable]),
    ):
        with pytest.raises(ConstraintsError, match=words):
            call()


def test_bodies_that_are_not_there() -> None:
    stray = Against((0, 5), (UP, DOWN))
    with pytest.raises(ConstraintsError, match="body 5, which has no pose"):
        solve([stray], [HOME, HOME], [5])
    with pytest.raises(ConstraintsError, match="body 5, which has no pose"):
        mobility([stray], [HOME, HOME], [0])
    with pytest.raises(ConstraintsError, match="body 9 is said to be fixed"):
        mobility([FACES], [HOME, HOME], [9])
    with pytest.raises(ConstraintsError, match="1 poses for 2 bodies"):
        ConstraintManager([(), ()]).update([HOME], NONE)


def test_a_kind_that_recognition_does_not_know_is_named() -> None:
    for call in (lambda: recognise([], [], NONE, kinds=["concentrik"]), lambda: ConstraintManager([], kinds=["gear"])):
        with pytest.raises(ConstraintsError, match=r"no kind '(concentrik|gear)'; give some of against, concentric"):
            call()


def test_what_is_not_a_number_is_not_taken_for_solved() -> None:
    assert np.isnan(FACES.residual(HOME, at(0, 0, np.nan))).any()
    within = Distance((0, 1), (UP, POINTS[1]), at=(0.0, 1.0))
    assert np.isnan(within.residual(HOME, at(0, 0, np.nan))).all()
    assert within.residual(HOME, at(0, 0, 1.0)) == 0.0 and within.residual(HOME, at(0, 0, 1.5)) == pytest.approx(0.5)


def test_ten_kilometres_are_solved_to_the_rounding_of_their_coordinates() -> None:
    faces = Plane([0, 0, 1e4], Z), Plane([0, 1e4, 0], [0, -1.0, 0])
    shafts = Cylinder([1e4, 0, 0], Z, 5e3), Cylinder([0, 1e4, 0], [0, 1.0, 0], 5e3)
    two = [Concentric((0, 1), shafts, size=5e3), Against((0, 1), faces, size=5e3)]
    start = pin.SE3(pin.exp3(np.array([0.4, 0.2, -0.3])), np.array([9e3, 1e3, 2e4]))
    solution = solve(two, [HOME, start], [1])
    assert solution.converged and solution.residual < 4 * 2.0**-52 * 4e4


def test_a_solver_tolerance_of_nought_ends_at_rounding() -> None:
    start = pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.0])), np.array([0.0, 0.0, 0.1]))
    solution = solve([FACES], [HOME, start], [1], replace(Tolerance(), solver=0.0))
    assert solution.residual < 1e-15


def test_the_rigidity_asked_for_is_that_of_the_tolerance_given() -> None:
    strained = pin.SE3(np.diag([1.0, 1.0, 1.0 + 1e-4]), np.zeros(3))
    lenient, strict = Tolerance(rigid=1e-3), Tolerance(rigid=1e-12)
    nearly = pin.SE3(np.diag([1.0, 1.0, 1.0 + 1e-9]), np.zeros(3))
    two = [FACES, Against((0, 1), (UP, DOWN))]
    for call in (
        lambda pose, tolerance: solve([FACES], [HOME, pose], [1], tolerance),
        lambda pose, tolerance: mobility(two, [HOME, pose], [0], tolerance).redundant,
        lambda pose, tolerance: AssemblyGraph.of(two, [HOME, pose], [0], tolerance=tolerance).links,
    ):
        call(strained, lenient)
        call(nearly, Tolerance())
        for pose, tolerance in ((strained, Tolerance()), (nearly, strict)):
            with pytest.raises(ConstraintsError, match="body 1 is no rigid motion"):
                call(pose, tolerance)
