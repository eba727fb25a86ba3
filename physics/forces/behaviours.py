"""Behaviours: forces on one object, or its scripted motion, each a small class that a user can write in ten lines.

A behaviour has up to three methods, all optional: `wrench`, the wrench it exerts on its object; `reaction`, friction,
restitution and solidity of the object; and `pose`, the pose of an object that moves by script. It reads a `View`.

    class Lift(Behaviour):
        def wrench(self, view):
            return force([0.0, 0.0, 12.0])

Wrenches are (6,): force and torque about the centre of mass, world axes, N and N·m.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from constraints.errors import GeometryError
from constraints.kinds.base import Constraint
from constraints.kinds.elements import axis_of
from physics.errors import BehaviourError
from physics.model.body import Body
from physics.model.material import LAWS

Array = NDArray[np.float64]
STANDARD_GRAVITY = 9.80665
"""m/s² (3rd CGPM, 1901)"""


@dataclass(frozen=True, eq=False)
class Touch:
    """One loaded contact point of an object, in the last step."""

    other: int
    """the other object's id"""
    point: Array
    """(3,) world, m"""
    normal: Array
    """(3,) world, unit, towards the object"""
    impulse: Array
    """(3,) world, N·s on the object"""


@dataclass(frozen=True, eq=False)
class View:
    """The state of an object at one instant, by value."""

    object_id: int
    time: float
    """s since the world began"""
    body: Body
    pose: pin.SE3
    """of the mesh frame in the world"""
    center: Array
    """(3,) centre of mass, world, m"""
    velocity: Array
    """(3,) of the centre of mass, world, m/s"""
    angular_velocity: Array
    """(3,) world, rad/s"""
    touches: tuple[Touch, ...] = ()

    def velocity_at(self, point: ArrayLike) -> Array:
        """(3,) velocity of the material point at `point` (3,), world, m/s."""
        return self.velocity + np.cross(self.angular_velocity, np.asarray(point) - self.center)


@dataclass(frozen=True)
class Reaction:
    """How an object meets another. None: that of its `Material`, else the other object's value counts.

    Where both have a value, that of the pair of their materials counts (`pairs` of `World`, unless a behaviour states
    one), else the geometric mean of friction and the lesser restitution, the latter with its own law; where neither
    has one, friction is 0.5 and restitution 0. Of equal restitutions under two laws Poisson's counts.
    """

    friction: float | None = None
    """1: Coulomb's coefficient"""
    restitution: float | None = None
    """1: coefficient of restitution, 0 … 1"""
    solid: bool = True
    """False: it passes through everything"""
    law: str = "newton"
    """one of `LAWS`, by which `restitution` is meant"""


def force(value: ArrayLike, view: View | None = None, at: ArrayLike | None = None) -> Array:
    """Wrench (6,) of a force (3,) through the centre of mass, or through the point `at` (3,) seen from `view`."""
    w = np.zeros(6)
    w[:3] = value
    if at is not None and view is not None:
        w[3:] = np.cross(np.asarray(at) - view.center, w[:3])
    return w


class Behaviour:
    """Base of all behaviours: subclass it and override what is needed."""

    constant: bool = False
    """True promises that `wrench` never changes; it is then called once"""

    def wrench(self, view: View) -> ArrayLike | None:
        """Force and torque (6,) about the centre of mass in world axes, N and N·m; None for none."""
        return None

    def reaction(self, reaction: Reaction) -> Reaction:
        """Friction, restitution and solidity of the object, given those after the behaviours before this one."""
        return reaction

    def pose(self, time: float) -> pin.SE3 | None:
        """The pose the object must have at `time` (s); None: it is free."""
        return None


def _number(value: float, what: str, behaviour: Behaviour, low: float = 0.0, high: float = np.inf) -> float:
    try:
        x = float(value)
    except (TypeError, ValueError):
        x = np.nan
    if not (np.isfinite(x) and low <= x <= high):
        name = type(behaviour).__name__
        limit = f"{low:g} … {high:g}" if np.isfinite(high) else f"{low:g} or more"
        raise BehaviourError(f"{name}: {what} is {value!r}; give {limit}", behaviour=name)
    return x


def _vector(value: ArrayLike, what: str, behaviour: Behaviour) -> Array:
    try:
        v = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        v = np.zeros(0)
    if v.shape != (3,) or not np.isfinite(v).all():
        name = type(behaviour).__name__
        raise BehaviourError(f"{name}: {what} is {value!r}; give three finite numbers", behaviour=name)
    return v


