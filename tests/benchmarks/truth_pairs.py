"""Pairs of B-rep solids whose gap is known in closed form: negative where they overlap, then minus the depth.

Each kind is a function of a random generator and a gap (m). It returns two solids and the pose of the second in the
frame of the first. Only the faces that are meant come near each other.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from vpframe.scene import modelling as m

Two = tuple[m.Solid, m.Solid, pin.SE3]
GAPS = (2e-6, 1.5e-4)
"""m: least and greatest size of a gap or a depth"""


@dataclass(frozen=True)
class Pair:
    """Two solids placed in the world."""

    kind: str
    seed: int
    gap: float
    """m"""
    depth: float
    """m: distance of the deepest point of one solid to the boundary of the other; 0 for clearances"""
    solids: tuple[m.Solid, m.Solid]
    poses: tuple[pin.SE3, pin.SE3]


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0, turn: np.ndarray | None = None) -> pin.SE3:
    """A pose from a position and a rotation vector."""
    return pin.SE3(np.eye(3) if turn is None else pin.exp3(np.asarray(turn, dtype=float)), np.array([x, y, z]))


def _x(angle: float) -> np.ndarray:
    return np.array([angle, 0.0, 0.0])


def _y(angle: float) -> np.ndarray:
    return np.array([0.0, angle, 0.0])


def _block(x: float, y: float, z: float) -> m.Solid:
    """A block about the origin in x and y, below z = 0."""
    return m.box(x, y, z).translated(-x / 2, -y / 2, -z)


def planes(rng: np.random.Generator, gap: float) -> Two:
    a, b = _block(*rng.uniform(0.01, 0.03, 3)), _block(*rng.uniform(0.01, 0.03, 2), 0.01)
    return a, b, at(*rng.uniform(-4e-3, 4e-3, 2), 0.01 + gap, [0.0, 0.0, rng.uniform(0.0, 3.0)])


def bored_planes(rng: np.random.Generator, gap: float) -> Two:
    a = _block(0.04, 0.04, 0.01) - m.cylinder(0.006, 0.02).translated(0.0, 0.0, -0.015)
    return a, m.cylinder(rng.uniform(0.008, 0.015), 0.01), at(*rng.uniform(-2e-3, 2e-3, 2), gap)


def edges(rng: np.random.Generator, gap: float) -> Two:
    """Two edges of boxes that cross."""
    bar = m.box(0.01, 0.05, 0.01).translated(0.0, -0.025, 0.0)
    lower, upper = bar.moved(at(turn=_y(0.75 * np.pi))), bar.moved(at(turn=_y(-0.25 * np.pi)))
    return lower, upper, at(*rng.uniform(-5e-3, 5e-3, 2), gap, [0.0, 0.0, rng.uniform(0.5, 2.5)])


def corner(rng: np.random.Generator, gap: float) -> Two:
    """The corner of a box above a ball."""
    r = rng.uniform(5e-3, 2e-2)
    diagonal = pin.Quaternion.FromTwoVectors(np.ones(3) / 3**0.5, np.array([0.0, 0.0, 1.0])).toRotationMatrix()
    tip = pin.SE3(diagonal, np.zeros(3))
    return m.sphere(r), m.box(0.01, 0.01, 0.01).moved(tip), at(z=r + gap)


def edge_on_cylinder(rng: np.random.Generator, gap: float) -> Two:
    r = rng.uniform(5e-3, 2e-2)
    edge = m.box(0.01, 0.01, 0.01).translated(0.0, -0.005, 0.0).moved(at(turn=_y(-np.pi / 4)))
    rod = m.cylinder(r, 0.04).moved(at(turn=_x(np.pi / 2))).translated(0.0, 0.02, 0.0)
    return rod, edge, at(z=r + gap, turn=[0.0, 0.0, rng.uniform(0.1, 3.0)])


def balls(rng: np.random.Generator, gap: float) -> Two:
    r, s = rng.uniform(2e-3, 2e-2, 2)
    u = rng.normal(size=3)
    return m.sphere(r), m.sphere(s), at(*((r + s + gap) * u / np.linalg.norm(u)))


def ball_on_plane(rng: np.random.Generator, gap: float) -> Two:
    r = rng.uniform(2e-3, 3e-2)
    return _block(0.03, 0.03, 0.02), m.sphere(r), at(*rng.uniform(-5e-3, 5e-3, 2), r + gap, rng.normal(size=3))


def ball_in_socket(rng: np.random.Generator, gap: float) -> Two:
    r, aside = rng.uniform(5e-3, 1.5e-2), rng.uniform(1e-5, 2e-4)
    block = _block(0.05, 0.05, 0.025) - m.sphere(r + gap + aside)
    u = np.array([0.5, 0.2, -1.0])
    return block, m.sphere(r), at(*(aside * u / np.linalg.norm(u)), rng.normal(size=3))


def ball_on_cylinder(rng: np.random.Generator, gap: float) -> Two:
    r, s = rng.uniform(3e-3, 2e-2, 2)
    angle = rng.uniform(0.0, 6.0)
    d = r + s + gap
    return m.cylinder(r, 0.04), m.sphere(s), at(d * np.cos(angle), d * np.sin(angle), rng.uniform(0.01, 0.03))


def ball_in_bore(rng: np.random.Generator, gap: float) -> Two:
    r, aside, angle = rng.uniform(3e-3, 1.2e-2), rng.uniform(1e-5, 3e-4), rng.uniform(0.0, 6.0)
    bore = _block(0.04, 0.04, 0.03) - m.cylinder(r + gap + aside, 0.05).translated(0.0, 0.0, -0.04)
    return bore, m.sphere(r), at(aside * np.cos(angle), aside * np.sin(angle), -rng.uniform(0.012, 0.018))


def ball_on_cone(rng: np.random.Generator, gap: float) -> Two:
    half, s, angle = rng.uniform(0.2, 0.9), rng.uniform(2e-3, 1e-2), rng.uniform(0.0, 6.0)
    height = 0.02
    cone = m.cone(0.0, height * np.tan(half), height)
    along, normal = np.array([np.sin(half), np.cos(half)]), np.array([np.cos(half), -np.sin(half)])
    r, z = 0.6 * height / np.cos(half) * along + (s + gap) * normal
    return cone, m.sphere(s), at(r * np.cos(angle), r * np.sin(angle), z)


def ball_on_torus(rng: np.random.Generator, gap: float) -> Two:
    major, minor, s = rng.uniform(0.012, 0.02), rng.uniform(2e-3, 6e-3), rng.uniform(2e-3, 5e-3)
    tube, angle = rng.uniform(-2.2, 2.2), rng.uniform(0.0, 6.0)
    r, z = major + (minor + s + gap) * np.cos(tube), (minor + s + gap) * np.sin(tube)
    return m.torus(major, minor), m.sphere(s), at(r * np.cos(angle), r * np.sin(angle), z)


def ball_in_groove(rng: np.random.Generator, gap: float) -> Two:
    """A ball in a round groove of a shaft, as in a bearing."""
    major, minor = rng.uniform(0.012, 0.02), rng.uniform(3e-3, 5e-3)
    shaft = m.cylinder(major - 1.5e-3, 0.02).translated(0.0, 0.0, -0.01) - m.torus(major, minor)
    aside = rng.uniform(1e-5, 3e-4)
    s, angle = minor - aside - gap, rng.uniform(0.0, 6.0)
    r = major - aside  # the groove's wall is deepest towards the axis
    return shaft, m.sphere(s), at(r * np.cos(angle), r * np.sin(angle), 0.0)


def lying_cylinder(rng: np.random.Generator, gap: float) -> Two:
    r, length = rng.uniform(3e-3, 2e-2), rng.uniform(0.01, 0.02)
    roll = m.cylinder(r, length).translated(0.0, 0.0, -length / 2).moved(at(turn=_x(np.pi / 2)))
    return _block(0.03, 0.03, 0.02), roll, at(0.0, 0.0, r + gap, [0.0, 0.0, rng.uniform(0.0, 3.0)])


def tilted_cylinder(rng: np.random.Generator, gap: float) -> Two:
    """The rim of a cylinder above a plane."""
    r, tilt = rng.uniform(3e-3, 1e-2), rng.uniform(0.05, 1.2)
    turn = at(turn=[0.0, 0.0, rng.uniform(0.0, 6.0)]) * at(turn=_y(tilt))
    return _block(0.06, 0.06, 0.02), m.cylinder(r, 0.02), at(z=r * np.sin(tilt) + gap) * turn


def parallel_cylinders(rng: np.random.Generator, gap: float) -> Two:
    r, s = rng.uniform(3e-3, 2e-2, 2)
    angle = rng.uniform(0.0, 6.0)
    d = r + s + gap
    shift = rng.choice([0.0, 0.01])
    return m.cylinder(r, 0.03), m.cylinder(s, 0.03), at(d * np.cos(angle), d * np.sin(angle), shift)


def crossed_cylinders(rng: np.random.Generator, gap: float) -> Two:
    r, s = rng.uniform(3e-3, 1.5e-2, 2)
    rod = m.cylinder(s, 0.05).translated(0.0, 0.0, -0.025)
    return m.cylinder(r, 0.04), rod, at(r + s + gap, 0.0, 0.02, _x(rng.uniform(0.1, np.pi - 0.1)))


def shaft_off_axis(rng: np.random.Generator, gap: float) -> Two:
    r, aside, angle = rng.uniform(5e-3, 2.5e-2), rng.uniform(2e-5, 1e-4), rng.uniform(0.0, 6.0)
    hub = _block(0.07, 0.07, 0.03) - m.cylinder(r + aside + gap, 0.05).translated(0.0, 0.0, -0.04)
    return hub, m.cylinder(r, 0.05), at(aside * np.cos(angle), aside * np.sin(angle), -0.04)


def tilted_shaft(rng: np.random.Generator, gap: float) -> Two:
    """A shaft off and askew in a bore: nearest to the bore's rim."""
    r, aside, tilt, half = rng.uniform(5e-3, 2e-2), rng.uniform(1e-5, 1e-4), rng.uniform(1e-4, 8e-3), 0.015
    bore = aside + (gap + r + half * np.sin(tilt)) / np.cos(tilt)
    hub = _block(0.06, 0.06, 2 * half).translated(0.0, 0.0, half)
    hub = hub - m.cylinder(bore, 0.05).translated(0.0, 0.0, -0.025)
    shaft = m.cylinder(r, 0.06).translated(0.0, 0.0, -0.03)
    return hub, shaft, at(turn=[0.0, 0.0, rng.uniform(0.0, 6.0)]) * at(x=aside, turn=_y(tilt))


