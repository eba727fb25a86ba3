"""Lower pairs that joints leave between two bodies."""

import numpy as np
from physics_meshes import at

from constraints.geometry.surfaces import Cylinder, Plane
from constraints.kinds.concentric import Concentric
from constraints.kinds.coplanar import Coplanar
from physics.joints.lower_pair import pair_between


def test_lower_pairs_are_named():
    z, o = np.array([0, 0, 1.0]), np.zeros(3)
    shaft = Concentric((0, 1), (Cylinder(o, z, 0.01), Cylinder(o, z, 0.01)))
    flush = Coplanar((0, 1), (Plane(o, z), Plane(o, z)))
    side = Coplanar((0, 1), (Plane(o, [1, 0, 0]), Plane(o, [1, 0, 0])))
    cases = {
        "cylindrical": [shaft], "revolute": [shaft, flush], "planar": [flush], "prismatic": [shaft, side],
        "rigid": [shaft, flush, side],
    }  # fmt: skip
    for name, joints in cases.items():
        assert pair_between(joints, 1, at(), at()).name == name
