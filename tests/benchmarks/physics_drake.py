"""The physics cases in Drake, each with the settings that served it best of those tried.

Discrete plants use SAP, with contacts so stiff that its near-rigid regularisation decides; smooth cases, and the ball
that keeps its energy, a continuous plant with explicit Runge-Kutta of fixed step. What Drake does not state is said
where it is stood in for: restitution (a spring and a damper), a closed loop (a ball constraint, or a stiff bushing).
"""

from __future__ import annotations

import importlib.metadata
import time
from collections.abc import Callable
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

RIGID = 1e12
"""N/m, point stiffness at which SAP takes contacts as near rigid"""

OPTIONS: dict[str, tuple[str, ...]] = {
    "bounce e=1": ("RK3", "SAP"),
    "bounce e=0.8": ("SAP",),
    "slope": ("SAP", "SAP damped", "RK3"),
    "spin": ("RK3", "RK5"),
    "pendulum": ("RK3", "RK5"),
    "four-bar": ("SAP ball", "RK3 bushing"),
    "stack": ("SAP",),
    "roll": ("SAP", "RK3"),
    "coin": ("SAP", "RK3"),
    "balloon rise": ("RK3", "RK5"),
    "balloon rest": ("SAP",),
    "peg": ("hull", "hydro"),
}
SCHEMES = {"RK3": "runge_kutta3", "RK5": "runge_kutta5"}


def options(row: str) -> tuple[str, ...]:
    """The names of the ways in which a row is run."""
    return OPTIONS.get(row) or OPTIONS[row.split()[0]]


