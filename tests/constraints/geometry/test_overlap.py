"""Facing areas against sampling and closed forms; open angles of whole and half bores."""

import numpy as np
import pytest

from constraints.geometry.overlap import facing_area, height_spans, open_angle, shared_height

Z = np.array([0.0, 0.0, 1.0])


def square(x, y, w, h, z=0.0, flip=False):
    c = np.array([[x, y, z], [x + w, y, z], [x + w, y + h, z], [x, y + h, z]], float)
    t = c[[[0, 1, 2], [0, 2, 3]]]
    return t[:, ::-1] if flip else t


@pytest.mark.parametrize(
    ("shift", "area"), [((0.0, 0.0), 1.0), ((0.5, 0.25), 0.375), ((1.0, 0.0), 0.0), ((3.0, 0.0), 0.0)]
)
def test_two_squares(shift, area):
    region = facing_area(np.zeros(3), Z, square(0, 0, 1, 1), square(*shift, 1, 1, 0.1, flip=True), 0.1 * Z, -Z)
    assert region.area == pytest.approx(area, abs=1e-15)
    if area:
        assert region.gap_min == pytest.approx(0.1) and region.gap_max == pytest.approx(0.1)
        assert region.centroid == pytest.approx([0.5 + shift[0] / 2, 0.5 + shift[1] / 2, 0.0])


def test_tilted_plane_tells_least_and_greatest_gap():
    n = np.array([np.sin(0.01), 0.0, -np.cos(0.01)])
    other = square(0, 0, 1, 1)
    other[..., 2] = np.tan(0.01) * other[..., 0] + 0.2
    region = facing_area(np.zeros(3), Z, square(0, 0, 1, 1), other, np.array([0, 0, 0.2]), n)
    assert region.gap_min == pytest.approx(0.2)
    assert region.gap_max == pytest.approx(0.2 + np.tan(0.01))


def test_random_triangles_against_sampling():
    rng = np.random.default_rng(3)
    points = rng.random((200_000, 2))

    def inside(triangles):
        hit = np.zeros(len(points), bool)
        for t in triangles[..., :2]:
            side = [
                (t[(k + 1) % 3, 0] - t[k, 0]) * (points[:, 1] - t[k, 1])
                - (t[(k + 1) % 3, 1] - t[k, 1]) * (points[:, 0] - t[k, 0])
                for k in range(3)
            ]
            hit |= (np.min(side, axis=0) >= 0) | (np.max(side, axis=0) <= 0)
        return hit

    for _ in range(20):
        a, b = np.zeros((2, 1, 3, 3))
        a[..., :2], b[..., :2] = rng.random((2, 1, 3, 2))
        region = facing_area(np.zeros(3), Z, a, b, np.zeros(3), -Z)
        both = inside(a) & inside(b)
        assert region.area == pytest.approx(both.mean(), abs=4e-3)
        if both.sum() > 500:
            # the plane's own coordinates are (u, v); the centroid comes back in the world's
            assert region.centroid[:2] == pytest.approx(points[both].mean(axis=0), abs=0.02)


def test_open_angle_of_whole_half_and_quarter():
    for arc, expected in ((2 * np.pi * 31 / 32, 2 * np.pi / 32), (np.pi, np.pi), (np.pi / 2, 1.5 * np.pi)):
        a = np.linspace(0.3, 0.3 + arc, 32)
        samples = np.stack([np.cos(a), np.sin(a), np.zeros(32)], axis=1)
        assert open_angle(samples, np.zeros(3), Z) == pytest.approx(expected)


def test_spans_of_two_ears_and_what_a_pin_shares_with_them():
    rows = np.array([0.0, 1.0, 2.0, 5.0, 6.0])
    samples = np.array([[x, 0, h] for h in rows for x in (0.0, 1.0)])
    strip = np.array([[0, 1, 2], [1, 3, 2]])
    triangles = np.vstack([strip, strip + 2, strip + 6]).astype(np.int32)
    spans = height_spans(samples, triangles, np.array([0, 0, 1.0]), Z)
    assert spans.tolist() == [[-1.0, 1.0], [4.0, 5.0]]
    assert shared_height(np.array([[0.5, 4.5]]), spans) == (1.0, 0.5, 4.5)
    assert shared_height(np.array([[1.5, 3.0]]), spans) == (-0.5, 1.0, 1.5)
    assert shared_height(np.array([[5.0, 7.0]]), spans)[0] == 0.0
