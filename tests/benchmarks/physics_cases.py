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
COIN = {"radius": 0.012, "thickness": 0.002, "mass": 0.006, "friction": 0.8, "time": 1.0}
COINS = {"coin roll": COIN | {"tilt": np.pi / 6}, "coin spin": COIN | {"tilt": np.radians(70.0)}}
"""tilt of the coin's axis out of the vertical: lying low and rolling on its rim, and spinning nearly upright"""
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
    "spin momentum": ("spin", "1, largest change of angular momentum in 100 s"),
    "spin flips": ("spin", "s, largest error of a flip's time in 100 s"),
    "spin attitude": ("spin", "rad after 100 s"),
    "pendulum": ("mechanism", "rad after 10 s"),
    "four-bar": ("mechanism", "m, of the coupler's middle after 2 s"),
    "stack": ("stack", "m, largest way of a box in 60 s"),
    "roll": ("roll", "m after 2 s"),
    "coin roll": ("coin", "m, way of the centre in 1 s"),
    "coin spin": ("coin", "m, way of the centre in 1 s"),
    "balloon rise": ("balloon", "m after 3 s"),
    "balloon rest": ("balloon", "m, height under the ceiling"),
    "peg 0.1 mm": ("peg", "m, height at rest after 1 s"),
    "peg 10 um": ("peg", "m, height at rest after 1 s"),
}
"""row -> its case, and the unit of its error"""
CASES = tuple(dict.fromkeys(case for case, _ in ROWS.values()))
"""the nine cases"""
RUNS = tuple(dict.fromkeys("spin" if case == "spin" else row for row, (case, _) in ROWS.items()))
"""what is simulated: one run gives all rows of the spin"""
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


