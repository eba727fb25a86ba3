"""Stage 1, filter objects: which pairs of objects have boxes that meet. Kernels.

Sweep and prune along one axis (Baraff 1992; Cohen et al., I-COLLIDE, 1995) over boxes in the world, kept sorted from
frame to frame. What may not move is swept against what may, never against its like.
"""

from __future__ import annotations

from typing import Final

from numba import njit

from collision.boxes import take_pose

OFFSET: Final = 64.0 * 2.0**-53
"""rounding of a moved vertex, of a relative pose and of a box in the world, a unit of length of the coordinates"""


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
def move_world_boxes(own, pose, stale, box):
    """Bring `box` (n, 6), the objects' boxes in the world, up to date from their boxes at home, `own`."""
    for i in range(len(stale)):
        if not stale[i]:
            continue
        stale[i] = False
        place = 0.0
        for d in range(3):
            place += abs(pose[i, 9 + d]) + max(abs(own[i, d]), abs(own[i, d + 3]))
        for d in range(3):
            centre, half = pose[i, 9 + d], OFFSET * place
            for e in range(3):
                r = pose[i, 3 * d + e]
                centre += r * (0.5 * own[i, e] + 0.5 * own[i, e + 3])
                half += abs(r) * (0.5 * own[i, e + 3] - 0.5 * own[i, e])
            box[i, d] = centre - half
            box[i, d + 3] = centre + half


@njit(cache=True, nogil=True)
def _sort_by_least(order, box, axis):
    """Insertion sort: next to nothing where little has moved."""
    for i in range(1, len(order)):
        item = order[i]
        least = box[item, axis]
        j = i
        while j > 0 and box[order[j - 1], axis] > least:
            order[j] = order[j - 1]
            j -= 1
        order[j] = item


@njit(cache=True, nogil=True)
def _scan(i, order, begin, box, axis, within, chosen, pairs, n):
    """Add to `pairs` those of i with what begins in `order[begin:]` before i ends along the axis; how many there are.

    Goes on counting where `pairs` is full.
    """
    y, z = (axis + 1) % 3, (axis + 2) % 3
    end = box[i, axis + 3] + within
    y0, y1 = box[i, y] - within, box[i, y + 3] + within
    z0, z1 = box[i, z] - within, box[i, z + 3] + within
    for k in range(begin, len(order)):
        j = order[k]
        if box[j, axis] > end:
            break
        if box[j, y] <= y1 and y0 <= box[j, y + 3] and box[j, z] <= z1 and z0 <= box[j, z + 3]:
            if not (chosen[i] or chosen[j]):
                continue
            if n < len(pairs):
                pairs[n, 0] = min(i, j)
                pairs[n, 1] = max(i, j)
            n += 1
    return n


@njit(cache=True, nogil=True)
def sweep(movers, fixed, box, axis, within, chosen, pairs):
    """Place in `pairs` (m, 2) the pairs i < j, at least one of them a mover and one chosen, whose boxes come near.

    Near is within `within` along every axis. How many there are is returned, perhaps more than m: then `pairs` is full.
    `movers` and `fixed` are sorted along the axis, and left so.
    """
    _sort_by_least(movers, box, axis)
    _sort_by_least(fixed, box, axis)
    n = 0
    f = 0
    for k in range(len(movers)):
        i = movers[k]
        least = box[i, axis]
        while f < len(fixed) and box[fixed[f], axis] < least:
            n = _scan(fixed[f], movers, k, box, axis, within, chosen, pairs, n)
            f += 1
        n = _scan(i, movers, k + 1, box, axis, within, chosen, pairs, n)
        n = _scan(i, fixed, f, box, axis, within, chosen, pairs, n)
    return n
