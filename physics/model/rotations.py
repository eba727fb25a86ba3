"""Kernels on rotations and small vectors: quaternions (x, y, z, w), exponential map."""

from __future__ import annotations

import numpy as np

from collision.numeric.kernel import inner_kernel, kernel


@kernel(allocates=True)
def across(n):
    """(3,) vector square to the unit vector `n` (3,), a function of n alone: n × one of the axes."""
    k = 0
    for i in range(1, 3):
        if abs(n[i]) < abs(n[k]) - 1e-6:
            k = i
    e = np.zeros(3)
    e[k] = 1.0
    return np.cross(n, e)


@kernel
def matrix(q, out):
    """Rotation matrix (3, 3) of the quaternion `q` (4,), into `out`; rounding in its length does not matter."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    s = 2.0 / (x * x + y * y + z * z + w * w)
    out[0, 0] = 1.0 - s * (y * y + z * z)
    out[0, 1] = s * (x * y - z * w)
    out[0, 2] = s * (x * z + y * w)
    out[1, 0] = s * (x * y + z * w)
    out[1, 1] = 1.0 - s * (x * x + z * z)
    out[1, 2] = s * (y * z - x * w)
    out[2, 0] = s * (x * z - y * w)
    out[2, 1] = s * (y * z + x * w)
    out[2, 2] = 1.0 - s * (x * x + y * y)


@kernel
def exponential(x, y, z):
    """Unit quaternion of the rotation vector (x, y, z), as a tuple."""
    half = 0.5 * np.sqrt(x * x + y * y + z * z)
    if half < 1e-4:  # Taylor's remainder is below 1e-18 here
        s = 0.5 * (1.0 - half * half / 6.0)
    else:
        s = 0.5 * np.sin(half) / half
    return s * x, s * y, s * z, np.cos(half)


@kernel
def multiply(a, b):
    """Quaternion product a b, normalised, as a tuple."""
    x = a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1]
    y = a[3] * b[1] + a[1] * b[3] + a[2] * b[0] - a[0] * b[2]
    z = a[3] * b[2] + a[2] * b[3] + a[0] * b[1] - a[1] * b[0]
    w = a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2]
    n = 1.0 / np.sqrt(x * x + y * y + z * z + w * w)
    return x * n, y * n, z * n, w * n


@inner_kernel
def turn(q, x, y, z):
    """The quaternion `q` (4,) turned in place by the world rotation vector (x, y, z)."""
    p = multiply(exponential(x, y, z), (q[0], q[1], q[2], q[3]))
    q[0], q[1], q[2], q[3] = p
