"""Triangles and segments into pixels with a depth buffer, in parallel projection (Pineda 1988, edge functions)."""

from __future__ import annotations

import numpy as np

from collision.numeric.kernel import kernel


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
            for column in range(left, right + 1):
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
