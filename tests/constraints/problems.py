"""Assemblies and linkages whose answer is known, at their solved pose and shaken off it: for tests and benchmarks."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from math import atan, pi, sin, tan

import numpy as np
import pinocchio as pin

from constraints.geometry.surfaces import Cone, Cylinder, Plane, Sphere
from constraints.kinds import (
    Against,
    Angle,
    Concentric,
    Conical,
    Constraint,
    Contact,
    Coplanar,
    Distance,
    Line,
    Parallel,
    Point,
    Spherical,
    Tangent,
)

Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Problem:
    """Constraints with poses that satisfy them; body 0 is fixed."""

    constraints: tuple[Constraint, ...]
    poses: tuple[pin.SE3, ...]
    size: float
    """m, of a part"""

    @property
    def movable(self) -> range:
        """All bodies but the first."""
        return range(1, len(self.poses))

    def shaken(self, linear: float, angular: float, seed: int = 0) -> list[pin.SE3]:
        """The poses with each movable body pushed by `linear` (m) and turned by `angular` (rad) some way."""
        rng = np.random.default_rng(seed)
        out = [self.poses[0]]
        for pose in self.poses[1:]:
            push, turn = rng.normal(size=3), rng.normal(size=3)
            push, turn = linear * push / np.linalg.norm(push), angular * turn / np.linalg.norm(turn)
            out.append(pin.SE3(pose.rotation @ pin.exp3(turn), pose.translation + push))
        return out

    def residual(self, poses: Sequence[pin.SE3] | dict[int, pin.SE3]) -> float:
        """Greatest row over all constraints, by their own formulas."""
        return max(float(np.abs(c.residual(poses[c.bodies[0]], poses[c.bodies[1]])).max()) for c in self.constraints)


def hinge(a: int, b: int, pose_a: pin.SE3, pose_b: pin.SE3, point: np.ndarray, axis: np.ndarray, size: float) -> list:
    """A pin through both bodies about `axis` through `point` (world): concentric and flush."""
    places = [(pose.actInv(np.asarray(point, float)), pose.rotation.T @ axis) for pose in (pose_a, pose_b)]
    return [
        Concentric((a, b), tuple(Line(p, d) for p, d in places), sense=1, size=size / 10),
        Coplanar((a, b), tuple(Plane(p, d) for p, d in places), size=size / 10),
    ]


def bolted_plate(n: int) -> Problem:
    """n bolts in the holes of a plate, each concentric and against: 3n equations less than 7n rows."""
    constraints: list[Constraint] = []
    poses = [pin.SE3.Identity()]
    for i in range(n):
        hole = np.array([0.02 * (i % 10), 0.02 * (i // 10), 0.0])
        bore, shank = Cylinder(hole, Z, 0.004), Cylinder([0, 0, -0.01], Z, 0.004)
        constraints.append(Concentric((0, i + 1), (bore, shank), size=0.004))
        constraints.append(Against((0, i + 1), (Plane(hole, Z), Plane([0, 0, 0], -Z)), size=0.006))
        poses.append(pin.SE3(pin.exp3(0.1 * i * Z), hole))
    return Problem(tuple(constraints), tuple(poses), 0.02)


def chain(n: int) -> Problem:
    """n links of 50 mm on hinges that turn by a right angle from one to the next, the first on the ground."""
    constraints: list[Constraint] = []
    poses = [pin.SE3.Identity()]
    for i in range(1, n + 1):
        joint = np.array([0.05 * i, 0.0, 0.0])
        poses.append(pin.SE3(np.eye(3), joint))
        axis = np.array([0.0, 0.0, 1.0]) if i % 2 else np.array([0.0, 1.0, 0.0])
        constraints += hinge(i - 1, i, poses[i - 1], poses[i], joint, axis, 0.05)
    return Problem(tuple(constraints), tuple(poses), 0.05)


def linkage(joints: Sequence[tuple[np.ndarray, np.ndarray]], size: float) -> Problem:
    """A single closed loop: link i carries joints i and i+1 (world point, axis), the ground the last and the first."""
    n = len(joints)
    poses = [pin.SE3(np.eye(3), np.zeros(3))]
    for i in range(1, n):
        middle = (np.asarray(joints[i - 1][0]) + np.asarray(joints[i][0])) / 2
        poses.append(pin.SE3(np.eye(3), middle))
    constraints: list[Constraint] = []
    for i, (point, axis) in enumerate(joints):
        a, b = i, (i + 1) % n
        constraints += hinge(a, b, poses[a], poses[b], point, axis, size)
    return Problem(tuple(constraints), tuple(poses), size)


def planar_loop(points: Sequence[tuple[float, float]], size: float = 0.1) -> Problem:
    """A four-bar or its like: hinges about z at these points."""
    return linkage([(np.array([x, y, 0.0]), Z) for x, y in points], size)


def four_bar() -> Problem:
    """A crank-rocker of 40, 100, 80 mm on a ground of 90 mm, in a general pose."""
    crank = 0.04 * np.array([np.cos(1.0), np.sin(1.0)])
    d = np.array([0.09, 0.0]) - crank
    length = np.linalg.norm(d)
    x = (0.1**2 - 0.08**2 + length**2) / (2 * length)
    side = np.array([-d[1], d[0]]) / length
    knee = crank + x * d / length + np.sqrt(0.1**2 - x**2) * side
    return planar_loop([(0.0, 0.0), tuple(crank), tuple(knee), (0.09, 0.0)])


def parallelogram(angle: float) -> Problem:
    """Cranks of 50 mm on a ground of 100 mm; at angle 0 all four hinges lie on one line."""
    x, y = 0.05 * np.cos(angle), 0.05 * np.sin(angle)
    return planar_loop([(0.0, 0.0), (x, y), (0.1 + x, y), (0.1, 0.0)])


def stretched_pair() -> Problem:
    """Two links of 50 mm stretched exactly between pivots 100 mm apart: shaky, yet nothing can move."""
    return planar_loop([(0.0, 0.0), (0.05, 0.0), (0.1, 0.0)])


def bennett(angle: float = 1.0) -> Problem:
    """Bennett's skew four-bar (1903): sin α / a = sin β / b, over-constrained by three and yet it moves."""
    a, alpha, b = 0.08, 0.9, 0.05
    beta = float(np.arcsin(b * sin(alpha) / a))
    other = 2 * atan(sin((beta + alpha) / 2) / sin((beta - alpha) / 2) / tan(angle / 2))
    joints, frame = [], pin.SE3.Identity()
    for turn, length, twist in ((angle, a, alpha), (other, b, beta), (2 * pi - angle, a, alpha), (-other, b, beta)):
        joints.append((frame.translation.copy(), frame.rotation[:, 2].copy()))
        frame = frame * pin.SE3(pin.exp3(turn * Z), np.zeros(3))
        frame = frame * pin.SE3(pin.exp3(np.array([twist, 0, 0])), np.array([length, 0, 0]))
    assert frame.isIdentity(1e-12)  # the loop closes
    return linkage(joints, 0.08)


