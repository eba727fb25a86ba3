"""The equations that constraints are made of, each with its analytic Jacobian, as kernels over flat arrays.

An equation speaks of one *element* on each body: a point P and an orthonormal frame (E1, E2, D), D the axis or
normal. With u = P_b - P_a, every row f of every equation is a function of u and of the frames' directions, and so
its differential is a pair of wrenches: with Ω the bodies' angular and V their linear velocities (world axes)

    df = g·(V_b + Ω_b × arm_b) - g·(V_a + Ω_a × arm_a) + τ_a·Ω_a + τ_b·Ω_b,       arm = R p,

where g = ∂f/∂u and τ = Σ X × ∂f/∂X over the directions X that the body carries. A kernel below states only f, g, τ_a
and τ_b; `evaluate` turns them into rows on local twists (linear first), as Pinocchio has them:

    J_a = [-R_aᵀ g, R_aᵀ (τ_a - arm_a × g)],      J_b = [R_bᵀ g, R_bᵀ (τ_b + arm_b × g)].

Lengths are metres and angles radians; a row is one or the other. Equations of one row hold between limits
`params[0] <= x <= params[1]`: inside them the row vanishes, equal limits make an equality.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

COINCIDENT = 0
ON_LINE = 1
ALIGNED = 2
ORIENTED = 3
ON_PLANE = 4
ANGLE = 5
POINT_DISTANCE = 6
LINE_DISTANCE = 7
LINES_DISTANCE = 8
CONE_DISTANCE = 9
TORUS_DISTANCE = 10
RIM_HEIGHT = 11
HELIX = 12
MESH = 13
RACK = 14

ROWS = (3, 2, 2, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1)
"""Rows of each equation, by code."""
ANGULAR = (False, False, True, True, False, True, False, False, False, False, False, False, False, True, False)
"""Whether an equation's rows are radians, by code."""
TWO_PI = 2.0 * math.pi


@njit(cache=True, inline="always")
def _dot(x, y):
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


@njit(cache=True)
def _cross(x, y, out):
    a = x[1] * y[2] - x[2] * y[1]
    b = x[2] * y[0] - x[0] * y[2]
    out[2] = x[0] * y[1] - x[1] * y[0]
    out[0] = a
    out[1] = b


@njit(cache=True)
def _put(scale, x, out):
    """out = scale · x. Loops and no array expressions in these kernels: they compile in a fraction of the time."""
    for i in range(3):
        out[i] = scale * x[i]


@njit(cache=True)
def _add(scale, x, out):
    """out += scale · x."""
    for i in range(3):
        out[i] += scale * x[i]


@njit(cache=True)
def _add_torque(scale, x, y, out):
    """out += scale · x × y."""
    out[0] += scale * (x[1] * y[2] - x[2] * y[1])
    out[1] += scale * (x[2] * y[0] - x[0] * y[2])
    out[2] += scale * (x[0] * y[1] - x[1] * y[0])


@njit(cache=True)
def _along(k, axis, u, f, g, ta):
    """Row k: u·X for a direction X that body a carries."""
    f[k] = _dot(axis, u)
    _put(1.0, axis, g[k])
    _add_torque(1.0, axis, u, ta[k])


@njit(cache=True)
def _aligned(A, B, sense, f, ta, tb):
    """D_b along sense·D_a: the rotation vector between them, on E1 and E2 (rad); sense 0 takes the nearer one."""
    c = _dot(A[2], B[2])
    s = sense if sense != 0.0 else (1.0 if c >= 0.0 else -1.0)
    c *= s
    x = -s * _dot(A[1], B[2])
    y = s * _dot(A[0], B[2])
    sine = math.hypot(x, y)
    theta = math.atan2(sine, c)
    if sine > 1e-4:
        k = theta / sine
        dk = -(sine - theta * c) / (sine * sine * sine)  # dk / d cos θ
    elif c > 0.0:  # series about θ = 0, exact to rounding below 1e-4
        k = 1.0 + theta * theta / 6.0
        dk = -1.0 / 3.0 - 2.0 * theta * theta / 15.0
    else:  # opposite, where the turn has no direction: take E1, at full length
        k, dk = 1.0, 0.0
        x = math.pi
    f[0] = k * x
    f[1] = k * y
    for i in range(2):
        axis, sign, value = (A[1], -s, x) if i == 0 else (A[0], s, y)
        _add_torque(k * sign, B[2], axis, tb[i])
        _add_torque(value * dk * s, B[2], A[2], tb[i])
        _put(-1.0, tb[i], ta[i])


