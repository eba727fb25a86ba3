"""Every kind: Jacobian against central differences, freedom against the Jacobian's rank, and what it means."""

from __future__ import annotations

from math import inf, pi

import numpy as np
import pinocchio as pin
import pytest

from constraints.errors import GeometryError
from constraints.geometry.surfaces import Cone, Cylinder, Geometry, Plane, Sphere, Torus
from constraints.kinds import (
    Against,
    Angle,
    Belt,
    Circle,
    Concentric,
    Conical,
    Constraint,
    Contact,
    Coplanar,
    Distance,
    Fixed,
    Gear,
    Groove,
    Line,
    Offset,
    Parallel,
    Perpendicular,
    Point,
    RackAndPinion,
    Screw,
    Spherical,
    Tangent,
    Toroidal,
)
from constraints.solve.solver import solve

PLANES = Plane([0.1, 0.2, 0.3], [1.0, 2.0, -0.5]), Plane([-0.3, 0.1, 0.05], [0.2, 1.0, 0.7])
CYLINDERS = Cylinder([0.1, 0.0, 0.2], [0.3, 1.0, 0.1], 0.02), Cylinder([0.0, 0.3, -0.1], [1.0, -0.4, 0.6], 0.03)
CONES = Cone([0.1, 0.1, 0.0], [0.0, 0.6, 1.0], 0.4), Cone([0.0, -0.1, 0.2], [1.0, 0.1, 0.2], 0.4)
SPHERES = Sphere([0.0, 0.1, 0.3], 0.02), Sphere([0.2, -0.1, 0.1], 0.05)
TORI = Torus([0.1, 0.2, 0.0], [0.1, 0.2, 1.0], 0.05, 0.02), Torus([0.0, 0.1, 0.1], [1.0, 0.2, 0.3], 0.06, 0.01)
LINES = Line([0.1, 0.0, 0.2], [0.2, 0.3, 1.0]), Line([0.0, 0.2, 0.1], [1.0, 0.1, -0.4])
POINTS = Point([0.1, 0.2, -0.1]), Point([-0.2, 0.1, 0.1])
CIRCLES = Circle([0.1, 0.0, 0.2], [0.2, 0.3, 1.0], 0.04), Circle([0.0, 0.2, 0.1], [1.0, 0.1, -0.4], 0.03)
POSE = pin.SE3(pin.exp3(np.array([0.3, -0.8, 0.5])), np.array([0.1, 0.2, -0.3]))
AB = (0, 1)

