"""The nine cases of the physics benchmark: their figures, shared by all engines, and what is true of each.

Needs numpy and scipy only, so that an interpreter with other people's engines can read it too. A case has rows; a row
has a truth in closed form, or a reference integrated to 1e-12.
"""

from __future__ import annotations

from typing import Any

import numpy as np

G = 9.80665
BALL = {"radius": 0.05, "mass": 1.0, "drop": 1.0, "bounces": 20}
SLOPE = {"tilt": np.pi / 6, "side": 0.1, "mass": 1.0, "slide": 0.3, "stick": 0.6, "time": 1.0}
SPIN = {"inertia": [1.0, 2.0, 3.0], "omega": [0.01, 5.0, 0.01], "time": 100.0}
PENDULUM = {"length": 0.5, "width": 0.02, "height": 0.04, "density": 1000.0, "angle": 1.0, "time": 10.0}
FOURBAR = {"ground": 0.45, "bars": [0.2, 0.5, 0.4], "width": 0.02, "density": 1000.0, "crank": 2.0, "time": 2.0}
STACK = {"n": 10, "side": 0.1, "mass": 1.0, "friction": 0.5, "time": 60.0}
ROLL = {"tilt": np.pi / 18, "radius": 0.05, "mass": 1.0, "friction": 0.5, "time": 2.0}
COIN = {"radius": 0.012, "thickness": 0.002, "mass": 0.006, "tilt": np.pi / 6, "friction": 0.8, "time": 1.0}
BALLOON = {"radius": 0.15, "mass": 0.008, "air": 1.204, "drag": 0.47, "start": 0.2, "ceiling": 10.0, "time": 3.0,
           "rest": 12.0}  # fmt: skip
PEG = {"radius": 0.004, "length": 0.03, "plate": 0.02, "offset": 0.3, "gap": 0.004, "time": 1.0}
"""m; `offset` is in units of the radial clearance, `gap` how high the peg's end hangs above the plate"""

ROWS: dict[str, tuple[str, str]] = {
    "bounce e=1": ("bounce", "m, height of apex 20 against the first"),
    "bounce e=0.8": ("bounce", "m, height of apex 20 against the closed form"),
    "slope slide": ("slope", "m after 1 s"),
    "slope stick": ("slope", "m of creep in 1 s"),
    "spin energy": ("spin", "1, largest change of energy in 100 s"),
    "spin attitude": ("spin", "rad after 100 s (the flips' timing)"),
    "pendulum": ("mechanism", "rad after 10 s"),
    "four-bar": ("mechanism", "m, of the coupler's middle after 2 s"),
    "stack": ("stack", "m, largest way of a box in 60 s"),
    "roll": ("roll", "m after 2 s"),
    "coin": ("coin", "m, way of the centre in 1 s"),
    "balloon rise": ("balloon", "m after 3 s"),
    "balloon rest": ("balloon", "m, height under the ceiling"),
    "peg 0.1 mm": ("peg", "m, height at rest after 1 s"),
    "peg 10 um": ("peg", "m, height at rest after 1 s"),
}
"""row -> its case, and the unit of its error"""
CLEARANCE = {"peg 0.1 mm": 5e-5, "peg 10 um": 5e-6}
"""m, radial, by row"""


def apex_time(e: float, bounces: int) -> float:
    """s at which the apex after so many bounces is reached, from a drop of 1 m."""
    fall = np.sqrt(2.0 * BALL["drop"] / G)
    return float(fall * (1.0 + 2.0 * sum(e**k for k in range(1, bounces)) + e**bounces))


def balloon_constants() -> tuple[float, float, float]:
    """Lift (N), drag k (N·s²/m²), frontal area (m²)."""
    r = BALLOON["radius"]
    lift = (BALLOON["air"] * 4.0 / 3.0 * np.pi * r**3 - BALLOON["mass"]) * G
    area = np.pi * r * r
    return lift, 0.5 * BALLOON["air"] * BALLOON["drag"] * area, area


def balloon_rise(t: float) -> float:
    """Height of the balloon's centre: m v' = L - k v²."""
    lift, k, _ = balloon_constants()
    terminal = np.sqrt(lift / k)
    tau = BALLOON["mass"] * terminal / lift
    return float(BALLOON["start"] + terminal * tau * np.log(np.cosh(t / tau)))


