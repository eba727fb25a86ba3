"""The arrays and kernels below the solver, each against numpy or networks small enough to see."""

import numpy as np
import pinocchio as pin
import pytest

from constraints.geometry.surfaces import Sphere
from constraints.kinds import Spherical
from constraints.solve.system import connected, systems
from tests.constraints import problems

BALL = (Sphere([0, 0, 0], 0.01), Sphere([0, 0, 0], 0.01))


def graph(*edges: tuple[int, int]) -> list[Spherical]:
    return [Spherical(e, BALL) for e in edges]


class TestSystem:
    def test_components_join_through_movable_bodies_only(self) -> None:
        constraints = graph((0, 1), (1, 2), (0, 3), (3, 4), (5, 6), (0, 5))
        assert connected(constraints, {1, 2, 3, 4, 6}) == [[0, 1], [2, 3], [4]]
        assert connected(constraints, set()) == []

    def test_systems_are_kept_while_the_constraints_are_the_same(self) -> None:
        constraints = tuple(graph((0, 1), (1, 2)))
        assert systems(constraints, frozenset({1, 2})) is systems(tuple(constraints), frozenset({1, 2}))

    def test_dense_jacobian_agrees_with_the_constraints_own(self) -> None:
        """Columns are local twists about the centre over the extent; rows weighed: undone, they are the kinds' own."""
        problem = problems.slider_crank()
        poses = problem.shaken(0.01, 0.3, 1)
        (system,) = systems(problem.constraints, frozenset(problem.movable))
        residual, jacobian = system.dense(*system.gather(poses))
        for c, constraint in enumerate(system.constraints):
            mine = system.owner == c
            weight = system.weight[mine]
            pair = [poses[b] for b in constraint.bodies]
            assert residual[mine] / weight == pytest.approx(constraint.residual(*pair), abs=1e-14)
            for body, own in zip(constraint.bodies, constraint.jacobian(*pair), strict=True):
                if body == 0:
                    continue
                i = system.bodies.index(body)
                columns = jacobian[mine, 6 * system.slot[i] : 6 * system.slot[i] + 6] / weight[:, None]
                columns = columns * np.array([1.0] * 3 + [system.extent[i]] * 3)
                shift = pin.SE3(np.eye(3), system.center[i]).inverse().action  # twist about the origin to the centre
                assert columns @ shift == pytest.approx(own, abs=1e-12)

    def test_gather_and_scatter_are_inverse(self) -> None:
        problem = problems.bennett()
        (system,) = systems(problem.constraints, frozenset(problem.movable))
        back = system.scatter(*system.gather(problem.poses))
        for b in problem.movable:
            assert back[b].homogeneous == pytest.approx(problem.poses[b].homogeneous, abs=1e-16)
