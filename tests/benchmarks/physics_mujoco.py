"""The physics cases in MuJoCo, each with the settings that served it best of those tried.

Tried for each case: the integrators, both cones, direct and indirect stiffness of contact (`solref`), constant and
varying impedance (`solimp`), `impratio`, `noslip_iterations`. OPTIONS holds what was best somewhere. RK4 beats the
default wherever forces are smooth; impedance 0.9999 from the start sags least; stiffer than 2 steps does not hold.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from physics_cases import (
    BALL,
    BALLOON,
    CLEARANCE,
    COINS,
    FOURBAR,
    PEG,
    PENDULUM,
    ROLL,
    SLOPE,
    SPIN,
    STACK,
    G,
    SpinErrors,
    apex_time,
    balloon_constants,
    balloon_rise,
    coin_start,
    fourbar_points,
    plate_ring,
)

STIFF = "0.9999 0.9999 1e-6"
SOFT = "0.9 0.9 1e-6"

OPTIONS: dict[str, dict[str, dict[str, Any]]] = {  # row -> name of a set of settings -> the settings
    "bounce": {
        "": {"stiff": 0.05, "impedance": SOFT},
        "RK4": {"stiff": 0.05, "impedance": SOFT, "integrator": "RK4"},
        "RK4 soft": {"stiff": 0.02, "integrator": "RK4"},
    },
    "slope slide": {
        "": {"impedance": "0.99 0.99 1e-3", "least": 2e-3},
        "RK4": {"integrator": "RK4"},
        "RK4 soft": {"integrator": "RK4", "least": 2e-2},
    },
    "slope stick": {
        "Euler": {"integrator": "Euler", "ratio": 100},
        "RK4": {"integrator": "RK4", "ratio": 10},
        "settled": {"integrator": "Euler", "ratio": 100, "noslip": 50, "settle": 1.0},
    },
    "spin": {"RK4": {}},
    "pendulum": {"RK4": {}},
    "four-bar": {"RK4": {"times": 2}, "RK4 soft": {"times": 4}},
    "stack": {"": {}, "noslip": {"noslip": 20, "ratio": 100}},
    "roll": {"": {}, "RK4": {"integrator": "RK4"}, "RK4 noslip": {"integrator": "RK4", "noslip": 50}},
    "coin": {"": {}, "soft": {"impedance": SOFT}},
    "balloon rise": {"": {}, "RK4": {"integrator": "RK4"}},
    "balloon rest": {"": {}},
    "peg": {"hull": {}, "wedges": {}},
}


def options(row: str) -> dict[str, dict[str, Any]]:
    """The sets of settings of a row, by name."""
    return OPTIONS.get(row) or OPTIONS[row.split()[0]]


def _r(value: float) -> str:
    """A number as MJCF reads it, to the last bit."""
    return repr(float(value))


def _quaternion(rotation: np.ndarray) -> str:
    """w x y z of a rotation matrix of less than half a turn."""
    w = np.sqrt(max(0.0, 1 + np.trace(rotation))) / 2
    v = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    return " ".join(_r(x) for x in (w, *(v / (4 * w))))


class Engine:
    """Cases as MJCF; elliptic cone and Newton's solver; stepped in C (`mj_step` with a count), not from Python."""

    def __init__(self, truth: dict[str, Any]) -> None:
        import mujoco

        self.mj = mujoco
        self.truth = truth
        self.version = mujoco.__version__

    def run(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
        """Seconds of stepping, steps, error."""
        name = row.split()[0].replace("four-bar", "fourbar")
        return getattr(self, name)(row, dt, option, options(row)[option])

    def model(self, dt: float, body: str, settings: dict[str, Any], asset: str = "", equality: str = "") -> Any:
        """`stiff`: ωdt of an undamped contact; else critically damped, time constant of `times` steps, >= `least`."""
        reference = f"{_r(max(settings.get('times', 2) * dt, settings.get('least', 0.0)))} 1"
        if "stiff" in settings:
            omega, damping = settings["stiff"] / dt, settings.get("damping", 0.0)
            reference = f"{_r(-(omega**2))} {_r(-2 * damping * omega)}"
        soft = f'solref="{reference}" solimp="{settings.get("impedance", STIFF)}"'
        xml = f"""<mujoco><option timestep="{_r(dt)}" gravity="0 0 {_r(-G)}" cone="elliptic" solver="Newton"
          integrator="{settings.get("integrator", "implicitfast")}" tolerance="1e-14" iterations="200"
          impratio="{settings.get("ratio", 1)}" noslip_iterations="{settings.get("noslip", 0)}"
          noslip_tolerance="1e-14"/><size memory="64M"/><default><geom {soft}/><equality {soft}/></default>
          <asset>{asset}</asset><worldbody>{body}</worldbody><equality>{equality}</equality></mujoco>"""
        return self.mj.MjModel.from_xml_string(xml)

    def timed(self, model: Any, data: Any, seconds: float) -> tuple[float, int]:
        n = max(1, round(seconds / model.opt.timestep))
        model.opt.timestep = seconds / n
        begin = time.process_time()
        self.mj.mj_step(model, data, n)
        return time.process_time() - begin, n

    def bounce(self, row: str, dt: float, option: str, settings: dict[str, Any]) -> tuple[float, int, float]:
        """Apex 20 is told by counting, as a soft contact takes time: kinder than to look when it should be there."""
        from mujoco import rollout

        e = float(row.split("=")[1])
        damping = 0.0 if e == 1.0 else -np.log(e) / np.sqrt(np.pi**2 + np.log(e) ** 2)
        m = self.model(
            dt,
            f"""<geom type="plane" size="4 4 1"/><body pos="0 0 {_r(BALL["drop"] + BALL["radius"])}"><freejoint/>
            <geom type="sphere" size="{BALL["radius"]}" mass="{BALL["mass"]}"/></body>""",
            {**settings, "damping": damping},
        )
        end = apex_time(e, BALL["bounces"])
        seconds, n = self.timed(m, self.mj.MjData(m), end)
        in_contact = BALL["bounces"] * np.pi * m.opt.timestep / settings["stiff"]
        d, everything = self.mj.MjData(m), self.mj.mjtState.mjSTATE_FULLPHYSICS
        start = np.empty(self.mj.mj_stateSize(m, everything))
        self.mj.mj_getState(m, d, start, everything)
        states, _ = rollout.rollout(m, d, start, nstep=round((1.2 * end + 2 * in_contact) / m.opt.timestep))
        z, v = states[0, :, 3] - BALL["radius"], states[0, :, 10]
        tops = np.nonzero((v[:-1] > 0) & (v[1:] <= 0))[0]
        if len(tops) < BALL["bounces"]:
            return seconds, n, np.inf
        k = tops[BALL["bounces"] - 1]
        return seconds, n, abs(z[k] + v[k] ** 2 / (2 * G) - e ** (2 * BALL["bounces"]))

    def slope(self, row: str, dt: float, option: str, settings: dict[str, Any]) -> tuple[float, int, float]:
        mu = SLOPE[row.split()[1]]
        a, s = SLOPE["tilt"], SLOPE["side"]
        m = self.model(
            dt,
            f"""<geom type="plane" size="20 20 1" friction="{mu} 0 0"/><body pos="0 0 {_r(s / 2)}"><freejoint/>
            <geom type="box" size="{s / 2} {s / 2} {s / 2}" mass="{SLOPE["mass"]}" friction="{mu} 0 0"/></body>""",
            settings,
        )
        m.opt.gravity[:] = [G * np.sin(a), 0, -G * np.cos(a)]
        d = self.mj.MjData(m)
        if "settle" in settings:  # its contacts sink in first; what it creeps after that is another question
            self.timed(m, d, settings["settle"])
        first = d.qpos[0]
        seconds, n = self.timed(m, d, SLOPE["time"])
        want = max(0.0, 0.5 * G * (np.sin(a) - mu * np.cos(a))) if mu < np.tan(a) else 0.0
        return seconds, n, abs(d.qpos[0] - first - want)

    def spin(self, row: str, dt: float, option: str, settings: dict[str, Any]) -> tuple[float, int, float]:
        i = SPIN["inertia"]
        m = self.model(
            dt,
            f"""<body><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="{i[0]} {i[1]} {i[2]}"/></body>""",
            {"integrator": "RK4"},
        )
        m.opt.gravity[:] = 0
        d = self.mj.MjData(m)
        d.qvel[3:6] = SPIN["omega"]
        errors, seconds, n = SpinErrors(self.truth), 0.0, 0
        rotation = np.empty(9)
        for _ in range(SpinErrors.LOOKS):
            s, k = self.timed(m, d, SPIN["time"] / SpinErrors.LOOKS)
            seconds, n = seconds + s, n + k
            self.mj.mju_quat2Mat(rotation, d.qpos[3:7])
            errors.look(rotation.reshape(3, 3), d.qvel[3:6])
        return seconds, n, errors.rows()

    def pendulum(self, row: str, dt: float, option: str, settings: dict[str, Any]) -> tuple[float, int, float]:
        p = PENDULUM
        m = self.model(
            dt,
            f"""<body><joint type="hinge" axis="0 1 0"/><geom type="box" contype="0" conaffinity="0"
            density="{p["density"]}" pos="{p["length"] / 2} 0 0"
            size="{p["length"] / 2} {p["width"] / 2} {p["height"] / 2}"/></body>""",
            {"integrator": "RK4"},
        )
        d = self.mj.MjData(m)
        d.qpos[0] = p["angle"]
        seconds, n = self.timed(m, d, p["time"])
        return seconds, n, abs((np.pi / 2 - d.qpos[0]) - self.truth["pendulum"])

    def fourbar(self, row: str, dt: float, option: str, settings: dict[str, Any]) -> tuple[float, int, float]:
        """Three hinges as coordinates; the fourth is a soft `connect`."""
        f = FOURBAR
        l1, l2, l3 = f["bars"]
        b, c = fourbar_points(f["crank"])
        base = np.array([f["ground"], 0.0])
        # hinges about -y so that angles count from x to z
        a2 = np.arctan2(*(c - b)[::-1]) - f["crank"]
        a3 = np.arctan2(*(c - base)[::-1])

        def bar(length: float) -> str:
            w = f["width"] / 2
            return (
                f'<geom type="box" contype="0" conaffinity="0" density="{f["density"]}" pos="{length / 2} 0 0" '
                f'size="{length / 2} {w} {w}"/>'
            )

        body = f"""<body name="1"><joint axis="0 -1 0"/>{bar(l1)}<body name="2" pos="{l1} 0 0"><joint axis="0 -1 0"/>
            {bar(l2)}<site name="mid" pos="{l2 / 2} 0 0"/></body></body>
            <body name="3" pos="{f["ground"]} 0 0"><joint axis="0 -1 0"/>{bar(l3)}</body>"""
        connect = f'<connect body1="2" body2="3" anchor="{l2} 0 0"/>'
        m = self.model(dt, body, {**settings, "integrator": "RK4"}, equality=connect)
        d = self.mj.MjData(m)
        d.qpos[:] = [f["crank"], a2, a3]
        # the anchor on body 3 is where body 2's was at qpos0: place it by hand
        m.eq_data[0, :6] = [l2, 0, 0, l3, 0, 0]
        seconds, n = self.timed(m, d, f["time"])
        self.mj.mj_forward(m, d)
        return seconds, n, float(np.linalg.norm(d.site_xpos[0][[0, 2]] - np.array(self.truth["four-bar"])))

    def stack(self, row: str, dt: float, option: str, settings: dict[str, Any]) -> tuple[float, int, float]:
        s = STACK["side"]
        geom = f'type="box" size="{s / 2} {s / 2} {s / 2}" mass="{STACK["mass"]}" friction="{STACK["friction"]} 0 0"'
        bodies = "".join(
            f'<body pos="0 0 {_r(s * (k + 0.5))}"><freejoint/><geom {geom}/></body>' for k in range(STACK["n"])
        )
        floor = f'<geom type="plane" size="4 4 1" friction="{STACK["friction"]} 0 0"/>'
        m = self.model(dt, floor + bodies, settings)
        d = self.mj.MjData(m)
        seconds, n = self.timed(m, d, STACK["time"])
        at = d.qpos.reshape(-1, 7)[:, :3]
        want = np.array([[0, 0, s * (k + 0.5)] for k in range(STACK["n"])])
        return seconds, n, float(np.abs(at - want).max())

    def roll(self, row: str, dt: float, option: str, settings: dict[str, Any]) -> tuple[float, int, float]:
        r, a, mu = ROLL["radius"], ROLL["tilt"], ROLL["friction"]
        m = self.model(
            dt,
            f"""<geom type="plane" size="20 20 1" friction="{mu} 0 0"/><body pos="0 0 {_r(r)}"><freejoint/>
            <geom type="sphere" size="{r}" mass="{ROLL["mass"]}" friction="{mu} 0 0"/></body>""",
            settings,
        )
        m.opt.gravity[:] = [G * np.sin(a), 0, -G * np.cos(a)]
        d = self.mj.MjData(m)
        seconds, n = self.timed(m, d, ROLL["time"])
        return seconds, n, abs(d.qpos[0] - 5 / 14 * G * np.sin(a) * ROLL["time"] ** 2)

    def coin(self, row: str, dt: float, option: str, settings: dict[str, Any]) -> tuple[float, int, float]:
        c = COINS[row]
        rotation, center, omega = coin_start(c)
        m = self.model(
            dt,
            f"""<geom type="plane" size="2 2 1" friction="{c["friction"]} 0 0"/>
            <body pos="0 0 {_r(center[2])}" quat="{_quaternion(rotation)}"><freejoint/><geom type="cylinder"
            size="{c["radius"]} {c["thickness"] / 2}" mass="{c["mass"]}" friction="{c["friction"]} 0 0"/></body>""",
            settings,
        )
        d = self.mj.MjData(m)
        d.qvel[3:6] = rotation.T @ omega
        seconds, n = self.timed(m, d, c["time"])
        return seconds, n, float(np.linalg.norm(d.qpos[:3] - center))

    def balloon(self, row: str, dt: float, option: str, settings: dict[str, Any]) -> tuple[float, int, float]:
        """Drag by its own fluid model (a blunt ellipsoid, coefficient without the half), lift as a constant force."""
        r = BALLOON["radius"]
        lift, _, _ = balloon_constants()
        m = self.model(
            dt,
            f"""<geom type="box" size="2 2 0.1" pos="0 0 {_r(BALLOON["ceiling"] + 0.1)}"/>
            <body pos="0 0 {BALLOON["start"]}"><freejoint/><geom type="sphere" size="{r}" mass="{BALLOON["mass"]}"
            fluidshape="ellipsoid" fluidcoef="{BALLOON["drag"] / 2} 0 0 0 0"/></body>""",
            settings,
        )
        m.opt.density, m.opt.viscosity = BALLOON["air"], 0.0
        d = self.mj.MjData(m)
        d.xfrc_applied[1, 2] = lift + BALLOON["mass"] * G
        end = BALLOON["time"] if row.endswith("rise") else BALLOON["rest"]
        seconds, n = self.timed(m, d, end)
        want = balloon_rise(end) if row.endswith("rise") else BALLOON["ceiling"] - r
        return seconds, n, abs(d.qpos[2] - want)

    def peg(self, row: str, dt: float, option: str, settings: dict[str, Any]) -> tuple[float, int, float]:
        c = CLEARANCE[row]
        r, length, plate = PEG["radius"], PEG["length"], PEG["plate"]
        asset = ""
        if option == "hull":  # the plate's mesh: MuJoCo takes its convex hull, which has no hole
            points, faces = plate_ring(0.04, plate, r + c)
            asset = f"""<mesh name="plate" vertex="{" ".join(map(repr, points.ravel().tolist()))}"
                face="{" ".join(map(str, faces.ravel()))}"/>"""
            walls = f'<geom type="mesh" mesh="plate" pos="0 0 {plate / 2}"/>'
        else:  # 32 blocks about the hole, tangent to it
            half = (r + c) * np.tan(np.pi / 32) + 1e-6
            out = r + c + 0.005
            turns = 2 * np.pi / 32 * np.arange(32)
            walls = "".join(
                f'<geom type="box" size="0.005 {_r(half)} {plate / 2}" euler="0 0 {_r(np.degrees(turn))}" '
                f'pos="{_r(out * np.cos(turn))} {_r(out * np.sin(turn))} {plate / 2}"/>'
                for turn in turns
            )
        z = plate + PEG["gap"] + length / 2
        body = f"""<geom type="plane" size="1 1 1"/>{walls}<body pos="{_r(PEG["offset"] * c)} 0 {_r(z)}"><freejoint/>
            <geom type="cylinder" size="{r} {length / 2}" density="7850" friction="0.1 0 0"/></body>"""
        m = self.model(dt, body, settings, asset=asset)
        d = self.mj.MjData(m)
        seconds, n = self.timed(m, d, PEG["time"])
        return seconds, n, abs(d.qpos[2] - length / 2)
