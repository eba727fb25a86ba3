"""The equations of constraints, each with its analytic Jacobian, as kernels over flat arrays.

An equation relates one *element* of each body: a point P and an orthonormal frame (E1, E2, D), D the axis or normal.
With u = P_b - P_a, every row f of every equation is a function of u and of the frames' directions, so that its
differential is a pair of wrenches: with Ω the bodies' angular and V their linear velocities (world axes)

    df = g·(V_b + Ω_b × arm_b) - g·(V_a + Ω_a × arm_a) + τ_a·Ω_a + τ_b·Ω_b,       arm = R p,

where g = ∂f/∂u and τ = Σ X × ∂f/∂X over the directions X of the body. The kernels below return f, g, τ_a and τ_b of a
row; `evaluate` converts them to rows on local twists (linear first), as in Pinocchio:

    J_a = [-R_aᵀ g, R_aᵀ (τ_a - arm_a × g)],      J_b = [R_bᵀ g, R_bᵀ (τ_b + arm_b × g)].

Lengths are metres and angles radians; a row is one or the other. Equations of one row hold between limits
`params[0] <= x <= params[1]`: inside them the row vanishes, equal limits make an equality.

Vectors are tuples of three: unlike views of arrays these stay in registers, which saves a third of the time.
"""

from __future__ import annotations

import math

from collision.numeric.kernel import inner_kernel, kernel
from collision.numeric.vectors import along, cross, dot, norm, scaled

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
"""rows of each equation, by code"""
ANGULAR = (False, False, True, True, False, True, False, False, False, False, False, False, False, True, False)
"""whether an equation's rows are in radians, by code"""
TWO_PI = 2.0 * math.pi
NONE = (0.0, 0.0, 0.0)


@inner_kernel
def _turned(R, x):
    """R x, of a tuple of rows."""
    return dot(R[0], x), dot(R[1], x), dot(R[2], x)


@inner_kernel
def _turned_back(R, x):
    """Rᵀ x."""
    return (
        R[0][0] * x[0] + R[1][0] * x[1] + R[2][0] * x[2],
        R[0][1] * x[0] + R[1][1] * x[1] + R[2][1] * x[2],
        R[0][2] * x[0] + R[1][2] * x[1] + R[2][2] * x[2],
    )


@inner_kernel
def _row3(x, i, o):
    """Three numbers of x[i], from column o on."""
    return x[i, o], x[i, o + 1], x[i, o + 2]


@inner_kernel
def _rows3(x, i):
    """Three rows of x[i] (3, 3)."""
    return (
        (x[i, 0, 0], x[i, 0, 1], x[i, 0, 2]),
        (x[i, 1, 0], x[i, 1, 1], x[i, 1, 2]),
        (x[i, 2, 0], x[i, 2, 1], x[i, 2, 2]),
    )


@inner_kernel
def _element(R, x, e, o):
    """Arm and frame, world axes, of the element at column o of x[e]."""
    arm = _turned(R, (x[e, o], x[e, o + 1], x[e, o + 2]))
    first = _turned(R, (x[e, o + 3], x[e, o + 4], x[e, o + 5]))
    second = _turned(R, (x[e, o + 6], x[e, o + 7], x[e, o + 8]))
    return arm, (first, second, _turned(R, (x[e, o + 9], x[e, o + 10], x[e, o + 11])))


@inner_kernel
def _component(axis, u):
    """u·X for a direction X of body a."""
    return dot(axis, u), axis, cross(axis, u), NONE


@inner_kernel
def _aligned(A, B, sense):
    """Rotation vector from sense·D_a to D_b, on E1 and E2 (rad); sense 0 takes the nearer direction."""
    c = dot(A[2], B[2])
    s = sense if sense != 0.0 else (1.0 if c >= 0.0 else -1.0)
    c *= s
    x = -s * dot(A[1], B[2])
    y = s * dot(A[0], B[2])
    sine = math.sqrt(x * x + y * y)
    theta = math.atan2(sine, c)
    if sine > 1e-4:
        k = theta / sine
        dk = -(sine - theta * c) / (sine * sine * sine)  # dk / d cos θ
    elif c > 0.0:  # series about θ = 0, exact to rounding below 1e-4
        k = 1.0 + theta * theta / 6.0
        dk = -1.0 / 3.0 - 2.0 * theta * theta / 15.0
    else:  # opposite: the axis of rotation is undefined, take E1
        k, dk = 1.0, 0.0
        x = math.pi
    tilt = scaled(dk * s, cross(B[2], A[2]))
    first = along(scaled(-k * s, cross(B[2], A[1])), x, tilt)
    second = along(scaled(k * s, cross(B[2], A[0])), y, tilt)
    return (k * x, NONE, scaled(-1.0, first), first), (k * y, NONE, scaled(-1.0, second), second)