@njit(cache=True)
def _oriented(A, B, f, ta, tb):
    """The frames coincide: f = log(F_aᵀ F_b) (rad), df = Jlog(f) F_bᵀ (Ω_b - Ω_a)."""
    R = np.empty((3, 3))  # A Bᵀ: rows of A, B are the frames' axes
    for i in range(3):
        for j in range(3):
            R[i, j] = _dot(A[i], B[j])
    x = 0.5 * (R[2, 1] - R[1, 2])
    y = 0.5 * (R[0, 2] - R[2, 0])
    z = 0.5 * (R[1, 0] - R[0, 1])
    sine = math.sqrt(x * x + y * y + z * z)
    cosine = 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    theta = math.atan2(sine, cosine)
    if sine > 1e-4:
        k = theta / sine
        q = 1.0 / (theta * theta) - (1.0 + cosine) / (2.0 * theta * sine)
    elif cosine > 0.0:
        k = 1.0 + theta * theta / 6.0
        q = 1.0 / 12.0
    else:  # half a turn: the axis is the column of R + 1 that is longest
        j = 0
        for i in range(1, 3):
            if R[i, i] > R[j, j]:
                j = i
        n = math.sqrt(2.0 * (1.0 + R[j, j]))
        x, y, z = (R[0, j] + (j == 0)) / n, (R[1, j] + (j == 1)) / n, (R[2, j] + (j == 2)) / n
        k = math.pi / math.sqrt(x * x + y * y + z * z)
        q = 1.0 / (math.pi * math.pi)
    f[0], f[1], f[2] = k * x, k * y, k * z
    square = _dot(f, f)
    for i in range(3):  # Jlog = 1 + [f]/2 + q [f]², and [f]² = f fᵀ - |f|²
        for j in range(3):
            w = q * f[i] * f[j]
            if i == j:
                w += 1.0 - q * square
            else:
                w += 0.5 * f[3 - i - j] * (-1.0 if (j - i) % 3 == 1 else 1.0)
            _add(w, B[j], tb[i])
        _put(-1.0, tb[i], ta[i])


@njit(cache=True)
def _angle(A, B, f, ta, tb):
    """Angle between D_a and D_b (rad, 0 … π)."""
    n = np.empty(3)
    _cross(A[2], B[2], n)
    sine = math.sqrt(_dot(n, n))
    f[0] = math.atan2(sine, _dot(A[2], B[2]))
    if sine > 0.0:
        _put(1.0 / sine, n, tb[0])
    else:
        _put(1.0, A[0], tb[0])
    _put(-1.0, tb[0], ta[0])


@njit(cache=True)
def _foot(A, u, out):
    """Vector from the axis of a to the point, at right angles to the axis, made unit length; and its length."""
    h = _dot(A[2], u)
    _put(1.0, u, out)
    _add(-h, A[2], out)
    rho = math.sqrt(_dot(out, out))
    if rho > 0.0:
        _put(1.0 / rho, out, out)
    else:
        _put(1.0, A[0], out)
    return rho


@njit(cache=True)
def _point_distance(A, u, f, g):
    """|u|."""
    f[0] = math.sqrt(_dot(u, u))
    if f[0] > 0.0:
        _put(1.0 / f[0], u, g[0])
    else:
        _put(1.0, A[0], g[0])


@njit(cache=True)
def _line_distance(A, u, f, g, ta):
    """Distance of P_b from the axis of a."""
    f[0] = _foot(A, u, g[0])
    _add_torque(-_dot(A[2], u), A[2], g[0], ta[0])


@njit(cache=True)
def _lines_distance(A, B, u, side, f, g, ta, tb):
    """Distance between the axes of a and b along their common normal, positive on `side` (0: whichever it is on)."""
    n = np.empty(3)
    _cross(A[2], B[2], n)
    sine = math.sqrt(_dot(n, n))
    if sine < 1e-12:  # parallel to rounding: any common normal through the offset serves
        _line_distance(A, u, f, g, ta)
        return
    _put(1.0 / sine, n, n)
    x = _dot(u, n)
    s = side if side != 0.0 else (1.0 if x >= 0.0 else -1.0)
    f[0] = s * x
    _put(s, n, g[0])
    h = np.empty(3)
    _put(s / sine, u, h)
    _add(-x * s / sine, n, h)
    w = np.empty(3)
    _cross(B[2], h, w)
    _add_torque(1.0, A[2], w, ta[0])
    _cross(h, A[2], w)
    _add_torque(1.0, B[2], w, tb[0])


@njit(cache=True)
def _cone_distance(A, u, half_angle, f, g, ta):
    """Signed distance of P_b from the cone of apex P_a, axis D_a: positive outside."""
    n = np.empty(3)
    rho = _foot(A, u, n)
    h = _dot(A[2], u)
    c, s = math.cos(half_angle), math.sin(half_angle)
    f[0] = rho * c - h * s
    _put(c, n, g[0])
    _add(-s, A[2], g[0])
    _add_torque(-h * c, A[2], n, ta[0])
    _add_torque(-s, A[2], u, ta[0])


