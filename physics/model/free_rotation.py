"""Free flight of one rigid body: methods by name, each a map of (orientation, angular momentum) over a step.

Between kicks the centre of mass has constant velocity; the rotation needs a method,

    R' = R ω̂,   ω = I⁻¹ Rᵀ L,   L' = torque,

with L the angular momentum about the centre of mass in world axes. The world splits a step as kick, drift, kick
(Strang): half the forces' impulse, free flight, the other half. For a constant force that is exact.

`gauss6` (default): Gauss collocation of three stages on Euler's equation π' = π × I⁻¹π, which keeps every quadratic
invariant, here energy and |π| (Hairer, Lubich & Wanner, "Geometric Numerical Integration", IV.2.1), and the
sixth-order Magnus method on the same nodes for the attitude (Blanes, Casas, Oteo & Ros, Phys. Rep. 470, 2009, eq. 253).
`rkmk4`: the classical fourth-order Runge-Kutta-Munthe-Kaas method. `euler`: semi-implicit Euler, for comparison.
"""

from __future__ import annotations

import numpy as np

from collision.numeric.kernel import inner_kernel
from collision.numeric.vectors import cross, rotated
from physics.model.rotations import exponential, matrix, multiply

MOST_TURN = 1e3
"""rad: the greatest turn in one call of `fly`"""
METHODS = {"gauss6": 0, "rkmk4": 1, "euler": 2}
"""integrator names; the first is the default"""

_S15 = np.sqrt(15.0)
_A = np.array(
    [
        [5 / 36, 2 / 9 - _S15 / 15, 5 / 36 - _S15 / 30],
        [5 / 36 + _S15 / 24, 2 / 9, 5 / 36 - _S15 / 24],
        [5 / 36 + _S15 / 30, 2 / 9 + _S15 / 15, 5 / 36],
    ]
)


@inner_kernel(allocates=True)
def _gauss(q, pi, inverse, h):
    """One step of length h: turns `q` (4,) and `pi` (3,) (body axes) in place."""
    stages = np.empty((3, 3))
    slope = np.empty((3, 3))
    omega = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            stages[i, j] = pi[j]
    size = np.sqrt(pi[0] * pi[0] + pi[1] * pi[1] + pi[2] * pi[2])
    before = np.inf
    for _ in range(60):
        for i in range(3):
            w = rotated(inverse, stages[i])
            omega[i, 0], omega[i, 1], omega[i, 2] = w
            slope[i, 0], slope[i, 1], slope[i, 2] = cross(stages[i], w)
        change = 0.0
        for i in range(3):
            for j in range(3):
                new = pi[j] + h * (_A[i, 0] * slope[0, j] + _A[i, 1] * slope[1, j] + _A[i, 2] * slope[2, j])
                change = max(change, abs(new - stages[i, j]))
                stages[i, j] = new
        if change == 0.0 or (change < 1e-15 * size and change >= before):
            break  # at rounding, and no longer shrinking
        before = change
    for i in range(3):
        w = rotated(inverse, stages[i])
        omega[i, 0], omega[i, 1], omega[i, 2] = w
        slope[i, 0], slope[i, 1], slope[i, 2] = cross(stages[i], w)
    for j in range(3):
        pi[j] += h * (5.0 * slope[0, j] + 8.0 * slope[1, j] + 5.0 * slope[2, j]) / 18.0
    # Magnus: (Rᵀ)' = -ω̂ Rᵀ, so A = -ω̂ and Rᵀ ← exp(Ω) Rᵀ, that is R ← R exp(-Ω)
    for j in range(3):
        first, middle, last = omega[0, j], omega[1, j], omega[2, j]
        stages[0, j] = -h * middle
        stages[1, j] = -h * _S15 / 3.0 * (last - first)
        stages[2, j] = -h * 10.0 / 3.0 * (last - 2.0 * middle + first)
    c1 = cross(stages[0], stages[1])
    for j in range(3):
        slope[0, j] = 2.0 * stages[2, j] + c1[j]
    c2 = cross(stages[0], slope[0])
    for j in range(3):
        slope[0, j] = -20.0 * stages[0, j] - stages[2, j] + c1[j]
        slope[1, j] = stages[1, j] - c2[j] / 60.0
    c3 = cross(slope[0], slope[1])
    for j in range(3):
        slope[2, j] = stages[0, j] + stages[2, j] / 12.0 + c3[j] / 240.0
    p = multiply((q[0], q[1], q[2], q[3]), exponential(-slope[2, 0], -slope[2, 1], -slope[2, 2]))
    q[0], q[1], q[2], q[3] = p


@inner_kernel(allocates=True)
def _rate(q, u, momentum, inverse, rotation):
    """ω in body axes at the attitude q exp(u), mapped to u's rate by dexp⁻¹ (enough terms for order 4)."""
    p = multiply((q[0], q[1], q[2], q[3]), exponential(u[0], u[1], u[2]))
    matrix(p, rotation)
    w = np.array(rotated(inverse, rotated(rotation.T, momentum)))
    first = np.array(cross(u, w))
    return w + 0.5 * first + np.array(cross(u, first)) / 12.0


@inner_kernel(allocates=True)
def _rkmk4(q, momentum, inverse, h):
    rotation = np.empty((3, 3))
    k1 = _rate(q, np.zeros(3), momentum, inverse, rotation)
    k2 = _rate(q, 0.5 * h * k1, momentum, inverse, rotation)
    k3 = _rate(q, 0.5 * h * k2, momentum, inverse, rotation)
    k4 = _rate(q, h * k3, momentum, inverse, rotation)
    u = h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    p = multiply((q[0], q[1], q[2], q[3]), exponential(u[0], u[1], u[2]))
    q[0], q[1], q[2], q[3] = p


@inner_kernel(allocates=True)
def fly(q, momentum, inverse, h, method):
    """Free rotation over `h` seconds, in place, of the attitude `q` (4,).

    `momentum` (3,) in world axes stays what it is; `inverse` (3, 3) is the inverse inertia in body axes. A step over
    which the body would turn by more than 1/40 rad is split, so that spins are followed; one of more than `MOST_TURN`
    makes the attitude NaN.
    """
    rotation = np.empty((3, 3))
    matrix(q, rotation)
    pi = np.array(rotated(rotation.T, momentum))
    w = rotated(inverse, pi)
    angle = h * np.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    if angle == 0.0:
        return
    if not angle <= MOST_TURN:  # also NaN
        q[0] = q[1] = q[2] = q[3] = np.nan
        return
    if method == 2:
        w = rotated(rotation, w)
        p = multiply(exponential(h * w[0], h * w[1], h * w[2]), (q[0], q[1], q[2], q[3]))
        q[0], q[1], q[2], q[3] = p
        return
    n = int(np.ceil(40.0 * angle))
    for _ in range(n):
        if method == 1:
            _rkmk4(q, momentum, inverse, h / n)
        else:
            _gauss(q, pi, inverse, h / n)
    if method == 0:  # the least turn that takes R π to L: the momentum in the world is then exact as well
        matrix(q, rotation)
        has = rotated(rotation, pi)
        axis = cross(has, momentum)
        size = momentum[0] * momentum[0] + momentum[1] * momentum[1] + momentum[2] * momentum[2]
        p = multiply(
            exponential(axis[0] / size, axis[1] / size, axis[2] / size), (q[0], q[1], q[2], q[3])
        )  # the sine is the angle: it is below 1e-9
        q[0], q[1], q[2], q[3] = p
