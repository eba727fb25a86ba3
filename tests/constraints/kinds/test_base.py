"""What the base class refuses: bodies, features and parameters of which no constraint is made."""

import pytest

from constraints.errors import GeometryError
from constraints.kinds import Against, Angle, Concentric, Contact, Distance, Gear, RackAndPinion, Screw, Tangent
from tests.constraints.kinds.properties import AB, CONES, CYLINDERS, LINES, PLANES, POINTS, SPHERES, TORI


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: Against(AB, (PLANES[0], SPHERES[0])), "features[1]"),
        (lambda: Against((2, 2), PLANES), "bodies"),
        (lambda: Against(AB, PLANES, size=0.0), "size"),
        (lambda: Concentric(AB, CYLINDERS, sense=2), "sense"),
        (lambda: Tangent(AB, CYLINDERS, mode="beside"), "mode"),
        (lambda: Tangent(AB, (CYLINDERS[0], CYLINDERS[0]), mode="inside"), "mode"),
        (lambda: Tangent(AB, (CONES[0], TORI[0])), "features"),
        (lambda: Contact(AB, CYLINDERS), "features"),
        (lambda: Angle(AB, PLANES, at=0.0), "at"),
        (lambda: Angle(AB, PLANES, at=(0.4, 0.3)), "limits"),
        (lambda: Distance(AB, PLANES), "features"),
        (lambda: Distance(AB, POINTS, at=-1.0), "at"),
        (lambda: Distance(AB, POINTS, at=0.0), "at"),
        (lambda: Screw(AB, CYLINDERS, pitch=0.0), "pitch"),
        (lambda: Screw(AB, CYLINDERS, pitch=float("nan")), "parameters"),
        (lambda: Distance(AB, POINTS, at=float("nan")), "limits"),
        (lambda: Gear(AB, CYLINDERS, teeth_a=0), "teeth_a"),
        (lambda: Gear(AB, CYLINDERS, sense=0), "sense"),
        (lambda: RackAndPinion(AB, (CYLINDERS[0], LINES[0]), radius=-1.0), "radius"),
    ],
)
def test_a_constraint_that_cannot_be_is_refused_with_the_field_at_fault(make: object, field: str) -> None:
    with pytest.raises(GeometryError) as caught:
        make()
    assert caught.value.field == field