def press_fit(rng: np.random.Generator, gap: float) -> Two:
    r = rng.uniform(2e-3, 2e-2)
    hub = _block(0.06, 0.06, 0.02) - m.cylinder(r + gap, 0.05).translated(0.0, 0.0, -0.04)
    return hub, m.cylinder(r, 0.04), at(z=-0.03, turn=[0.0, 0.0, rng.uniform(0.0, 6.0)])


def taper(rng: np.random.Generator, gap: float) -> Two:
    """A cone in a socket of the same angle, off its axis and not pushed home, or too far."""
    half, aside, angle = rng.uniform(0.03, 0.4), rng.uniform(0.0, 1.0) * 5e-5, rng.uniform(0.0, 6.0)
    small, length = rng.uniform(4e-3, 8e-3), 0.02
    wide = small + length * np.tan(half)
    rise = (gap + aside * np.cos(half)) / np.sin(half)
    plug = m.cone(small, wide, length)
    extra = 0.25  # the socket is longer at both ends
    grown, shrunk = wide + extra * length * np.tan(half), small - extra * length * np.tan(half)
    hollow = m.cone(shrunk, grown, length * (1 + 2 * extra)).translated(0.0, 0.0, -extra * length)
    size = 2 * grown + 0.01
    body = _block(size, size, length * 1.2).translated(0.0, 0.0, length * 1.1) - hollow
    return body, plug, at(aside * np.cos(angle), aside * np.sin(angle), rise)


