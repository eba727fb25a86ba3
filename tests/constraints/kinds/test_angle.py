"""`Angle`: directions at an angle."""

from constraints.kinds import Angle
from tests.constraints.kinds.properties import AB, CYLINDERS, PLANES, KindProperties


class TestAngle(KindProperties):
    cases = (
        ("angle", Angle(AB, (CYLINDERS[0], PLANES[1]), at=0.7), 5),
        ("angle with limits", Angle(AB, PLANES, at=(0.3, 0.4)), 6),
    )
