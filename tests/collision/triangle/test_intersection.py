"""Triangle against triangle, held to integer arithmetic, to libigl and to what symmetry demands."""

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from collision.numeric.predicates import workspace
from collision.triangle.intersection import triangles_meet
from tests.collision import adversarial, exact


@njit
def _meet_all(corners, w):
    out = np.empty(len(corners), np.bool_)
    for i in range(len(corners)):
        c = corners[i]
        out[i] = triangles_meet(
            (c[0, 0], c[0, 1], c[0, 2]), (c[1, 0], c[1, 1], c[1, 2]), (c[2, 0], c[2, 1], c[2, 2]),
            (c[3, 0], c[3, 1], c[3, 2]), (c[4, 0], c[4, 1], c[4, 2]), (c[5, 0], c[5, 1], c[5, 2]), w,
        )  # fmt: skip
    return out


def meet(corners: NDArray[np.float64]) -> NDArray[np.bool_]:
    return _meet_all(np.ascontiguousarray(corners), workspace())


def disagreements(corners: NDArray[np.float64]) -> list[int]:
    return [i for i, ours in enumerate(meet(corners)) if ours != exact.triangles_meet(corners[i])]


def test_random_pairs_against_integers() -> None:
    corners = adversarial.random_pairs(4_000, 1)
    assert 0.2 < meet(corners).mean() < 0.4
    assert disagreements(corners) == []


def test_adversarial_pairs_against_integers() -> None:
    corners = adversarial.adversarial_pairs(10_000, 2)
    assert 0.3 < meet(corners).mean() < 0.9
    assert disagreements(corners) == []


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("block", range(10))
def test_a_hundred_thousand_of_each_against_integers(block: int) -> None:
    assert disagreements(adversarial.random_pairs(10_000, 100 + block)) == []
    assert disagreements(adversarial.adversarial_pairs(10_000, 200 + block)) == []


def test_the_order_of_corners_and_of_triangles_does_not_matter() -> None:
    corners = adversarial.adversarial_pairs(20_000, 3)
    expected = meet(corners)
    for order in ([3, 4, 5, 0, 1, 2], [1, 2, 0, 3, 4, 5], [1, 0, 2, 5, 4, 3], [5, 3, 4, 2, 1, 0]):
        assert np.array_equal(meet(corners[:, order]), expected)


def test_against_libigl() -> None:
    predicates = pytest.importorskip("igl.predicates")
    rng = np.random.default_rng(4)
    corners = np.concatenate([adversarial.adversarial_pairs(4_000, 4), adversarial.random_pairs(4_000, 5)])
    rng.shuffle(corners)
    area = [min(_area(c[:3]), _area(c[3:])) for c in corners]
    corners = corners[np.array(area) > 0]  # libigl is wrong on degenerate triangles
    assert len(corners) > 5_000
    ours = meet(corners)
    for block in range(0, len(corners), 64):
        chunk = corners[block : block + 64]
        faces = np.arange(3 * len(chunk), dtype=np.int64).reshape(-1, 3)
        first, second = chunk[:, :3].reshape(-1, 3), chunk[:, 3:].reshape(-1, 3)
        pairs = predicates.find_intersections(first, faces, second, faces)[1]
        found = {int(i) for i, j in np.asarray(pairs).reshape(-1, 2) if i == j}
        assert found == set(np.flatnonzero(ours[block : block + 64]).tolist())


def _area(triangle: NDArray[np.float64]) -> int:
    p = exact.integers(triangle)
    normal = exact.cross(exact.sub(p[1], p[0]), exact.sub(p[2], p[0]))
    return exact.dot(normal, normal)


def test_no_fused_multiply_add() -> None:
    meet(adversarial.random_pairs(1, 0))
    code = "".join(_meet_all.inspect_asm().values())
    assert "mulsd" in code and "fmadd" not in code and "fmsub" not in code
