"""The solver: residuals end below 1e-12, what need not move stays, and the solution found is the nearest."""

from math import pi

import numpy as np
import pinocchio as pin
import pytest

from collision import Tolerance
from constraints.errors import ConstraintsError
from constraints.geometry.surfaces import Cylinder, Plane, Sphere
from constraints.kinds import (
    Against,
    Angle,
    Concentric,
    Constraint,
    Coplanar,
    Distance,
    Fixed,
    Gear,
    Offset,
    Parallel,
    Point,
    Spherical,
    Tangent,
)
from constraints.solve.solver import solve
from tests.constraints import problems
from tests.constraints.problems import Problem

AB = (0, 1)
HOME = pin.SE3.Identity()
Z = np.array([0.0, 0.0, 1.0])
PROBLEMS = {
    "bolted plate": problems.bolted_plate(20),
    "chain of 10": problems.chain(10),
    "chain of 100": problems.chain(100),
    **problems.LINKAGES,
    "slider crank at its dead point": problems.slider_crank(0.0),
    "four-bolt flange": problems.flange(),
    "machine of 1,000 constraints": problems.machine(),
    "lattice of parallelograms": problems.lattice(8, 6),
}


def turned(axis: list[float], angle: float, at: list[float] | np.ndarray = (0.0, 0.0, 0.0)) -> pin.SE3:
    return pin.SE3(pin.exp3(angle * np.asarray(axis, float) / np.linalg.norm(axis)), np.asarray(at, float))


@pytest.mark.parametrize("problem", PROBLEMS.values(), ids=PROBLEMS.keys())
@pytest.mark.parametrize("seed", range(3))
def test_consistent_systems_end_below_1e12_from_a_tenth_of_the_size_and_30_degrees(problem: Problem, seed: int) -> None:
    assert problem.residual(problem.poses) < 1e-12  # the truth is one
    start = problem.shaken(0.1 * problem.size, pi / 6, seed)
    solution = solve(problem.constraints, start, problem.movable)
    assert solution.converged
    assert solution.residual <= 1e-12
    assert not solution.conflicting
    assert problem.residual({0: start[0], **solution.poses}) < 2e-12  # by their own formulas, at the poses returned
    again = solve(problem.constraints, {0: start[0], **solution.poses}, problem.movable)
    assert again.iterations <= len(problem.poses)  # at most a last rounding a component
    assert all(p.rotation.T @ p.rotation == pytest.approx(np.eye(3), abs=1e-14) for p in solution.poses.values())


def test_random_assemblies_with_loops_come_together_from_30_degrees_off() -> None:
    """Each body off its own way, so 60° between two: 99 in 100 are found, and a miss is never called a solution."""
    missed = 0
    for seed in range(200):
        problem = problems.random_assembly(seed)
        assert problem.residual(problem.poses) < 1e-12
        start = problem.shaken(0.01, pi / 6, seed)
        solution = solve(problem.constraints, start, problem.movable)
        held = problem.residual({0: start[0], **solution.poses}) < 2e-12
        assert solution.converged == held
        missed += not held
    assert missed <= 2


def test_same_input_same_bits() -> None:
    problem = problems.lattice(5, 5)
    start = problem.shaken(0.01, 0.3, 5)
    first, second = (solve(problem.constraints, start, problem.movable) for _ in range(2))
    assert all((first.poses[b].homogeneous == second.poses[b].homogeneous).all() for b in problem.movable)


def test_a_solved_system_is_left_alone_to_the_last_bit() -> None:
    problem = problems.bolted_plate(3)
    solution = solve(problem.constraints, problem.poses, problem.movable)
    assert solution.iterations == 0
    assert all(solution.poses[b] is problem.poses[b] for b in problem.movable)


def test_only_components_that_move_and_do_not_hold_are_touched() -> None:
    problem = problems.bolted_plate(4)
    start = list(problem.poses)
    start[2] = start[2] * turned([1, 0, 0], 0.2, [0.001, 0, 0])
    solution = solve(problem.constraints, start, problem.movable)
    assert solution.poses[1] is start[1] and solution.poses[3] is start[3]
    assert solution.poses[2] is not start[2]
    only = solve(problem.constraints, start, [1])  # bolt 2 is off, but is not asked for
    assert set(only.poses) == {1} and only.converged


