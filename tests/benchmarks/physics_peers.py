"""The physics cases in MuJoCo and Drake: runs in an interpreter that has them.

`python physics_peers.py ENGINE < request.json > answer.json`; request {"truth", "runs": [[row, dt, option], …]}, answer
{"version", "rows": [{"row", "method", "dt", "seconds", "steps", "error"}]} or {"missing": reason}. `seconds` is wall
time for the whole run, stepping only; MuJoCo steps in C (`mj_step` with a count), not from Python, where it can.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import numpy as np
from physics_cases import (
    BALL,
    BALLOON,
    CLEARANCE,
    COIN,
    FOURBAR,
    PEG,
    PENDULUM,
    ROLL,
    SLOPE,
    SPIN,
    STACK,
    G,
    angle_between,
    apex_time,
    balloon_constants,
    balloon_rise,
    coin_start,
    fourbar_points,
)


def _r(value: float) -> str:
    """A number as MJCF reads it, to the last bit."""
    return repr(float(value))


def _quaternion(rotation: np.ndarray) -> str:
    """w x y z of a rotation matrix."""
    w = np.sqrt(max(0.0, 1 + np.trace(rotation))) / 2
    if w > 1e-6:
        v = np.array(
            [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
        )
        return " ".join(repr(float(x)) for x in (w, *(v / (4 * w))))
    raise ValueError("half a turn")


class MuJoCo:
    """Cases as MJCF; contacts as stiff as the step allows, elliptic cone, Newton solver at 1e-12."""

    def __init__(self, truth: dict[str, Any]) -> None:
        import mujoco

        self.mj = mujoco
        self.truth = truth
        self.version = mujoco.__version__

    def model(self, dt: float, body: str, option: str = "", integrator: str = "implicitfast", asset: str = "") -> Any:
        xml = f"""<mujoco><option timestep="{_r(dt)}" gravity="0 0 {_r(-G)}" integrator="{integrator}" cone="elliptic"
          solver="Newton" tolerance="1e-12" iterations="200" {option}/>
          <size memory="64M"/><default><geom solref="{_r(max(2.0 * dt, 1e-4))} 1" solimp="0.99 0.9999 1e-6"/></default>
          <asset>{asset}</asset><worldbody>{body}</worldbody></mujoco>"""
        return self.mj.MjModel.from_xml_string(xml)

    def timed(self, model: Any, data: Any, seconds: float) -> tuple[float, int]:
        n = round(seconds / model.opt.timestep)
        begin = time.perf_counter()
        self.mj.mj_step(model, data, n)
        return time.perf_counter() - begin, n

    def run(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
        name = row.split()[0].replace("four-bar", "fourbar")
        return getattr(self, name)(row, dt, option)

    def bounce(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
        e = float(row.split("=")[1])
        k = (0.2 / dt) ** 2
        ratio = 0.0 if e == 1.0 else -np.log(e) / np.sqrt(np.pi**2 + np.log(e) ** 2)
        b = 2 * ratio * np.sqrt(k)
        geom = f'solref="{_r(-k)} {_r(-b)}" solimp="0.9999 0.9999 1e-6"'
        m = self.model(
            dt,
            f"""<geom type="plane" size="4 4 1" {geom}/><body pos="0 0 {_r(BALL["drop"] + BALL["radius"])}"><freejoint/>
            <geom type="sphere" size="{BALL["radius"]}" mass="{BALL["mass"]}" {geom}/></body>""",
            integrator="RK4" if option == "RK4" else "implicitfast",
        )
        d = self.mj.MjData(m)
        end = apex_time(e, BALL["bounces"])
        seconds, n = self.timed(m, d, end)
        height = d.qpos[2] - BALL["radius"] + d.qvel[2] ** 2 / (2 * G)
        return seconds, n, abs(height - e ** (2 * BALL["bounces"]))

    def slope(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
        mu = SLOPE[row.split()[1]]
        a, s = SLOPE["tilt"], SLOPE["side"]
        m = self.model(
            dt,
            f"""<geom type="plane" size="20 20 1" friction="{mu} 0 0"/><body pos="0 0 {_r(s / 2)}"><freejoint/>
            <geom type="box" size="{s / 2} {s / 2} {s / 2}" mass="{SLOPE["mass"]}" friction="{mu} 0 0"/></body>""",
            option='noslip_iterations="20"' if option == "noslip" else "",
        )
        m.opt.gravity[:] = [G * np.sin(a), 0, -G * np.cos(a)]
        d = self.mj.MjData(m)
        seconds, n = self.timed(m, d, SLOPE["time"])
        want = max(0.0, 0.5 * G * (np.sin(a) - mu * np.cos(a))) if mu < np.tan(a) else 0.0
        return seconds, n, abs(d.qpos[0] - want)

    def spin(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
        i = SPIN["inertia"]
        m = self.model(
            dt,
            f"""<body><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="{i[0]} {i[1]} {i[2]}"/></body>""",
            integrator="RK4",
        )
        m.opt.gravity[:] = 0
        d = self.mj.MjData(m)
        d.qvel[3:6] = SPIN["omega"]
        e0 = 0.5 * np.array(SPIN["omega"]) ** 2 @ np.array(i)
        worst, seconds, n = 0.0, 0.0, 0
        for _ in range(100):
            s, k = self.timed(m, d, SPIN["time"] / 100)
            seconds, n = seconds + s, n + k
            worst = max(worst, abs(0.5 * (d.qvel[3:6] ** 2 @ np.array(i)) / e0 - 1))
        if row.endswith("energy"):
            return seconds, n, worst
        rotation = np.empty(9)
        self.mj.mju_quat2Mat(rotation, d.qpos[3:7])
        return seconds, n, angle_between(rotation.reshape(3, 3), np.array(self.truth["spin"]))

    def pendulum(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
        p = PENDULUM
        m = self.model(
            dt,
            f"""<body><joint type="hinge" axis="0 1 0"/><geom type="box" contype="0" conaffinity="0"
            density="{p["density"]}" pos="{p["length"] / 2} 0 0"
            size="{p["length"] / 2} {p["width"] / 2} {p["height"] / 2}"/></body>""",
            integrator="RK4",
        )
        d = self.mj.MjData(m)
        d.qpos[0] = p["angle"]
        seconds, n = self.timed(m, d, p["time"])
        return seconds, n, abs((np.pi / 2 - d.qpos[0]) - self.truth["pendulum"])

    def fourbar(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
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
        xml = f"""<mujoco><option timestep="{_r(dt)}" gravity="0 0 {_r(-G)}" integrator="RK4" tolerance="1e-14"
            iterations="200"/><worldbody>{body}</worldbody><equality><connect body1="2" body2="3" anchor="{l2} 0 0"
            solref="{_r(2 * dt)} 1" solimp="0.9999 0.9999 1e-6"/></equality></mujoco>"""
        m = self.mj.MjModel.from_xml_string(xml)
        d = self.mj.MjData(m)
        d.qpos[:] = [f["crank"], a2, a3]
        # the anchor on body 3 is where body 2's was at qpos0: place it by hand
        m.eq_data[0, :6] = [l2, 0, 0, l3, 0, 0]
        seconds, n = self.timed(m, d, f["time"])
        self.mj.mj_forward(m, d)
        return seconds, n, float(np.linalg.norm(d.site_xpos[0][[0, 2]] - np.array(self.truth["four-bar"])))

    def stack(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
        s = STACK["side"]
        geom = f'type="box" size="{s / 2} {s / 2} {s / 2}" mass="{STACK["mass"]}" friction="{STACK["friction"]} 0 0"'
        bodies = "".join(
            f'<body pos="0 0 {_r(s * (k + 0.5))}"><freejoint/><geom {geom}/></body>' for k in range(STACK["n"])
        )
        m = self.model(dt, f'<geom type="plane" size="4 4 1" friction="{STACK["friction"]} 0 0"/>{bodies}')
        d = self.mj.MjData(m)
        seconds, n = self.timed(m, d, STACK["time"])
        at = d.qpos.reshape(-1, 7)[:, :3]
        want = np.array([[0, 0, s * (k + 0.5)] for k in range(STACK["n"])])
        return seconds, n, float(np.abs(at - want).max())

    def roll(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
        r, a, mu = ROLL["radius"], ROLL["tilt"], ROLL["friction"]
        m = self.model(
            dt,
            f"""<geom type="plane" size="20 20 1" friction="{mu} 0 0"/><body pos="0 0 {_r(r)}"><freejoint/>
            <geom type="sphere" size="{r}" mass="{ROLL["mass"]}" friction="{mu} 0 0"/></body>""",
        )
        m.opt.gravity[:] = [G * np.sin(a), 0, -G * np.cos(a)]
        d = self.mj.MjData(m)
        seconds, n = self.timed(m, d, ROLL["time"])
        return seconds, n, abs(d.qpos[0] - 5 / 14 * G * np.sin(a) * ROLL["time"] ** 2)

    def coin(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
        rotation, center, omega = coin_start()
        mu = COIN["friction"]
        m = self.model(
            dt,
            f"""<geom type="plane" size="2 2 1" friction="{mu} 0 0"/>
            <body pos="0 0 {_r(center[2])}" quat="{_quaternion(rotation)}"><freejoint/><geom type="cylinder"
            size="{COIN["radius"]} {COIN["thickness"] / 2}" mass="{COIN["mass"]}" friction="{mu} 0 0"/></body>""",
        )
        d = self.mj.MjData(m)
        d.qvel[3:6] = rotation.T @ omega
        seconds, n = self.timed(m, d, COIN["time"])
        return seconds, n, float(np.linalg.norm(d.qpos[:3] - center))

    def balloon(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
        r = BALLOON["radius"]
        lift, k, _ = balloon_constants()
        m = self.model(
            dt,
            f"""<geom type="box" size="2 2 0.1" pos="0 0 {_r(BALLOON["ceiling"] + 0.1)}"/>
            <body pos="0 0 {BALLOON["start"]}"><freejoint/><geom type="sphere" size="{r}"
            mass="{BALLOON["mass"]}"/></body>""",
        )
        d = self.mj.MjData(m)
        end = BALLOON["time"] if row.endswith("rise") else BALLOON["rest"]
        n = round(end / dt)
        weight = BALLOON["mass"] * G
        begin = time.perf_counter()
        for _ in range(n):
            v = d.qvel[2]
            d.xfrc_applied[1, 2] = lift + weight - k * abs(v) * v
            self.mj.mj_step(m, d)
        seconds = time.perf_counter() - begin
        want = balloon_rise(end) if row.endswith("rise") else BALLOON["ceiling"] - r
        return seconds, n, abs(d.qpos[2] - want)

    def peg(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
        c = CLEARANCE[row]
        r, length, plate = PEG["radius"], PEG["length"], PEG["plate"]
        asset = ""
        if option == "hull":  # the plate's mesh: MuJoCo takes its convex hull, which has no hole
            points, faces = _plate(0.04, plate, r + c)
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
        m = self.model(dt, body, asset=asset)
        d = self.mj.MjData(m)
        seconds, n = self.timed(m, d, PEG["time"])
        return seconds, n, abs(d.qpos[2] - length / 2)


def _plate(size: float, thickness: float, radius: float, n: int = 64) -> tuple[np.ndarray, np.ndarray]:
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


class Drake:
    """Point contact: continuous with RK3 (bounce), or discrete SAP; only the cases that take no mesh or loop."""

    def __init__(self, truth: dict[str, Any]) -> None:
        import pydrake

        self.truth = truth
        self.version = getattr(pydrake, "__version__", "")

    def run(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
        return getattr(self, row.split()[0])(row, dt)

    def _plant(self, dt: float, gravity: list[float]) -> tuple[Any, Any]:
        from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, DiscreteContactApproximation
        from pydrake.systems.framework import DiagramBuilder

        builder = DiagramBuilder()
        plant, _ = AddMultibodyPlantSceneGraph(builder, dt)
        if dt > 0:
            plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
        plant.mutable_gravity_field().set_gravity_vector(gravity)
        return builder, plant

    def _simulate(self, builder: Any, plant: Any, start: Any, end: float, dt: float) -> tuple[float, int, Any]:
        from pydrake.systems.analysis import Simulator

        plant.Finalize()
        diagram = builder.Build()
        simulator = Simulator(diagram)
        context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        start(context)
        simulator.Initialize()
        begin = time.perf_counter()
        simulator.AdvanceTo(end)
        return time.perf_counter() - begin, round(end / dt), context

    def _box(self, plant: Any, name: str, side: float, mass: float, mu: float) -> Any:
        """A box that touches by small balls in its corners: a box alone has one contact point, and tips over it."""
        from pydrake.geometry import Sphere
        from pydrake.math import RigidTransform
        from pydrake.multibody.plant import CoulombFriction
        from pydrake.multibody.tree import SpatialInertia

        body = plant.AddRigidBody(name, SpatialInertia.SolidBoxWithMass(mass, side, side, side))
        radius = 0.01 * side
        for k in range(8):
            corner = (side / 2 - radius) * np.array([1 if k >> i & 1 else -1 for i in range(3)])
            plant.RegisterCollisionGeometry(
                body, RigidTransform(corner), Sphere(radius), f"{name}_{k}", CoulombFriction(mu, mu)
            )
        return body

    def _ground(self, plant: Any, mu: float) -> None:
        from pydrake.geometry import HalfSpace
        from pydrake.math import RigidTransform
        from pydrake.multibody.plant import CoulombFriction

        plant.RegisterCollisionGeometry(
            plant.world_body(), RigidTransform(), HalfSpace(), "ground", CoulombFriction(mu, mu)
        )

    def slope(self, row: str, dt: float) -> tuple[float, int, float]:
        from pydrake.math import RigidTransform

        mu, a, s = SLOPE[row.split()[1]], SLOPE["tilt"], SLOPE["side"]
        builder, plant = self._plant(dt, [G * np.sin(a), 0, -G * np.cos(a)])
        self._ground(plant, mu)
        body = self._box(plant, "box", s, SLOPE["mass"], mu)
        seconds, n, context = self._simulate(
            builder, plant, lambda c: plant.SetFreeBodyPose(c, body, RigidTransform([0, 0, s / 2])), SLOPE["time"], dt
        )
        want = 0.5 * G * (np.sin(a) - mu * np.cos(a)) if mu < np.tan(a) else 0.0
        return seconds, n, abs(plant.EvalBodyPoseInWorld(context, body).translation()[0] - want)

    def pendulum(self, row: str, dt: float) -> tuple[float, int, float]:
        from pydrake.math import RigidTransform
        from pydrake.multibody.tree import RevoluteJoint, SpatialInertia, UnitInertia
        from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator

        p = PENDULUM
        builder, plant = self._plant(0.0, [0, 0, -G])
        mass = p["density"] * p["length"] * p["width"] * p["height"]
        about = UnitInertia.SolidBox(p["length"], p["width"], p["height"]).ShiftFromCenterOfMass(
            [-p["length"] / 2, 0, 0]
        )
        body = plant.AddRigidBody("bar", SpatialInertia(mass, [p["length"] / 2, 0, 0], about))
        joint = plant.AddJoint(RevoluteJoint("hinge", plant.world_frame(), body.body_frame(), [0, 1, 0]))
        plant.Finalize()
        diagram = builder.Build()
        simulator = Simulator(diagram)
        ResetIntegratorFromFlags(simulator, "runge_kutta3", dt)
        simulator.get_mutable_integrator().set_fixed_step_mode(True)
        context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        joint.set_angle(context, p["angle"])
        del RigidTransform
        begin = time.perf_counter()
        simulator.AdvanceTo(p["time"])
        seconds = time.perf_counter() - begin
        return seconds, round(p["time"] / dt), abs(np.pi / 2 - joint.get_angle(context) - self.truth["pendulum"])


ENGINES = {"mujoco": MuJoCo, "drake": Drake}


def main(name: str) -> None:
    request = json.load(sys.stdin)
    try:
        engine: Any = ENGINES[name](request["truth"])
    except ImportError as error:
        json.dump({"missing": f"not installed: {error}"}, sys.stdout)
        return
    rows = []
    for row, dt, option in request["runs"]:
        try:
            seconds, steps, error = engine.run(row, dt, option)
        except Exception as failure:
            rows.append({"row": row, "method": option, "dt": dt, "failed": str(failure).splitlines()[0][:120]})
            continue
        error = float(error) if np.isfinite(error) else None
        rows.append({"row": row, "method": option, "dt": dt, "seconds": seconds, "steps": steps, "error": error})
    json.dump({"version": engine.version, "rows": rows}, sys.stdout)


if __name__ == "__main__":
    main(sys.argv[1])