def slider_crank(angle: float = 0.7) -> Problem:
    """Crank of 30 mm, rod of 90 mm, piston in a cylinder along x."""
    pin_at = np.array([0.03 * np.cos(angle), 0.03 * np.sin(angle), 0.0])
    wrist = np.array([pin_at[0] + np.sqrt(0.09**2 - pin_at[1] ** 2), 0.0, 0.0])
    poses = [pin.SE3.Identity()] + [pin.SE3(np.eye(3), p) for p in (pin_at / 2, (pin_at + wrist) / 2, wrist)]
    constraints = hinge(0, 1, poses[0], poses[1], np.zeros(3), Z, 0.09)
    constraints += hinge(1, 2, poses[1], poses[2], pin_at, Z, 0.09)
    constraints += hinge(2, 3, poses[2], poses[3], wrist, Z, 0.09)
    bore, piston = Cylinder([0, 0, 0], [1, 0, 0], 0.02), Cylinder([0, 0, 0], [1, 0, 0], 0.02)
    constraints.append(Concentric((0, 3), (bore, piston), sense=1, size=0.02))
    return Problem(tuple(constraints), tuple(poses), 0.09)


def sarrus() -> Problem:
    """Sarrus' linkage (1853): two legs of three parallel hinges, at right angles, carry a platform straight up."""
    x, y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    legs = [
        (x, [np.array(p) for p in ([0, 0.1, 0], [0, 0.15, 0.05], [0, 0.1, 0.1])]),
        (y, [np.array(p) for p in ([0.1, 0, 0], [0.15, 0, 0.05], [0.1, 0, 0.1])]),
    ]
    poses = [pin.SE3.Identity(), pin.SE3(np.eye(3), 0.1 * Z)]
    constraints: list[Constraint] = []
    for axis, (foot, knee, top) in legs:
        lower, upper = len(poses), len(poses) + 1
        poses += [pin.SE3(np.eye(3), (foot + knee) / 2), pin.SE3(np.eye(3), (knee + top) / 2)]
        constraints += hinge(0, lower, poses[0], poses[lower], foot, axis, 0.1)
        constraints += hinge(lower, upper, poses[lower], poses[upper], knee, axis, 0.1)
        constraints += hinge(upper, 1, poses[upper], poses[1], top, axis, 0.1)
    return Problem(tuple(constraints), tuple(poses), 0.1)