class Engine:
    """Cases as a `MultibodyPlant` each."""

    def __init__(self, truth: dict[str, Any]) -> None:
        import pydrake.all

        self.d = pydrake.all
        self.truth = truth
        self.version = importlib.metadata.version("drake")

    def run(self, row: str, dt: float, option: str) -> tuple[float, int, Any]:
        """Seconds of stepping, steps, error."""
        return getattr(self, row.split()[0].replace("four-bar", "fourbar"))(row, dt, option)

    # --- plants ---------------------------------------------------------------------------------------------------

    def _plant(self, dt: float, option: str, gravity: list[float], hydroelastic: bool = False) -> tuple[Any, Any, Any]:
        d = self.d
        builder = d.DiagramBuilder()
        discrete = option.split()[0] not in SCHEMES
        plant, scene = d.AddMultibodyPlantSceneGraph(builder, dt if discrete else 0.0)
        if discrete:
            plant.set_discrete_contact_approximation(d.DiscreteContactApproximation.kSap)
        plant.set_contact_model(d.ContactModel.kHydroelasticWithFallback if hydroelastic else d.ContactModel.kPoint)
        plant.mutable_gravity_field().set_gravity_vector(gravity)
        return builder, plant, scene

    def _start(self, builder: Any, plant: Any, dt: float, option: str, begin: Callable[[Any], Any]) -> tuple[Any, Any]:
        if not plant.is_finalized():
            plant.Finalize()
        simulator = self.d.Simulator(builder.Build())
        scheme = SCHEMES.get(option.split()[0])
        if scheme:
            self.d.ResetIntegratorFromFlags(simulator, scheme, dt)
            simulator.get_mutable_integrator().set_fixed_step_mode(True)
        context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        begin(context)
        simulator.Initialize()
        return simulator, context

    def _timed(self, simulator: Any, end: float) -> float:
        begin = time.process_time()
        simulator.AdvanceTo(end)
        return time.process_time() - begin

    def _touch(
        self, friction: float, stiffness: float = RIGID, relaxation: float = 0.0, dissipation: float = 0.0
    ) -> Any:
        """How a contact of two alike is to be: halves of the compliance and of the relaxation time on each side."""
        properties = self.d.ProximityProperties()
        coulomb = self.d.CoulombFriction(friction, friction)
        self.d.AddContactMaterial(dissipation, 2.0 * stiffness, coulomb, properties)
        properties.AddProperty("material", "relaxation_time", relaxation / 2.0)
        return properties

    def _ground(self, plant: Any, properties: Any, pose: Any = None) -> None:
        where = self.d.RigidTransform() if pose is None else pose
        plant.RegisterCollisionGeometry(plant.world_body(), where, self.d.HalfSpace(), "ground", properties)

    def _inertia(self, mass: float, moments: Any) -> Any:
        return self.d.SpatialInertia(mass, np.zeros(3), self.d.UnitInertia(*(np.asarray(moments, float) / mass)))

    def _smooth(self, option: str, mass: float, dt: float, friction: float) -> Any:
        """A contact for a case that stays in touch; in RK3 as stiff and as damped as the step allows."""
        if option == "SAP damped":
            return self._touch(friction, RIGID, 10.0 * dt)
        if option.startswith("SAP"):
            return self._touch(friction, mass * 1e5, dt)
        return self._touch(friction, stiffness=mass * (0.3 / dt) ** 2, dissipation=20.0)

    # --- cases ----------------------------------------------------------------------------------------------------

    def bounce(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
        """A spring of ωdt = 0.05, damped linearly in SAP so that e is the same at all speeds; apex told by counting."""
        d, e = self.d, float(row.split("=")[1])
        ratio = 0.0 if e == 1.0 else -np.log(e) / np.sqrt(np.pi**2 + np.log(e) ** 2)
        omega = 0.05 / dt
        end = apex_time(e, BALL["bounces"])

        def start() -> tuple[Any, Any]:
            builder, plant, _ = self._plant(dt, option, [0, 0, -G])
            touch = self._touch(0.0, BALL["mass"] * omega**2, 2.0 * ratio / omega)
            if option == "SAP":
                plant.set_sap_near_rigid_threshold(0.0)
            self._ground(plant, touch)
            body = plant.AddRigidBody("ball", d.SpatialInertia.SolidSphereWithMass(BALL["mass"], BALL["radius"]))
            plant.RegisterCollisionGeometry(body, d.RigidTransform(), d.Sphere(BALL["radius"]), "ball", touch)
            at = d.RigidTransform([0, 0, BALL["drop"] + BALL["radius"]])
            simulator, _ = self._start(builder, plant, dt, option, lambda c: plant.SetFreeBodyPose(c, body, at))
            return simulator, plant

        seconds = self._timed(start()[0], end)
        simulator, plant = start()
        tops: list[float] = []
        last = [0.0]

        def watch(root: Any) -> Any:
            z, v = plant.GetPositionsAndVelocities(plant.GetMyContextFromRoot(root))[[6, 12]]
            if last[0] > 0.0 >= v:
                tops.append(z - BALL["radius"] + v * v / (2 * G))
            last[0] = v
            return d.EventStatus.Succeeded()

        simulator.set_monitor(watch)
        for _ in range(8):
            if len(tops) < BALL["bounces"]:
                simulator.AdvanceTo(simulator.get_context().get_time() + end / 4)
        wrong = abs(tops[BALL["bounces"] - 1] - e ** (2 * BALL["bounces"])) if len(tops) >= BALL["bounces"] else np.inf
        return seconds, round(end / dt), wrong

    def _cornered(self, plant: Any, name: str, side: float, mass: float, touch: Any) -> Any:
        """A box with small balls in its lower corners to stand on: alone it has one contact point, and tips over it."""
        d = self.d
        body = plant.AddRigidBody(name, d.SpatialInertia.SolidBoxWithMass(mass, side, side, side))
        radius = 0.01 * side
        for k, corner in enumerate((x, y, -1.0) for x in (-1.0, 1.0) for y in (-1.0, 1.0)):
            at = d.RigidTransform((side / 2 - radius) * np.array(corner))
            plant.RegisterCollisionGeometry(body, at, d.Sphere(radius), f"{name}_{k}", touch)
        return body

    def slope(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
        mu, a, s = SLOPE[row.split()[1]], SLOPE["tilt"], SLOPE["side"]
        builder, plant, _ = self._plant(dt, option, [G * np.sin(a), 0, -G * np.cos(a)])
        touch = self._smooth(option, SLOPE["mass"] / 4, dt, mu)
        self._ground(plant, touch)
        body = self._cornered(plant, "box", s, SLOPE["mass"], touch)
        at = self.d.RigidTransform([0, 0, s / 2])
        simulator, context = self._start(builder, plant, dt, option, lambda c: plant.SetFreeBodyPose(c, body, at))
        seconds = self._timed(simulator, SLOPE["time"])
        want = 0.5 * G * (np.sin(a) - mu * np.cos(a)) if mu < np.tan(a) else 0.0
        x = plant.EvalBodyPoseInWorld(context, body).translation()[0]
        return seconds, round(SLOPE["time"] / dt), abs(x - want)

    def spin(self, row: str, dt: float, option: str) -> tuple[float, int, dict[str, float]]:
        d = self.d
        builder, plant, _ = self._plant(dt, option, [0, 0, 0])
        body = plant.AddRigidBody("body", self._inertia(1.0, SPIN["inertia"]))
        spin = d.SpatialVelocity(SPIN["omega"], np.zeros(3))
        simulator, context = self._start(
            builder, plant, dt, option, lambda c: plant.SetFreeBodySpatialVelocity(c, body, spin)
        )
        errors, seconds = SpinErrors(self.truth), 0.0
        for k in range(errors.LOOKS):
            seconds += self._timed(simulator, (k + 1) * SPIN["time"] / errors.LOOKS)
            rotation = plant.EvalBodyPoseInWorld(context, body).rotation().matrix()
            errors.look(rotation, rotation.T @ plant.EvalBodySpatialVelocityInWorld(context, body).rotational())
        return seconds, round(SPIN["time"] / dt), errors.rows()

    def _bar(self, plant: Any, name: str, length: float, width: float, height: float, density: float) -> Any:
        """A uniform bar along x from its frame's origin."""
        d = self.d
        mass, about = density * length * width * height, d.UnitInertia.SolidBox(length, width, height)
        middle = [length / 2, 0, 0]
        inertia = d.SpatialInertia(mass, middle, about.ShiftFromCenterOfMass([-length / 2, 0, 0]))
        return plant.AddRigidBody(name, inertia)

    def _hinge(self, plant: Any, name: str, a: Any, at: Any, b: Any, axis: Any) -> Any:
        d = self.d
        return plant.AddJoint(d.RevoluteJoint(name, self._frame(plant, name, a, at), b.body_frame(), axis))

    def _frame(self, plant: Any, name: str, body: Any, at: Any, turn: Any = None) -> Any:
        pose = self.d.RigidTransform(turn or self.d.RotationMatrix(), at)
        return plant.AddFrame(self.d.FixedOffsetFrame(f"{name}_at", body.body_frame(), pose))

    def pendulum(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
        p = PENDULUM
        builder, plant, _ = self._plant(dt, option, [0, 0, -G])
        body = self._bar(plant, "bar", p["length"], p["width"], p["height"], p["density"])
        joint = self._hinge(plant, "hinge", plant.world_body(), [0, 0, 0], body, [0, 1, 0])
        simulator, context = self._start(builder, plant, dt, option, lambda c: joint.set_angle(c, p["angle"]))
        seconds = self._timed(simulator, p["time"])
        return seconds, round(p["time"] / dt), abs(np.pi / 2 - joint.get_angle(context) - self.truth["pendulum"])

    def fourbar(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
        """Three hinges as coordinates; the fourth a ball constraint of SAP, or a bushing as stiff as RK3 bears."""
        d, f = self.d, FOURBAR
        builder, plant, _ = self._plant(dt, option, [0, 0, -G])
        links = [self._bar(plant, f"bar{k}", x, f["width"], f["width"], f["density"]) for k, x in enumerate(f["bars"])]
        ends = [[x, 0, 0] for x in f["bars"]]
        down = [0, -1, 0]  # hinges about -y so that angles count from x to z
        crank = self._hinge(plant, "crank", plant.world_body(), [0, 0, 0], links[0], down)
        coupler = self._hinge(plant, "coupler", links[0], ends[0], links[1], down)
        rocker = self._hinge(plant, "rocker", plant.world_body(), [f["ground"], 0, 0], links[2], down)
        if option == "SAP ball":
            plant.AddBallConstraint(links[1], ends[1], links[2], ends[2])
        else:
            omega = 0.5 / dt
            weight = 0.05  # kg, about what the loop's ends weigh to each other
            flat = np.array([1.0, 1.0, 0.0])
            k, c = weight * omega**2 * flat, weight * omega * flat
            yaw = d.RotationMatrix.MakeXRotation(-np.pi / 2)  # its angles are singular where it turns about y
            at = [self._frame(plant, f"end{i}", links[i], ends[i], yaw) for i in (1, 2)]
            plant.AddForceElement(d.LinearBushingRollPitchYaw(*at, np.zeros(3), np.zeros(3), k, c))
        b, c = fourbar_points(f["crank"])
        angles = [f["crank"], np.arctan2(*(c - b)[::-1]) - f["crank"], np.arctan2(*(c - [f["ground"], 0.0])[::-1])]

        def begin(context: Any) -> None:
            for joint, angle in zip((crank, coupler, rocker), angles, strict=True):
                joint.set_angle(context, angle)

        simulator, context = self._start(builder, plant, dt, option, begin)
        seconds = self._timed(simulator, f["time"])
        middle = plant.EvalBodyPoseInWorld(context, links[1]).multiply(np.array([f["bars"][1] / 2, 0.0, 0.0]))
        error = np.linalg.norm(middle[[0, 2]] - np.array(self.truth["four-bar"]))
        return seconds, round(f["time"] / dt), float(error)

    def stack(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
        """Boxes that stand on balls in their corners; hydroelastic ones fell over or sank in more."""
        d, s = self.d, STACK["side"]
        builder, plant, scene = self._plant(dt, option, [0, 0, -G])
        touch = self._touch(STACK["friction"])
        box = d.Box(s, s, s)
        filters, bodies = scene.collision_filter_manager(), []
        inspect = scene.model_inspector()
        self._ground(plant, touch)
        for k in range(STACK["n"]):
            bodies.append(self._cornered(plant, f"box{k}", s, STACK["mass"], touch))
            plant.RegisterCollisionGeometry(bodies[-1], d.RigidTransform(), box, f"box{k}", touch)
        plant.Finalize()
        # balls meet tops of boxes and the ground; boxes meet balls only
        shapes = [i for b in bodies for i in plant.GetCollisionGeometriesForBody(b)]
        solid = d.GeometrySet([i for i in shapes if isinstance(inspect.GetShape(i), d.Box)])
        balls = d.GeometrySet([i for i in shapes if isinstance(inspect.GetShape(i), d.Sphere)])
        ground = d.GeometrySet(plant.GetCollisionGeometriesForBody(plant.world_body()))
        apart = d.CollisionFilterDeclaration().ExcludeWithin(solid).ExcludeWithin(balls)
        filters.Apply(apart.ExcludeBetween(solid, ground))

        def begin(context: Any) -> None:
            for k, body in enumerate(bodies):
                plant.SetFreeBodyPose(context, body, d.RigidTransform([0, 0, s * (k + 0.5)]))

        simulator, context = self._start(builder, plant, dt, option, begin)
        seconds = self._timed(simulator, STACK["time"])
        here = np.array([plant.EvalBodyPoseInWorld(context, body).translation() for body in bodies])
        error = np.abs(here - [[0, 0, s * (k + 0.5)] for k in range(STACK["n"])]).max()
        return seconds, round(STACK["time"] / dt), float(error)

    def roll(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
        d, r, a = self.d, ROLL["radius"], ROLL["tilt"]
        builder, plant, _ = self._plant(dt, option, [G * np.sin(a), 0, -G * np.cos(a)])
        touch = self._smooth(option, ROLL["mass"], dt, ROLL["friction"])
        self._ground(plant, touch)
        body = plant.AddRigidBody("ball", d.SpatialInertia.SolidSphereWithMass(ROLL["mass"], r))
        plant.RegisterCollisionGeometry(body, d.RigidTransform(), d.Sphere(r), "ball", touch)
        at = d.RigidTransform([0, 0, r])
        simulator, context = self._start(builder, plant, dt, option, lambda c: plant.SetFreeBodyPose(c, body, at))
        seconds = self._timed(simulator, ROLL["time"])
        x = plant.EvalBodyPoseInWorld(context, body).translation()[0]
        return seconds, round(ROLL["time"] / dt), abs(x - 5 / 14 * G * np.sin(a) * ROLL["time"] ** 2)

    def coin(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
        d, c = self.d, COINS[row]
        rotation, center, omega = coin_start(c)
        builder, plant, _ = self._plant(dt, option, [0, 0, -G])
        touch = self._smooth(option, c["mass"], dt, c["friction"])
        self._ground(plant, touch)
        r, t, m = c["radius"], c["thickness"], c["mass"]
        across = m * (r * r / 4 + t * t / 12)
        body = plant.AddRigidBody("coin", self._inertia(m, [across, across, m * r * r / 2]))
        plant.RegisterCollisionGeometry(body, d.RigidTransform(), d.Cylinder(r, t), "coin", touch)

        def begin(context: Any) -> None:
            plant.SetFreeBodyPose(context, body, d.RigidTransform(d.RotationMatrix(rotation), center))
            plant.SetFreeBodySpatialVelocity(context, body, d.SpatialVelocity(omega, np.zeros(3)))

        simulator, context = self._start(builder, plant, dt, option, begin)
        seconds = self._timed(simulator, c["time"])
        away = plant.EvalBodyPoseInWorld(context, body).translation() - center
        return seconds, round(c["time"] / dt), float(np.linalg.norm(away))

    def balloon(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
        """Lift and drag as a force applied by a system that sees the velocity."""
        d, r = self.d, BALLOON["radius"]
        lift, k, _ = balloon_constants()
        weight = BALLOON["mass"] * G
        builder, plant, _ = self._plant(dt, option, [0, 0, -G])
        touch = self._touch(0.0)
        ceiling = d.RigidTransform(d.RotationMatrix.MakeXRotation(np.pi), [0, 0, BALLOON["ceiling"]])
        self._ground(plant, touch, ceiling)
        body = plant.AddRigidBody("balloon", d.SpatialInertia.SolidSphereWithMass(BALLOON["mass"], r))
        plant.RegisterCollisionGeometry(body, d.RigidTransform(), d.Sphere(r), "balloon", touch)
        plant.Finalize()

        class Air(d.LeafSystem):
            def __init__(self) -> None:
                super().__init__()
                self.seen = self.DeclareVectorInputPort("state", plant.num_multibody_states())
                kind = d.Value[list[d.ExternallyAppliedSpatialForce]]
                self.DeclareAbstractOutputPort("force", kind, self.push)

            def push(self, context: Any, output: Any) -> None:
                v = self.seen.Eval(context)[12]
                force = d.ExternallyAppliedSpatialForce()
                force.body_index, force.p_BoBq_B = body.index(), np.zeros(3)
                up = np.array([0.0, 0.0, lift + weight - k * abs(v) * v])
                force.F_Bq_W = d.SpatialForce(np.zeros(3), up)
                output.set_value([force])

        air = builder.AddSystem(Air())
        builder.Connect(plant.get_state_output_port(), air.get_input_port())
        builder.Connect(air.get_output_port(), plant.get_applied_spatial_force_input_port())
        at = d.RigidTransform([0, 0, BALLOON["start"]])
        simulator, context = self._start(builder, plant, dt, option, lambda c: plant.SetFreeBodyPose(c, body, at))
        end = BALLOON["time"] if row.endswith("rise") else BALLOON["rest"]
        seconds = self._timed(simulator, end)
        want = balloon_rise(end) if row.endswith("rise") else BALLOON["ceiling"] - r
        z = plant.EvalBodyPoseInWorld(context, body).translation()[2]
        return seconds, round(end / dt), abs(z - want)

    def peg(self, row: str, dt: float, option: str) -> tuple[float, int, float]:
        """The plate's mesh: its convex hull in point contact; itself, rigid, with a hydroelastic peg of 100 MPa."""
        d, c = self.d, CLEARANCE[row]
        r, length, plate = PEG["radius"], PEG["length"], PEG["plate"]
        hydro = option == "hydro"
        builder, plant, _ = self._plant(dt, option, [0, 0, -G], hydroelastic=hydro)
        fixed, moving = self._touch(0.1, RIGID, dt), self._touch(0.1, RIGID, dt)
        if hydro:
            d.AddRigidHydroelasticProperties(fixed)
            d.AddCompliantHydroelasticProperties(r, 1e8, moving)
        self._ground(plant, fixed)
        points, faces = plate_ring(0.04, plate, r + c)
        text = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in points.tolist())
        text += "".join(f"f {a + 1} {b + 1} {e + 1}\n" for a, b, e in faces.tolist())
        mesh = d.Mesh(d.InMemoryMesh(mesh_file=d.MemoryFile(text, ".obj", "plate.obj")))
        at = d.RigidTransform([0, 0, plate / 2])
        plant.RegisterCollisionGeometry(plant.world_body(), at, mesh, "plate", fixed)
        mass = 7850 * np.pi * r * r * length
        inertia = d.SpatialInertia.SolidCylinderWithMass(mass, r, length, [0, 0, 1])
        body = plant.AddRigidBody("peg", inertia)
        plant.RegisterCollisionGeometry(body, d.RigidTransform(), d.Cylinder(r, length), "peg", moving)
        start = d.RigidTransform([PEG["offset"] * c, 0, plate + PEG["gap"] + length / 2])
        simulator, context = self._start(builder, plant, dt, option, lambda c: plant.SetFreeBodyPose(c, body, start))
        seconds = self._timed(simulator, PEG["time"])
        z = plant.EvalBodyPoseInWorld(context, body).translation()[2]
        return seconds, round(PEG["time"] / dt), abs(z - length / 2)
