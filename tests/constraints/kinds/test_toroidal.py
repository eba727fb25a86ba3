"""`Toroidal`: a torus seated in a torus."""

from constraints.kinds import Toroidal
from tests.constraints.kinds.properties import AB, TORI, KindProperties


class TestToroidal(KindProperties):
    cases = (("toroidal", Toroidal(AB, TORI, sense=1), 1),)