def coin_start() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotation (3, 3), centre (3,) and angular velocity (3,) of the steady roll of a disc whose centre stays at rest.

    With n the disc's axis, e the radius to the lowest rim point and ω along the line from the centre to it, the
    balance of angular momentum gives Ω² (A sin a cos a - C sin² a h/r) = m g (r cos a - h sin a), h half the thickness.
    """
    r, h, a, m = COIN["radius"], COIN["thickness"] / 2, COIN["tilt"], COIN["mass"]
    across, along = m * (r * r / 4 + h * h / 3), m * r * r / 2
    s, c = np.sin(a), np.cos(a)
    rate = np.sqrt(m * G * (r * c - h * s) / (across * s * c - along * s * s * h / r))
    n = np.array([s, 0.0, c])
    e = np.array([c, 0.0, -s])
    omega = rate * s * (h / r * n - e)
    rotation = np.column_stack([e, np.cross(n, e), n])
    return rotation, np.array([0.0, 0.0, r * s + h * c]), omega


def spin_reference() -> np.ndarray:
    """Rotation (3, 3) of the free body at the end, by DOP853 at 1e-13 on Euler's equations."""
    from scipy.integrate import solve_ivp

    inertia = np.array(SPIN["inertia"])

    def rate(_, y):
        q, w = y[:4] / np.linalg.norm(y[:4]), y[4:]
        x, yy, z, s = q
        dq = 0.5 * np.array(
            [
                s * w[0] + yy * w[2] - z * w[1],
                s * w[1] + z * w[0] - x * w[2],
                s * w[2] + x * w[1] - yy * w[0],
                -x * w[0] - yy * w[1] - z * w[2],
            ]
        )
        return np.concatenate([dq, np.cross(inertia * w, w) / inertia])

    y = np.array([0, 0, 0, 1.0, *SPIN["omega"]])
    end = solve_ivp(rate, (0, SPIN["time"]), y, method="DOP853", rtol=1e-13, atol=1e-15, max_step=0.02).y[:, -1]
    x, yy, z, s = end[:4] / np.linalg.norm(end[:4])
    return np.array(
        [
            [1 - 2 * (yy * yy + z * z), 2 * (x * yy - z * s), 2 * (x * z + yy * s)],
            [2 * (x * yy + z * s), 1 - 2 * (x * x + z * z), 2 * (yy * z - x * s)],
            [2 * (x * z - yy * s), 2 * (yy * z + x * s), 1 - 2 * (x * x + yy * yy)],
        ]
    )


def angle_between(a: np.ndarray, b: np.ndarray) -> float:
    """rad, of the rotation from a to b."""
    return float(2.0 * np.arcsin(min(1.0, np.linalg.norm(a - b) / np.sqrt(8.0))))


def pendulum_constants() -> tuple[float, float]:
    """Moment about the pivot over mass, and distance of the centre, of a bar hung at its end."""
    p = PENDULUM
    return (p["length"] ** 2 + p["height"] ** 2) / 12 + p["length"] ** 2 / 4, p["length"] / 2


def pendulum_truth() -> float:
    """Angle from hanging at the end, in closed form (Jacobi's elliptic functions)."""
    from scipy.special import ellipj, ellipk

    moment, arm = pendulum_constants()
    omega = np.sqrt(G * arm / moment)
    k = np.sin((np.pi / 2 - PENDULUM["angle"]) / 2)
    sn = ellipj(ellipk(k * k) - omega * PENDULUM["time"], k * k)[0]
    return float(2 * np.arcsin(k * sn))


def fourbar_points(crank: Any) -> tuple[Any, Any]:
    """Coordinates (x, z) of the crank's and the rocker's moving pins; also for complex angles (for derivatives)."""
    (l1, l2, l3), d = FOURBAR["bars"], FOURBAR["ground"]
    b = np.array([l1 * np.cos(crank), l1 * np.sin(crank)])
    to = np.array([d, 0.0]) - b
    r2 = to @ to
    r = np.sqrt(r2)
    x = (l2 * l2 - l3 * l3 + r2) / (2 * r)
    y = np.sqrt(l2 * l2 - x * x)
    e = to / r
    return b, b + x * e + y * np.array([-e[1], e[0]])


def fourbar_reference() -> np.ndarray:
    """(x, z) of the coupler's middle at the end: one coordinate, Lagrange's equation, DOP853 at 1e-13."""
    from scipy.integrate import solve_ivp

    bars, width, rho = np.array(FOURBAR["bars"]), FOURBAR["width"], FOURBAR["density"]
    masses = rho * bars * width**2
    moments = masses * (bars**2 + width**2) / 12
    ground = np.array([FOURBAR["ground"], 0.0])

    def speeds(q):
        """Derivatives by q of centres and of directions times length, and centres' heights."""
        step = 1e-20j
        b, c = fourbar_points(q + step)
        db, dc = np.imag(b) / 1e-20, np.imag(c) / 1e-20
        return np.real(b), np.real(c), db, dc

    def inertia_and_potential(q):
        b, c, db, dc = speeds(q)
        centers = [db / 2, (db + dc) / 2, dc / 2]
        spins = [np.linalg.norm(db) / bars[0], np.linalg.norm(dc - db) / bars[1], np.linalg.norm(dc) / bars[2]]
        m = sum(masses[i] * centers[i] @ centers[i] + moments[i] * spins[i] ** 2 for i in range(3))
        u = G * (masses[0] * b[1] / 2 + masses[1] * (b[1] + c[1]) / 2 + masses[2] * (c[1] + ground[1]) / 2)
        return m, u

    def rate(_, y):
        q, v = y
        h = 1e-3  # eighth-order central differences: error h⁸
        w = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
        sides = [inertia_and_potential(q + k * h) for k in range(-4, 5)]
        dm = sum(wi * s[0] for wi, s in zip(w, sides, strict=True)) / h
        du = sum(wi * s[1] for wi, s in zip(w, sides, strict=True)) / h
        return [v, (-0.5 * dm * v * v - du) / sides[4][0]]

    end = solve_ivp(rate, (0, FOURBAR["time"]), [FOURBAR["crank"], 0.0], method="DOP853", rtol=1e-13, atol=1e-14).y[
        0, -1
    ]
    b, c = fourbar_points(end)
    return (b + c) / 2


def truths() -> dict[str, Any]:
    """What needs scipy, computed once and passed on to the other interpreters."""
    return {
        "spin": spin_reference().tolist(),
        "pendulum": pendulum_truth(),
        "four-bar": fourbar_reference().tolist(),
    }
