"""Contradictions and repetitions in the user's terms, on assemblies made by hand."""

import numpy as np
import pinocchio as pin
import pytest

from constraints import solve
from constraints.freedom.mobility import mobility
from constraints.geometry.surfaces import Cylinder, Plane
from constraints.kinds import Against, Angle, Concentric, Coplanar, Distance, Offset, Parallel, Point

NAMES = {0: "plate", 1: "spacer", 2: "ring", 3: "pin"}
Z = np.array([0.0, 0.0, 1.0])


def at(*point: float) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array(point))


def face(height: float, up: float = 1.0) -> Plane:
    return Plane([0, 0, height], up * Z)


def hole(x: float, y: float = 0.0) -> Cylinder:
    return Cylinder([x, y, 0], Z, 0.004)


def stack(height: float) -> list:
    """A spacer of 10 mm, a ring of 20 mm and a pin, whose sole shall stand `height` above the plate."""
    return [
        Against((0, 1), (face(0.0), face(0.0, -1.0))),
        Against((1, 2), (face(0.01), face(0.0, -1.0))),
        Against((2, 3), (face(0.02), face(0.0, -1.0))),
        Offset((0, 3), (face(0.0), face(0.0, -1.0)), at=height),
        Concentric((0, 3), (hole(0.0), hole(0.0))),
    ]


STACKED = [at(0, 0, 0), at(0, 0, 0), at(0, 0, 0.01), at(0, 0, 0.03)]


def test_a_stack_that_does_not_fill_its_height() -> None:
    (conflict,) = mobility(stack(0.0304), STACKED, [0], names=NAMES).conflicting
    assert conflict.constraints == (0, 1, 2, 3)  # the concentric has no part in it
    assert conflict.off == pytest.approx(4e-4, rel=1e-4) and conflict.unit == "m"
    assert conflict.text == (
        "these four cannot hold together: off by 0.4 mm: against between plate and spacer, "
        "against between spacer and ring, against between ring and pin and offset between plate and pin"
    )


def test_a_stack_that_does_has_one_constraint_to_spare() -> None:
    found = mobility(stack(0.03), STACKED, [0], names=NAMES)
    assert found.conflicting == ()
    offset = found.redundant[0]
    assert offset.wholly and offset.by == (0, 1, 2)
    assert offset.text == (
        "offset between plate and pin is implied by against between plate and spacer, against between spacer and ring "
        "and against between ring and pin"
    )


def test_three_distances_that_make_no_triangle() -> None:
    centre = (Point([0, 0, 0]), Point([0, 0, 0]))
    sides = [Distance((0, 1), centre, at=0.1), Distance((1, 2), centre, at=0.1), Distance((0, 2), centre, at=0.2004)]
    (conflict,) = mobility(sides, [at(0, 0, 0), at(0.1, 1e-3, 0), at(0.2, 0, 0)], [0]).conflicting
    assert conflict.text.startswith("these three cannot hold together: off by 0.4 mm: ")
    assert conflict.constraints == (0, 1, 2)


def test_two_contradictions_are_told_apart_and_the_wider_one_first() -> None:
    point = (Point([0, 0, 0]), Point([0, 0, 0]))
    both = [*stack(0.0304), Distance((0, 1), point, at=0.2), Distance((0, 1), point, at=0.21)]
    poses = [at(0, 0, 0), at(0.2, 0, 0), *STACKED[2:]]
    wide, narrow = mobility(both, poses, [0], names=NAMES).conflicting
    assert wide.constraints == (5, 6) and wide.off == pytest.approx(0.01, rel=1e-4)
    assert narrow.constraints == (0, 1, 2, 3) and narrow.off == pytest.approx(4e-4, rel=1e-4)


def test_angles_are_told_in_degrees() -> None:
    faces = (Plane([0, 0, 0], Z), Plane([0, 0, 0], Z))
    two = [Angle((0, 1), faces, at=np.radians(30.0)), Angle((0, 1), faces, at=np.radians(31.5))]
    (conflict,) = mobility(two, [at(0, 0, 0), at(0, 0, 0)], [0], names=NAMES).conflicting
    assert conflict.unit == "rad" and conflict.off == pytest.approx(np.radians(1.5), rel=1e-4)
    assert "off by 1.5°" in conflict.text


def test_a_hole_that_is_off_is_in_every_conflict() -> None:
    holes = [(0.05, 0.0, 0.0), (-0.05, 0.0, 4e-4), (0.0, 0.05, 0.0)]
    constraints = [
        Against((0, 1), (face(0.0), face(0.0, -1.0))),
        *(Concentric((0, 1), (hole(x, y), hole(x - off, y)), ((i,), (i,))) for i, (x, y, off) in enumerate(holes)),
    ]
    conflicts = mobility(constraints, [at(0, 0, 0), at(0, 0, 0)], [0], names=NAMES).conflicting
    assert {c.constraints for c in conflicts} == {(1, 2), (2, 3)}
    assert conflicts[0].off == pytest.approx(4e-4, rel=1e-3)
    assert "concentric between plate and spacer (faces 1 and 1)" in conflicts[0].text


@pytest.mark.parametrize("tilt", [0.0, 1e-9, 1e-6, 1e-3, 0.1])
@pytest.mark.parametrize("head", [Against, Coplanar])
def test_a_bolt_upside_down_is_turned_over_and_no_contradiction(tilt: float, head: type) -> None:
    """Across its hole the concentric pulls one way and the head's face the other: no solution, and no conflict."""
    down = face(0.0, 1.0 if head is Against else -1.0)
    bolt = [head((0, 3), (face(0.0), down)), Concentric((0, 3), (hole(0.0), hole(0.0)))]
    poses = {0: at(0, 0, 0), 3: pin.SE3(pin.exp3(np.array([tilt, 0.0, 0.0])), np.array([0.0, 0.0, 0.03]))}
    solution = solve(bolt, poses, [3])
    assert solution.converged and solution.residual < 1e-12
    assert mobility(bolt, poses, [0]).conflicting == ()


def test_where_the_solver_gets_stuck_only_true_contradictions_are_named() -> None:
    point = (Point([0, 0, 0]), Point([0, 0, 0]))
    constraints = [
        Offset((0, 3), (face(0.0), face(0.0)), at=0.03),  # upside down at the start
        Concentric((0, 3), (hole(0.0), hole(0.0))),
        Parallel((0, 3), (Plane([0, 0, 0], [1, 0, 0]), Plane([0, 0, 0], [1, 0, 0]))),
        Distance((0, 1), point, at=0.2),
        Distance((0, 1), point, at=0.21),
        Distance((1, 3), point, at=0.2),
    ]
    poses = {0: at(0, 0, 0), 1: at(0.2, 0, 0), 3: at(0, 0, 0.03)}
    conflicts = mobility(constraints, poses, [0], names=NAMES).conflicting
    assert [c.constraints for c in conflicts] == [(3, 4)]
    assert all(c.off > 1e-7 for c in conflicts)