@njit(cache=True)
def _torus_distance(A, u, major, f, g, ta):
    """Distance of P_b from the circle of radius `major` about D_a through P_a."""
    n = np.empty(3)
    rho = _foot(A, u, n)
    h = _dot(A[2], u)
    q = math.hypot(rho - major, h)
    f[0] = q
    if q > 0.0:
        _put((rho - major) / q, n, g[0])
        _add(h / q, A[2], g[0])
        _add_torque(-(rho - major) * h / q, A[2], n, ta[0])
        _add_torque(h / q, A[2], u, ta[0])
    else:
        _put(1.0, n, g[0])


@njit(cache=True)
def _rim_height(A, B, u, radius, f, g, ta, tb):
    """Height over plane a of the lowest point of the circle of `radius` about D_b through P_b."""
    n = np.empty(3)
    _cross(A[2], B[2], n)
    sine = math.sqrt(_dot(n, n))
    _along(0, A[2], u, f, g, ta)
    f[0] -= radius * sine
    if sine > 0.0:
        k = radius * _dot(A[2], B[2]) / sine
        _add_torque(k, A[2], B[2], ta[0])
        _add_torque(k, B[2], A[2], tb[0])


@njit(cache=True)
def _wrapped(x, period):
    """x modulo the period, within half a period of nought."""
    return x - period * math.floor(x / period + 0.5)


@njit(cache=True)
def _turning(x, y):
    """Slope of atan2(y, x) along its circle: 1 / (x² + y²), nought where the direction is lost."""
    square = x * x + y * y
    return 1.0 / square if square > 0.0 else 0.0


@njit(cache=True)
def _helix(A, B, u, pitch, offset, f, g, ta, tb):
    """Advance along D_a less pitch times the turn of b's E1 about it, modulo one pitch (m)."""
    x = _dot(A[0], B[0])
    y = _dot(A[1], B[0])
    _along(0, A[2], u, f, g, ta)
    f[0] = _wrapped(f[0] - offset - pitch * math.atan2(y, x) / TWO_PI, abs(pitch))
    k = -pitch / TWO_PI * _turning(x, y)
    w = np.zeros(3)
    _add_torque(k * x, B[0], A[1], w)
    _add_torque(-k * y, B[0], A[0], w)
    _add(1.0, w, tb[0])
    _add(-1.0, w, ta[0])


@njit(cache=True)
def _mesh(A, B, u, teeth_a, teeth_b, sense, offset, f, g, ta, tb):
    """Turn of a plus sense·teeth_b/teeth_a times that of b, both counted from the line of centres, modulo a tooth."""
    f[0] = -offset
    for body in range(2):
        F, t, sign, k = (A, ta[0], 1.0, 1.0) if body == 0 else (B, tb[0], -1.0, sense * teeth_b / teeth_a)
        x = sign * _dot(F[0], u)
        y = sign * _dot(F[1], u)
        f[0] -= k * math.atan2(y, x)
        k *= sign * _turning(x, y)
        _add(k * y, F[0], g[0])
        _add(-k * x, F[1], g[0])
        _add_torque(k * y, F[0], u, t)
        _add_torque(-k * x, F[1], u, t)
    f[0] = _wrapped(f[0], TWO_PI / teeth_a)


@njit(cache=True)
def _rack(A, B, u, radius, teeth, sense, offset, f, g, ta, tb):
    """Travel of rack b along D_b less sense·radius times the turn of pinion a from the normal to the rack (m)."""
    s = _dot(B[2], u)
    x = _dot(A[0], u) - s * _dot(A[0], B[2])
    y = _dot(A[1], u) - s * _dot(A[1], B[2])
    turn = -math.atan2(y, x)
    f[0] = _wrapped(s - sense * radius * turn - offset, TWO_PI * radius / teeth)
    k = sense * radius * _turning(x, y)
    h, w = np.empty(3), np.empty(3)  # f = s + … and d(-turn) = h·dw with w = u - s D_b, seen from a
    _put(k * x, A[1], h)
    _add(-k * y, A[0], h)
    _put(1.0, u, w)
    _add(-s, B[2], w)
    along = _dot(h, B[2])
    _put(1.0 - along, B[2], g[0])
    _add(1.0, h, g[0])
    _add_torque(k * x, A[1], w, ta[0])
    _add_torque(-k * y, A[0], w, ta[0])
    _add_torque(1.0 - along, B[2], u, tb[0])
    _add_torque(-s, B[2], h, tb[0])


