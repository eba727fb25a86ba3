"""The solver: what must hold holds, what need not move stays."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from constraints.geometry import Cylinder, Plane
from constraints.kinds import Against, Concentric
from constraints.solver import solve


def test_a_bolt_thirty_degrees_off_snaps_into_its_hole_and_the_plate_stays() -> None:
    rng = np.random.default_rng(3)
    hole, shank = Cylinder([0.1, 0.2, 0], [0, 0, 1], 0.004), Cylinder([0, 0, 0.01], [0, 0, 1], 0.004)
    top, head = Plane([0, 0, 0.01], [0, 0, 1]), Plane([0, 0, 0], [0, 0, -1])
    constraints = [Concentric((0, 1), (hole, shank)), Against((0, 1), (top, head))]
    for _ in range(20):
        axis = rng.normal(size=3)
        pose = pin.SE3(pin.exp3(np.pi / 6 * axis / np.linalg.norm(axis)), [0.1, 0.2, 0.01] + rng.normal(size=3) * 0.003)
        solution = solve(constraints, [pin.SE3.Identity(), pose], movable=[1])
        assert solution.converged
        assert set(solution.poses) == {1}
        seated = solution.poses[1]
        for c in constraints:
            assert np.abs(c.residual(pin.SE3.Identity(), seated)).max() < 1e-12
        assert seated.rotation[2, 2] > 0  # not turned over
        again = solve(constraints, [pin.SE3.Identity(), seated], movable=[1])
        assert again.iterations == 0
        assert again.poses[1] is seated
