"""Rasterise triangles and segments with a depth buffer, in parallel projection (Pineda 1988, edge functions)."""

from __future__ import annotations

import numpy as np

from collision.numeric.kernel import inner_kernel, kernel


@kernel
def fill_triangles(xy, z, keep, depth, face, weight):
    """Draw triangles into the buffers; nearer (greater z) wins, at equal depth the first triangle.

    xy: (m, 3, 2) float64 corners in pixels, y down. z: (m, 3) depth towards the eye.
    keep: (m, 3) signed distance of the corners to the section plane; a pixel where it is positive is cut away.
    depth (h, w) float64, face (h, w) int32 (triangle, or -1), weight (h, w, 2) float32 barycentrics: changed in place.
    """
    height, width = depth.shape
    for t in range(xy.shape[0]):
        x0, y0 = xy[t, 0, 0], xy[t, 0, 1]
        x1, y1 = xy[t, 1, 0], xy[t, 1, 1]
        x2, y2 = xy[t, 2, 0], xy[t, 2, 1]
        double_area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
        if double_area == 0.0 or (keep[t, 0] > 0.0 and keep[t, 1] > 0.0 and keep[t, 2] > 0.0):
            continue
        left = max(int(np.ceil(min(x0, x1, x2) - 0.5)), 0)
        right = min(int(np.floor(max(x0, x1, x2) - 0.5)), width - 1)
        top = max(int(np.ceil(min(y0, y1, y2) - 0.5)), 0)
        bottom = min(int(np.floor(max(y0, y1, y2) - 0.5)), height - 1)
        inverse = 1.0 / double_area
        for row in range(top, bottom + 1):
            y = row + 0.5
            low, high = _span(xy, t, y)
            for column in range(int(max(left, low - 1.5)), int(min(right, high + 0.5)) + 1):
                x = column + 0.5
                b1 = ((x - x0) * (y2 - y0) - (x2 - x0) * (y - y0)) * inverse
                b2 = ((x1 - x0) * (y - y0) - (x - x0) * (y1 - y0)) * inverse
                b0 = 1.0 - b1 - b2
                if b0 < 0.0 or b1 < 0.0 or b2 < 0.0:
                    continue
                if b0 * keep[t, 0] + b1 * keep[t, 1] + b2 * keep[t, 2] > 0.0:
                    continue
                d = b0 * z[t, 0] + b1 * z[t, 1] + b2 * z[t, 2]
                if d > depth[row, column]:
                    depth[row, column] = d
                    face[row, column] = t
                    weight[row, column, 0] = b1
                    weight[row, column, 1] = b2


@inner_kernel
def _span(xy, t, y):
    """Return least and greatest x of triangle `t` on the line of this y, up to rounding; inf, -inf if there is none."""
    low, high = np.inf, -np.inf
    for k in range(3):
        ax, ay = xy[t, k, 0], xy[t, k, 1]
        bx, by = xy[t, (k + 1) % 3, 0], xy[t, (k + 1) % 3, 1]
        if y < min(ay, by) or y > max(ay, by):
            continue
        if abs(by - ay) < 1e-3:  # nearly along the line
            low, high = min(low, ax, bx), max(high, ax, bx)
        else:
            x = ax + (y - ay) / (by - ay) * (bx - ax)
            low, high = min(low, x), max(high, x)
    return low, high