@inner_kernel
def _oriented(A, B):
    """Rotation vector between the frames: f = log(F_aᵀ F_b) (rad), df = Jlog(f) F_bᵀ (Ω_b - Ω_a)."""
    R = (_turned(B, A[0]), _turned(B, A[1]), _turned(B, A[2]))  # A Bᵀ: rows of A, B are the frames' axes
    x = 0.5 * (R[2][1] - R[1][2])
    y = 0.5 * (R[0][2] - R[2][0])
    z = 0.5 * (R[1][0] - R[0][1])
    sine = math.sqrt(x * x + y * y + z * z)
    cosine = 0.5 * (R[0][0] + R[1][1] + R[2][2] - 1.0)
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
            if R[i][i] > R[j][j]:
                j = i
        n = math.sqrt(2.0 * (1.0 + R[j][j]))
        x, y, z = (R[0][j] + (j == 0)) / n, (R[1][j] + (j == 1)) / n, (R[2][j] + (j == 2)) / n
        k = math.pi / math.sqrt(x * x + y * y + z * z)
        q = 1.0 / (math.pi * math.pi)
    f = (k * x, k * y, k * z)
    # Jlog = 1 + [f]/2 + q [f]², and [f]² = f fᵀ - |f|²: row i applied to F_bᵀ
    d = 1.0 - q * dot(f, f)
    mixed = along(along(scaled(q * f[0], B[0]), q * f[1], B[1]), q * f[2], B[2])
    first = along(along(along(scaled(f[0], mixed), d, B[0]), -0.5 * f[2], B[1]), 0.5 * f[1], B[2])
    second = along(along(along(scaled(f[1], mixed), d, B[1]), -0.5 * f[0], B[2]), 0.5 * f[2], B[0])
    third = along(along(along(scaled(f[2], mixed), d, B[2]), -0.5 * f[1], B[0]), 0.5 * f[0], B[1])
    return (
        (f[0], NONE, scaled(-1.0, first), first),
        (f[1], NONE, scaled(-1.0, second), second),
        (f[2], NONE, scaled(-1.0, third), third),
    )


@inner_kernel
def _angle(A, B):
    """Angle between D_a and D_b (rad, 0 … π)."""
    n = cross(A[2], B[2])
    sine = norm(n)
    turn = scaled(1.0 / sine, n) if sine > 0.0 else A[0]
    return math.atan2(sine, dot(A[2], B[2])), NONE, scaled(-1.0, turn), turn


@inner_kernel
def _foot(A, u):
    """(unit vector from the axis of a to the point, perpendicular to the axis; distance)."""
    out = along(u, -dot(A[2], u), A[2])
    rho = norm(out)
    return (scaled(1.0 / rho, out) if rho > 0.0 else A[0]), rho


@inner_kernel
def _point_distance(A, u):
    """|u|."""
    f = norm(u)
    return f, (scaled(1.0 / f, u) if f > 0.0 else A[0]), NONE, NONE


@inner_kernel
def _line_distance(A, u):
    """Distance of P_b from the axis of a."""
    n, f = _foot(A, u)
    return f, n, scaled(-dot(A[2], u), cross(A[2], n)), NONE


@inner_kernel
def _lines_distance(A, B, u, side):
    """Distance between the axes of a and b along their common normal, positive on `side` (0: the present side)."""
    n = cross(A[2], B[2])
    sine = norm(n)
    if sine < 1e-12:  # parallel up to rounding: any normal through the offset is common
        return _line_distance(A, u)
    n = scaled(1.0 / sine, n)
    x = dot(u, n)
    s = side if side != 0.0 else (1.0 if x >= 0.0 else -1.0)
    h = along(scaled(s / sine, u), -x * s / sine, n)
    return s * x, scaled(s, n), cross(A[2], cross(B[2], h)), cross(B[2], cross(h, A[2]))


