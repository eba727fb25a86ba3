"""Numba kernels of `collision.sweep`: conservative advancement over two trees.

At a time t every pair of nodes (or of triangles) yields a certificate: a direction n in a's frame along which it is
separated by g, the speed s at which b's points can close that gap at t, and a bound k of how fast that speed can grow.
The pair then stays apart for as long as s·dt + k·dt²/2 < g. The least such dt over the pair of trees is the step, found
by branch and bound (Tang, Kim & Manocha, "C²A: Controlled Conservative Advancement", ICRA 2009; here n is any
separating direction, and the second-order term lets motion along a surface be told from motion towards it).

Both objects move along screws: body twists (v, w) are constant over t in [0, 1]. A point x of b, in a's frame, moves
with u = dv + dw × x, dw = R·w_b - w_a. In the world, where dw is constant, du/dt = dw × (the velocity x has by b's own
motion, of constant length), and a's frame turns with w_a; so for n fixed in a's frame

    |n·du/dt| <= |n × w_a|·|u| + (|n × dw| + |w_a × dw|)·|v_b + w_b × x_b|

where |w_a × dw| bounds how far dw can turn in a's frame within the unit of time.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from collision.kernels_distance import box_gap, closest_features, move, planes_part, rounding_of, size_of
from collision.kernels_vector import cross, dot, norm, sub
from collision.polygons import triangles_meet
from collision.predicates import KERNEL

STEPS: Final = 20000
"""Advancements after which a pair counts as in contact at the time reached: a guard that stays on the safe side."""


@njit(error_model="numpy", **KERNEL)
def _turned(rotation, u):
    return (
        rotation[0, 0] * u[0] + rotation[0, 1] * u[1] + rotation[0, 2] * u[2],
        rotation[1, 0] * u[0] + rotation[1, 1] * u[1] + rotation[1, 2] * u[2],
        rotation[2, 0] * u[0] + rotation[2, 1] * u[1] + rotation[2, 2] * u[2],
    )


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
def _safe(g, s, k):
    """The greatest dt with s·dt + k·dt²/2 <= g, for g > 0 and k >= 0; infinity if there is none."""
    root = np.sqrt(s * s + 2.0 * k * g)
    if s + root > 0.0:
        return 2.0 * g / (s + root)
    return np.inf


@njit(error_model="numpy", **KERNEL)
def _node_speeds(box_b, j, rotation, translation, dv, dw, vb, wb):
    """(middle of a node of b in a's frame, its half extents, velocity of the middle, speed of the fastest point against
    a now, against a at any time up to 1, and by b's own motion)."""
    bc = (0.5 * (box_b[j, 0] + box_b[j, 3]), 0.5 * (box_b[j, 1] + box_b[j, 4]), 0.5 * (box_b[j, 2] + box_b[j, 5]))
    bh = (box_b[j, 3] - bc[0], box_b[j, 4] - bc[1], box_b[j, 5] - bc[2])
    c = _turned(rotation, bc)
    c = (c[0] + translation[0], c[1] + translation[1], c[2] + translation[2])
    radius = norm(bh)
    u = cross(dw, c)
    u = (u[0] + dv[0], u[1] + dv[1], u[2] + dv[2])
    own = cross(wb, bc)
    own = (own[0] + vb[0], own[1] + vb[1], own[2] + vb[2])
    turn = norm(dw)
    fastest = norm(u) + turn * radius
    pace = norm(own) + norm(wb) * radius
    return c, bh, u, fastest, fastest + turn * pace, pace


@njit(error_model="numpy", **KERNEL)
def _node_step(box_a, i, box_b, j, rotation, translation, dv, dw, wa, vb, wb, level, aim):
    """How long two nodes that are more than `level` (m) apart, or overlap by less, surely stay `aim` apart; else 0.

    The gap of the boxes along an axis is never more than the signed distance of triangles in them.
    """
    if level == -np.inf:
        return np.inf
    c, bh, u, fastest, ever, pace = _node_speeds(box_b, j, rotation, translation, dv, dw, vb, wb)
    turn, bend = norm(dw), norm(cross(wa, dw))
    step = 0.0
    square = 0.0
    for d in range(3):
        e, f = (d + 1) % 3, (d + 2) % 3
        half = abs(rotation[d, 0]) * bh[0] + abs(rotation[d, 1]) * bh[1] + abs(rotation[d, 2]) * bh[2]
        middle = 0.5 * (box_a[i, d] + box_a[i, d + 3])
        offset = c[d] - middle
        gap = abs(offset) - half - (box_a[i, d + 3] - middle)
        if gap > level:
            closing = -u[d] if offset > 0.0 else u[d]
            for k in range(3):
                closing += abs(dw[e] * rotation[f, k] - dw[f] * rotation[e, k]) * bh[k]
            spin = np.sqrt(dw[e] * dw[e] + dw[f] * dw[f])
            growth = np.sqrt(wa[e] * wa[e] + wa[f] * wa[f]) * ever + (spin + bend) * pace
            step = max(step, _safe(gap - aim, closing, growth))
        if gap > 0.0:
            square += gap * gap
    distance = np.sqrt(square)
    if distance > max(level, 0.0):
        step = max(step, _safe(distance - aim, fastest, norm(wa) * ever + (turn + bend) * pace))
    return step


@njit(error_model="numpy", **KERNEL)
def _stops(level, s, u, tolerance, play):
    """(signed distance at which a pair of nodes, of surfaces s and u or of several (-1), stops; what steps aim at)."""
    if level.shape[0] > 0 and s >= 0 and u >= 0 and level[s, u] < tolerance:
        return level[s, u], level[s, u] - 0.5 * play
    return tolerance, tolerance - play


@njit(error_model="numpy", **KERNEL)
def _range(n, a, b, c):
    x, y, z = dot(n, a), dot(n, b), dot(n, c)
    return min(x, y, z), max(x, y, z)


@njit(error_model="numpy", **KERNEL)
def _hold(n, front, p, q, r, dv, dw, wa, ever, pace, aim):
    """How long p, q, r, which move, surely stay more than `aim` beyond the plane n·x = `front`: each by its own speed.

    What is far beyond may come fast: a large triangle beside a small one that turns.
    """
    growth = norm(cross(n, wa)) * ever + (norm(cross(n, dw)) + norm(cross(wa, dw))) * pace
    hold = np.inf
    for k in range(3):
        x = p if k == 0 else (q if k == 1 else r)
        gap = dot(n, x) - front - aim
        if gap <= 0.0:
            return 0.0
        hold = min(hold, _safe(gap, -dot(n, dv) - dot(n, cross(dw, x)), growth))
    return hold


@njit(error_model="numpy", **KERNEL)
def separation(a, b, c, p, q, r, dv, dw, wa, ever, pace, level, aim, enough):
    """(separation of two triangles, how long it surely stays above `aim`), over their normals and products of edges.

    The separation is the greatest over these axes. For triangles that meet it is minus the length of the shortest
    translation that parts them, 0 for triangles in one plane. It holds as long as along the axis that holds longest.
    Ends with the first axis that shows it to be above `level`, and to hold for `enough`.
    """
    ab, bc, ca = sub(b, a), sub(c, b), sub(a, c)
    pq, qr, rp = sub(q, p), sub(r, q), sub(p, r)
    best, hold = -np.inf, 0.0
    for k in range(-2, 9):
        if k == -2:
            n = cross(ab, bc)
        elif k == -1:
            n = cross(pq, qr)
        else:
            u = ab if k < 3 else (bc if k < 6 else ca)
            v = pq if k % 3 == 0 else (qr if k % 3 == 1 else rp)
            n = cross(u, v)
        length = norm(n)
        if length == 0.0:
            continue
        n = (n[0] / length, n[1] / length, n[2] / length)
        low_a, high_a = _range(n, a, b, c)
        low_b, high_b = _range(n, p, q, r)
        ahead, behind = low_b - high_a, low_a - high_b
        best = max(best, ahead, behind)
        if ahead > aim:
            hold = max(hold, _hold(n, high_a, p, q, r, dv, dw, wa, ever, pace, aim))
        if behind > aim:
            n = (-n[0], -n[1], -n[2])
            hold = max(hold, _hold(n, -low_a, p, q, r, dv, dw, wa, ever, pace, aim))
        if best > level and hold >= enough:
            break
    if best == -np.inf:
        best = 0.0  # points or parallel segments, which meet in a point or along a line
    return best, hold


@njit(error_model="numpy", **KERNEL)
def _pair_step(a, b, c, p, q, r, dv, dw, wa, ever, pace, level, aim, enough, touching, work):
    """(signed distance of two triangles, how long it surely stays above `aim`); less exact if that is `enough`.

    Signed distance: the distance, or the separation where they meet or are nearer than `touching` (m), below which
    float64 no longer tells the direction from one witness to the other.
    """
    s, hold = separation(a, b, c, p, q, r, dv, dw, wa, ever, pace, level, aim, enough)
    if (s > level and hold >= enough) or triangles_meet(a, b, c, p, q, r, work):
        return s, hold
    d2, x, y = closest_features(a, b, c, p, q, r)
    d = np.sqrt(d2)
    if d <= touching:
        return s, hold
    if d > aim:
        n = sub(y, x)
        n = (n[0] / d, n[1] / d, n[2] / d)
        _, front = _range(n, a, b, c)
        hold = max(hold, _hold(n, front, p, q, r, dv, dw, wa, ever, pace, aim))
    return d, hold


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
            d, hold = _pair_step(a, b, c, p, q, r, dv, dw, wa, ever, pace, level, aim, step, rounding, work)
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
        turned = _turned(rotation, wb)
        dw = sub(turned, wa)
        dv = sub(_turned(rotation, vb), cross(turned, (translation[0], translation[1], translation[2])))
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
            leaf_a, leaf_b = second_a[i] < 0, second_b[j] < 0
            if leaf_a and leaf_b:
                stop, aim = _stops(level, s, u, tolerance, play)
                if stop == -np.inf:
                    continue
                _, _, _, fastest, ever, pace = _node_speeds(box_b, j, rotation, translation, dv, dw, vb, wb)
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
            if leaf_b or (not leaf_a and size_of(box_a, i) >= size_of(box_b, j)):
                i0, j0, i1, j1 = i + 1, j, second_a[i], j
            else:
                i0, j0, i1, j1 = i, j + 1, i, second_b[j]
            # no level lies above the tolerance, which is safe for nodes of several surfaces
            stop, aim = _stops(level, surface_a[i0], surface_b[j0], tolerance, play)
            s0 = _node_step(
                box_a, i0, box_b, j0, rotation, translation, dv, dw, wa, vb, wb, stop + rounding, aim + rounding
            )
            stop, aim = _stops(level, surface_a[i1], surface_b[j1], tolerance, play)
            s1 = _node_step(
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


@njit(error_model="numpy", **KERNEL)
def _signed_gap(box_a, i, box_b, j, rotation, translation):
    """Lower bound of the signed distance of triangles in two nodes: the boxes' distance, or minus what parts them."""
    gap = box_gap(box_a, i, box_b, j, rotation, translation)
    if gap > 0.0:
        return np.sqrt(gap)
    most = -np.inf
    bx, by, bz = 0.5 * (box_b[j, 0] + box_b[j, 3]), 0.5 * (box_b[j, 1] + box_b[j, 4]), 0.5 * (box_b[j, 2] + box_b[j, 5])
    hx, hy, hz = box_b[j, 3] - bx, box_b[j, 4] - by, box_b[j, 5] - bz
    for d in range(3):
        half = abs(rotation[d, 0]) * hx + abs(rotation[d, 1]) * hy + abs(rotation[d, 2]) * hz
        offset = rotation[d, 0] * bx + rotation[d, 1] * by + rotation[d, 2] * bz + translation[d]
        middle = 0.5 * (box_a[i, d] + box_a[i, d + 3])
        most = max(most, abs(offset - middle) - half - (box_a[i, d + 3] - middle))
    return most


@njit(error_model="numpy", **KERNEL)
def _leaf_depth(
    i, j, vertices_a, first_a, count_a, corner_a, vertices_b, first_b, count_b, corner_b,
    rotation, translation, least, rounding, work,
):  # fmt: skip
    """`least`, or the least signed distance of two leaves' triangles if that is less."""
    still = (0.0, 0.0, 0.0)
    for tb in range(first_b[j], first_b[j] + count_b[j]):
        p = move(rotation, translation, vertices_b, corner_b[tb, 0])
        q = move(rotation, translation, vertices_b, corner_b[tb, 1])
        r = move(rotation, translation, vertices_b, corner_b[tb, 2])
        for ta in range(first_a[i], first_a[i] + count_a[i]):
            ia, ib, ic = corner_a[ta, 0], corner_a[ta, 1], corner_a[ta, 2]
            a = (vertices_a[ia, 0], vertices_a[ia, 1], vertices_a[ia, 2])
            b = (vertices_a[ib, 0], vertices_a[ib, 1], vertices_a[ib, 2])
            c = (vertices_a[ic, 0], vertices_a[ic, 1], vertices_a[ic, 2])
            beyond = -np.inf  # what parts their boxes parts the triangles: a lower bound of their signed distance
            for k in range(3):
                low_a, high_a = min(a[k], b[k], c[k]), max(a[k], b[k], c[k])
                low_b, high_b = min(p[k], q[k], r[k]), max(p[k], q[k], r[k])
                beyond = max(beyond, low_b - high_a, low_a - high_b)
            if beyond < least and not planes_part(a, b, c, p, q, r, max(0.0, least)):
                d, _ = _pair_step(a, b, c, p, q, r, still, still, still, 0.0, 0.0, least, least, 0.0, rounding, work)
                least = min(least, d)
    return least


@njit(error_model="numpy", **KERNEL)
def depths_of(
    pairs, root_a, root_b,
    vertices_a, box_a, second_a, first_a, count_a, corner_a,
    vertices_b, box_b, second_b, first_b, count_b, corner_b,
    rotation, translation, within, rounding, depths, work, stack, safe,
):  # fmt: skip
    """The least signed distance (m) of each pair of surfaces, or `within` (>= 0) if it is more, into `depths`."""
    for k in range(len(pairs)):
        depths[k] = _depth(
            root_a[pairs[k, 0]], root_b[pairs[k, 1]],
            vertices_a, box_a, second_a, first_a, count_a, corner_a,
            vertices_b, box_b, second_b, first_b, count_b, corner_b,
            rotation, translation, within, rounding, work, stack, safe,
        )  # fmt: skip


@njit(error_model="numpy", **KERNEL)
def _depth(
    root_a, root_b,
    vertices_a, box_a, second_a, first_a, count_a, corner_a,
    vertices_b, box_b, second_b, first_b, count_b, corner_b,
    rotation, translation, within, rounding, work, stack, safe,
):  # fmt: skip
    least = within
    stack[0, 0], stack[0, 1] = root_a, root_b
    safe[0] = -np.inf
    top = 1
    while top > 0:
        top -= 1
        if safe[top] > least + rounding:
            continue
        i, j = stack[top, 0], stack[top, 1]
        leaf_a, leaf_b = second_a[i] < 0, second_b[j] < 0
        if leaf_a and leaf_b:
            least = _leaf_depth(
                i, j, vertices_a, first_a, count_a, corner_a, vertices_b, first_b, count_b, corner_b,
                rotation, translation, least, rounding, work,
            )  # fmt: skip
            continue
        if leaf_b or (not leaf_a and size_of(box_a, i) >= size_of(box_b, j)):
            i0, j0, i1, j1 = i + 1, j, second_a[i], j
        else:
            i0, j0, i1, j1 = i, j + 1, i, second_b[j]
        g0 = _signed_gap(box_a, i0, box_b, j0, rotation, translation)
        g1 = _signed_gap(box_a, i1, box_b, j1, rotation, translation)
        if g0 < g1:
            i0, j0, g0, i1, j1, g1 = i1, j1, g1, i0, j0, g0
        stack[top, 0], stack[top, 1], safe[top] = i0, j0, g0
        stack[top + 1, 0], stack[top + 1, 1], safe[top + 1] = i1, j1, g1
        top += 2
    return least
