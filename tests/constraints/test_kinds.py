"""Every kind: its Jacobian against central differences, its freedom against the Jacobian's rank."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from constraints.geometry import Cylinder, Plane
from constraints.kinds import Against, Concentric, Constraint, Coplanar

X, Y, Z = np.eye(3)
PLANE = Plane([0.1, 0.2, 0.3], [1.0, 2.0, -0.5])
PLANE_B = Plane([-0.3, 0.1, 0.05], [0.2, 1.0, 0.7])
CYLINDER = Cylinder([0.1, 0.0, 0.2], [0.3, 1.0, 0.1], 0.02)
CYLINDER_B = Cylinder([0.0, 0.3, -0.1], [1.0, -0.4, 0.6], 0.02)

CASES = [
    Against((0, 1), (PLANE, PLANE_B)),
    Coplanar((0, 1), (PLANE, PLANE_B)),
    Concentric((0, 1), (CYLINDER, CYLINDER_B)),
    Concentric((0, 1), (CYLINDER, CYLINDER_B), sense=-1),
]


def differences(constraint: Constraint, a: pin.SE3, b: pin.SE3, h: float = 1e-6) -> tuple[np.ndarray, np.ndarray]:
    """Central differences of the residual by each local twist."""
    out = []
    for body in (0, 1):
        columns = []
        for k in range(6):
            step = np.zeros(6)
            step[k] = h
            values = []
            for sign in (1, -1):
                poses = [a, b]
                poses[body] = poses[body] * pin.exp6(sign * step)
                values.append(constraint.residual(*poses))
            columns.append((values[0] - values[1]) / (2 * h))
        out.append(np.array(columns).T)
    return out[0], out[1]


@pytest.mark.parametrize("constraint", CASES, ids=lambda c: c.kind)
def test_jacobian_agrees_with_differences_at_random_poses(constraint: Constraint) -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        a, b = (pin.SE3(pin.Quaternion(*_unit4(rng)).matrix(), rng.normal(size=3)) for _ in range(2))
        ja, jb = constraint.jacobian(a, b)
        na, nb = differences(constraint, a, b)
        scale = 1.0 + np.abs(na).max() + np.abs(nb).max()
        assert np.abs(ja - na).max() < 1e-7 * scale**2
        assert np.abs(jb - nb).max() < 1e-7 * scale**2


def _unit4(rng: np.random.Generator) -> np.ndarray:
    q = rng.normal(size=4)
    return q / np.linalg.norm(q)