def coin_start(coin: dict[str, Any]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotation (3, 3), centre (3,) and angular velocity (3,) of the steady roll of a disc whose centre stays at rest.

    With n the disc's axis, e the radius to the lowest rim point and ω along the line from the centre to it, the
    balance of angular momentum gives Ω² (A sin a cos a - C sin² a h/r) = m g (r cos a - h sin a), h half the thickness.
    """
    r, h, a, m = coin["radius"], coin["thickness"] / 2, coin["tilt"], coin["mass"]
    across, along = m * (r * r / 4 + h * h / 3), m * r * r / 2
    s, c = np.sin(a), np.cos(a)
    rate = np.sqrt(m * G * (r * c - h * s) / (across * s * c - along * s * s * h / r))
    n = np.array([s, 0.0, c])
    e = np.array([c, 0.0, -s])
    omega = rate * s * (h / r * n - e)
    rotation = np.column_stack([e, np.cross(n, e), n])
    return rotation, np.array([0.0, 0.0, r * s + h * c]), omega


def carlson(x: float, y: float, z: float) -> float:
    """Carlson's elliptic integral R_F by duplication (Numerical Algorithms 10, 1995), to rounding."""
    while True:
        mean = (x + y + z) / 3.0
        far = max(abs(mean - x), abs(mean - y), abs(mean - z)) / mean
        if far < 2e-3:  # what is left out is of sixth order
            a, b = 1.0 - x / mean, 1.0 - y / mean
            e2, e3 = a * b - (a + b) ** 2, -a * b * (a + b)
            series = 1.0 - e2 / 10.0 + e3 / 14.0 + e2 * e2 / 24.0 - 3.0 * e2 * e3 / 44.0
            return float(series / np.sqrt(mean))
        shift = np.sqrt(x * y) + np.sqrt(y * z) + np.sqrt(z * x)
        x, y, z = (x + shift) / 4.0, (y + shift) / 4.0, (z + shift) / 4.0


def jacobi(u: Any, rest: float) -> tuple[Any, Any, Any]:
    """sn, cn, dn of u for the parameter 1 - rest, by the arithmetic-geometric mean (Abramowitz & Stegun, 16.4)."""
    a, b, c = [1.0], np.sqrt(rest), [np.sqrt(1.0 - rest)]
    while c[-1] > 1e-17:
        c.append((a[-1] - b) / 2.0)
        a, b = [*a, (a[-1] + b) / 2.0], np.sqrt(a[-1] * b)
    phi = 2.0 ** (len(a) - 1) * a[-1] * u
    for k in range(len(a) - 1, 0, -1):
        phi = (phi + np.arcsin(c[k] / a[k] * np.sin(phi))) / 2.0
    sn, cn = np.sin(phi), np.cos(phi)
    return sn, cn, np.sqrt(rest + (1.0 - rest) * cn * cn)


def spin_truth() -> dict[str, Any]:
    """The free body in closed form (Landau & Lifshitz, Mechanics, § 37), for I1 < I2 < I3 and L² > 2 T I2.

    ω = (A1 cn, A2 sn, A3 dn)(rate·t + phase); it flips where sn = 0, every `half` / rate. The attitude follows from the
    angular momentum's direction and the angle about it, whose rate is L (2T - I3 ω3²) / (L² - I3² ω3²) (quadrature).
    """
    i, w = np.array(SPIN["inertia"]), np.array(SPIN["omega"])
    over = [float((w * w * i * (i - i[k])).sum()) for k in range(3)]  # L² - 2 T I_k
    amplitudes = np.sqrt([-over[2] / (i[0] * (i[2] - i[0])), -over[2] / (i[1] * (i[2] - i[1])), 0.0])
    amplitudes[2] = np.sqrt(over[0] / (i[2] * (i[2] - i[0])))
    rate = np.sqrt((i[2] - i[1]) * over[0] / i.prod())
    rest = (i[2] - i[0]) * over[1] / ((i[2] - i[1]) * over[0])
    cn, sn, dn = w / amplitudes
    phase = sn * carlson(cn * cn, dn * dn, 1.0)
    half = 2.0 * carlson(0.0, rest, 1.0)

    def omega(t: Any) -> Any:
        s, c, d = jacobi((rate * t + phase + half) % (2.0 * half) - half, rest)
        return np.stack([amplitudes[0] * c, amplitudes[1] * s, amplitudes[2] * d])

    def triad(w: np.ndarray) -> np.ndarray:
        n = i * w / np.linalg.norm(i * w)
        p = np.cross([0.0, 0.0, 1.0], n)
        p /= np.linalg.norm(p)
        return np.column_stack([n, p, np.cross(n, p)])

    nodes, weights = np.polynomial.legendre.leggauss(12)
    edges = np.linspace(0.0, SPIN["time"], 2001)
    t = (edges[:-1, None] + edges[1:, None] + np.diff(edges)[:, None] * nodes) / 2.0
    w1, w2, _ = omega(t)
    total = np.linalg.norm(i * w)
    turning = total * (i[0] * w1**2 + i[1] * w2**2) / ((i[0] * w1) ** 2 + (i[1] * w2) ** 2)
    angle = float((turning @ weights * np.diff(edges) / 2.0).sum())
    s, c = np.sin(angle), np.cos(angle)
    attitude = triad(w) @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ triad(omega(SPIN["time"])).T
    numbers = {"rate": float(rate), "phase": float(phase), "half": float(half)}
    return {"attitude": attitude.tolist(), "amplitudes": amplitudes.tolist(), **numbers}


class SpinErrors:
    """What is wrong with a free body's spin, from looks at it at even times."""

    LOOKS = 200

    def __init__(self, truth: dict[str, Any]) -> None:
        self._truth = truth["spin"]
        self._inertia, w = np.array(SPIN["inertia"]), np.array(SPIN["omega"])
        self._energy, self._momentum = w @ (self._inertia * w), self._inertia * w
        self._looks = 0
        self.energy = self.momentum = self.flips = self.attitude = 0.0

    def look(self, rotation: np.ndarray, omega: np.ndarray) -> None:
        """Takes rotation (3, 3) and angular velocity (3,) in body axes at the next of the even times."""
        self._looks += 1
        t = self._looks * SPIN["time"] / self.LOOKS
        truth, momentum = self._truth, rotation @ (self._inertia * omega)
        self.energy = max(self.energy, abs(omega @ (self._inertia * omega) / self._energy - 1.0))
        away = float(np.linalg.norm(momentum - self._momentum) / np.linalg.norm(self._momentum))
        self.momentum = max(self.momentum, away)
        half, phase = truth["half"], truth["rate"] * t + truth["phase"]
        since = (phase + half / 2.0) % half - half / 2.0
        if abs(since) < 0.75 * truth["rate"] * SPIN["time"] / self.LOOKS:  # a flip is near: how long ago, it seems?
            cn, sn, dn = omega / np.array(truth["amplitudes"])
            seems = np.sign(cn) * sn * carlson(cn * cn, dn * dn, 1.0)
            self.flips = max(self.flips, abs(seems - since) / truth["rate"])
        if self._looks == self.LOOKS:
            self.attitude = angle_between(rotation, np.array(truth["attitude"]))

    def rows(self) -> dict[str, float]:
        """The error of each row of the spin."""
        return {row: getattr(self, row.split()[1]) for row, (case, _) in ROWS.items() if case == "spin"}


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
    """(x, z) of the coupler's middle at the end: three angles and the loop's two multipliers, DOP853 at 1e-13.

    The crank's angle is integrated; the other two follow from the loop, so that nothing drifts.
    """
    from scipy.integrate import solve_ivp

    l1, l2, l3 = bars = np.array(FOURBAR["bars"])
    ground = np.array([FOURBAR["ground"], 0.0])
    masses = FOURBAR["density"] * bars * FOURBAR["width"] ** 2
    about = masses * (bars**2 + FOURBAR["width"] ** 2) / 12 + masses * bars**2 / 4
    about[0] += masses[1] * l1**2
    weight = G * (masses * bars / 2 + [masses[1] * l1, 0, 0])

    def rate(_, y):
        q, v = y
        b, c = fourbar_points(q)
        along = np.array([b / l1, (c - b) / l2, (c - ground) / l3])
        across = np.column_stack([-along[:, 1], along[:, 0]])
        jacobian = across.T * [l1, l2, -l3]
        speed = np.array([v, *np.linalg.solve(jacobian[:, 1:], -jacobian[:, 0] * v)])
        mixed = masses[1] * l1 * l2 / 2
        mass = np.diag(about)
        mass[0, 1] = mass[1, 0] = mixed * (along[0] @ along[1])
        turned = mixed * (along[0, 1] * along[1, 0] - along[0, 0] * along[1, 1])
        force = -weight * along[:, 0] + [-turned * speed[1] ** 2, turned * speed[0] ** 2, 0.0]
        both = np.block([[mass, jacobian.T], [jacobian, np.zeros((2, 2))]])
        inward = along.T @ (speed**2 * [l1, l2, -l3])
        return [v, np.linalg.solve(both, np.concatenate([force, inward]))[0]]

    span, start = (0, FOURBAR["time"]), [FOURBAR["crank"], 0.0]
    end = solve_ivp(rate, span, start, method="DOP853", rtol=1e-13, atol=1e-15, max_step=0.005).y[0, -1]
    b, c = fourbar_points(end)
    return (b + c) / 2


def truths() -> dict[str, Any]:
    """What needs scipy, computed once and passed on to the other interpreters."""
    return {
        "spin": spin_truth(),
        "pendulum": pendulum_truth(),
        "four-bar": fourbar_reference().tolist(),
    }


def plate_ring(size: float, thickness: float, radius: float, n: int = 64) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of a square plate about the origin with a hole along z."""
    a = 2 * np.pi * np.arange(n) / n
    ring = np.stack([np.cos(a), np.sin(a)], axis=1)
    outer = 0.5 * size * ring / np.abs(ring).max(axis=1)[:, None]
    h = thickness / 2
    points = np.vstack([np.column_stack([p, np.full(n, z)]) for p in (radius * ring, outer) for z in (h, -h)])
    faces = []
    for k in range(n):
        m = (k + 1) % n
        it, ib, ot, ob, jt, jb, pt, pb = k, n + k, 2 * n + k, 3 * n + k, m, n + m, 2 * n + m, 3 * n + m
        faces += [(it, jt, ib), (jt, jb, ib), (it, ot, jt), (jt, ot, pt), (ib, jb, ob), (jb, pb, ob)]
        faces += [(ot, ob, pt), (pt, ob, pb)]
    return points, np.array(faces)