def test_bodies_share_the_move_and_the_fixed_one_does_not() -> None:
    ball = Spherical(AB, (Sphere([0, 0, 0], 0.01), Sphere([0, 0, 0], 0.01)))
    apart = pin.SE3(np.eye(3), np.array([0.2, 0, 0]))
    both = solve([ball], [HOME, apart], [0, 1])
    assert both.poses[0].translation == pytest.approx([0.1, 0, 0], abs=1e-9)
    assert both.poses[1].translation == pytest.approx([0.1, 0, 0], abs=1e-9)
    assert solve([ball], [HOME, apart], [1]).poses[1].translation == pytest.approx([0, 0, 0], abs=1e-12)


def test_two_fixed_bodies_are_no_business_of_the_solver() -> None:
    ball = Spherical(AB, (Sphere([0, 0, 0], 0.01), Sphere([0.1, 0, 0], 0.01)))
    solution = solve([ball], [HOME, HOME], [])
    assert solution.poses == {} and solution.converged and solution.residual == 0.0


class TestNearest:
    """Chirality and branch: the solution on the side where the start is."""

    def test_a_face_is_not_turned_over(self) -> None:
        up, down = Plane([0, 0, 0], Z), Plane([0, 0, 0], -Z)
        for kind, sign in ((Against, 1.0), (Coplanar, -1.0)):
            for angle in (0.1, 1.0, 2.0, 3.0):
                solution = solve([kind(AB, (up, down))], [HOME, turned([0.3, 1, 0], angle)], [1])
                assert solution.poses[1].rotation[2, 2] == pytest.approx(sign, abs=1e-12)

    def test_least_turn_and_least_push_onto_a_face(self) -> None:
        against = Against(AB, (Plane([0, 0, 0], Z), Plane([0, 0, 0], -Z)))
        start = turned([1, 2, 0.5], 0.5, [0.3, -0.2, 0.1])
        tilt = np.arccos(start.rotation[2, 2])
        end = solve([against], [HOME, start], [1]).poses[1]
        assert np.linalg.norm(pin.log3(start.rotation.T @ end.rotation)) == pytest.approx(tilt, abs=1e-12)
        assert end.translation == pytest.approx([0.3, -0.2, 0], abs=1e-12)

    def test_a_shaft_goes_in_by_its_nearer_end_unless_told(self) -> None:
        shaft = Cylinder([0, 0, 0], Z, 0.01)
        for angle, sign in ((0.5, 1.0), (pi - 0.5, -1.0)):
            end = solve([Concentric(AB, (shaft, shaft))], [HOME, turned([1, 0, 0], angle)], [1]).poses[1]
            assert end.rotation[2, 2] == pytest.approx(sign, abs=1e-12)
            end = solve([Concentric(AB, (shaft, shaft), sense=-1)], [HOME, turned([1, 0, 0], angle)], [1]).poses[1]
            assert end.rotation[2, 2] == pytest.approx(-1.0, abs=1e-12)

    def test_parallel_takes_the_nearer_sense(self) -> None:
        a, b = Plane([0, 0, 0], Z), Plane([0, 0, 0], Z)
        for angle, sign in ((1.4, 1.0), (1.8, -1.0)):
            end = solve([Parallel(AB, (a, b))], [HOME, turned([1, 0, 0], angle)], [1]).poses[1]
            assert end.rotation[2, 2] == pytest.approx(sign, abs=1e-12)

    def test_a_door_opens_to_the_side_it_is_on(self) -> None:
        hinge = problems.hinge(0, 1, HOME, HOME, np.zeros(3), Z, 0.1)
        door = Angle(AB, (Plane([0, 0, 0], [1, 0, 0]), Plane([0, 0, 0], [1, 0, 0])), at=0.5)
        for side in (1.0, -1.0):
            end = solve([*hinge, door], [HOME, turned([0, 0, 1], 0.2 * side, [0.001, 0, 0.002])], [1]).poses[1]
            assert np.arctan2(end.rotation[1, 0], end.rotation[0, 0]) == pytest.approx(0.5 * side, abs=1e-12)

    def test_a_ball_stays_on_its_side_of_what_it_touches(self) -> None:
        ball, other = Sphere([0, 0, 0], 0.01), Sphere([0, 0, 0], 0.02)
        for x in (0.05, -0.05, 0.001, -0.001):
            end = solve([Tangent(AB, (other, ball))], [HOME, pin.SE3(np.eye(3), np.array([x, 0, 0]))], [1]).poses[1]
            assert end.translation == pytest.approx([0.03 * np.sign(x), 0, 0], abs=1e-12)

    def test_crossed_rods_stay_above_or_below(self) -> None:
        rods = Cylinder([0, 0, 0], [1, 0, 0], 0.01), Cylinder([0, 0, 0], [0, 1, 0], 0.01)
        for z in (0.05, -0.05, 0.003, -0.003):
            start = turned([0, 0, 1], 0.3, [0, 0, z])
            end = solve([Tangent(AB, rods, mode="crossed")], [HOME, start], [1]).poses[1]
            assert end.translation[2] == pytest.approx(0.02 * np.sign(z), abs=1e-12)

    def test_a_four_bar_keeps_its_elbow(self) -> None:
        up = problems.four_bar()
        for seed in range(10):
            start = up.shaken(0.004, 0.2, seed)
            end = {0: HOME, **solve(up.constraints, start, up.movable).poses}
            side = [end[2].rotation[:, 0] @ up.poses[2].rotation[:, 0], end[3].rotation[2, 2]]
            assert min(side) > 0.5  # the other assembly turns coupler and rocker by about a right angle and more

    def test_a_gear_takes_the_nearest_tooth(self) -> None:
        wheels = Cylinder([0, 0, 0], Z, 0.02), Cylinder([0, 0, 0], Z, 0.02)
        b = pin.SE3(np.eye(3), np.array([0.04, 0, 0]))
        gear = Gear(AB, wheels, teeth_a=20, teeth_b=20).engaged(HOME, b)
        axle = problems.hinge(2, 1, HOME, b, np.array([0.04, 0, 0]), Z, 0.02)
        tooth = 2 * pi / 20
        end = solve([gear, *axle], [HOME, b * turned([0, 0, 1], 3.3 * tooth), HOME], [1]).poses[1]
        assert np.arctan2(end.rotation[1, 0], end.rotation[0, 0]) == pytest.approx(3 * tooth, abs=1e-11)


