"""Candidates: which surfaces of which objects are near enough to meet soon, by bounding balls and boxes.

The list is made with slack and kept until something has moved by that slack (Verlet's neighbour list), so that most
steps ask nothing here. Static objects are only ever looked at from a moving one.
"""

from __future__ import annotations

import numpy as np

from collision.numeric.kernel import inner_kernel, kernel


@kernel(allocates=True)
def near_objects(movers, others, center, radius, reach, out):
    """Pairs (lower id, higher id) of a mover and any other whose balls are within `reach` (sum of both); how many.

    movers, others: ids; `others` includes the movers. center (n, 3), radius (n,), reach (n,): by id.
    """
    n = 0
    is_mover = np.zeros(len(radius), np.bool_)
    for i in movers:
        is_mover[i] = True
    for i in movers:
        for j in others:
            if j == i or (is_mover[j] and j < i):
                continue
            x, y, z = center[i, 0] - center[j, 0], center[i, 1] - center[j, 1], center[i, 2] - center[j, 2]
            r = radius[i] + radius[j] + reach[i] + reach[j]
            if x * x + y * y + z * z > r * r:
                continue
            if n < out.shape[0]:
                out[n, 0], out[n, 1] = min(i, j), max(i, j)
            n += 1
    return n


@inner_kernel
def closing_speed(velocity, radius, a, b):
    """m/s that points of the bodies a and b do not exceed towards one another; velocity (n, 6), radius (n,): by id."""
    total = 0.0
    for k in range(3):
        total += (velocity[a, k] - velocity[b, k]) ** 2
    speed = np.sqrt(total)
    for side in (a, b):
        w = velocity[side]
        speed += radius[side] * np.sqrt(w[3] * w[3] + w[4] * w[4] + w[5] * w[5])
    return speed


@inner_kernel
def apart(box_a, ra, pa, box_b, rb, pb, reach):
    """Whether two boxes in their own frames are farther apart than `reach` along one of their six axes."""
    for turn in range(2):
        if turn == 1:
            box_a, box_b = box_b, box_a
            ra, rb = rb, ra
            pa, pb = pb, pa
        for k in range(3):  # axis k of a
            at = 0.0
            extent = 0.0
            for m in range(3):
                at += ra[m, k] * (pb[m] - pa[m])
            for m in range(3):
                d = ra[0, k] * rb[0, m] + ra[1, k] * rb[1, m] + ra[2, k] * rb[2, m]
                at += d * 0.5 * (box_b[m] + box_b[3 + m])
                extent += abs(d) * 0.5 * (box_b[3 + m] - box_b[m])
            if at - extent > box_a[3 + k] + reach or at + extent < box_a[k] - reach:
                return True
    return False


@inner_kernel
def separation(box_a, ra, pa, box_b, rb, pb):
    """Largest gap (m) between two boxes in their own frames along one of their six axes, not above their distance."""
    most = -np.inf
    for turn in range(2):
        if turn == 1:
            box_a, box_b = box_b, box_a
            ra, rb = rb, ra
            pa, pb = pb, pa
        for k in range(3):  # axis k of a
            at = 0.0
            extent = 0.0
            for m in range(3):
                at += ra[m, k] * (pb[m] - pa[m])
            for m in range(3):
                d = ra[0, k] * rb[0, m] + ra[1, k] * rb[1, m] + ra[2, k] * rb[2, m]
                at += d * 0.5 * (box_b[m] + box_b[3 + m])
                extent += abs(d) * 0.5 * (box_b[3 + m] - box_b[m])
            most = max(most, at - extent - box_a[3 + k], box_a[k] - at - extent)
    return most


@kernel
def near_surfaces(objects, rotations, origins, shape_of, boxes, first_surface, count, whole, reach, out):
    """Surface pairs (a, surface, b, surface) of near objects whose boxes are within reach; how many.

    objects: (k, 2) sorted ids. boxes (s, 6) of all surfaces, those of shape f from first_surface[f], count[f] of them.
    whole: (shapes, 6) box of each shape. reach: (n,) by id.
    """
    n = 0
    for i in range(objects.shape[0]):
        a, b = objects[i, 0], objects[i, 1]
        fa, fb = shape_of[a], shape_of[b]
        within = reach[a] + reach[b]
        ra, pa, rb, pb = rotations[a], origins[a], rotations[b], origins[b]
        if apart(whole[fa], ra, pa, whole[fb], rb, pb, within):
            continue
        for sa in range(count[fa]):
            box = boxes[first_surface[fa] + sa]
            if apart(box, ra, pa, whole[fb], rb, pb, within):
                continue
            for sb in range(count[fb]):
                if apart(box, ra, pa, boxes[first_surface[fb] + sb], rb, pb, within):
                    continue
                if n < out.shape[0]:
                    out[n, 0], out[n, 1], out[n, 2], out[n, 3] = a, sa, b, sb
                n += 1
    return n


@kernel(allocates=True)
def within(pairs, center, radius, rotations, origins, shape_of, boxes, first_surface, whole, reach, closest):
    """Mask (k,) of the surface pairs (k, 4), sorted, whose boxes are within `reach` (k,) m.

    Of objects whose balls, or whole boxes (shapes, 6), are farther apart than `closest` (k,) m none are; `reach` and
    `closest` are alike for all rows of an object pair.
    """
    out = np.zeros(len(pairs), np.bool_)
    before_a, before_b = -1, -1
    near = False
    for i in range(len(pairs)):
        a, b = pairs[i, 0], pairs[i, 2]
        fa, fb = shape_of[a], shape_of[b]
        if a != before_a or b != before_b:
            before_a, before_b = a, b
            x, y, z = center[a, 0] - center[b, 0], center[a, 1] - center[b, 1], center[a, 2] - center[b, 2]
            r = radius[a] + radius[b] + closest[i]
            near = x * x + y * y + z * z <= r * r and not apart(
                whole[fa], rotations[a], origins[a], whole[fb], rotations[b], origins[b], closest[i]
            )
        if near:
            box_a = boxes[first_surface[fa] + pairs[i, 1]]
            box_b = boxes[first_surface[fb] + pairs[i, 3]]
            out[i] = not apart(box_a, rotations[a], origins[a], box_b, rotations[b], origins[b], reach[i])
    return out
