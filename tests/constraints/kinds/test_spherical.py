"""`Spherical`: a ball in a socket."""

from constraints.kinds import Spherical
from tests.constraints.kinds.properties import AB, SPHERES, KindProperties


class TestSpherical(KindProperties):
    cases = (("spherical", Spherical(AB, SPHERES), 3),)
