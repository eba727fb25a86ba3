"""Kernels for poses of many bodies: referred to the bodies' centres and back, and moved."""

from __future__ import annotations

import math

import numpy as np

from collision.numeric.kernel import kernel


@kernel
def to_centres(pose, place, center, rotation, translation):
    """Rotations (n, 3, 3) of the bodies and positions (n, 3) of their centres, from poses (u, 4, 4)[place]."""
    for i in range(len(place)):
        k = place[i]
        c = center[i, 0], center[i, 1], center[i, 2]
        for j in range(3):
            x, y, z = pose[k, j, 0], pose[k, j, 1], pose[k, j, 2]
            rotation[i, j, 0], rotation[i, j, 1], rotation[i, j, 2] = x, y, z
            translation[i, j] = pose[k, j, 3] + (x * c[0] + y * c[1] + z * c[2])


@kernel
def from_centres(rotation, translation, center, pose):
    """Poses (n, 4, 4) of the bodies from the positions of their centres: the inverse of `to_centres`."""
    for i in range(len(center)):
        c = center[i, 0], center[i, 1], center[i, 2]
        for j in range(3):
            x, y, z = rotation[i, j, 0], rotation[i, j, 1], rotation[i, j, 2]
            pose[i, j, 0], pose[i, j, 1], pose[i, j, 2] = x, y, z
            pose[i, j, 3] = translation[i, j] - (x * c[0] + y * c[1] + z * c[2])
            pose[i, 3, j] = 0.0
        pose[i, 3, 3] = 1.0


@kernel(allocates=True)
def move(rotation, translation, extent, column_of, step, new_rotation, new_translation):
    """Poses after the scaled local step (n, 6): t + R v, R exp(ω), with the rotation made orthonormal again."""
    W = np.empty((3, 3))
    for i in range(len(column_of)):
        c = column_of[i]
        R, Q = rotation[i], new_rotation[i]
        if c < 0:
            continue
        for j in range(3):
            new_translation[i, j] = translation[i, j] + (
                R[j, 0] * step[c, 0] + R[j, 1] * step[c, 1] + R[j, 2] * step[c, 2]
            )
        x, y, z = step[c, 3] / extent[i], step[c, 4] / extent[i], step[c, 5] / extent[i]
        theta = math.sqrt(x * x + y * y + z * z)
        s = math.sin(theta) / theta if theta > 1e-8 else 1.0
        h = math.sin(0.5 * theta)
        q = 2.0 * h * h / (theta * theta) if theta > 1e-8 else 0.5
        W[0, 0] = 1.0 - q * (y * y + z * z)
        W[1, 1] = 1.0 - q * (x * x + z * z)
        W[2, 2] = 1.0 - q * (x * x + y * y)
        W[0, 1] = q * x * y - s * z
        W[1, 0] = q * x * y + s * z
        W[0, 2] = q * x * z + s * y
        W[2, 0] = q * x * z - s * y
        W[1, 2] = q * y * z - s * x
        W[2, 1] = q * y * z + s * x
        for j in range(3):
            for k in range(3):
                Q[j, k] = R[j, 0] * W[0, k] + R[j, 1] * W[1, k] + R[j, 2] * W[2, k]
        for j in range(3):  # one Newton step to the nearest rotation: Q (3 - QᵀQ) / 2
            for k in range(3):
                W[j, k] = -0.5 * (Q[0, j] * Q[0, k] + Q[1, j] * Q[1, k] + Q[2, j] * Q[2, k])
            W[j, j] += 1.5
        for j in range(3):
            a, b, c2 = Q[j, 0], Q[j, 1], Q[j, 2]
            for k in range(3):
                Q[j, k] = a * W[0, k] + b * W[1, k] + c2 * W[2, k]
