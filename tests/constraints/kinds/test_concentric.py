"""`Concentric`: two surfaces of revolution on one axis."""

from constraints.kinds import Concentric
from tests.constraints.kinds.properties import AB, CIRCLES, CYLINDERS, LINES, KindProperties


class TestConcentric(KindProperties):
    cases = (
        ("concentric", Concentric(AB, CYLINDERS), 2),
        ("concentric opposed", Concentric(AB, CYLINDERS, sense=-1), 2),
        ("concentric of circle and line", Concentric(AB, (CIRCLES[0], LINES[1]), sense=1), 2),
    )
