"""Surface pairs of near objects by their boxes: kernels of the neighbour list and of the narrow phase."""

from __future__ import annotations

import numpy as np

from collision.numeric.kernel import inner_kernel, kernel


@inner_kernel
def closing_speed(velocity, radius, a, b):
    """m/s: bound of the closing speed of any two points of bodies a and b; velocity (n, 6), radius (n,): by id."""
    total = 0.0
    for k in range(3):
        total += (velocity[a, k] - velocity[b, k]) ** 2
    speed = np.sqrt(total)
    for side in (a, b):
        w = velocity[side]
        speed += radius[side] * np.sqrt(w[3] * w[3] + w[4] * w[4] + w[5] * w[5])
    return speed


@inner_kernel
def separation(box_a, ra, pa, box_b, rb, pb, enough):
    """Largest gap (m) between two boxes in their own frames along one of their six axes; the first above `enough`.

    A lower bound of their distance, negative where they overlap on all six.
    """
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
            if most > enough:
                return most
    return most


@inner_kernel
def apart(box_a, ra, pa, box_b, rb, pb, reach):
    """Whether two boxes in their own frames are farther apart than `reach` (m) along one of their six axes."""
    return separation(box_a, ra, pa, box_b, rb, pb, reach) > reach


@kernel
def near_surfaces(objects, rotations, origins, shape_of, boxes, first_surface, count, whole, reach, out):
    """Write pairs (a, surface, b, surface) of surfaces whose boxes are within reach to `out`; returns their number.

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

    False for all pairs of objects whose balls or whole boxes (shapes, 6) are farther apart than `closest` (k,) m.
    `reach` and `closest` are equal for all rows of an object pair.
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
