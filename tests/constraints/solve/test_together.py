"""Residuals of many constraints in one call are those of each alone, to the bit."""

import numpy as np
import pinocchio as pin

from constraints.geometry.surfaces import Cylinder, Plane, Sphere
from constraints.kinds import Against, Concentric, Distance, Fixed, Screw
from constraints.solve.together import Together


def test_residuals_and_distances_of_any_subset_are_those_of_each_alone() -> None:
    rng = np.random.default_rng(5)
    poses = [pin.SE3.Random() for _ in range(6)]

    def plane() -> Plane:
        return Plane(rng.normal(size=3), rng.normal(size=3))

    def cylinder() -> Cylinder:
        return Cylinder(rng.normal(size=3), rng.normal(size=3), 0.01)

    every = [
        Against((0, 3), (plane(), plane())),
        Concentric((4, 1), (cylinder(), cylinder())),
        Screw((1, 2), (cylinder(), cylinder()), pitch=1e-3),
        Fixed.between((5, 0), poses[1], poses[2]),
        Distance((2, 5), (Sphere(rng.normal(size=3), 0.1), Sphere(rng.normal(size=3), 0.2)), at=0.5),
    ]
    together = Together.of(every)
    for chosen in ([0, 1, 2, 3, 4], [1, 3], [4], []):
        part = together.subset(np.array(chosen, np.int64))
        residual = part.residual(poses)
        alone = [c.residual(poses[c.bodies[0]], poses[c.bodies[1]]) for c in (every[k] for k in chosen)]
        assert np.array_equal(residual, np.concatenate([np.empty(0), *alone]))
        linear = [np.abs(r[~every[k].angular]).max(initial=0.0) for k, r in zip(chosen, alone, strict=True)]
        assert part.distance(residual).tolist() == linear
