"""Blocks of the constraint graph, against networks small enough to see."""

import numpy as np
import pytest

from constraints.freedom.biconnected import GROUND, blocks
from constraints.geometry.surfaces import Sphere
from constraints.kinds import Spherical

BALL = (Sphere([0, 0, 0], 0.01), Sphere([0, 0, 0], 0.01))


def graph(*edges: tuple[int, int]) -> list[Spherical]:
    return [Spherical(e, BALL) for e in edges]


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
