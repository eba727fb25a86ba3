"""Traversal of one hierarchy against a single box, that of a point or a triangle, in lane 0 of `ws.moved`.

A task of this kind is called with (a, a) for the two hierarchies and `ALONE` for the lane of b. It has `children_of_a`,
but neither `children` nor `children_of_b`.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from collision.bvh.layout import LANES
from collision.numeric.kernel import inline_kernel, inner_kernel

ALONE: Final = 0xFFFFFFFF
"""lane of the single box"""


def below_packets_alone(task, bvh, lane):
    """`is_bottom` of tasks for one hierarchy."""
    return lane == ALONE or bvh.child[lane] < 0


@inner_kernel
def _place(frame, moved, d, low, high):
    slack = 2.0**-50 * (max(abs(low), abs(high)) + frame[6]) + 1e-37
    low, high = low - frame[d] - slack, high - frame[d] + slack
    moved[LANES * d] = np.float32(low - 1.2e-7 * abs(low))
    moved[LANES * (d + 3)] = np.float32(high + 1.2e-7 * abs(high))


@inline_kernel
def place_box(bvh, ws, low, high):
    """Set the single box to that from `low` to `high`, (x, y, z) in the mesh's frame, m, rounded outwards."""
    for d in range(3):
        _place(bvh.frame, ws.moved, d, low[d], high[d])
