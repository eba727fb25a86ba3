"""Vectors as numba kernels take them: tuples (x, y, z), which live in registers."""

from __future__ import annotations

import numpy as np
from numba import njit

from collision.predicates import KERNEL


@njit(error_model="numpy", **KERNEL)
def sub(a, b):
    """a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@njit(error_model="numpy", **KERNEL)
def dot(a, b):
    """a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(error_model="numpy", **KERNEL)
def cross(a, b):
    """a × b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@njit(error_model="numpy", **KERNEL)
def along(a, s, u):
    """a + s·u."""
    return (a[0] + s * u[0], a[1] + s * u[1], a[2] + s * u[2])


@njit(error_model="numpy", **KERNEL)
def greatest(u):
    """The greatest magnitude among the components."""
    return max(abs(u[0]), abs(u[1]), abs(u[2]))


@njit(error_model="numpy", **KERNEL)
def norm(u):
    """The length."""
    return np.sqrt(dot(u, u))
