"""The arrays and kernels below the solver, each against numpy or networks small enough to see."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from constraints.freedom.biconnected import GROUND, blocks
from constraints.geometry.surfaces import Sphere
from constraints.kinds import Spherical
from constraints.solve.ranks import least_norm, null_basis, pivoted_qr, row_space
from constraints.solve.system import connected, systems
from tests.constraints import problems

BALL = (Sphere([0, 0, 0], 0.01), Sphere([0, 0, 0], 0.01))


def graph(*edges: tuple[int, int]) -> list[Spherical]:
    return [Spherical(e, BALL) for e in edges]


class TestRanks:
    @pytest.mark.parametrize("seed", range(20))
    def test_pivoted_qr_finds_rank_and_null_space_as_svd_does(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        m, n = int(rng.integers(1, 40)), int(rng.integers(1, 40))
        rank = int(rng.integers(1, min(m, n) + 1))
        matrix = rng.normal(size=(m, rank)) @ rng.normal(size=(rank, n))
        matrix *= 10.0 ** rng.integers(-6, 7)
        order, upper, found, margin = pivoted_qr(np.ascontiguousarray(matrix.T), 1e-9)
        assert found == rank == np.linalg.matrix_rank(matrix, tol=1e-9 * np.linalg.norm(matrix, 2))
        assert 1e-9 < margin <= 1.0
        null = null_basis(order, upper, found)
        assert null.shape == (n - rank, n)
        assert np.linalg.matrix_rank(null) == n - rank
        assert np.abs(matrix @ null.T).max(initial=0.0) < 1e-8 * np.linalg.norm(matrix, 2) * np.abs(null).max(initial=1)

    def test_no_rows_but_zeros_leave_everything_free(self) -> None:
        order, upper, rank, margin = pivoted_qr(np.zeros((6, 3)), 1e-9)
        assert rank == 0 and margin == 1.0
        assert np.linalg.matrix_rank(null_basis(order, upper, rank)) == 6

    @pytest.mark.parametrize("seed", range(20))
    def test_least_norm_is_that_of_numpy(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        m, n = int(rng.integers(1, 30)), int(rng.integers(1, 30))
        rank = int(rng.integers(1, min(m, n) + 1))
        matrix = rng.normal(size=(m, rank)) @ rng.normal(size=(rank, n))
        rhs = rng.normal(size=m)
        x = least_norm(np.ascontiguousarray(matrix.T), rhs, 1e-10)
        assert x == pytest.approx(np.linalg.lstsq(matrix, rhs, rcond=1e-10)[0], rel=1e-6, abs=1e-8)

    @pytest.mark.parametrize("seed", range(20))
    def test_row_space_keeps_what_is_new_and_explains_the_rest(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        n, rank = 12, int(rng.integers(1, 10))
        rows = rng.normal(size=(20, rank)) @ rng.normal(size=(rank, n))
        rows /= np.linalg.norm(rows, axis=1, keepdims=True)
        place, weights = row_space(rows, 1e-9)
        kept = rows[place >= 0]
        assert len(kept) == rank
        for i in range(20):
            assert (place[i] >= 0) == (
                np.linalg.matrix_rank(rows[: i + 1], 1e-8) > np.linalg.matrix_rank(rows[:i], 1e-8)
            )
        assert weights[place < 0] @ kept == pytest.approx(rows[place < 0], abs=1e-8)


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


class TestBlocks:
    def test_series_loops_and_what_hangs_from_them(self) -> None:
        """Ground - 1 - 2 in a chain, a loop 2-3-4, a second loop on the ground, and a component that floats."""
        constraints = graph((0, 1), (1, 2), (2, 3), (3, 4), (4, 2), (0, 5), (5, 6), (9, 6), (7, 8))
        found = {(b.root, b.bodies): b.constraints for b in blocks(constraints, [0, 9])}
        assert found == {
            (GROUND, (1,)): (0,),
            (1, (2,)): (1,),
            (2, (3, 4)): (2, 3, 4),
            (GROUND, (5, 6)): (5, 6, 7),
            (7, (8,)): (8,),
        }

    def test_parallel_constraints_are_one_block_and_fixed_pairs_none(self) -> None:
        constraints = graph((1, 0), (0, 1), (0, 2), (2, 0))
        assert [(b.bodies, b.constraints) for b in blocks(constraints, [0, 2])] == [((1,), (0, 1))]

    @pytest.mark.parametrize("seed", range(10))
    def test_each_constraint_is_in_one_block_and_roots_come_first(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        pairs = [(int(a), int(b)) for a, b in rng.integers(0, 15, (22, 2)) if a != b]
        found = blocks(graph(*pairs), [0])
        assert sorted(i for b in found for i in b.constraints) == list(range(len(pairs)))
        seen = {GROUND}
        for b in found:
            if b.root not in seen:  # then it is the lowest body of its component
                assert b.root < min(b.bodies)
                seen.add(b.root)
            assert not seen & set(b.bodies)
            seen.update(b.bodies)

    @pytest.mark.parametrize("seed", range(10))
    def test_a_block_stays_connected_when_any_body_is_taken_out(self, seed: int) -> None:
        rng = np.random.default_rng(100 + seed)
        pairs = [(int(a), int(b)) for a, b in rng.integers(0, 12, (16, 2)) if a != b]
        for b in blocks(graph(*pairs), [0]):
            ends = [tuple(GROUND if x == 0 else x for x in pairs[i]) for i in b.constraints]
            nodes = {x for e in ends for x in e}
            assert nodes == {b.root, *b.bodies}
            for out in nodes:
                left = nodes - {out}
                reached, todo = set(), [min(left)]
                while todo:
                    x = todo.pop()
                    if x not in reached:
                        reached.add(x)
                        todo += [y for e in ends if x in e and out not in e for y in e]
                assert reached == left