CASES = {
    "against": (Against(AB, PLANES), 3),
    "coplanar": (Coplanar(AB, PLANES), 3),
    "concentric": (Concentric(AB, CYLINDERS), 2),
    "concentric opposed": (Concentric(AB, CYLINDERS, sense=-1), 2),
    "concentric of circle and line": (Concentric(AB, (CIRCLES[0], LINES[1]), sense=1), 2),
    "conical": (Conical(AB, CONES, offset=0.01), 1),
    "spherical": (Spherical(AB, SPHERES), 3),
    "toroidal": (Toroidal(AB, TORI, sense=1), 1),
    "groove straight": (Groove(AB, (CYLINDERS[0], SPHERES[1])), 4),
    "groove ring": (Groove(AB, (SPHERES[0], TORI[1])), 4),
    "groove of circle and point": (Groove(AB, (CIRCLES[0], POINTS[1])), 4),
    "tangent plane cylinder": (Tangent(AB, (PLANES[0], CYLINDERS[1])), 4),
    "tangent cylinder plane": (Tangent(AB, (CYLINDERS[0], PLANES[1])), 4),
    "tangent plane sphere": (Tangent(AB, (PLANES[0], SPHERES[1])), 5),
    "tangent sphere plane": (Tangent(AB, (SPHERES[0], PLANES[1])), 5),
    "tangent plane cone": (Tangent(AB, (PLANES[0], CONES[1])), 4),
    "tangent plane torus": (Tangent(AB, (PLANES[0], TORI[1])), 5),
    "tangent torus plane": (Tangent(AB, (TORI[0], PLANES[1])), 5),
    "tangent cylinders outside": (Tangent(AB, CYLINDERS), 3),
    "tangent cylinders inside": (Tangent(AB, CYLINDERS, mode="inside"), 3),
    "tangent cylinders crossed": (Tangent(AB, CYLINDERS, mode="crossed"), 5),
    "tangent cylinder sphere": (Tangent(AB, (CYLINDERS[0], SPHERES[1])), 5),
    "tangent sphere in cylinder": (Tangent(AB, (SPHERES[0], CYLINDERS[1]), mode="inside"), 5),
    "tangent spheres": (Tangent(AB, SPHERES), 5),
    "tangent spheres inside": (Tangent(AB, SPHERES, mode="inside"), 5),
    "tangent cone sphere": (Tangent(AB, (CONES[0], SPHERES[1])), 5),
    "tangent sphere in cone": (Tangent(AB, (SPHERES[0], CONES[1]), mode="inside"), 5),
    "tangent torus sphere": (Tangent(AB, (TORI[0], SPHERES[1])), 5),
    "contact plane line": (Contact(AB, (PLANES[0], LINES[1])), 4),
    "contact plane circle": (Contact(AB, (PLANES[0], CIRCLES[1])), 5),
    "contact point plane": (Contact(AB, (POINTS[0], PLANES[1])), 5),
    "contact cylinder point": (Contact(AB, (CYLINDERS[0], POINTS[1])), 5),
    "contact cone point": (Contact(AB, (CONES[0], POINTS[1])), 5),
    "contact sphere point": (Contact(AB, (SPHERES[0], POINTS[1])), 5),
    "contact torus point": (Contact(AB, (TORI[0], POINTS[1])), 5),
    "contact cylinder line": (Contact(AB, (CYLINDERS[0], LINES[1])), 5),
    "contact line line": (Contact(AB, LINES), 5),
    "contact point on line": (Contact(AB, (POINTS[0], LINES[1])), 4),
    "contact points": (Contact(AB, POINTS), 3),
    "parallel": (Parallel(AB, (PLANES[0], CYLINDERS[1])), 4),
    "parallel opposed": (Parallel(AB, PLANES, sense=-1), 4),
    "perpendicular": (Perpendicular(AB, PLANES), 5),
    "angle": (Angle(AB, (CYLINDERS[0], PLANES[1]), at=0.7), 5),
    "angle with limits": (Angle(AB, PLANES, at=(0.3, 0.4)), 6),
    "distance plane point": (Distance(AB, (PLANES[0], POINTS[1]), at=-0.1), 5),
    "distance point axis": (Distance(AB, (POINTS[0], CYLINDERS[1]), at=0.1), 5),
    "distance axes": (Distance(AB, LINES, at=0.1), 5),
    "distance axes that meet": (Distance(AB, LINES, at=0.0), 5),
    "distance points": (Distance(AB, POINTS, at=0.1), 5),
    "distance with limits": (Distance(AB, POINTS, at=(0.1, 0.12)), 6),
    "offset": (Offset(AB, PLANES, at=0.01), 3),
    "offset with limits": (Offset(AB, PLANES, at=(-inf, 0.01)), 4),
    "fixed": (Fixed(AB, POINTS, relative=POSE), 0),
    "screw": (Screw(AB, CYLINDERS, pitch=0.05), 1),
    "screw left-hand": (Screw(AB, CYLINDERS, pitch=-0.04, sense=-1), 1),
    "gear": (Gear(AB, CYLINDERS, teeth_a=2, teeth_b=3), 5),
    "gear internal": (Gear(AB, CYLINDERS, teeth_a=2, teeth_b=3, sense=-1), 5),
    "belt": (Belt(AB, CYLINDERS, teeth_a=3, teeth_b=1), 5),
    "rack": (RackAndPinion(AB, (CYLINDERS[0], LINES[1]), radius=0.03, teeth=3), 5),
    "rack reversed": (RackAndPinion(AB, (CYLINDERS[0], LINES[1]), radius=0.03, teeth=1, sense=-1), 5),
}
each_kind = pytest.mark.parametrize(("constraint", "freedom"), CASES.values(), ids=CASES.keys())


