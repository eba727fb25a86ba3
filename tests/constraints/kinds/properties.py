"""What holds of every kind: Jacobian against central differences, freedom against the Jacobian's rank, symbols.

The test class of a kind derives from `KindProperties` and lists its cases.
"""

from math import pi

import numpy as np
import pinocchio as pin
import pytest

from constraints.geometry.surfaces import Cone, Cylinder, Plane, Sphere, Torus
from constraints.kinds import Belt, Circle, Constraint, Fixed, Gear, Line, Point, RackAndPinion, Screw
from constraints.solve.solver import solve

PLANES = Plane([0.1, 0.2, 0.3], [1.0, 2.0, -0.5]), Plane([-0.3, 0.1, 0.05], [0.2, 1.0, 0.7])
CYLINDERS = Cylinder([0.1, 0.0, 0.2], [0.3, 1.0, 0.1], 0.02), Cylinder([0.0, 0.3, -0.1], [1.0, -0.4, 0.6], 0.03)
CONES = Cone([0.1, 0.1, 0.0], [0.0, 0.6, 1.0], 0.4), Cone([0.0, -0.1, 0.2], [1.0, 0.1, 0.2], 0.4)
SPHERES = Sphere([0.0, 0.1, 0.3], 0.02), Sphere([0.2, -0.1, 0.1], 0.05)
TORI = Torus([0.1, 0.2, 0.0], [0.1, 0.2, 1.0], 0.05, 0.02), Torus([0.0, 0.1, 0.1], [1.0, 0.2, 0.3], 0.06, 0.01)
LINES = Line([0.1, 0.0, 0.2], [0.2, 0.3, 1.0]), Line([0.0, 0.2, 0.1], [1.0, 0.1, -0.4])
POINTS = Point([0.1, 0.2, -0.1]), Point([-0.2, 0.1, 0.1])
CIRCLES = Circle([0.1, 0.0, 0.2], [0.2, 0.3, 1.0], 0.04), Circle([0.0, 0.2, 0.1], [1.0, 0.1, -0.4], 0.03)
AB = (0, 1)


def random_pose(rng: np.random.Generator, scale: float = 0.3) -> pin.SE3:
    q = rng.normal(size=4)
    return pin.SE3(pin.Quaternion(*(q / np.linalg.norm(q))).matrix(), scale * rng.normal(size=3))


