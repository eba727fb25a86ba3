"""`Groove`: a ball in a groove."""

from constraints.kinds import Groove
from tests.constraints.kinds.properties import AB, CIRCLES, CYLINDERS, POINTS, SPHERES, TORI, KindProperties


class TestGroove(KindProperties):
    cases = (
        ("groove straight", Groove(AB, (CYLINDERS[0], SPHERES[1])), 4),
        ("groove ring", Groove(AB, (SPHERES[0], TORI[1])), 4),
        ("groove of circle and point", Groove(AB, (CIRCLES[0], POINTS[1])), 4),
    )
