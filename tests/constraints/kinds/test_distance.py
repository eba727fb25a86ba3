"""`Distance`: features at a distance."""

from constraints.kinds import Distance
from tests.constraints.kinds.properties import AB, CYLINDERS, LINES, PLANES, POINTS, KindProperties


class TestDistance(KindProperties):
    cases = (
        ("distance plane point", Distance(AB, (PLANES[0], POINTS[1]), at=-0.1), 5),
        ("distance point axis", Distance(AB, (POINTS[0], CYLINDERS[1]), at=0.1), 5),
        ("distance axes", Distance(AB, LINES, at=0.1), 5),
        ("distance axes that meet", Distance(AB, LINES, at=0.0), 5),
        ("distance points", Distance(AB, POINTS, at=0.1), 5),
        ("distance with limits", Distance(AB, POINTS, at=(0.1, 0.12)), 6),
    )