@kernel
def shade_faces(window, face, weight, normals, color, label, filled, lights, alpha, image):
    """Blend what `fill_triangles` left in `face` and `weight` over `image`, with dark lines between labels.

    window: (4,) int64 first row, row after the last, first column, column after the last: nothing is drawn elsewhere.
    normals: (m, 3, 3) of the corners in the camera's frame. color: (m, 3) in 0 … 1. label: (m,) a number a feature.
    filled: (m,) whether the triangle stands for the fill of a cut, which is hatched and not lit.
    lights: (3, 3) unit vectors: the key light, the highlight's half vector, the fill light.
    image: (h, w, 3) float32 is changed in place.
    """
    height, width = face.shape
    for row in range(window[0], window[1]):
        for column in range(window[2], window[3]):
            t = face[row, column]
            if t < 0:
                continue
            left = -1 if column == 0 else face[row, column - 1]
            above = -1 if row == 0 else face[row - 1, column]
            line = column > 0 and (left < 0 or label[left] != label[t])
            line = line or (row > 0 and (above < 0 or label[above] != label[t]))
            line = line or (column + 1 < width and face[row, column + 1] < 0)
            line = line or (row + 1 < height and face[row + 1, column] < 0)
            light, shine = 1.0, 0.0
            if filled[t]:
                light = 0.62 if ((row + column) // 5) % 3 == 0 else 0.80
            else:
                b1, b2 = weight[row, column, 0], weight[row, column, 1]
                b0 = 1.0 - b1 - b2
                x = b0 * normals[t, 0, 0] + b1 * normals[t, 1, 0] + b2 * normals[t, 2, 0]
                y = b0 * normals[t, 0, 1] + b1 * normals[t, 1, 1] + b2 * normals[t, 2, 1]
                z = b0 * normals[t, 0, 2] + b1 * normals[t, 1, 2] + b2 * normals[t, 2, 2]
                scale = 1.0 / max(np.sqrt(x * x + y * y + z * z), 1e-30)
                if z < 0.0:
                    scale = -scale
                x, y, z = scale * x, scale * y, scale * z
                key = max(lights[0, 0] * x + lights[0, 1] * y + lights[0, 2] * z, 0.0)
                shine = max(lights[1, 0] * x + lights[1, 1] * y + lights[1, 2] * z, 0.0)
                fill = max(lights[2, 0] * x + lights[2, 1] * y + lights[2, 2] * z, 0.0)
                light = 0.50 + 0.50 * key + 0.18 * fill
                eighth = (shine * shine * shine * shine) ** 2
                shine = 0.13 * eighth**5
            ink = 1.0 - 0.75 * alpha if line else 1.0
            for channel in range(3):
                value = image[row, column, channel]
                value += alpha * (color[t, channel] * light + shine - value)
                image[row, column, channel] = ink * value


@kernel
def draw_segments(ends, z, color, width, hidden, depth, image):
    """Draw segments as discs of `width` pixels swept along them; where something nearer stands, only `hidden` of them.

    ends: (n, 2, 2) float64 pixels. z: (n, 2). color: (n, 3) in 0 … 1. width: (n,) pixels. hidden: (n,) opacity.
    depth: (h, w) is read only; image: (h, w, 3) float32 is changed in place.
    """
    height, columns = depth.shape
    for s in range(ends.shape[0]):
        ax, ay = ends[s, 0, 0], ends[s, 0, 1]
        dx, dy = ends[s, 1, 0] - ax, ends[s, 1, 1] - ay
        length2 = dx * dx + dy * dy
        half = 0.5 * width[s]
        left = max(int(min(ax, ax + dx) - half - 1.0), 0)
        right = min(int(max(ax, ax + dx) + half + 1.0), columns - 1)
        top = max(int(min(ay, ay + dy) - half - 1.0), 0)
        bottom = min(int(max(ay, ay + dy) + half + 1.0), height - 1)
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                px, py = column + 0.5 - ax, row + 0.5 - ay
                t = 0.0 if length2 == 0.0 else min(max((px * dx + py * dy) / length2, 0.0), 1.0)
                ex, ey = px - t * dx, py - t * dy
                if ex * ex + ey * ey > half * half:
                    continue
                d = z[s, 0] + t * (z[s, 1] - z[s, 0])
                alpha = 1.0 if d >= depth[row, column] else hidden[s]
                for channel in range(3):
                    image[row, column, channel] += alpha * (color[s, channel] - image[row, column, channel])