class Gravity(Behaviour):
    """Weight in a uniform field (m/s²); takes the place of the world's gravity on its object. (0, 0, 0): none."""

    constant = True

    def __init__(self, acceleration: ArrayLike = (0.0, 0.0, -STANDARD_GRAVITY)) -> None:
        self.acceleration = _vector(acceleration, "acceleration", self)

    def wrench(self, view: View) -> Array:
        return force(view.body.mass * self.acceleration)


class Buoyancy(Behaviour):
    """Archimedes' force of a fluid of one density (kg/m³) that fills the room; acts against `gravity` (m/s²)."""

    constant = True

    def __init__(self, density: float = 1.204, gravity: ArrayLike = (0.0, 0.0, -STANDARD_GRAVITY)) -> None:
        self.density = _number(density, "density", self)
        self.gravity = _vector(gravity, "gravity", self)

    def wrench(self, view: View) -> Array:
        return force(-self.density * view.body.volume * self.gravity)


class Drag(Behaviour):
    """Resistance of a fluid: ½ ρ c A |v| v against the motion, and a viscous part b v, c_r ω.

    `area` is the frontal area (m²), `density` the fluid's (kg/m³), `linear` in N·s/m, `angular` in N·m·s,
    `wind` the fluid's own velocity (3,) in m/s.
    """

    def __init__(
        self,
        area: float = 0.0,
        coefficient: float = 0.47,
        density: float = 1.204,
        linear: float = 0.0,
        angular: float = 0.0,
        wind: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        self.quadratic = (
            0.5
            * _number(density, "density", self)
            * _number(coefficient, "coefficient", self)
            * _number(area, "area", self)
        )
        self.linear = _number(linear, "linear", self)
        self.angular = _number(angular, "angular", self)
        self.wind = _vector(wind, "wind", self)

    def wrench(self, view: View) -> Array:
        v = view.velocity - self.wind
        speed = float(np.sqrt(v @ v))
        w = np.empty(6)
        w[:3] = -(self.quadratic * speed + self.linear) * v
        w[3:] = -self.angular * view.angular_velocity
        return w


class Wind(Drag):
    """Drag in moving air: `velocity` (3,) m/s on the frontal `area` (m²)."""

    def __init__(self, velocity: ArrayLike, area: float, coefficient: float = 1.0, density: float = 1.204) -> None:
        super().__init__(area=area, coefficient=coefficient, density=density, wind=velocity)


class Spring(Behaviour):
    """Spring and damper between a point of the object (mesh frame) and a point of the world, m, N/m, N·s/m."""

    def __init__(
        self,
        anchor: ArrayLike,
        stiffness: float,
        damping: float = 0.0,
        length: float = 0.0,
        point: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        self.anchor = _vector(anchor, "anchor", self)
        self.point = _vector(point, "point", self)
        self.stiffness = _number(stiffness, "stiffness", self)
        self.damping = _number(damping, "damping", self)
        self.length = _number(length, "length", self)

    def wrench(self, view: View) -> Array:
        at = view.pose.act(self.point)
        span = at - self.anchor
        distance = float(np.sqrt(span @ span))
        pull = -self.damping * view.velocity_at(at)
        if distance > 0.0:
            pull = pull - self.stiffness * (distance - self.length) / distance * span
        return force(pull, view, at)


class Magnet(Behaviour):
    """Snap: within `reach` (m) of `target` (3,) a damped pull that grows to `strength` (N) as the point nears it.

    The pull is strength · (1 - d/reach) towards the target beyond `core` (m), linear within it, so that it ends at
    rest on the target instead of jittering about it.
    """

    def __init__(
        self,
        target: ArrayLike,
        strength: float,
        reach: float,
        point: ArrayLike = (0.0, 0.0, 0.0),
        damping: float = 0.0,
        core: float | None = None,
    ) -> None:
        self.target = _vector(target, "target", self)
        self.point = _vector(point, "point", self)
        self.strength = _number(strength, "strength", self)
        self.reach = _number(reach, "reach", self)
        self.damping = _number(damping, "damping", self)
        self.core = _number(0.1 * reach if core is None else core, "core", self)

    def wrench(self, view: View) -> Array | None:
        at = view.pose.act(self.point)
        span = self.target - at
        distance = float(np.sqrt(span @ span))
        if distance >= self.reach:
            return None
        pull = self.strength * (1.0 - distance / self.reach) / max(distance, self.core) * span
        return force(pull - self.damping * view.velocity_at(at), view, at)


class Motor(Behaviour):
    """A torque about (or, `linear`, a force along) an axis of the object, on a speed governor.

    `axis` (3,) and `point` (3,) lie in the mesh frame; `Motor.on` takes them from a joint. The effort is
    gain · (speed - actual), limited to `limit` (N·m or N); the other side of the joint is at rest, or has a motor of
    its own for the reaction.
    """

    @classmethod
    def on(
        cls, joint: Constraint, object_id: int, speed: float, limit: float, gain: float, linear: bool = False
    ) -> Motor:
        """The motor that drives object `object_id` about (or along) the axis of a recognised joint, whose axis it is on
        that object. Raises BehaviourError if the joint does not hold the object, or has no axis.
        """
        if object_id not in joint.bodies:
            text = f"Motor: object {object_id} is not on {joint!r}; it joins {joint.bodies[0]} and {joint.bodies[1]}"
            raise BehaviourError(text, object_id, "Motor")
        try:
            axis = axis_of(joint, joint.bodies.index(object_id))
        except GeometryError as error:
            raise BehaviourError(f"Motor: {joint!r} has no axis to drive: {error}", object_id, "Motor") from None
        return cls(axis[9:], speed, limit, gain, axis[:3], linear)

    def __init__(
        self,
        axis: ArrayLike,
        speed: float,
        limit: float,
        gain: float,
        point: ArrayLike = (0.0, 0.0, 0.0),
        linear: bool = False,
    ) -> None:
        axis = _vector(axis, "axis", self)
        length = float(np.linalg.norm(axis))
        if length == 0.0:
            raise BehaviourError("Motor: axis is the zero vector; give a direction", behaviour="Motor")
        self.axis = axis / length
        self.point = _vector(point, "point", self)
        self.speed = _number(speed, "speed", self, -np.inf)
        self.limit = _number(limit, "limit", self)
        self.gain = _number(gain, "gain", self)
        self.linear = linear

    def wrench(self, view: View) -> Array:
        axis = view.pose.rotation @ self.axis
        if self.linear:
            at = view.pose.act(self.point)
            actual = float(axis @ view.velocity_at(at))
        else:
            actual = float(axis @ view.angular_velocity)
        effort = float(np.clip(self.gain * (self.speed - actual), -self.limit, self.limit))
        if self.linear:
            return force(effort * axis, view, at)
        return np.concatenate([np.zeros(3), effort * axis])


class ScriptedPath(Behaviour):
    """The object follows a path: a function of time, or poses at given times joined by screw motions."""

    def __init__(self, path: Callable[[float], pin.SE3] | Sequence[tuple[float, pin.SE3]]) -> None:
        if callable(path):
            self.path = path
            return
        times = [_number(t, "a time", self, -np.inf) for t, _ in path]
        if not times or any(b <= a for a, b in pairwise(times)):
            raise BehaviourError(f"ScriptedPath: times are {times}; give them rising", behaviour="ScriptedPath")
        poses = [p for _, p in path]
        if not all(isinstance(p, pin.SE3) for p in poses):
            raise BehaviourError("ScriptedPath: give each time with a pinocchio.SE3", behaviour="ScriptedPath")

        def between(time: float) -> pin.SE3:
            if time <= times[0]:
                return poses[0]
            if time >= times[-1]:
                return poses[-1]
            k = int(np.searchsorted(times, time, side="right")) - 1
            part = (time - times[k]) / (times[k + 1] - times[k])
            return pin.SE3.Interpolate(poses[k], poses[k + 1], part)

        self.path = between

    def pose(self, time: float) -> pin.SE3:
        return self.path(time)


class Friction(Behaviour):
    """Coulomb friction with coefficient μ."""

    def __init__(self, coefficient: float) -> None:
        self.coefficient = _number(coefficient, "coefficient", self)

    def reaction(self, reaction: Reaction) -> Reaction:
        return replace(reaction, friction=self.coefficient)


class Elastic(Behaviour):
    """Rebound with a coefficient of restitution, 0 (clay) … 1 (ideal).

    law: "newton", the ratio of the speeds at which contacts part and close; "poisson", the ratio of the impulses while
    they part and while they are pressed together. Without friction a single contact does the same under both; where
    friction stops or turns its sliding Poisson's parts more slowly.
    """

    def __init__(self, restitution: float, law: str = "newton") -> None:
        self.restitution = _number(restitution, "restitution", self, 0.0, 1.0)
        if law not in LAWS:
            raise BehaviourError(f"Elastic: law is {law!r}; give one of {', '.join(LAWS)}", behaviour="Elastic")
        self.law = law

    def reaction(self, reaction: Reaction) -> Reaction:
        return replace(reaction, restitution=self.restitution, law=self.law)


class Solidity(Behaviour):
    """Whether the object is solid; switched off, it passes through everything."""

    def __init__(self, on: bool) -> None:
        self.on = bool(on)

    def reaction(self, reaction: Reaction) -> Reaction:
        return replace(reaction, solid=self.on)


class Sleeping(Behaviour):
    """Whether the object may fall asleep at rest; without this behaviour it may."""

    def __init__(self, allowed: bool) -> None:
        self.allowed = bool(allowed)
