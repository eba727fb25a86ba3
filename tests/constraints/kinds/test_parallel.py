"""`Parallel`: parallel directions."""

from constraints.kinds import Parallel
from tests.constraints.kinds.properties import AB, CYLINDERS, PLANES, KindProperties


class TestParallel(KindProperties):
    cases = (
        ("parallel", Parallel(AB, (PLANES[0], CYLINDERS[1])), 4),
        ("parallel opposed", Parallel(AB, PLANES, sense=-1), 4),
    )
