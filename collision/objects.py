"""Stage 1, filter objects: which pairs of objects come near each other by their boxes and spheres.

Two wide trees (see `collision.wide`) over boxes in the world, of the objects that may move and of the others, are kept
from frame to frame. The boxes of the first follow the objects, which are grouped anew when those have grown too large;
the second stays as it is. What may move is asked against both, what may not never against its like.
"""

# mypy: disable-error-code="call-arg, var-annotated"
# (numba's intrinsics take one argument less than they are written with)

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from collision.boxes import take_pose
from collision.kernels_tree import add_levels, empty_node, longest_axis, middle, select
from collision.lanes import overlapping
from collision.memory import lowest
from collision.wide import BOXES, LANES, nodes_over

OFFSET: Final = 64.0 * 2.0**-53
"""rounding of a moved vertex, of a relative pose and of a box in the world, a unit of length of the coordinates"""
SKEW: Final = 8.0
"""how far a rotation that is not quite one shifts a vertex, a unit of |RᵀR - I| and of length of its coordinates: the
verdict is about b moved into a's frame by a's transposed rotation, boxes and spheres are in the world"""
GROWN: Final = 1.5
"""times the extent of the groups of eight objects when formed, beyond which they are formed anew"""


class ObjectTree:
    """Boxes in the world of some objects, eight a node, from groups of eight objects up to one node."""

    def __init__(self, ids: NDArray[np.int64]) -> None:
        self.ids = ids
        """in the order of the tree"""
        self.nodes = np.empty(BOXES * max(1, nodes_over(len(ids))), np.float32)
        starts, boxes = [0], -(-len(ids) // LANES)
        while boxes > 1:
            starts.append(starts[-1] + BOXES * boxes)
            boxes = -(-boxes // LANES)
        self.starts = np.array(starts, np.int64)
        """where in `nodes` each level begins"""
        self.formed = -1.0
        """the extent of the groups of eight objects when they were formed"""

    def follow(self, box: NDArray[np.float64]) -> None:
        """Bring the tree up to date with the objects' boxes (n, 6) in the world."""
        if set_nodes(self.ids, box, self.nodes) > GROWN * self.formed:
            form_groups(self.ids, np.ascontiguousarray((0.5 * box[:, :3] + 0.5 * box[:, 3:]).T))
            self.formed = set_nodes(self.ids, box, self.nodes)

    @property
    def arrays(self) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.int64]]:
        """ids, nodes, starts"""
        return self.ids, self.nodes, self.starts


@njit(cache=True, nogil=True)
def relative_poses(pose, pairs, out):
    """Place in `out` (n, 12) the poses of the second of each pair in the frame of the first, for (12,) poses."""
    for k in range(len(pairs)):
        a, b = pairs[k, 0], pairs[k, 1]
        for i in range(3):
            for j in range(3):
                out[k, 3 * i + j] = (
                    pose[a, i] * pose[b, j] + pose[a, 3 + i] * pose[b, 3 + j] + pose[a, 6 + i] * pose[b, 6 + j]
                )
            out[k, 9 + i] = (
                pose[a, i] * (pose[b, 9] - pose[a, 9])
                + pose[a, 3 + i] * (pose[b, 10] - pose[a, 10])
                + pose[a, 6 + i] * (pose[b, 11] - pose[a, 11])
            )


@njit(cache=True, nogil=True)
def take_poses(matrices, rigid, packed):
    """Place (n, 4, 4) `matrices` in `packed` (n, 12); the place of the first that is no rigid motion, or -1."""
    for n in range(len(matrices)):
        if not take_pose(matrices[n], rigid, packed[n]):
            return n
    return -1


@njit(cache=True, nogil=True)
def move_world_boxes(own, pose, stale, box, radius):
    """Bring `box` (n, 6) and `radius` (n,), the objects' boxes in the world and spheres about the boxes' centres, up to
    date from those at home, `own` (n, 7)."""
    for i in range(len(stale)):
        if not stale[i]:
            continue
        stale[i] = False
        place = size = off = 0.0
        for d in range(3):
            greatest = max(abs(own[i, d]), abs(own[i, d + 3]))
            place += abs(pose[i, 9 + d]) + greatest
            size += greatest
            for e in range(d, 3):
                r = pose[i, d] * pose[i, e] + pose[i, 3 + d] * pose[i, 3 + e] + pose[i, 6 + d] * pose[i, 6 + e]
                off = max(off, abs(r - (1.0 if d == e else 0.0)))
        doubt = OFFSET * place + SKEW * off * size
        radius[i] = own[i, 6] + 2.0 * doubt
        for d in range(3):
            centre, half = pose[i, 9 + d], doubt
            for e in range(3):
                r = pose[i, 3 * d + e]
                centre += r * (0.5 * own[i, e] + 0.5 * own[i, e + 3])
                half += abs(r) * (0.5 * own[i, e + 3] - 0.5 * own[i, e])
            box[i, d] = centre - half
            box[i, d + 3] = centre + half