@each_kind
def test_only_threads_and_teeth_hold_again_a_period_farther(constraint, freedom):
    assert constraint.periodic == isinstance(constraint, Screw | Gear | Belt | RackAndPinion)


def random_pose(rng: np.random.Generator, scale: float = 0.3) -> pin.SE3:
    q = rng.normal(size=4)
    return pin.SE3(pin.Quaternion(*(q / np.linalg.norm(q))).matrix(), scale * rng.normal(size=3))


def differences(constraint: Constraint, a: pin.SE3, b: pin.SE3, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Fourth-order central differences of the residual by each local twist; NaN where it jumps in between."""
    out = []
    for body in (0, 1):
        columns = []
        for k in range(6):
            values = {}
            for s in (-2, -1, 0, 1, 2):
                step = np.zeros(6)
                step[k] = s * h
                poses = [a, b]
                poses[body] = poses[body] * pin.exp6(step)
                values[s] = constraint.residual(*poses)
            d = (8 * (values[1] - values[-1]) - (values[2] - values[-2])) / (12 * h)
            jump = np.abs(np.diff([values[s] for s in (-2, -1, 0, 1, 2)], axis=0)).max(axis=0) > 0.02 * pi / 3
            columns.append(np.where(jump, np.nan, d))
        out.append(np.array(columns).T)
    return out[0], out[1]


@each_kind
def test_jacobian_agrees_with_differences_at_random_poses(constraint: Constraint, freedom: int) -> None:
    rng = np.random.default_rng(7)
    compared = 0
    for _ in range(25):
        a, b = random_pose(rng), random_pose(rng)
        ja, jb = constraint.jacobian(a, b)
        scale = 1.0 + max(np.abs(ja).max(), np.abs(jb).max())
        if scale > 100.0:  # next to a singular pose differences are no reference
            continue
        na, nb = differences(constraint, a, b, 2e-4 / scale)
        for exact, numeric in ((ja, na), (jb, nb)):
            known = np.isfinite(numeric)
            compared += int(known.sum())
            assert np.abs(exact - numeric)[known].max(initial=0.0) < 1e-7 * scale**2
    assert compared > 20 * 12  # the comparison did take place


@each_kind
def test_freedom_is_what_the_jacobian_leaves_where_the_constraint_holds(constraint: Constraint, freedom: int) -> None:
    rng = np.random.default_rng(11)
    for _ in range(5):
        poses = [random_pose(rng), random_pose(rng)]
        solution = solve([constraint], poses, movable=[1])
        assert solution.converged
        held = poses[0], solution.poses[1]
        assert np.abs(constraint.residual(*held)).max() <= 1e-12
        equalities = np.zeros(constraint.rows, dtype=bool)
        row = 0
        for e in constraint.equations():
            equalities[row : row + e.rows] = e.holds
            row += e.rows
        jacobian = constraint.jacobian(*held)[1][equalities]
        rank = np.linalg.matrix_rank(jacobian, tol=1e-7) if len(jacobian) else 0
        assert 6 - rank == freedom == constraint.freedom


@each_kind
def test_a_common_motion_of_both_bodies_changes_nothing(constraint: Constraint, freedom: int) -> None:
    rng = np.random.default_rng(13)
    a, b, everywhere = random_pose(rng), random_pose(rng), random_pose(rng)
    before, after = constraint.residual(a, b), constraint.residual(everywhere * a, everywhere * b)
    assert np.allclose(np.abs(before), np.abs(after), atol=1e-12)  # a sign may flip at exactly half a period


def points_on(surface: Geometry) -> np.ndarray:
    """A dense sample of a surface about its middle."""
    s, t = (g.ravel() for g in np.meshgrid(np.linspace(0, 2 * pi, 721), np.linspace(-1, 1, 401)))
    if isinstance(surface, Sphere):
        z = np.stack([np.cos(s) * np.sqrt(1 - t**2), np.sin(s) * np.sqrt(1 - t**2), t], axis=1)
        return surface.center + surface.radius * z
    frame = np.linalg.svd(surface.axis[None])[2]
    e1, e2 = frame[1], frame[2]
    ring = np.cos(s)[:, None] * e1 + np.sin(s)[:, None] * e2
    if isinstance(surface, Cylinder):
        return surface.origin + 0.5 * t[:, None] * surface.axis + surface.radius * ring
    if isinstance(surface, Cone):
        h = 0.25 * (t[:, None] + 1)
        return surface.apex + h * surface.axis + h * np.tan(surface.half_angle) * ring
    assert isinstance(surface, Torus)
    up = np.cos(pi * t)[:, None] * ring + np.sin(pi * t)[:, None] * surface.axis
    return surface.center + surface.major * ring + surface.minor * up


@pytest.mark.parametrize("name", [n for n in CASES if n.startswith("tangent")])
def test_tangent_surfaces_touch_and_do_not_cross(name: str) -> None:
    """Against samples of the surfaces themselves: the least distance is nought and all others lie on one side."""
    constraint = CASES[name][0]
    rng = np.random.default_rng(17)
    poses = [pin.SE3.Identity(), random_pose(rng)]
    pose = solve([constraint], poses, movable=[1]).poses[1]
    a, b = constraint.features[0], constraint.features[1].transformed(pose)
    if isinstance(b, Plane) or (isinstance(a, Sphere) and not isinstance(b, Sphere)):
        a, b = b, a
    if isinstance(a, Sphere) and isinstance(b, Sphere) and a.radius < b.radius:
        a, b = b, a
    if isinstance(a, Cylinder) and isinstance(b, Cylinder):
        if a.radius < b.radius:
            a, b = b, a
        foot = np.linalg.lstsq(np.stack([a.axis, -b.axis], axis=1), b.origin - a.origin, rcond=None)[0]
        b = Cylinder(b.origin + (foot[1] if "crossed" in name else 0.0) * b.axis, b.axis, b.radius)
    distance = a.distance(points_on(b))
    assert np.abs(distance).min() < 2e-5
    inside = "inside" in name or " in " in name
    assert (distance.max() < 2e-5) if inside else (distance.min() > -2e-5)


def test_limits_are_inert_inside_and_hold_at_the_nearer_end_outside() -> None:
    slider = Offset(AB, (Plane([0, 0, 0], [0, 0, 1]), Plane([0, 0, 0], [0, 0, -1])), at=(0.01, 0.05))
    for start, end in ((0.03, 0.03), (0.2, 0.05), (-0.4, 0.01)):
        pose = pin.SE3(np.eye(3), np.array([0.0, 0.0, start]))
        solution = solve([slider], [pin.SE3.Identity(), pose], movable=[1])
        assert solution.poses[1].translation[2] == pytest.approx(end, abs=1e-12)


def test_a_screw_advances_its_pitch_in_a_turn_and_a_left_hand_one_backs_out() -> None:
    thread = Cylinder([0, 0, 0], [0, 0, 1], 0.005)
    for pitch in (2e-3, -1e-3):
        screw = Screw(AB, (thread, thread), pitch=pitch)
        pose = pin.SE3.Identity()
        for _ in range(24):  # two turns, by the hand turning it 30° and the thread pulling it along
            turned = pose * pin.SE3(pin.exp3(np.array([0, 0, pi / 6])), np.zeros(3))
            hold = Fixed.between((2, 1), pin.SE3.Identity(), turned)
            turn_only = Parallel((2, 1), (Plane([0, 0, 0], hold.relative.rotation[:, 0]), Plane([0, 0, 0], [1, 0, 0])))
            poses = [pin.SE3.Identity(), turned, pin.SE3.Identity()]
            pose = solve([screw, turn_only], poses, movable=[1]).poses[1]
        assert pose.translation == pytest.approx([0, 0, 2 * pitch], abs=1e-11)


def test_a_gear_pair_turns_by_its_teeth_and_a_planet_rolls_on_its_carrier() -> None:
    wheels = Cylinder([0, 0, 0], [0, 0, 1], 0.02), Cylinder([0, 0, 0], [0, 0, 1], 0.01)
    b0 = pin.SE3(np.eye(3), np.array([0.03, 0, 0]))
    gear = Gear(AB, wheels, teeth_a=40, teeth_b=20).engaged(pin.SE3.Identity(), b0)
    spin = lambda angle: pin.SE3(pin.exp3(np.array([0, 0, angle])), np.zeros(3))  # noqa: E731
    for turn in (0.02, 0.3, 2.0, 7.0):
        assert gear.residual(spin(turn), b0 * spin(-2 * turn))[0] == pytest.approx(0, abs=1e-12)
        assert gear.residual(spin(0.0), spin(turn) * b0 * spin(2 * turn))[0] == pytest.approx(0, abs=1e-12)
    assert abs(gear.residual(spin(0.02), b0)[0]) == pytest.approx(0.02, abs=1e-12)
    belt = Belt(AB, wheels, teeth_a=40, teeth_b=20).engaged(pin.SE3.Identity(), b0)
    assert belt.residual(spin(0.3), b0 * spin(0.6))[0] == pytest.approx(0, abs=1e-12)


def test_a_pinion_moves_its_rack_by_the_arc() -> None:
    rack0 = pin.SE3(np.eye(3), np.array([0, -0.02, 0]))
    pair = (Cylinder([0, 0, 0], [0, 0, 1], 0.02), Line([0, 0, 0], [1, 0, 0]))
    rack = RackAndPinion(AB, pair, radius=0.02, teeth=25).engaged(pin.SE3.Identity(), rack0)
    for turn in (0.01, 0.5, 3.0):
        moved = pin.SE3(np.eye(3), np.array([0.02 * turn, -0.02, 0]))
        assert rack.residual(pin.SE3(pin.exp3(np.array([0, 0, turn])), np.zeros(3)), moved)[0] == pytest.approx(
            0, abs=1e-12
        )


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: Against(AB, (PLANES[0], SPHERES[0])), "features[1]"),
        (lambda: Against((2, 2), PLANES), "bodies"),
        (lambda: Against(AB, PLANES, size=0.0), "size"),
        (lambda: Concentric(AB, CYLINDERS, sense=2), "sense"),
        (lambda: Tangent(AB, CYLINDERS, mode="beside"), "mode"),
        (lambda: Tangent(AB, (CYLINDERS[0], CYLINDERS[0]), mode="inside"), "mode"),
        (lambda: Tangent(AB, (CONES[0], TORI[0])), "features"),
        (lambda: Contact(AB, CYLINDERS), "features"),
        (lambda: Angle(AB, PLANES, at=0.0), "at"),
        (lambda: Angle(AB, PLANES, at=(0.4, 0.3)), "limits"),
        (lambda: Distance(AB, PLANES), "features"),
        (lambda: Distance(AB, POINTS, at=-1.0), "at"),
        (lambda: Distance(AB, POINTS, at=0.0), "at"),
        (lambda: Screw(AB, CYLINDERS, pitch=0.0), "pitch"),
        (lambda: Screw(AB, CYLINDERS, pitch=float("nan")), "parameters"),
        (lambda: Distance(AB, POINTS, at=float("nan")), "limits"),
        (lambda: Gear(AB, CYLINDERS, teeth_a=0), "teeth_a"),
        (lambda: Gear(AB, CYLINDERS, sense=0), "sense"),
        (lambda: RackAndPinion(AB, (CYLINDERS[0], LINES[0]), radius=-1.0), "radius"),
    ],
)
def test_a_constraint_that_cannot_be_is_refused_with_the_field_at_fault(make: object, field: str) -> None:
    with pytest.raises(GeometryError) as caught:
        make()
    assert caught.value.field == field


def test_opposed_directions_still_know_which_way_to_turn() -> None:
    """Exactly upside down has no nearest way round; any half turn will do, but it must not stay there."""
    up, down = Plane([0, 0, 0], [0, 0, 1]), Plane([0, 0, 0], [0, 0, -1])
    flipped = pin.SE3(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
    for start in (flipped, pin.SE3(pin.exp3(np.array([0.0, pi - 1e-9, 0.0])), np.zeros(3))):
        solution = solve([Against(AB, (up, down))], [pin.SE3.Identity(), start], movable=[1])
        assert solution.converged
        assert solution.poses[1].rotation[2, 2] == pytest.approx(1.0, abs=1e-12)
    fixed = Fixed(AB, POINTS)
    solution = solve([fixed], [pin.SE3.Identity(), flipped], movable=[1])
    assert solution.converged
    assert solution.poses[1].isIdentity(1e-11)


@each_kind
def test_the_symbol_is_drawn_on_body_a_and_moves_with_it(constraint: Constraint, freedom: int) -> None:
    rng = np.random.default_rng(3)
    pose, move = random_pose(rng), random_pose(rng)
    here, there = constraint.drawing(pose), constraint.drawing(move * pose)
    assert here.shape in ("plane", "axis", "point", "rigid")
    assert here.size == constraint.size
    assert np.linalg.norm(here.direction) == pytest.approx(1.0)
    assert there.origin == pytest.approx(move.act(here.origin))
    assert there.direction == pytest.approx(move.rotation @ here.direction)
    feature = constraint.features[0].transformed(pose)
    if isinstance(feature, Plane):
        assert feature.distance([here.origin])[0] == pytest.approx(0.0, abs=1e-12)
    elif isinstance(feature, (Cylinder, Sphere)) and not isinstance(constraint, Fixed):
        assert feature.distance([here.origin])[0] == pytest.approx(-feature.radius)  # on the axis, at the centre


@each_kind
def test_degenerate_poses_give_finite_rows(constraint: Constraint, freedom: int) -> None:
    """Features on top of one another; axes parallel, opposed and crossed; a wheel on its own axis: no NaN, no error."""
    frames = [constraint.compiled.element[0, :12], constraint.compiled.element[0, 12:]]
    if constraint.compiled.side[0, 0]:
        frames.reverse()
    to_feature = [pin.SE3(np.column_stack([f[3:6], f[6:9], f[9:12]]), f[0:3].copy()) for f in frames]
    turns = [np.zeros(3), [pi, 0, 0], [0, pi, 0], [0, 0, pi], [pi / 2, 0, 0], [1e-9, 0, 0], [pi - 1e-9, 0, 0]]
    for turn in turns:
        for shift in (np.zeros(3), [0, 0, 0.1], [0.1, 0, 0], [1e-12, 0, 0]):
            between = pin.SE3(pin.exp3(np.array(turn, dtype=float)), np.array(shift, dtype=float))
            pose = to_feature[0] * between * to_feature[1].inverse()
            residual = constraint.residual(pin.SE3.Identity(), pose)
            assert np.isfinite(residual).all()
            assert all(np.isfinite(j).all() for j in constraint.jacobian(pin.SE3.Identity(), pose))


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-6, 9e-5, 1.1e-4, 1e-3, 0.5, 2.0, 3.0])
@pytest.mark.parametrize(
    "constraint", [Parallel(AB, PLANES, sense=1), Parallel(AB, PLANES, sense=-1), Fixed(AB, POINTS)]
)
def test_rotation_rows_are_right_at_every_angle(constraint: Constraint, angle: float) -> None:
    """Series and closed form meet; near the pole, at 3 rad, too."""
    frames = constraint.compiled.element[0].reshape(2, 12)
    a, b = (np.column_stack([f[3:6], f[6:9], f[9:12]]) for f in frames)
    flip = np.diag([1.0, -1.0, -1.0]) if getattr(constraint, "sense", 1) == -1 else np.eye(3)
    turn = pin.exp3(angle * np.array([0.6, 0.8, 0.0]))
    pose = pin.SE3(a @ turn @ flip @ b.T, np.zeros(3))
    first, second = pin.SE3.Identity(), pose
    assert np.linalg.norm(constraint.residual(first, second)) == pytest.approx(angle, abs=1e-15, rel=1e-9)
    for exact, numeric in zip(
        constraint.jacobian(first, second), differences(constraint, first, second, 1e-4), strict=True
    ):
        assert np.abs(exact - numeric).max() < 2e-7 * max(1.0, np.abs(exact).max() ** 2)
