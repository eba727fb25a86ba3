"""`Belt`: two pulleys joined by a belt."""

from constraints.kinds import Belt
from tests.constraints.kinds.properties import AB, CYLINDERS, KindProperties


class TestBelt(KindProperties):
    cases = (("belt", Belt(AB, CYLINDERS, teeth_a=3, teeth_b=1), 5),)
