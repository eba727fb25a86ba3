"""Vectors in kernels: tuples (x, y, z), which live in registers."""

from __future__ import annotations

import numpy as np

from collision.numeric.kernel import inner_kernel


@inner_kernel
def sub(a, b):
    """a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@inner_kernel
def dot(a, b):
    """a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner_kernel
def cross(a, b):
    """a × b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@inner_kernel
def along(a, s, u):
    """a + s·u."""
    return (a[0] + s * u[0], a[1] + s * u[1], a[2] + s * u[2])


@inner_kernel
def scaled(s, u):
    """s·u."""
    return (s * u[0], s * u[1], s * u[2])


@inner_kernel
def greatest(u):
    """The greatest magnitude among the components."""
    return max(abs(u[0]), abs(u[1]), abs(u[2]))


@inner_kernel
def norm(u):
    """The length."""
    return np.sqrt(dot(u, u))


@inner_kernel
def unit(u):
    """u / |u|, or zero if u is zero."""
    length = norm(u)
    return (u[0] / length, u[1] / length, u[2] / length) if length > 1e-300 else (0.0, 0.0, 0.0)


@inner_kernel
def rotated(rotation, u):
    """R u, of an array R (3, 3)."""
    return (
        rotation[0, 0] * u[0] + rotation[0, 1] * u[1] + rotation[0, 2] * u[2],
        rotation[1, 0] * u[0] + rotation[1, 1] * u[1] + rotation[1, 2] * u[2],
        rotation[2, 0] * u[0] + rotation[2, 1] * u[1] + rotation[2, 2] * u[2],
    )


@inner_kernel
def row(x, i):
    """Row i of an array (n, 3)."""
    return (x[i, 0], x[i, 1], x[i, 2])
