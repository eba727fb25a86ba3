"""Walks of one hierarchy: a point or a triangle stands in the place of the second, as a box in lane 0 of `ws.moved`.

Such tasks take (a, a) for the two hierarchies and `ALONE` for the lane of b. They have `children_of_a`, and neither
`children` nor `children_of_b`.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from collision.bvh.layout import LANES
from collision.numeric.kernel import inline_kernel, inner_kernel

ALONE: Final = 0xFFFFFFFF
"""the lane of the one box"""


def below_packets_alone(task, bvh, lane):
    """`is_bottom` of tasks about one hierarchy."""
    return lane == ALONE or bvh.child[lane] < 0


@inner_kernel
def _place(frame, moved, d, low, high):
    slack = 2.0**-50 * (max(abs(low), abs(high)) + frame[6]) + 1e-37
    low, high = low - frame[d] - slack, high - frame[d] + slack
    moved[LANES * d] = np.float32(low - 1.2e-7 * abs(low))
    moved[LANES * (d + 3)] = np.float32(high + 1.2e-7 * abs(high))


@inline_kernel
def place_box(bvh, ws, low, high):
    """Make the box from `low` to `high`, (x, y, z) in the mesh's frame, m, the one that stands for b."""
    for d in range(3):
        _place(bvh.frame, ws.moved, d, low[d], high[d])