class TestHardCases:
    @pytest.mark.parametrize("tilt", [1e-3, 1e-5, 1e-7, 1e-9])
    def test_near_parallel_axes_and_planes_that_agree(self, tilt: float) -> None:
        n = np.array([0.0, np.sin(tilt), np.cos(tilt)])
        holes = [Cylinder([0, 0, 0], Z, 0.005), Cylinder([0.05, 0, 0], n, 0.005)]
        faces = [Plane([0, 0, 0], Z), Plane([0.05, 0, 0], n)]
        backs = [Plane([0, 0, 0], -Z), Plane([0.05, 0, 0], -n)]
        for constraints in (
            [Concentric(AB, (h, h), size=0.005) for h in holes],
            [Against(AB, pair, size=0.05) for pair in zip(faces, backs, strict=True)],
        ):
            problem = Problem(tuple(constraints), (HOME, HOME), 0.1)
            for seed in range(5):
                start = problem.shaken(0.01, pi / 6, seed)
                solution = solve(constraints, start, [1])
                assert solution.converged
                moved = np.linalg.norm(solution.poses[1].translation - start[1].translation)
                assert moved < 0.05  # never far away for the sake of an angle of 1e-7

    @pytest.mark.parametrize("tilt", [1e-3, 1e-5, 1e-7])
    def test_near_parallel_planes_that_disagree_are_split_and_not_fled_from(self, tilt: float) -> None:
        n = np.array([0.0, np.sin(tilt), np.cos(tilt)])
        constraints = [
            Against(AB, (Plane([0, 0, 0], Z), Plane([0, 0, 0], -Z))),
            Against(AB, (Plane([0.05, 0, 0], n), Plane([0.05, 0, 0], -Z))),
        ]
        for seed in range(5):
            start = Problem(tuple(constraints), (HOME, HOME), 0.1).shaken(0.01, 0.3, seed)
            solution = solve(constraints, start, [1])
            assert not solution.converged
            assert solution.conflicting == (0, 1)
            assert solution.residual == pytest.approx(tilt / 2, rel=0.02)
            assert np.linalg.norm(solution.poses[1].translation - start[1].translation) < 0.02

    @pytest.mark.parametrize("size", [1e-4, 1.0, 1e3])
    def test_the_unit_of_length_does_not_matter(self, size: float) -> None:
        at = size * np.array([1.0, 2.0, 0.3])
        bore, shaft = Cylinder(at, Z, 0.1 * size), Cylinder([0, 0, 0], Z, 0.1 * size)
        constraints: list[Constraint] = [
            Concentric(AB, (bore, shaft), size=0.1 * size),
            Against(AB, (Plane(at, Z), Plane([0, 0, 0], -Z)), size=0.2 * size),
        ]
        problem = Problem(tuple(constraints), (HOME, pin.SE3(np.eye(3), at)), size)
        for seed in range(5):
            solution = solve(constraints, problem.shaken(0.1 * size, pi / 6, seed), [1])
            assert solution.converged
            assert solution.residual <= 1e-12
            assert problem.residual({0: HOME, **solution.poses}) <= max(1e-12, 1e-15 * size)

    def test_tiny_beside_huge(self) -> None:
        far = np.array([400.0, 300.0, 10.0])
        constraints = [
            Against(AB, (Plane([0, 0, 0], Z), Plane([0, 0, 0], -Z)), size=500.0),
            Concentric((1, 2), (Cylinder(far, Z, 3e-5), Cylinder([0, 0, 0], Z, 3e-5)), size=3e-5),
            Against((1, 2), (Plane(far, Z), Plane([0, 0, 0], -Z)), size=1e-4),
        ]
        problem = Problem(tuple(constraints), (HOME, HOME, pin.SE3(np.eye(3), far)), 1e-4)
        start = problem.shaken(1e-5, 0.5, 1)
        start[1] = turned([1, 0, 0], 1e-3, [0.1, 0, 0.5])
        solution = solve(constraints, start, [1, 2])
        assert solution.converged
        poses = {0: HOME, **solution.poses}
        assert problem.residual(poses) <= 1e-12 + 4 * np.spacing(500.0)
        assert np.linalg.norm(poses[1].translation - start[1].translation) < 1.0  # the huge one keeps its place
        seated = poses[1].inverse() * poses[2]
        assert seated.translation == pytest.approx(far, abs=1e-11)

    def test_radii_equal_to_1e9_touch_on_the_inside(self) -> None:
        bore, shaft = Cylinder([0, 0, 0], Z, 0.01), Cylinder([0, 0, 0], Z, 0.01 - 1e-9)
        start = turned([1, 0, 0], 0.3, [0.002, 0.001, 0])
        solution = solve([Tangent(AB, (bore, shaft), mode="inside")], [HOME, start], [1])
        assert solution.converged
        assert np.hypot(*solution.poses[1].translation[:2]) == pytest.approx(1e-9, abs=1e-12)

    def test_half_bores_and_a_plane_split_in_ten_say_one_thing(self) -> None:
        bore, shaft = Cylinder([0, 0, 0], Z, 0.01), Cylinder([0, 0, 0], Z, 0.01)
        other = Cylinder([0, 0, 0.03], -Z, 0.01)  # the other half, as a file may write it
        faces = [(Plane([0.01 * k, 0.02, 0], Z), Plane([0.01 * k, -0.01, 0], -Z)) for k in range(10)]
        constraints = [Concentric(AB, (bore, shaft), sense=1), Concentric(AB, (other, shaft), sense=-1)]
        constraints += [Against(AB, pair) for pair in faces]
        problem = Problem(tuple(constraints), (HOME, HOME), 0.1)
        for seed in range(5):
            solution = solve(constraints, problem.shaken(0.01, pi / 6, seed), [1])
            assert solution.converged

    def test_identical_parts_that_coincide_stay(self) -> None:
        problem = problems.bolted_plate(2)
        poses = [HOME, problem.poses[1], problem.poses[1]]  # both bolts in the first hole
        both = [problem.constraints[0], problem.constraints[1]]
        both += [Concentric((0, 2), both[0].features), Against((0, 2), both[1].features)]
        solution = solve(both, poses, [1, 2])
        assert solution.converged and solution.iterations == 0

    @pytest.mark.parametrize("error", [1e-6, 1e-2])
    def test_an_inconsistent_flange_is_said_to_be_and_ends_at_least_squares(self, error: float) -> None:
        problem = problems.flange(4, error)
        solution = solve(problem.constraints, problem.shaken(0.01, 0.3, 2), [1])
        assert not solution.converged
        assert 0.3 * error < solution.residual < 0.8 * error
        assert 4 in solution.conflicting
        again = solve(problem.constraints, {0: HOME, **solution.poses}, [1])
        assert again.poses[1].translation == pytest.approx(solution.poses[1].translation, abs=1e-3 * error)

    def test_an_inconsistency_within_the_tolerance_given_is_none(self) -> None:
        problem = problems.flange(4, 1e-6)
        solution = solve(problem.constraints, problem.shaken(0.01, 0.3, 2), [1], Tolerance(solver=1e-5))
        assert solution.converged

    def test_deleting_in_the_middle_of_a_motion(self) -> None:
        """A crank turned step by step; half way a rocker's hinge is taken out, then put back."""
        problem = problems.four_bar()
        poses = dict(enumerate(problem.poses))
        constraints = list(problem.constraints)
        taken = constraints[4:6]
        for step in range(60):
            if step == 20:
                del constraints[4:6]
            if step == 40:
                constraints[4:4] = taken
            wanted = poses[1] * turned([0, 0, 1], 0.01)
            drive = Fixed.between((9, 1), HOME, wanted)
            drive = Parallel((9, 1), (Plane([0, 0, 0], drive.relative.rotation[:, 0]), Plane([0, 0, 0], [1, 0, 0])))
            solution = solve([*constraints, drive], {**poses, 9: HOME}, problem.movable)
            assert solution.converged
            moved = max(np.linalg.norm(solution.poses[b].translation - poses[b].translation) for b in (1, 2, 3))
            assert moved < 0.01  # no jump, neither at the loss nor at the return
            poses.update(solution.poses)
            for c in constraints:
                assert np.abs(c.residual(poses[c.bodies[0]], poses[c.bodies[1]])).max() <= 2e-12

    def test_a_thousand_steps_do_not_drift(self) -> None:
        """The residual of a step does not grow with their number, and a rotation stays one."""
        problem = problems.bolted_plate(1)
        pose = problem.poses[1]
        worst = []
        for _ in range(1000):
            pose = solve(problem.constraints, [HOME, pose * turned([0, 0, 1], 0.1, [1e-4, 0, 1e-4])], [1]).poses[1]
            worst.append(problem.residual([HOME, pose]))
        assert max(worst) <= 1e-12
        assert pose.rotation.T @ pose.rotation == pytest.approx(np.eye(3), abs=1e-14)