def countersink(rng: np.random.Generator, gap: float) -> Two:
    """A countersunk screw in its plate: the cones decide, not the shank."""
    half, d = np.pi / 4, rng.uniform(3e-3, 8e-3)
    head, sink = d, d + 4e-4
    plate = _block(0.04, 0.04, 0.012) - m.cylinder(d / 2 + 5e-4, 0.02).translated(0.0, 0.0, -0.015)
    cut = m.cone(sink - 0.75 * d, sink + 1e-3, 0.75 * d + 1e-3).translated(0.0, 0.0, -0.75 * d)
    plate = plate - cut
    height = (head - d / 2) / np.tan(half)
    screw = m.cone(d / 2, head, height).translated(0.0, 0.0, -height) + m.cylinder(d / 2, 0.016).translated(z=-0.016)
    # with tops level the cones are apart by (sink - head) cos 45°
    return plate, screw, at(z=(gap - (sink - head) * np.cos(half)) / np.sin(half))


def plug_on_rim(rng: np.random.Generator, gap: float) -> Two:
    """A cone on the sharp rim of a bore."""
    half, r = rng.uniform(0.3, 1.1), rng.uniform(3e-3, 8e-3)
    plate = _block(0.06, 0.06, 0.01) - m.cylinder(r, 0.03).translated(0.0, 0.0, -0.02)
    height = 1.6 * r / np.tan(half)
    apex = (r * np.cos(half) - gap) / np.sin(half)
    return plate, m.cone(0.0, height * np.tan(half), height), at(z=-apex)


