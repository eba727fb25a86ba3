"""Freedom of joints and mechanisms against what the textbook says, and against one dense decomposition of the whole."""

import numpy as np
import pinocchio as pin
import pytest

from constraints.freedom.mobility import mobility
from constraints.geometry.surfaces import Cylinder, Plane, Sphere
from constraints.kinds import Against, Concentric, Contact, Gear, Line, Point, Spherical, Tangent
from constraints.solve.system import systems
from tests.constraints import problems
from tests.constraints.problems import Problem, hinge

AB = (0, 1)
HOME = pin.SE3.Identity()
X, Y, Z = np.eye(3)
ORIGIN = np.zeros(3)
SHAFT = Cylinder(ORIGIN, Z, 0.01)
UP, DOWN = Plane(ORIGIN, Z), Plane(ORIGIN, -Z)
MECHANISMS = {
    "bolted plate": problems.bolted_plate(6),
    "chain": problems.chain(7),
    **problems.LINKAGES,
    "flange": problems.flange(),
    "machine": problems.machine(2, 4),
    "lattice": problems.lattice(4, 3),
}


@pytest.mark.parametrize(
    ("name", "freedom", "finite", "joints"),
    [
        ("four-bar", 1, 1, ["revolute", "1-dof", "revolute"]),
        ("parallelogram", 1, 1, ["revolute", "1-dof", "revolute"]),
        ("parallelogram, flat", 2, 1, ["revolute", "2-dof", "revolute"]),
        ("stretched pair", 1, 0, ["1-dof", "1-dof"]),
        ("Bennett", 1, 1, ["revolute", "1-dof", "revolute"]),
        ("Sarrus", 1, 1, ["prismatic", "revolute", "1-dof", "revolute", "1-dof"]),
        ("slider crank", 1, 1, ["revolute", "1-dof", "prismatic"]),
        ("flange", 0, 0, ["rigid"]),
        ("bolted plate", 6, 6, ["revolute"] * 6),
        ("chain", 7, 7, ["revolute", "2-dof", "3-dof", "4-dof", "4-dof", "4-dof", "4-dof"]),
        ("machine", 0, 0, ["rigid"] * 10),
    ],
)
def test_mechanisms_move_as_they_do(name: str, freedom: int, finite: int, joints: list[str]) -> None:
    problem = MECHANISMS[name]
    found = mobility(problem.constraints, problem.poses, [0])
    assert (found.freedom, found.finite) == (freedom, finite)
    assert [f.joint for f in found.parts.values()] == joints


@pytest.mark.parametrize(
    "problem",
    [pytest.param(p, id=name, marks=[pytest.mark.slow] * (name == "Bennett")) for name, p in MECHANISMS.items()],
)
def test_freedom_by_blocks_is_the_freedom_of_the_whole(problem: Problem) -> None:
    """One singular value decomposition of everything at once, and the part's rows of its null space."""
    found = mobility(problem.constraints, problem.poses, [0])
    total = 0
    for system in systems(problem.constraints, frozenset(problem.movable)):
        _, jacobian = system.dense(*system.gather(problem.poses))
        _, s, vt = np.linalg.svd(jacobian)
        null = vt[int(np.sum(s > 1e-9 * s[0])) :]
        total += len(null)
        for slot, body in enumerate(system.movable):
            own = null[:, 6 * slot : 6 * slot + 6]
            assert found.parts[body].freedom == np.linalg.matrix_rank(own, tol=1e-7)
    assert found.freedom == total


def test_a_slider_crank_is_the_same_mechanism_at_any_pose() -> None:
    for angle in (0.3, 1.2, 2.5):
        problem = problems.slider_crank(angle)
        assert [f.joint for f in mobility(problem.constraints, problem.poses, [0]).parts.values()] == [
            "revolute",
            "1-dof",
            "prismatic",
        ]


def test_gears_share_one_freedom_and_a_differential_has_two() -> None:
    wheels = [Cylinder([0, 0, 0], Z, 0.02), Cylinder([0, 0, 0], Z, 0.01)]
    poses = [HOME, HOME, pin.SE3(np.eye(3), np.array([0.03, 0, 0])), HOME]
    mesh = Gear((1, 2), (wheels[0], wheels[1]), teeth_a=40, teeth_b=20).engaged(poses[1], poses[2])
    axles = hinge(0, 1, HOME, poses[1], ORIGIN, Z, 0.02) + hinge(0, 2, HOME, poses[2], poses[2].translation, Z, 0.02)
    found = mobility([*axles, mesh], poses[:3], [0])
    assert (found.freedom, found.finite) == (1, 1)
    assert [found.parts[b].joint for b in (1, 2)] == ["revolute", "revolute"]
    carrier = hinge(0, 3, HOME, HOME, ORIGIN, Z, 0.05) + hinge(3, 2, HOME, poses[2], poses[2].translation, Z, 0.02)
    planet = mobility([*hinge(0, 1, HOME, HOME, ORIGIN, Z, 0.02), *carrier, mesh], poses, [0])
    assert (planet.freedom, planet.finite) == (2, 2)