@inner_kernel
def _cone_distance(A, u, half_angle):
    """Signed distance of P_b from the cone of apex P_a, axis D_a: positive outside."""
    n, rho = _foot(A, u)
    h = dot(A[2], u)
    c, s = math.cos(half_angle), math.sin(half_angle)
    torque = along(scaled(-h * c, cross(A[2], n)), -s, cross(A[2], u))
    return rho * c - h * s, along(scaled(c, n), -s, A[2]), torque, NONE


@inner_kernel
def _torus_distance(A, u, major):
    """Distance of P_b from the circle of radius `major` about D_a through P_a."""
    n, rho = _foot(A, u)
    h = dot(A[2], u)
    q = math.hypot(rho - major, h)
    if q == 0.0:
        return q, n, NONE, NONE
    x, y = (rho - major) / q, h / q
    return q, along(scaled(x, n), y, A[2]), along(scaled(-x * h, cross(A[2], n)), y, cross(A[2], u)), NONE


@inner_kernel
def _rim_height(A, B, u, radius):
    """Height over plane a of the lowest point of the circle of `radius` about D_b through P_b."""
    n = cross(A[2], B[2])
    sine = norm(n)
    k = radius * dot(A[2], B[2]) / sine if sine > 0.0 else 0.0
    return dot(A[2], u) - radius * sine, A[2], along(cross(A[2], u), k, n), scaled(-k, n)


@inner_kernel
def _wrapped(x, period):
    """x modulo the period, within half a period of 0."""
    return x - period * math.floor(x / period + 0.5)


@inner_kernel
def _turning(x, y):
    """Slope of atan2(y, x) along its circle: 1 / (x² + y²), or 0 at the origin."""
    square = x * x + y * y
    return 1.0 / square if square > 0.0 else 0.0


@inner_kernel
def _helix(A, B, u, pitch, offset):
    """Advance along D_a minus pitch times the turn of b's E1 about it, modulo one pitch (m)."""
    x = dot(A[0], B[0])
    y = dot(A[1], B[0])
    f = _wrapped(dot(A[2], u) - offset - pitch * math.atan2(y, x) / TWO_PI, abs(pitch))
    k = -pitch / TWO_PI * _turning(x, y)
    w = along(scaled(k * x, cross(B[0], A[1])), -k * y, cross(B[0], A[0]))
    return f, A[2], along(cross(A[2], u), -1.0, w), w


@inner_kernel
def _seen(F, u, k):
    """(angle of u about the axis of the frame F, k times its derivatives by u and by the rotation of F)."""
    x, y = dot(F[0], u), dot(F[1], u)
    slope = k * _turning(x, y)
    by_u = along(scaled(slope * x, F[1]), -slope * y, F[0])
    by_turn = along(scaled(slope * x, cross(F[1], u)), -slope * y, cross(F[0], u))
    return math.atan2(y, x), by_u, by_turn


@inner_kernel
def _mesh(A, B, u, teeth_a, teeth_b, sense, offset):
    """Turn of a plus sense·teeth_b/teeth_a times that of b, both from the line of centres, modulo a tooth (rad)."""
    ratio = sense * teeth_b / teeth_a
    turn_a, g_a, torque_a = _seen(A, u, -1.0)
    turn_b, g_b, torque_b = _seen(B, scaled(-1.0, u), -ratio)
    f = _wrapped(-offset - turn_a - ratio * turn_b, TWO_PI / teeth_a)
    return f, along(g_a, -1.0, g_b), torque_a, torque_b


@inner_kernel
def _rack(A, B, u, radius, teeth, sense, offset):
    """Travel of rack b along D_b minus sense·radius times the turn of pinion a from the normal to the rack (m)."""
    s = dot(B[2], u)
    turn, h, torque_a = _seen(A, along(u, -s, B[2]), sense * radius)
    f = _wrapped(s + sense * radius * turn - offset, TWO_PI * radius / teeth)
    share = 1.0 - dot(h, B[2])
    torque_b = along(scaled(share, cross(B[2], u)), -s, cross(B[2], h))
    return f, along(h, share, B[2]), torque_a, torque_b


@inner_kernel
def _between(low, high, row):
    """The row of a value with limits, which vanishes between them."""
    f, g, torque_a, torque_b = row
    if f < low:
        return f - low, g, torque_a, torque_b
    if f > high:
        return f - high, g, torque_a, torque_b
    if low < high and f == f:
        return 0.0, NONE, NONE, NONE
    return f - low, g, torque_a, torque_b  # 0, or NaN, which must not be hidden


