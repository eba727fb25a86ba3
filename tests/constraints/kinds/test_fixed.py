"""`Fixed`: two bodies held as one."""

import numpy as np
import pinocchio as pin

from constraints.kinds import Fixed
from tests.constraints.kinds.properties import AB, POINTS, KindProperties


class TestFixed(KindProperties):
    cases = (
        (
            "fixed",
            Fixed(AB, POINTS, relative=pin.SE3(pin.exp3(np.array([0.3, -0.8, 0.5])), np.array([0.1, 0.2, -0.3]))),
            0,
        ),
    )