def test_an_assembly_without_a_fixed_part_is_free_and_its_pairs_are_not() -> None:
    problem = problems.four_bar()
    found = mobility(problem.constraints, problem.poses, [])
    assert {f.joint for f in found.parts.values()} == {"free"}
    assert found.freedom == 7
    assert all(f.joint == "revolute" for f in found.pairs.values())


def test_a_part_that_nothing_constrains_is_free_and_counts_for_nothing() -> None:
    found = mobility([], [HOME, HOME], [0])
    assert found.parts[1].joint == "free" and found.parts[1].freedom == 6
    assert found.freedom == 0 and not found.redundant and not found.conflicting


def test_mobility_is_of_the_solved_pose() -> None:
    problem = problems.four_bar()
    found = mobility(problem.constraints, problem.shaken(0.002, 0.05, 3), [0])
    assert (found.freedom, found.parts[1].joint) == (1, "revolute")
    assert found.residual <= 1e-12


@pytest.mark.parametrize("size", [1e-4, 1.0, 1e3])
def test_freedom_does_not_depend_on_the_size(size: float) -> None:
    at = size * np.array([1.0, 2.0, 0.3])
    shaft = Cylinder([0, 0, 0], Z, 0.1 * size)
    poses = [HOME, pin.SE3(np.eye(3), at)]
    concentric = Concentric(AB, (Cylinder(at, Z, 0.1 * size), shaft), size=0.1 * size)
    against = Against(AB, (Plane(at, Z), DOWN), size=0.2 * size)
    assert mobility([concentric], poses, [0]).parts[1].joint == "cylindrical"
    assert mobility([concentric, against], poses, [0]).parts[1].joint == "revolute"


def test_tiny_beside_huge_each_has_its_joint() -> None:
    far = np.array([400.0, 300.0, 10.0])
    constraints = [
        Against(AB, (UP, DOWN), size=500.0),
        Concentric((1, 2), (Cylinder(far, Z, 3e-5), Cylinder(ORIGIN, Z, 3e-5)), size=3e-5),
        Against((1, 2), (Plane(far, Z), DOWN), size=1e-4),
    ]
    found = mobility(constraints, [HOME, HOME, pin.SE3(np.eye(3), far)], [0])
    assert found.parts[1].joint == "planar"
    assert found.pairs[1, 2].joint == "revolute"
    assert found.freedom == 4


def test_planes_that_are_nearly_parallel_say_how_nearly() -> None:
    """1e-7 rad apart and consistent, they do stop the turn; `margin` tells that it hangs by a hair."""
    n = np.array([0.0, np.sin(1e-7), np.cos(1e-7)])
    pairs = [(UP, DOWN), (Plane([0.05, 0, 0], n), Plane([0.05, 0, 0], -n))]
    found = mobility([Against(AB, p, size=0.05) for p in pairs], [HOME, HOME], [0])
    assert found.parts[1].joint == "prismatic"
    assert 1e-9 < found.margin < 1e-6
    skew = mobility([Against(AB, (UP, DOWN)), Against(AB, (pairs[1][0], DOWN))], [HOME, HOME], [0])
    assert skew.parts[1].joint == "planar"  # inconsistent by 1e-7: no more is known than that


def test_a_ball_in_a_bore_and_a_rod_on_a_table() -> None:
    ball = mobility([Contact(AB, (Line(ORIGIN, Z), Point(ORIGIN)))], [HOME, HOME], [0])
    assert ball.parts[1].freedom == 4
    rod = Tangent(AB, (UP, Cylinder([0, 0, 0.01], X, 0.01)))
    assert mobility([rod], [HOME, HOME], [0]).parts[1].freedom == 4