@njit(cache=True, nogil=True)
def _below(x):
    """A float32 below x; finite, if x is above all float32."""
    y = np.float32(min(x, 3e38) - 1e-30)
    return y - abs(y) * np.float32(1.2e-7)


@njit(cache=True, nogil=True)
def _above(x):
    y = np.float32(max(x, -3e38) + 1e-30)
    return y + abs(y) * np.float32(1.2e-7)


@njit(cache=True, nogil=True)
def form_groups(ids, centre):
    """Order `ids` so that 8, 64, 512 … in a row lie close together, by their centres (3, n)."""
    key = np.empty(len(ids))
    stack = np.empty((128, 2), np.int64)
    stack[0, 0], stack[0, 1] = 0, len(ids)
    top = 1
    while top > 0:
        top -= 1
        lo, hi = stack[top, 0], stack[top, 1]
        if hi - lo > LANES:
            mid = lo + middle(hi - lo, LANES)
            select(centre[longest_axis(centre, ids, lo, hi)], ids, lo, hi, mid, key)
            stack[top, 0], stack[top, 1] = mid, hi
            stack[top + 1, 0], stack[top + 1, 1] = lo, mid
            top += 2


@njit(cache=True, nogil=True)
def set_nodes(ids, box, nodes):
    """Fill the nodes of an `ObjectTree`; the sum of the extents of the groups of eight objects."""
    groups = (len(ids) + LANES - 1) // LANES
    extent = 0.0
    for group in range(groups):
        at = BOXES * group
        empty_node(nodes, at)
        for d in range(3):
            low, high = np.inf, -np.inf
            for k in range(min(LANES, len(ids) - LANES * group)):
                i = ids[LANES * group + k]
                nodes[at + LANES * d + k] = _below(box[i, d])
                nodes[at + LANES * (d + 3) + k] = _above(box[i, d + 3])
                low, high = min(low, box[i, d]), max(high, box[i, d + 3])
            extent += high - low
    add_levels(nodes, 0, groups)
    return extent


@njit(cache=True, nogil=True)
def _near(i, after, ids, nodes, starts, box, radius, within, chosen, pairs, n, stack):
    """Add to `pairs` those of i with objects of a tree, behind place `after` in it; how many pairs there are then.

    Goes on counting where `pairs` is full.
    """
    x0, y0, z0 = _below(box[i, 0] - within), _below(box[i, 1] - within), _below(box[i, 2] - within)
    x1, y1, z1 = _above(box[i, 3] + within), _above(box[i, 4] + within), _above(box[i, 5] + within)
    stack[0, 0], stack[0, 1] = len(starts) - 1, 0
    top = 1
    while top > 0:
        top -= 1
        level, node = stack[top, 0], stack[top, 1]
        bits = overlapping(nodes, starts[level] + BOXES * node, x0, y0, z0, x1, y1, z1)
        while bits != 0:
            child = LANES * node + lowest(bits)
            bits &= bits - 1
            first, size = child << (3 * level), 1 << (3 * level)
            if first >= len(ids) or first + size <= after:  # an empty lane is in a box without end
                continue
            if level > 0:
                stack[top, 0], stack[top, 1] = level - 1, child
                top += 1
                continue
            j = ids[child]
            if (chosen[i] or chosen[j]) and _meet(i, j, box, radius, within):
                if n < len(pairs):
                    pairs[n, 0] = min(i, j)
                    pairs[n, 1] = max(i, j)
                n += 1
    return n


@njit(cache=True, nogil=True)
def _meet(i, j, box, radius, within):
    """Whether both the boxes and the spheres of two objects come within `within`."""
    apart = 0.0
    for d in range(3):
        if box[i, d] - within > box[j, d + 3] or box[j, d] - within > box[i, d + 3]:
            return False
        apart += (0.5 * (box[i, d] + box[i, d + 3]) - 0.5 * (box[j, d] + box[j, d + 3])) ** 2
    return apart <= (radius[i] + radius[j] + within) ** 2


@njit(cache=True, nogil=True)
def near_pairs(ids, nodes, starts, fixed_ids, fixed_nodes, fixed_starts, box, radius, within, chosen, pairs):
    """Place in `pairs` (m, 2) the pairs i < j, at least one of them a mover and one chosen, that come near.

    First the arrays of the movers' tree, then those of the others'. Near is within `within` along every axis by boxes,
    and by spheres. How many there are is returned, perhaps more than m: then `pairs` is full.
    """
    stack = np.empty((128, 2), np.int64)
    n = 0
    for place in range(len(ids)):
        i = ids[place]
        n = _near(i, place + 1, ids, nodes, starts, box, radius, within, chosen, pairs, n, stack)
        if len(fixed_ids) > 0:
            n = _near(i, 0, fixed_ids, fixed_nodes, fixed_starts, box, radius, within, chosen, pairs, n, stack)
    return n
