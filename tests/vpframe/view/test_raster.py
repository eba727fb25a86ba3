"""Triangles with a depth buffer, pixel by pixel."""

import numpy as np
import pytest

from vpframe.view import snapshot
from vpframe.view.raster import fill_triangles, shade_faces


def plain_fill(xy, z, keep, width, height):
    """Depth and triangle of every pixel, one pixel and one triangle at a time."""
    depth, face = np.full((height, width), -np.inf), np.full((height, width), -1)
    for row in range(height):
        for column in range(width):
            p = np.array([column + 0.5, row + 0.5])
            for t, (a, b, c) in enumerate(xy):
                m = np.array([b - a, c - a]).T
                if np.linalg.det(m) == 0.0:
                    continue
                b1, b2 = np.linalg.solve(m, p - a)
                w = np.array([1 - b1 - b2, b1, b2])
                if w.min() < 0 or w @ keep[t] > 0:
                    continue
                if w @ z[t] > depth[row, column]:
                    depth[row, column], face[row, column] = w @ z[t], t
    return depth, face


@pytest.mark.parametrize("seed", range(4))
def test_rasteriser_agrees_with_pixel_by_pixel(seed):
    rng = np.random.default_rng(seed)
    width, height, count = 24, 18, 12
    xy = rng.uniform(-6, 30, (count, 3, 2))
    xy[0, 2] = xy[0, 1]  # a needle without area
    xy[1] = [[-2.0, 8.4999], [26.0, 8.5], [26.0, 8.5001]]  # and two that lie along a row of pixels
    xy[2] = [[3.2, 4.5], [21.7, 4.5], [9.0, 5.75]]
    z, keep = rng.uniform(-1, 1, (count, 3)), rng.uniform(-1, 0.4, (count, 3))
    depth, face = np.full((height, width), -np.inf), np.full((height, width), -1, np.int32)
    weight = np.zeros((height, width, 2), np.float32)
    fill_triangles(xy, z, keep, depth, face, weight)
    slow_depth, slow_face = plain_fill(xy, z, keep, width, height)
    assert (face >= 0).any()
    np.testing.assert_array_equal(face, slow_face)
    np.testing.assert_allclose(depth[face >= 0], slow_depth[face >= 0], atol=1e-12)


def plain_shade(face, weight, normals, color, label, filled, alpha, image):
    """The picture, one pixel at a time."""
    out = image.astype(np.float64)
    for row, column in zip(*np.nonzero(face >= 0), strict=True):
        t = face[row, column]
        b = weight[row, column].astype(float)
        n = np.array([1.0 - b.sum(), *b]) @ normals[t]
        n /= np.linalg.norm(n)
        n = -n if n[2] < 0 else n
        half = snapshot.KEY_LIGHT + np.array([0.0, 0.0, 1.0])
        shine = max(n @ (half / np.linalg.norm(half)), 0.0) ** 40
        light = 0.5 + 0.5 * max(n @ snapshot.KEY_LIGHT, 0.0) + 0.18 * max(n @ snapshot.FILL_LIGHT, 0.0)
        shaded = color[t] * light + 0.13 * shine
        if filled[t]:
            shaded = color[t] * (0.62 if (row + column) // 5 % 3 == 0 else 0.80)
        value = image[row, column] + alpha * (shaded - image[row, column])
        sides = [(row - 1, column), (row, column - 1), (row + 1, column), (row, column + 1)]
        there = [(r, c) for r, c in sides if 0 <= r < face.shape[0] and 0 <= c < face.shape[1]]
        bare = any(face[place] < 0 for place in there)
        other = any(face[p] >= 0 and label[face[p]] != label[t] for p in there if p in sides[:2])
        out[row, column] = value * (1.0 - 0.75 * alpha) if bare or other else value
    return out


@pytest.mark.parametrize("alpha", [1.0, 0.3])
def test_shading_agrees_with_pixel_by_pixel(alpha):
    rng = np.random.default_rng(5)
    shape, count = (17, 23), 6
    face = rng.integers(-1, count, shape).repeat(2, axis=0).repeat(2, axis=1).astype(np.int32)
    weight = rng.uniform(0, 0.5, (*face.shape, 2)).astype(np.float32)
    normals, color = rng.normal(size=(count, 3, 3)), rng.uniform(size=(count, 3))
    label, filled = np.array([0, 0, 1, 1, 2, 3]), np.array([False, False, False, False, False, True])
    image = rng.uniform(size=(*face.shape, 3)).astype(np.float32)
    half = snapshot.KEY_LIGHT + np.array([0.0, 0.0, 1.0])
    lights = np.stack([snapshot.KEY_LIGHT, half / np.linalg.norm(half), snapshot.FILL_LIGHT])
    expected = plain_shade(face, weight, normals, color, label, filled, alpha, image)
    window = np.array([0, face.shape[0], 0, face.shape[1]])
    drawn = image.copy()
    shade_faces(window, face, weight, normals, color, label, filled, lights, alpha, drawn)
    np.testing.assert_allclose(drawn, expected, atol=1e-5)
    part = image.copy()
    shade_faces(np.array([3, 9, 4, 20]), face, weight, normals, color, label, filled, lights, alpha, part)
    np.testing.assert_array_equal(part[3:9, 4:20], drawn[3:9, 4:20])
    part[3:9, 4:20] = image[3:9, 4:20]
    np.testing.assert_array_equal(part, image)