def flange(bolts: int = 4, error: float = 0.0) -> Problem:
    """A cover on a housing: faces against, `bolts` holes each concentric; the last hole of the cover `error` m off."""
    constraints: list[Constraint] = [Against((0, 1), (Plane([0, 0, 0], Z), Plane([0, 0, 0], -Z)), size=0.05)]
    for k in range(bolts):
        angle = 2 * pi * k / bolts
        hole = 0.04 * np.array([np.cos(angle), np.sin(angle), 0.0])
        off = np.array([error, 0.0, 0.0]) if k == bolts - 1 else np.zeros(3)
        constraints.append(Concentric((0, 1), (Cylinder(hole, Z, 0.004), Cylinder(hole + off, Z, 0.004)), size=0.004))
    return Problem(tuple(constraints), (pin.SE3.Identity(), pin.SE3.Identity()), 0.1)


def machine(covers: int = 10, bolts: int = 24) -> Problem:
    """A frame, covers on it, each held by bolts: against, two concentric and a parallel a bolt, four a cover.

    The default has 251 parts and 1,000 constraints.
    """
    constraints: list[Constraint] = []
    poses = [pin.SE3.Identity()]
    for c in range(covers):
        seat = np.array([0.3 * c, 0.0, 0.0])
        cover = len(poses)
        poses.append(pin.SE3(np.eye(3), seat))
        constraints.append(Against((0, cover), (Plane(seat, Z), Plane([0, 0, 0], -Z)), size=0.1))
        for y in (-0.09, 0.09):
            dowel = np.array([0.0, y, 0.0])
            constraints.append(
                Concentric((0, cover), (Cylinder(seat + dowel, Z, 0.004), Cylinder(dowel, Z, 0.004)), size=0.004)
            )
        constraints.append(Parallel((0, cover), (Plane(seat, [1, 0, 0]), Plane([0, 0, 0], [1, 0, 0])), size=0.1))
        for k in range(bolts):
            angle = 2 * pi * k / bolts
            hole = 0.1 * np.array([np.cos(angle), np.sin(angle), 0.0])
            bolt = len(poses)
            poses.append(pin.SE3(np.eye(3), seat + hole + 0.01 * Z))
            shank = Cylinder([0, 0, -0.02], Z, 0.003)
            constraints.append(Concentric((cover, bolt), (Cylinder(hole, Z, 0.003), shank), size=0.003))
            constraints.append(Concentric((0, bolt), (Cylinder(seat + hole, Z, 0.003), shank), size=0.003))
            constraints.append(Against((cover, bolt), (Plane(hole + 0.01 * Z, Z), Plane([0, 0, 0], -Z)), size=0.005))
            constraints.append(
                Parallel((cover, bolt), (Plane(hole, [1, 0, 0]), Plane([0, 0, 0], [1, 0, 0])), size=0.005)
            )
    return Problem(tuple(constraints), tuple(poses), 0.1)


