"""`Coplanar`: two planes flush with one another."""

from constraints.kinds import Coplanar
from tests.constraints.kinds.properties import AB, PLANES, KindProperties


class TestCoplanar(KindProperties):
    cases = (("coplanar", Coplanar(AB, PLANES), 3),)
