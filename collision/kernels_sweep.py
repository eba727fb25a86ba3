"""Numba kernels of `collision.sweep`: conservative advancement over two trees.

The least time for which any pair of nodes or of triangles surely holds (`collision.kernels_hold`) is the step, found by
branch and bound (Tang, Kim & Manocha, "C²A: Controlled Conservative Advancement", ICRA 2009; here the direction of a
certificate is any separating one, and its second-order term lets motion along a surface be told from motion towards
it). Both objects move along screws: body twists (v, w) are constant over t in [0, 1].
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from collision.kernels_distance import move, opened, rounding_of
from collision.kernels_hold import node_speeds, node_step, pair_step
from collision.kernels_triangles import planes_part
from collision.kernels_vector import cross, norm, rotated, sub
from collision.predicates import KERNEL

STEPS: Final = 20000
"""Advancements after which a pair counts as in contact at the time reached: a guard that stays on the safe side."""


@njit(error_model="numpy", **KERNEL)
def pose_at(rotation, translation, twist, t, rotation_t, translation_t):
    """Write the pose (rotation, translation)·exp(t·twist); twist = (v, w) in the body frame (Rodrigues' formula)."""
    wx, wy, wz = twist[3] * t, twist[4] * t, twist[5] * t
    angle = np.sqrt(wx * wx + wy * wy + wz * wz)
    if angle < 1e-4:  # the series, to the last bit at this size
        s, c, e = 1.0 - angle * angle / 6.0, 0.5 - angle * angle / 24.0, 1.0 / 6.0 - angle * angle / 120.0
    else:
        s = np.sin(angle) / angle
        half = np.sin(0.5 * angle) / angle
        c = 2.0 * half * half
        e = (1.0 - s) / (angle * angle)
    vx, vy, vz = twist[0] * t, twist[1] * t, twist[2] * t
    cx, cy, cz = wy * vz - wz * vy, wz * vx - wx * vz, wx * vy - wy * vx
    dx, dy, dz = wy * cz - wz * cy, wz * cx - wx * cz, wx * cy - wy * cx
    p = (vx + c * cx + e * dx, vy + c * cy + e * dy, vz + c * cz + e * dz)
    r = (
        (1.0 - c * (wy * wy + wz * wz), c * wx * wy - s * wz, c * wx * wz + s * wy),
        (c * wx * wy + s * wz, 1.0 - c * (wx * wx + wz * wz), c * wy * wz - s * wx),
        (c * wx * wz - s * wy, c * wy * wz + s * wx, 1.0 - c * (wx * wx + wy * wy)),
    )
    for i in range(3):
        translation_t[i] = translation[i] + rotation[i, 0] * p[0] + rotation[i, 1] * p[1] + rotation[i, 2] * p[2]
        for j in range(3):
            rotation_t[i, j] = rotation[i, 0] * r[0][j] + rotation[i, 1] * r[1][j] + rotation[i, 2] * r[2][j]


@njit(error_model="numpy", **KERNEL)
def relative(rotation_a, translation_a, rotation_b, translation_b, rotation, translation):
    """Write the pose of b in a's frame."""
    d = (
        translation_b[0] - translation_a[0], translation_b[1] - translation_a[1], translation_b[2] - translation_a[2],
    )  # fmt: skip
    for i in range(3):
        translation[i] = rotation_a[0, i] * d[0] + rotation_a[1, i] * d[1] + rotation_a[2, i] * d[2]
        for j in range(3):
            rotation[i, j] = (
                rotation_a[0, i] * rotation_b[0, j]
                + rotation_a[1, i] * rotation_b[1, j]
                + rotation_a[2, i] * rotation_b[2, j]
            )


@njit(error_model="numpy", **KERNEL)
def _stops(level, s, u, tolerance, play):
    """(signed distance at which a pair of nodes, of surfaces s and u or of several (-1), stops; what steps aim at)."""
    if level.shape[0] > 0 and s >= 0 and u >= 0 and level[s, u] < tolerance:
        return level[s, u], level[s, u] - 0.5 * play
    return tolerance, tolerance - play


@njit(error_model="numpy", **KERNEL)
def _leaf_step(
    i, j, vertices_a, first_a, count_a, corner_a, vertices_b, first_b, count_b, corner_b,
    rotation, translation, dv, dw, wa, fastest, ever, pace, level, aim, step, rounding, work,
):  # fmt: skip
    """(step, least signed distance - level) of two leaves; the step is what was given, or shorter."""
    least = np.inf
    most = norm(wa) * ever + (norm(dw) + norm(cross(wa, dw))) * pace
    for tb in range(first_b[j], first_b[j] + count_b[j]):
        p = move(rotation, translation, vertices_b, corner_b[tb, 0])
        q = move(rotation, translation, vertices_b, corner_b[tb, 1])
        r = move(rotation, translation, vertices_b, corner_b[tb, 2])
        low = (min(p[0], q[0], r[0]), min(p[1], q[1], r[1]), min(p[2], q[2], r[2]))
        high = (max(p[0], q[0], r[0]), max(p[1], q[1], r[1]), max(p[2], q[2], r[2]))
        for ta in range(first_a[i], first_a[i] + count_a[i]):
            ia, ib, ic = corner_a[ta, 0], corner_a[ta, 1], corner_a[ta, 2]
            a = (vertices_a[ia, 0], vertices_a[ia, 1], vertices_a[ia, 2])
            b = (vertices_a[ib, 0], vertices_a[ib, 1], vertices_a[ib, 2])
            c = (vertices_a[ic, 0], vertices_a[ic, 1], vertices_a[ic, 2])
            reach = max(0.0, level + fastest * step + 0.5 * most * step * step) + rounding
            if (
                min(a[0], b[0], c[0]) > high[0] + reach or low[0] > max(a[0], b[0], c[0]) + reach
                or min(a[1], b[1], c[1]) > high[1] + reach or low[1] > max(a[1], b[1], c[1]) + reach
                or min(a[2], b[2], c[2]) > high[2] + reach or low[2] > max(a[2], b[2], c[2]) + reach
            ):  # fmt: skip
                continue
            if planes_part(a, b, c, p, q, r, reach):
                continue
            d, hold = pair_step(a, b, c, p, q, r, dv, dw, wa, ever, pace, level, aim, step, rounding, work)
            least = min(least, d - level)
            if d <= level:
                return 0.0, least
            step = min(step, hold)
    return step, least


@njit(error_model="numpy", **KERNEL)
def sweep(
    vertices_a, box_a, second_a, first_a, count_a, corner_a, surface_a,
    vertices_b, box_b, second_b, first_b, count_b, corner_b, surface_b,
    rotation_a, translation_a, twist_a, rotation_b, translation_b, twist_b,
    until, tolerance, play, steps, level, hit, work, stack, safe, rotations, translations,
):  # fmt: skip
    """The first time in [0, until] at which a pair of surfaces comes to its level, or infinity.

    level: (ka, kb) m, the signed distance at which a surface pair stops the motion, -inf where it never does; (0, 0)
    where all stop at `tolerance`. Steps aim half of `play` (m) below a pair's own level, `play` below the others':
    the level is crossed, never by more than that.
    hit: (2,) the surface pair, also where `steps` advancements do not suffice and it counts as met where they end.
    rotations, translations: room for three.

    Returns (time, time of the advancement before it).
    """
    ra, rb, rotation = rotations[0], rotations[1], rotations[2]
    ta, tb, translation = translations[0], translations[1], translations[2]
    wa = (twist_a[3], twist_a[4], twist_a[5])
    wb = (twist_b[3], twist_b[4], twist_b[5])
    vb = (twist_b[0], twist_b[1], twist_b[2])
    t = 0.0
    before = 0.0
    hit[0], hit[1] = -1, -1
    last_a, last_b = -1, -1
    for _ in range(steps):
        pose_at(rotation_a, translation_a, twist_a, t, ra, ta)
        pose_at(rotation_b, translation_b, twist_b, t, rb, tb)
        relative(ra, ta, rb, tb, rotation, translation)
        rounding = rounding_of(box_a, box_b, rotation, translation)
        turned = rotated(rotation, wb)
        dw = sub(turned, wa)
        dv = sub(rotated(rotation, vb), cross(turned, (translation[0], translation[1], translation[2])))
        dv = (dv[0] - twist_a[0], dv[1] - twist_a[1], dv[2] - twist_a[2])
        step = until - t
        stack[0, 0], stack[0, 1] = 0, 0
        safe[0] = 0.0
        top = 1
        if last_a >= 0:  # what held the last step back is likely to hold this one back: asked first, it rules out much
            stack[1, 0], stack[1, 1] = last_a, last_b
            safe[1] = 0.0
            top = 2
        while top > 0:
            top -= 1
            if safe[top] >= step:
                continue
            i, j = stack[top, 0], stack[top, 1]
            s, u = surface_a[i], surface_b[j]
            if second_a[i] < 0 and second_b[j] < 0:
                stop, aim = _stops(level, s, u, tolerance, play)
                if stop == -np.inf:
                    continue
                _, _, _, fastest, ever, pace = node_speeds(box_b, j, rotation, translation, dv, dw, vb, wb)
                shorter, least = _leaf_step(
                    i, j, vertices_a, first_a, count_a, corner_a, vertices_b, first_b, count_b, corner_b,
                    rotation, translation, dv, dw, wa, fastest, ever, pace, stop, aim, step, rounding, work,
                )  # fmt: skip
                if least <= 0.0 or shorter < step:
                    hit[0], hit[1] = s, u
                    last_a, last_b = i, j
                if least <= 0.0:
                    return t, before
                step = shorter
                continue
            i0, j0, i1, j1 = opened(i, j, box_a, second_a, box_b, second_b)
            # no level lies above the tolerance, which is safe for nodes of several surfaces
            stop, aim = _stops(level, surface_a[i0], surface_b[j0], tolerance, play)
            s0 = node_step(
                box_a, i0, box_b, j0, rotation, translation, dv, dw, wa, vb, wb, stop + rounding, aim + rounding
            )
            stop, aim = _stops(level, surface_a[i1], surface_b[j1], tolerance, play)
            s1 = node_step(
                box_a, i1, box_b, j1, rotation, translation, dv, dw, wa, vb, wb, stop + rounding, aim + rounding
            )
            if s0 < s1:
                i0, j0, s0, i1, j1, s1 = i1, j1, s1, i0, j0, s0
            stack[top, 0], stack[top, 1], safe[top] = i0, j0, s0
            stack[top + 1, 0], stack[top + 1, 1], safe[top + 1] = i1, j1, s1
            top += 2
        if step >= until - t:
            return np.inf, t
        before = t
        t += step
    return t, before