def test_limits_hold_together_with_equalities() -> None:
    rail = [
        Concentric(AB, (Cylinder([0, 0, 0], Z, 0.01), Cylinder([0, 0, 0], Z, 0.01)), sense=1),
        Parallel(AB, (Plane([0, 0, 0], [1, 0, 0]), Plane([0, 0, 0], [1, 0, 0])), sense=1),
    ]
    stop = Distance(AB, (Plane([0, 0, 0], Z), Point([0, 0, 0])), at=(0.0, 0.1))
    for z, end in ((0.05, 0.05), (0.3, 0.1), (-0.2, 0.0)):
        solution = solve([*rail, stop], [HOME, turned([1, 1, 1], 0.3, [0.01, 0, z])], [1])
        assert solution.converged
        assert solution.poses[1].translation == pytest.approx([0, 0, end], abs=1e-12)


def test_what_cannot_be_solved_is_named() -> None:
    offset = Offset((0, 3), (Plane([0, 0, 0], Z), Plane([0, 0, 0], Z)))
    with pytest.raises(ConstraintsError, match="body 3"):
        solve([offset], [HOME, HOME], [3])
    bad = pin.SE3(np.eye(3), np.array([0.0, np.nan, 0.0]))
    with pytest.raises(ConstraintsError, match="body 3 is not finite"):
        solve([offset], {0: HOME, 3: bad}, [3])
