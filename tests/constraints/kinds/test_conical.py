"""`Conical`: a cone seated in a cone."""

from constraints.kinds import Conical
from tests.constraints.kinds.properties import AB, CONES, KindProperties


class TestConical(KindProperties):
    cases = (("conical", Conical(AB, CONES, offset=0.01), 1),)