@inner_kernel
def _single(code, A, B, u, p, e):
    """The row of an equation of one row; p[e] are its parameters."""
    if code == ON_PLANE:
        row = _component(A[2], u)
    elif code == ANGLE:
        row = _angle(A, B)
    elif code == POINT_DISTANCE:
        row = _point_distance(A, u)
    elif code == LINE_DISTANCE:
        row = _line_distance(A, u)
    elif code == LINES_DISTANCE:
        row = _lines_distance(A, B, u, p[e, 2])
    elif code == CONE_DISTANCE:
        row = _cone_distance(A, u, p[e, 2])
    elif code == TORUS_DISTANCE:
        row = _torus_distance(A, u, p[e, 2])
    elif code == RIM_HEIGHT:
        row = _rim_height(A, B, u, p[e, 2])
    elif code == HELIX:
        return _helix(A, B, u, p[e, 0], p[e, 1])
    elif code == MESH:
        return _mesh(A, B, u, p[e, 0], p[e, 1], p[e, 2], p[e, 3])
    else:
        return _rack(A, B, u, p[e, 0], p[e, 1], p[e, 2], p[e, 3])
    return _between(p[e, 0], p[e, 1], row)


@inner_kernel
def _state(k, row, r, Ja, Jb):
    """Store f in r[k], g and τ_b in Jb[k], τ_a in Ja[k]."""
    r[k], g, torque_a, torque_b = row
    Jb[k, 0], Jb[k, 1], Jb[k, 2] = g
    Jb[k, 3], Jb[k, 4], Jb[k, 5] = torque_b
    Ja[k, 3], Ja[k, 4], Ja[k, 5] = torque_a


@inner_kernel
def _rows(code, A, B, u, p, e, k, r, Ja, Jb):
    """Store the rows of one equation, from row k on; return their number."""
    if code <= ON_LINE:
        count = 3 if code == COINCIDENT else 2
        for i in range(count):
            _state(k + i, _component(A[i], u), r, Ja, Jb)
        return count
    if code == ALIGNED:
        pair = _aligned(A, B, p[e, 0])
        for i in range(2):
            _state(k + i, pair[i], r, Ja, Jb)
        return 2
    if code == ORIENTED:
        rows = _oriented(A, B)
        for i in range(3):
            _state(k + i, rows[i], r, Ja, Jb)
        return 3
    _state(k, _single(code, A, B, u, p, e), r, Ja, Jb)
    return 1


@kernel
def evaluate(code, body, element, param, start, rotation, translation, r, Ja, Jb):
    """Residuals and Jacobians of all equations at the given poses, written into r (m,), Ja and Jb (m, 6).

    code (e,), body (e, 2) rows of rotation (n, 3, 3) and translation (n, 3), element (e, 24) = point and frame of a,
    then of b (frames by rows E1, E2, D), param (e, 4), start (e,) first row of each equation.
    """
    for e in range(len(code)):
        ia, ib = body[e, 0], body[e, 1]
        Ra, Rb = _rows3(rotation, ia), _rows3(rotation, ib)
        arm_a, A = _element(Ra, element, e, 0)
        arm_b, B = _element(Rb, element, e, 12)
        # difference of the centres first: bodies far from the world's origin are near each other
        between = along(_row3(translation, ib, 0), -1.0, _row3(translation, ia, 0))
        u = along(between, 1.0, along(arm_b, -1.0, arm_a))
        first = start[e]
        for k in range(first, first + _rows(code[e], A, B, u, param, e, first, r, Ja, Jb)):
            g = _row3(Jb, k, 0)
            va, vb = _turned_back(Ra, g), _turned_back(Rb, g)
            wa = _turned_back(Ra, along(_row3(Ja, k, 3), -1.0, cross(arm_a, g)))
            wb = _turned_back(Rb, along(_row3(Jb, k, 3), 1.0, cross(arm_b, g)))
            Ja[k, 0], Ja[k, 1], Ja[k, 2] = -va[0], -va[1], -va[2]
            Jb[k, 0], Jb[k, 1], Jb[k, 2] = vb
            Ja[k, 3], Ja[k, 4], Ja[k, 5] = wa
            Jb[k, 3], Jb[k, 4], Jb[k, 5] = wb
