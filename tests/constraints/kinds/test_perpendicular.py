"""`Perpendicular`: directions at right angles."""

from constraints.kinds import Perpendicular
from tests.constraints.kinds.properties import AB, PLANES, KindProperties


class TestPerpendicular(KindProperties):
    cases = (("perpendicular", Perpendicular(AB, PLANES), 5),)