@njit(cache=True)
def _rows(code, A, B, u, p, f, g, ta, tb):
    """Fill the rows of one equation; g, ta, tb come in zeroed. Returns their number."""
    if code == COINCIDENT:
        for k in range(3):
            _along(k, A[k], u, f, g, ta)
        return 3
    if code == ON_LINE:
        for k in range(2):
            _along(k, A[k], u, f, g, ta)
        return 2
    if code == ALIGNED:
        _aligned(A, B, p[0], f, ta, tb)
        return 2
    if code == ORIENTED:
        _oriented(A, B, f, ta, tb)
        return 3
    if code == HELIX:
        _helix(A, B, u, p[0], p[1], f, g, ta, tb)
        return 1
    if code == MESH:
        _mesh(A, B, u, p[0], p[1], p[2], p[3], f, g, ta, tb)
        return 1
    if code == RACK:
        _rack(A, B, u, p[0], p[1], p[2], p[3], f, g, ta, tb)
        return 1
    if code == ON_PLANE:
        _along(0, A[2], u, f, g, ta)
    elif code == ANGLE:
        _angle(A, B, f, ta, tb)
    elif code == POINT_DISTANCE:
        _point_distance(A, u, f, g)
    elif code == LINE_DISTANCE:
        _line_distance(A, u, f, g, ta)
    elif code == LINES_DISTANCE:
        _lines_distance(A, B, u, p[2], f, g, ta, tb)
    elif code == CONE_DISTANCE:
        _cone_distance(A, u, p[2], f, g, ta)
    elif code == TORUS_DISTANCE:
        _torus_distance(A, u, p[2], f, g, ta)
    else:
        _rim_height(A, B, u, p[2], f, g, ta, tb)
    if f[0] < p[0]:
        f[0] -= p[0]
    elif f[0] > p[1]:
        f[0] -= p[1]
    else:
        f[0] = 0.0
        if p[0] < p[1]:
            _put(0.0, g[0], g[0])
            _put(0.0, ta[0], ta[0])
            _put(0.0, tb[0], tb[0])
    return 1


@njit(cache=True)
def evaluate(code, body, element, param, start, rotation, translation, r, Ja, Jb):
    """Residuals and Jacobians of all equations at the given poses, written into r (m,), Ja and Jb (m, 6).

    code (e,), body (e, 2) rows of rotation (n, 3, 3) and translation (n, 3), element (e, 24) = point and frame of a,
    then of b (frames by rows E1, E2, D), param (e, 4), start (e,) first row of each equation.
    """
    A = np.empty((3, 3))
    B = np.empty((3, 3))
    arm_a = np.empty(3)
    arm_b = np.empty(3)
    u = np.empty(3)
    f = np.empty(3)
    g = np.empty((3, 3))
    ta = np.empty((3, 3))
    tb = np.empty((3, 3))
    for e in range(len(code)):
        ia, ib = body[e, 0], body[e, 1]
        Ra, Rb = rotation[ia], rotation[ib]
        x = element[e]
        for i in range(3):
            arm_a[i] = Ra[i, 0] * x[0] + Ra[i, 1] * x[1] + Ra[i, 2] * x[2]
            arm_b[i] = Rb[i, 0] * x[12] + Rb[i, 1] * x[13] + Rb[i, 2] * x[14]
            u[i] = (translation[ib, i] - translation[ia, i]) + (arm_b[i] - arm_a[i])
            for k in range(3):
                o = 3 + 3 * k
                A[k, i] = Ra[i, 0] * x[o] + Ra[i, 1] * x[o + 1] + Ra[i, 2] * x[o + 2]
                o = 15 + 3 * k
                B[k, i] = Rb[i, 0] * x[o] + Rb[i, 1] * x[o + 1] + Rb[i, 2] * x[o + 2]
        for k in range(3):
            for i in range(3):
                g[k, i] = ta[k, i] = tb[k, i] = 0.0
        n = _rows(code[e], A, B, u, param[e], f, g, ta, tb)
        for k in range(n):
            row = start[e] + k
            r[row] = f[k]
            gk = g[k]
            _add_torque(-1.0, arm_a, gk, ta[k])
            _add_torque(1.0, arm_b, gk, tb[k])
            for i in range(3):
                Ja[row, i] = -(Ra[0, i] * gk[0] + Ra[1, i] * gk[1] + Ra[2, i] * gk[2])
                Jb[row, i] = Rb[0, i] * gk[0] + Rb[1, i] * gk[1] + Rb[2, i] * gk[2]
                Ja[row, 3 + i] = Ra[0, i] * ta[k, 0] + Ra[1, i] * ta[k, 1] + Ra[2, i] * ta[k, 2]
                Jb[row, 3 + i] = Rb[0, i] * tb[k, 0] + Rb[1, i] * tb[k, 1] + Rb[2, i] * tb[k, 2]