def differences(constraint: Constraint, a: pin.SE3, b: pin.SE3, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Fourth-order central differences of the residual by each local twist; NaN where it jumps in between."""
    out = []
    for body in (0, 1):
        columns = []
        for k in range(6):
            values = {}
            for s in (-2, -1, 0, 1, 2):
                step = np.zeros(6)
                step[k] = s * h
                poses = [a, b]
                poses[body] = poses[body] * pin.exp6(step)
                values[s] = constraint.residual(*poses)
            d = (8 * (values[1] - values[-1]) - (values[2] - values[-2])) / (12 * h)
            jump = np.abs(np.diff([values[s] for s in (-2, -1, 0, 1, 2)], axis=0)).max(axis=0) > 0.02 * pi / 3
            columns.append(np.where(jump, np.nan, d))
        out.append(np.array(columns).T)
    return out[0], out[1]


class KindProperties:
    """Each property, of each case of a kind."""

    cases: tuple[tuple[str, Constraint, int], ...] = ()
    """Name, a constraint, and the degrees of freedom that it leaves."""

    def test_only_threads_and_teeth_hold_again_a_period_farther(self, constraint: Constraint, freedom: int) -> None:
        assert constraint.periodic == isinstance(constraint, Screw | Gear | Belt | RackAndPinion)

    def test_jacobian_agrees_with_differences_at_random_poses(self, constraint: Constraint, freedom: int) -> None:
        rng = np.random.default_rng(7)
        compared = 0
        for _ in range(25):
            a, b = random_pose(rng), random_pose(rng)
            ja, jb = constraint.jacobian(a, b)
            scale = 1.0 + max(np.abs(ja).max(), np.abs(jb).max())
            if scale > 100.0:  # next to a singular pose differences are no reference
                continue
            na, nb = differences(constraint, a, b, 2e-4 / scale)
            for exact, numeric in ((ja, na), (jb, nb)):
                known = np.isfinite(numeric)
                compared += int(known.sum())
                assert np.abs(exact - numeric)[known].max(initial=0.0) < 1e-7 * scale**2
        assert compared > 20 * 12  # the comparison did take place

    def test_freedom_is_what_the_jacobian_leaves_where_the_constraint_holds(
        self, constraint: Constraint, freedom: int
    ) -> None:
        rng = np.random.default_rng(11)
        for _ in range(5):
            poses = [random_pose(rng), random_pose(rng)]
            solution = solve([constraint], poses, movable=[1])
            assert solution.converged
            held = poses[0], solution.poses[1]
            assert np.abs(constraint.residual(*held)).max() <= 1e-12
            equalities = np.zeros(constraint.rows, dtype=bool)
            row = 0
            for e in constraint.equations():
                equalities[row : row + e.rows] = e.holds
                row += e.rows
            jacobian = constraint.jacobian(*held)[1][equalities]
            rank = np.linalg.matrix_rank(jacobian, tol=1e-7) if len(jacobian) else 0
            assert 6 - rank == freedom == constraint.freedom

    def test_a_common_motion_of_both_bodies_changes_nothing(self, constraint: Constraint, freedom: int) -> None:
        rng = np.random.default_rng(13)
        a, b, everywhere = random_pose(rng), random_pose(rng), random_pose(rng)
        before, after = constraint.residual(a, b), constraint.residual(everywhere * a, everywhere * b)
        assert np.allclose(np.abs(before), np.abs(after), atol=1e-12)  # a sign may flip at exactly half a period

    def test_the_symbol_is_drawn_on_body_a_and_moves_with_it(self, constraint: Constraint, freedom: int) -> None:
        rng = np.random.default_rng(3)
        pose, move = random_pose(rng), random_pose(rng)
        here, there = constraint.drawing(pose), constraint.drawing(move * pose)
        assert here.shape in ("plane", "axis", "point", "rigid")
        assert here.size == constraint.size
        assert np.linalg.norm(here.direction) == pytest.approx(1.0)
        assert there.origin == pytest.approx(move.act(here.origin))
        assert there.direction == pytest.approx(move.rotation @ here.direction)
        feature = constraint.features[0].transformed(pose)
        if isinstance(feature, Plane):
            assert feature.distance([here.origin])[0] == pytest.approx(0.0, abs=1e-12)
        elif isinstance(feature, (Cylinder, Sphere)) and not isinstance(constraint, Fixed):
            assert feature.distance([here.origin])[0] == pytest.approx(-feature.radius)  # on the axis, at the centre

    def test_degenerate_poses_give_finite_rows(self, constraint: Constraint, freedom: int) -> None:
        """Features on top of one another; axes parallel, opposed, crossed; a wheel on its axis: rows are finite."""
        frames = [constraint.compiled.element[0, :12], constraint.compiled.element[0, 12:]]
        if constraint.compiled.side[0, 0]:
            frames.reverse()
        to_feature = [pin.SE3(np.column_stack([f[3:6], f[6:9], f[9:12]]), f[0:3].copy()) for f in frames]
        turns = [np.zeros(3), [pi, 0, 0], [0, pi, 0], [0, 0, pi], [pi / 2, 0, 0], [1e-9, 0, 0], [pi - 1e-9, 0, 0]]
        for turn in turns:
            for shift in (np.zeros(3), [0, 0, 0.1], [0.1, 0, 0], [1e-12, 0, 0]):
                between = pin.SE3(pin.exp3(np.array(turn, dtype=float)), np.array(shift, dtype=float))
                pose = to_feature[0] * between * to_feature[1].inverse()
                residual = constraint.residual(pin.SE3.Identity(), pose)
                assert np.isfinite(residual).all()
                assert all(np.isfinite(j).all() for j in constraint.jacobian(pin.SE3.Identity(), pose))