def lying_cone(rng: np.random.Generator, gap: float) -> Two:
    half, length = rng.uniform(0.1, 0.7), 0.02
    small = rng.uniform(3e-3, 6e-3)
    cone = m.cone(small, small + length * np.tan(half), length)
    # its lowest line is level where the axis rises by the half angle
    side = np.array([0.0, -small, 0.0])
    lie = at(turn=_x(np.pi / 2)) * at(turn=_x(-half))
    turned = cone.moved(lie)
    lowest = min((lie * side)[2], (lie * -side)[2])
    return _block(0.08, 0.08, 0.02), turned, at(z=gap - lowest)


def ring_on_plane(rng: np.random.Generator, gap: float) -> Two:
    major, minor, tilt = rng.uniform(8e-3, 0.015), rng.uniform(2e-3, 5e-3), rng.choice([0.0, 1.0]) * rng.uniform(0.1, 1)
    turn = at(turn=[0.0, 0.0, rng.uniform(0.0, 6.0)]) * at(turn=_y(tilt))
    return _block(0.06, 0.06, 0.02), m.torus(major, minor), at(z=minor + major * np.sin(tilt) + gap) * turn


def ring_on_rod(rng: np.random.Generator, gap: float) -> Two:
    major, minor = rng.uniform(0.01, 0.015), rng.uniform(2e-3, 5e-3)
    aside, angle = rng.uniform(0.0, 1e-4), rng.uniform(0.0, 6.0)
    rod = m.cylinder(major - minor - gap - aside, 0.04).translated(0.0, 0.0, -0.02)
    return m.torus(major, minor), rod, at(aside * np.cos(angle), aside * np.sin(angle))


def rings(rng: np.random.Generator, gap: float) -> Two:
    """Two coaxial rings, one above the other."""
    major, other = rng.uniform(0.012, 0.016, 2)
    minor, small = rng.uniform(3e-3, 5e-3, 2)
    d = minor + small + gap
    return m.torus(major, minor), m.torus(other, small), at(z=(d * d - (major - other) ** 2) ** 0.5)


def drawn_thread(rng: np.random.Generator, gap: float) -> Two:
    """A screw with its head in its tap drill, drawn as cylinders: a thread by convention."""
    outer, core = ((6e-3, 5e-3), (8e-3, 6.8e-3), (10e-3, 8.5e-3))[int(rng.integers(3))]
    plate = _block(0.04, 0.04, 0.01) - m.cylinder(core / 2, 0.03).translated(0.0, 0.0, -0.02)
    screw = m.cylinder(outer / 2, 0.016) + m.cylinder(outer * 0.85, 6e-3).translated(z=0.016)
    return plate, screw, at(z=-0.016, turn=[0.0, 0.0, rng.uniform(0.0, 6.0)])


KINDS: dict[str, Callable[[np.random.Generator, float], Two]] = {
    function.__name__.replace("_", " "): function
    for function in (
        planes, bored_planes, edges, corner, edge_on_cylinder, balls, ball_on_plane, ball_in_socket, ball_on_cylinder,
        ball_in_bore, ball_on_cone, ball_on_torus, ball_in_groove, lying_cylinder, tilted_cylinder, parallel_cylinders,
        crossed_cylinders, shaft_off_axis, tilted_shaft, press_fit, taper, countersink, plug_on_rim, lying_cone,
        ring_on_plane, ring_on_rod, rings, drawn_thread,
    )
}  # fmt: skip
THREAD = "drawn thread"
PRESS = "press fit"


def pair(kind: str, seed: int) -> Pair:
    """A pair of a kind, placed anywhere."""
    rng = np.random.default_rng([seed, list(KINDS).index(kind)])
    gap = float(np.exp(rng.uniform(*np.log(GAPS)))) * (1.0 if rng.random() < 0.5 else -1.0)
    if kind == PRESS:
        gap = -min(abs(gap), 2e-5)
    a, b, pose = KINDS[kind](rng, gap)
    # a point of an edge is deepest below the middle of the other, 45° from both its faces
    depth = max(0.0, -gap) * (0.5**0.5 if kind == "edges" else 1.0)
    place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.uniform(-0.1, 0.1, 3))
    return Pair(kind, seed, gap, depth, (a, b), (place, place * pose))