class TestWords:
    NAMES = ("plate", "bolt_2", "cover")

    def test_a_wholly_redundant_constraint_names_what_implies_it(self) -> None:
        dowels = [Concentric((0, 2), (c, c)) for c in (Cylinder([x, 0, 0], Z, 0.004) for x in (0.0, 0.1, 0.2))]
        found = mobility([Against((0, 2), (UP, DOWN)), *dowels], [HOME] * 3, [0], names=self.NAMES)
        whole = [r for r in found.redundant if r.wholly]
        assert [(r.constraint, r.by) for r in whole] == [(3, (0, 1, 2))]
        assert whole[0].text == (
            "concentric between plate and cover (no. 3) is implied by against between plate and cover, "
            "concentric between plate and cover (no. 1) and concentric between plate and cover (no. 2)"
        )

    def test_the_same_said_twice_is_implied_by_its_twin_alone(self) -> None:
        twice = [
            Concentric((0, 1), (SHAFT, SHAFT), surfaces=((3,), (1,))),
            Against((0, 2), (UP, DOWN)),
            Concentric((0, 1), (SHAFT, SHAFT), surfaces=((4, 5), (1,))),
        ]
        (found,) = mobility(twice, [HOME] * 3, [0], names=self.NAMES).redundant
        assert found.by == (0,) and found.wholly
        assert found.text == (
            "concentric between plate and bolt_2 (faces 4,5 and 1) is implied by "
            "concentric between plate and bolt_2 (faces 3 and 1)"
        )

    def test_part_of_a_constraint_may_be_implied(self) -> None:
        pair = [Concentric((0, 1), (SHAFT, SHAFT)), Against((0, 1), (UP, DOWN))]
        (found,) = mobility(pair, [HOME] * 2, [0], names=self.NAMES).redundant
        assert (found.constraint, found.implied, found.equations, found.by) == (1, 2, 3, (0,))
        assert found.text.startswith("2 of the 3 equations of against between plate and bolt_2 are implied by")

    @pytest.mark.parametrize("problem", MECHANISMS.values(), ids=MECHANISMS.keys())
    def test_leaving_out_what_is_wholly_redundant_changes_no_freedom(self, problem: Problem) -> None:
        found = mobility(problem.constraints, problem.poses, [0])
        out = {r.constraint for r in found.redundant if r.wholly}
        rest = [c for i, c in enumerate(problem.constraints) if i not in out]
        left = mobility(rest, problem.poses, [0])
        assert left.freedom == found.freedom
        assert not any(r.wholly for r in left.redundant)
        rows = sum(6 - c.freedom for c in problem.constraints)
        said = sum(r.implied for r in found.redundant)
        assert found.freedom == 6 * len(problem.movable) - (rows - said)  # every equation is new or said before

    def test_a_contradiction_names_its_members_and_by_how_much(self) -> None:
        """Three faces that enclose a block 0.4 mm too long for them, and a fourth that has nothing to do with it."""
        block = [
            Against((0, 1), (UP, DOWN)),
            Against((0, 1), (Plane(ORIGIN, X), Plane(ORIGIN, -X))),
            Against((0, 1), (Plane([0.05, 0, 0], -X), Plane([0.0504, 0, 0], X))),
        ]
        found = mobility(block, [HOME] * 2, [0], names=("frame", "block"))
        (conflict,) = found.conflicting
        assert conflict.constraints == (1, 2)
        assert (conflict.off, conflict.unit) == (pytest.approx(4e-4, rel=1e-6), "m")
        assert conflict.text == (
            "these two cannot hold together: off by 0.4 mm: "
            "against between frame and block (no. 1) and against between frame and block (no. 2)"
        )

    def test_three_holes_that_no_two_pins_can_tell(self) -> None:
        """Any two of three links close; the third is 0.4 mm too long: these three cannot hold together."""
        points = [np.array([0, 0, 0.0]), np.array([0.1, 0, 0]), np.array([0.2004, 0, 0])]
        spheres = lambda a, b: tuple(Sphere(p, 0.01) for p in (a, b))  # noqa: E731
        rods = [
            Spherical((0, 1), spheres(points[0], ORIGIN)),
            Spherical((1, 2), spheres([0.1, 0, 0], ORIGIN)),
            Spherical((2, 0), spheres([0.1, 0, 0], points[2])),
        ]
        poses = [HOME, HOME, pin.SE3(np.eye(3), points[1])]
        found = mobility(rods, poses, [0], names=("frame", "left", "right"))
        (conflict,) = found.conflicting
        assert conflict.constraints == (0, 1, 2)
        assert conflict.off == pytest.approx(4e-4, rel=1e-3)
        assert conflict.text.startswith("these three cannot hold together: off by 0.4 mm: ")
        assert "0.4 mm: spherical between frame and left," in conflict.text

    @pytest.mark.parametrize("error", [1e-6, 1e-2])
    def test_the_hole_that_is_off_is_in_the_conflict(self, error: float) -> None:
        problem = problems.flange(4, error)
        found = mobility(problem.constraints, problem.poses, [0])
        assert found.freedom == 0
        (conflict,) = found.conflicting
        assert conflict.constraints[-1] == 4
        assert 0.5 * error < conflict.off < 1.5 * error

    def test_fixed_bodies_that_contradict_are_said_to(self) -> None:
        found = mobility([Against((0, 1), (UP, Plane([0, 0, 1e-3], -Z)))], [HOME] * 2, [0, 1], names=("a", "b"))
        (conflict,) = found.conflicting
        assert conflict.text == "against between a and b cannot hold, both are fixed: off by 1 mm"
