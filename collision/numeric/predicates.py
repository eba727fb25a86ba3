"""Exact orientation predicates: the side of a plane, or of a line, on which a point lies, for float64 coordinates.

A floating-point filter decides first: the determinant in float64 and an a-priori error bound. A determinant within the
bound is computed without error as an expansion, a sum of floats that do not overlap (Shewchuk, "Adaptive Precision
Floating-Point Arithmetic and Fast Robust Geometric Predicates", 1997; figure numbers refer to it). Exact as long as no
product over- or underflows: coordinates are 0 or of magnitude 1e-70 to 1e70.

The kernels do not use fastmath: a fused multiply-add would break the error-free transformations. They share a workspace
`w` of `WORKSPACE` float64 per thread; `w[FALLBACKS]` counts the signs that needed exact arithmetic.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from collision.numeric.kernel import inline_kernel, inner_kernel, kernel
from collision.numeric.vectors import sub

WORKSPACE: Final = 1024
"""length of a workspace, float64"""
FALLBACKS: Final = WORKSPACE - 1
"""index in the workspace of the number of exact evaluations"""

SPLITTER: Final = 134217729.0  # 2^27 + 1
ORIENT2D: Final = (3.0 + 16.0 * 2.0**-53) * 2.0**-53  # Shewchuk's ccwerrboundA
ORIENT3D: Final = (7.0 + 56.0 * 2.0**-53) * 2.0**-53  # Shewchuk's o3derrboundA
TINY: Final = 1e-280
"""an error bound below this may have lost bits to underflow; 0 is exact, since then every product is 0"""

# offsets in the workspace; each part is as long as its longest expansion
_DIFFERENCE: Final = 0
_LEFT: Final = 32
_RIGHT: Final = 48
_MINOR: Final = 64
_SCALED: Final = 96
_SCALED2: Final = 160
_TERM: Final = 224
_TOTAL: Final = 320
_PART: Final = 544
_GIVEN: Final = 768
_LENGTH: Final = 784


def workspace() -> NDArray[np.float64]:
    """Return a workspace for the kernels of this module, its count of exact evaluations at zero."""
    return np.zeros(WORKSPACE)


@inline_kernel
def _append(w, h, n, x):
    """Append x to the expansion of length n at `w[h]`, unless it is 0; return the new length."""
    if x != 0.0:
        w[h + n] = x
        n += 1
    return n


@inner_kernel
def _difference(w, h, a, b):
    """Write a - b without error to `w[h]`; return its length, 0 … 2 (figure 6, Two-Diff)."""
    x = a - b
    bv = a - x
    av = x + bv
    return _append(w, h, _append(w, h, 0, (a - av) + (bv - b)), x)


@inner_kernel
def _sum(w, e, ne, f, nf, sign, h):
    """Write e + sign·f to `w[h]` without zeros; return its length (figure 8, Fast-Expansion-Sum)."""
    if ne == 0 or nf == 0:
        for i in range(ne + nf):
            w[h + i] = w[e + i] if nf == 0 else sign * w[f + i]
        return ne + nf
    i, j, n = 0, 0, 0
    q = 0.0
    for step in range(ne + nf):
        if j >= nf or (i < ne and abs(w[e + i]) < abs(w[f + j])):
            g = w[e + i]
            i += 1
        else:
            g = sign * w[f + j]
            j += 1
        if step == 0:
            q = g
            continue
        s = q + g  # Two-Sum
        gv = s - q
        qv = s - gv
        n = _append(w, h, n, (q - qv) + (g - gv))
        q = s
    return _append(w, h, n, q)


@inner_kernel
def _scale(w, e, ne, b, h):
    """Write e·b to `w[h]` without zeros; return its length, at most 2·ne (figure 13, Scale-Expansion)."""
    c = SPLITTER * b
    b_high = c - (c - b)
    b_low = b - b_high
    n = 0
    q = 0.0
    for i in range(ne):
        x = w[e + i]
        c = SPLITTER * x
        high = c - (c - x)
        low = x - high
        p = x * b
        r = low * b_low - (((p - high * b_high) - low * b_high) - high * b_low)  # Two-Product
        if i == 0:
            q = p
            n = _append(w, h, n, r)
            continue
        s = q + r
        rv = s - q
        qv = s - rv
        n = _append(w, h, n, (q - qv) + (r - rv))
        q = p + s  # |p| >= |s|: Fast-Two-Sum
        n = _append(w, h, n, s - (q - p))
    return _append(w, h, n, q)


@inner_kernel
def _product(w, e, ne, f, nf, h):
    """Write e·f to `w[h]`, where f has at most two components and e at most sixteen; return its length."""
    n = 0
    for i in range(nf):
        m = _scale(w, e, ne, w[f + i], _SCALED)
        for j in range(n):
            w[_SCALED2 + j] = w[h + j]
        n = _sum(w, _SCALED2, n, _SCALED, m, 1.0, h)
    return n


@inner_kernel
def _sign(w, e, ne):
    """Return the sign of an expansion, that of its greatest component."""
    if ne == 0:
        return 0
    return 1 if w[e + ne - 1] > 0.0 else -1


@inline_kernel
def _filtered(det, bound):
    """Return the sign of a determinant with an error bound, 2 if it is within the bound."""
    if bound == 0.0:
        return 0
    if bound > TINY and abs(det) > bound:
        return 1 if det > 0.0 else -1
    return 2


@inner_kernel
def _orient2d_exact(ax, ay, bx, by, cx, cy, w):
    """The sign of `orient2d` by expansions."""
    w[FALLBACKS] += 1.0
    d = _DIFFERENCE
    n0 = _difference(w, d, ax, cx)
    n1 = _difference(w, d + 2, by, cy)
    n2 = _difference(w, d + 4, ay, cy)
    n3 = _difference(w, d + 6, bx, cx)
    left = _product(w, d, n0, d + 2, n1, _LEFT)
    right = _product(w, d + 4, n2, d + 6, n3, _RIGHT)
    return _sign(w, _MINOR, _sum(w, _LEFT, left, _RIGHT, right, -1.0, _MINOR))


@kernel
def orient2d(ax, ay, bx, by, cx, cy, w):
    """Return 1 if a, b, c turn left, -1 if right, 0 if collinear."""
    left = (ax - cx) * (by - cy)
    right = (ay - cy) * (bx - cx)
    sign = _filtered(left - right, ORIENT2D * (abs(left) + abs(right)))
    return _orient2d_exact(ax, ay, bx, by, cx, cy, w) if sign == 2 else sign


@inner_kernel
def _entries(w, i, j, h):
    """Write the product of the differences i and j to `w[h]`; return its length."""
    return _product(w, _DIFFERENCE + 2 * i, int(w[_LENGTH + i]), _DIFFERENCE + 2 * j, int(w[_LENGTH + j]), h)


@inner_kernel
def _orient3d_exact(a, b, c, d, w):
    """The sign of `orient3d` by expansions: a loop, because three written terms would be inlined three times."""
    w[FALLBACKS] += 1.0
    for i in range(3):
        w[_GIVEN + i], w[_GIVEN + 3 + i], w[_GIVEN + 6 + i], w[_GIVEN + 9 + i] = a[i], b[i], c[i], d[i]
    for i in range(9):
        w[_LENGTH + i] = _difference(w, _DIFFERENCE + 2 * i, w[_GIVEN + i], w[_GIVEN + 9 + i % 3])
    total = 0
    for i in range(3):  # z of one row times the minor of the x and y of the next two
        j, k = 3 * ((i + 1) % 3), 3 * ((i + 2) % 3)
        left = _entries(w, j, k + 1, _LEFT)
        right = _entries(w, k, j + 1, _RIGHT)
        minor = _sum(w, _LEFT, left, _RIGHT, right, -1.0, _MINOR)
        z = 3 * i + 2
        term = _product(w, _MINOR, minor, _DIFFERENCE + 2 * z, int(w[_LENGTH + z]), _TERM)
        for n in range(total):
            w[_PART + n] = w[_TOTAL + n]
        total = _sum(w, _PART, total, _TERM, term, 1.0, _TOTAL)
    return _sign(w, _TOTAL, total)


@kernel
def orient3d(a, b, c, d, w):
    """Return the sign of det[a - d, b - d, c - d] of points (x, y, z).

    1 if d lies below the plane of a, b, c (from above, a, b, c turn left), -1 if above, 0 if coplanar.
    """
    (adx, ady, adz), (bdx, bdy, bdz), (cdx, cdy, cdz) = sub(a, d), sub(b, d), sub(c, d)
    bc, cb = bdx * cdy, cdx * bdy
    ca, ac = cdx * ady, adx * cdy
    ab, ba = adx * bdy, bdx * ady
    det = adz * (bc - cb) + bdz * (ca - ac) + cdz * (ab - ba)
    bound = ORIENT3D * (
        (abs(bc) + abs(cb)) * abs(adz) + (abs(ca) + abs(ac)) * abs(bdz) + (abs(ab) + abs(ba)) * abs(cdz)
    )
    sign = _filtered(det, bound)
    return _orient3d_exact(a, b, c, d, w) if sign == 2 else sign