def random_pair(kind: str, bodies: tuple[int, int], poses: Sequence[pin.SE3], rng: np.random.Generator) -> Constraint:
    """A constraint of this kind somewhere between two bodies, true at these poses."""
    a, b = bodies
    place = poses[a].act(0.05 * rng.normal(size=3))
    d = rng.normal(size=3)
    d /= np.linalg.norm(d)
    e = np.cross(d, rng.normal(size=3))
    e /= np.linalg.norm(e)
    flip = float(rng.choice([-1.0, 1.0]))
    of, pair = {
        "against": (Against, (Plane(place, d), Plane(place + 0.02 * e, -d))),
        "coplanar": (Coplanar, (Plane(place, d), Plane(place + 0.02 * e, d))),
        "concentric": (Concentric, (Cylinder(place, d, 0.01), Cylinder(place + 0.03 * d, flip * d, 0.01))),
        "spherical": (Spherical, (Sphere(place, 0.01), Sphere(place, 0.01))),
        "conical": (Conical, (Cone(place, d, 0.3), Cone(place, d, 0.3))),
        "parallel": (Parallel, (Plane(place, d), Plane(place + 0.05 * e, flip * d))),
        "contact": (Contact, (Line(place, d), Point(place + 0.02 * d))),
        "distance": (partial(Distance, at=0.05), (Point(place), Point(place + 0.05 * e))),
        "angle": (partial(Angle, at=0.7), (Plane(place, d), Plane(place, np.cos(0.7) * d + np.sin(0.7) * e))),
        "tangent plane sphere": (Tangent, (Plane(place, d), Sphere(place + 0.02 * e + 0.01 * d, 0.01))),
        "tangent plane cylinder": (Tangent, (Plane(place, d), Cylinder(place + 0.01 * d, e, 0.01))),
        "tangent cylinders": (Tangent, (Cylinder(place, d, 0.01), Cylinder(place + 0.03 * e, flip * d, 0.02))),
    }[kind]
    return of(bodies, (pair[0].transformed(poses[a].inverse()), pair[1].transformed(poses[b].inverse())))


RANDOM_KINDS = (
    "against", "coplanar", "concentric", "spherical", "conical", "parallel", "contact", "distance", "angle",
    "tangent plane sphere", "tangent plane cylinder", "tangent cylinders",
)  # fmt: skip


def random_assembly(seed: int) -> Problem:
    """Two to eight bodies in a random graph with loops, one or two constraints of random kinds an edge, all true."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 9))
    turns = rng.normal(size=(n, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    poses = [pin.SE3(pin.Quaternion(*q).matrix(), 0.05 * rng.normal(size=3)) for q in turns]
    edges = [(int(rng.integers(0, i)), i) for i in range(1, n)]
    for _ in range(int(rng.integers(0, n))):
        a, b = rng.choice(n, 2, replace=False)
        edges.append((int(a), int(b)))
    kinds = [(e, str(rng.choice(RANDOM_KINDS))) for e in edges for _ in range(int(rng.integers(1, 3)))]
    return Problem(tuple(random_pair(kind, e, poses, rng) for e, kind in kinds), tuple(poses), 0.1)


def lattice(columns: int, rows: int) -> Problem:
    """Loops upon loops: a net of bars hinged about z at the crossings, every mesh a parallelogram; one that moves."""
    step = 0.05
    poses = [pin.SE3.Identity()]
    bars: list[tuple[np.ndarray, np.ndarray, int]] = []
    lean = np.array([0.3, 0.95, 0.0]) / np.hypot(0.3, 0.95)
    at = lambda i, j: step * (i * np.array([1.0, 0.0, 0.0]) + j * lean)  # noqa: E731
    for j in range(rows):
        bars.append((at(0, j), at(columns - 1, j), len(poses) if j else 0))
        if j:
            poses.append(pin.SE3(np.eye(3), (bars[-1][0] + bars[-1][1]) / 2))
    constraints: list[Constraint] = []
    for i in range(columns):
        bar = len(poses)
        poses.append(pin.SE3(np.eye(3), (at(i, 0) + at(i, rows - 1)) / 2))
        for j in range(rows):
            other = bars[j][2]
            constraints += hinge(other, bar, poses[other], poses[bar], at(i, j), Z, step)
    return Problem(tuple(constraints), tuple(poses), step * max(columns, rows))


LINKAGES = {
    "four-bar": four_bar(),
    "parallelogram": parallelogram(0.8),
    "parallelogram, flat": parallelogram(0.0),
    "stretched pair": stretched_pair(),
    "Bennett": bennett(),
    "Sarrus": sarrus(),
    "slider crank": slider_crank(),
}
