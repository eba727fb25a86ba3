"""Constrained motion: the nearest allowed pose, nothing passed at any speed, constraints kept without drift."""

from itertools import combinations

import numpy as np
import pinocchio as pin
import pytest

from collision import CollisionManager, Tolerance
from constraints import ConstraintManager, ConstraintsError, Motion, Screw
from constraints.geometry.surfaces import Cylinder
from constraints.kinds.stated import stated
from constraints.motion.quadratic_program import UndecidedError, quadratic_program
from constraints.recognition.mated import adjacent_surfaces
from tests.constraints.shapes import Body, box, flanged_shaft, housing, shaft, turned


def at(x=0.0, y=0.0, z=0.0, rpy=(0.0, 0.0, 0.0)):
    return pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array([x, y, z], float))


class Room:
    """Bodies, of which number 0 stands still, and a hand on number 1."""

    def __init__(self, bodies: list[Body], poses, accept=True, **options):
        self.world = CollisionManager()
        for k, (body, pose) in enumerate(zip(bodies, poses, strict=True)):
            self.world.add(body.mesh, pose, movable=k > 0)
        rules = [lambda c: True] if accept else []
        self.manager = ConstraintManager([b.features for b in bodies], rules=rules, fixed=[0], **options)
        self.motion = Motion(self.world, self.manager)
        self.poses = list(poses)
        self.movable = range(1, len(bodies))

    def move(self, pose, held=1, movable=None, carried=()):
        movable = self.movable if movable is None else movable
        result = self.motion.step({held: pose}, self.poses, movable, {held: carried})
        for i, p in result.poses.items():
            self.poses[i] = p
        return result

    def update(self, wanted=None):
        changes = self.manager.update(self.poses, self.world.contacts(self.manager.within), wanted)
        self.motion.sync()
        return [(c.kind, c.candidate.kind) for c in changes]

    def mate(self):
        """Accept what is there, and let it snap."""
        self.update()
        self.move(self.poses[1])
        return self


def test_a_free_part_goes_where_the_hand_wants_it():
    room = Room([box(0.1, 0.1, 0.1), box(0.02, 0.03, 0.04)], [at(), at(x=0.5)])
    for target in (at(x=0.3, rpy=(3.0, 0, 0)), at(y=2.0, rpy=(0, 0.2, -2.9)), at(z=-5.0)):
        result = room.move(target)
        assert np.abs(room.poses[1].homogeneous - target.homogeneous).max() < 1e-9
        assert not result.blocked and len(result.contacts) == 0
        assert result.remaining[1] == pytest.approx((0.0, 0.0), abs=1e-8)


@pytest.mark.parametrize("jump", [0.2, 2.0, 200.0])
def test_no_speed_carries_a_part_through_a_thin_wall(jump):
    room = Room([box(1.0, 1.0, 1e-4), box(0.02, 0.03, 0.04)], [at(), at(z=0.1)])
    result = room.move(at(z=0.1 - jump))
    assert result.blocked and set(result.contacts["object_a"].tolist()) == {0}
    assert 0.0 < room.poses[1].translation[2] - 0.02 - 5e-5 < 1e-4
    assert len(room.world.colliding_surfaces()) == 0


def test_it_slides_along_the_wall_under_the_hand():
    room = Room([box(1.0, 1.0, 0.02), box(0.04, 0.04, 0.04)], [at(), at(z=0.05)])
    for x in np.linspace(0.0, 0.3, 31):
        room.move(at(x=x, y=-0.5 * x, z=0.0))
        assert room.poses[1].translation[:2] == pytest.approx([x, -0.5 * x], abs=1e-6)
        assert 0.0 <= room.poses[1].translation[2] - 0.03 < 1e-4
        assert np.abs(pin.log3(room.poses[1].rotation)).max() < 1e-3


def test_what_starts_in_contact_slides_and_lifts():
    room = Room([box(1.0, 1.0, 0.02), box(0.04, 0.04, 0.04)], [at(), at(z=0.03)], accept=False)
    room.move(at(x=0.05, z=0.02))
    assert room.poses[1].translation == pytest.approx([0.05, 0.0, 0.03], abs=3e-5)
    assert len(room.world.colliding_surfaces()) == 0
    room.move(at(x=0.05, z=0.08))
    assert room.poses[1].translation == pytest.approx([0.05, 0.0, 0.08], abs=1e-9)


def test_a_shaking_hand_in_a_cage_never_gets_out():
    """A box in a closed cage, wanted anywhere within a metre: no two surfaces ever meet."""
    rng = np.random.default_rng(7)
    cage = turned([(0.0, 0.0), (0.1, 0.0), (0.1, 0.1), (0.0, 0.1)][::-1], n=12)  # a hollow drum, normals inward
    room = Room([cage, box(0.03, 0.05, 0.07)], [at(), at(z=0.05)])
    for _ in range(60):
        room.move(at(*rng.uniform(-1, 1, 3), rpy=rng.uniform(-3, 3, 3)))
        assert len(room.world.colliding_surfaces()) == 0
        assert np.abs(room.poses[1].translation - [0, 0, 0.05]).max() < 0.1


def bored(clearance=2e-5, z=0.03):
    return Room([housing(0.01 + clearance), flanged_shaft(phase=0.05)], [at(), at(z=z)]).mate()


@pytest.mark.parametrize("clearance", [2e-5, 1e-4, 0.0])
def test_a_shaft_turns_and_slides_freely_in_its_bore_whatever_the_facets(clearance):
    room = bored(clearance)
    assert [c.kind for c in room.manager.constraints] == ["concentric"]
    for k in range(1, 40):
        z, turn = 0.03 + 0.02 * np.sin(0.3 * k), 0.2 * k
        result = room.move(at(x=0.01 * np.sin(k), z=z, rpy=(0.02 * np.cos(k), 0.0, turn)))
        pose = room.poses[1]
        assert result.residual < 1e-9 and not result.blocked
        assert pose.translation[2] == pytest.approx(z, abs=1e-3)
        assert abs(pin.log3(pose.rotation.T @ pin.rpy.rpyToMatrix(0, 0, turn))[2]) < 0.02


def test_a_hand_that_goes_straight_skips_the_turns_of_a_thread_that_is_drawn_plain():
    room = Room([housing(0.0105), flanged_shaft(phase=0.05)], [at(), at(z=0.03)], accept=False)
    axis = Cylinder([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], 0.01)
    screw = Screw((0, 1), (axis, axis), pitch=1e-3).engaged(*room.poses)
    room.manager.impose(stated(screw, room.poses, room.manager.recogniser.features, 0, "a thread"))
    for z in np.arange(0.03, 0.045, 8.5e-4):
        result = room.move(at(z=z))
        assert not result.blocked and result.residual < 1e-9
        assert abs(room.poses[1].translation[2] - z) <= 5e-4 + 1e-9
        assert np.abs(pin.log3(room.poses[1].rotation)).max() < 0.01


def test_the_flange_stops_at_the_face_and_seats_when_accepted():
    room = bored()
    result = room.move(at(z=-0.05))
    assert result.blocked and 0.0 < room.poses[1].translation[2] - 0.01 < 1e-4
    assert (0, 2, 1, 2) in {tuple(r)[:4] for r in result.contacts.tolist()}
    assert ("accepted", "against") in room.update()
    room.move(at(z=-0.05))
    assert room.poses[1].translation == pytest.approx([0, 0, 0.01], abs=1e-12)
    assert ("satisfied", "against") in room.update({1: at(z=-0.05)})
    assert room.update({1: at(z=0.02)}) == [("removed", "against")]
    room.move(at(z=0.02))
    assert room.poses[1].translation == pytest.approx([0, 0, 0.02], abs=1e-9)


def test_accepting_snaps_the_part_into_place():
    room = Room([housing(0.0101), flanged_shaft(phase=0.05)], [at(), at(x=5e-5, z=0.0105, rpy=(0.0005, 0, 0))])
    room.update()
    assert len(room.manager.accepted) == 2
    result = room.move(room.poses[1])
    assert result.residual < 1e-9
    assert room.poses[1].translation == pytest.approx([0, 0, 0.01], abs=1e-9)


def test_the_subassembly_comes_along():
    """A ring sits on a shaft's flange: held by the shaft, the ring follows; held by the ring, the shaft does."""
    ring = housing(0.01, 0.01, 0.02)
    room = Room([box(0.1, 0.1, 0.1), flanged_shaft(), ring], [at(x=1.0), at(), at(z=0.04)])
    room.update()
    assert sorted(c.kind for c in room.manager.constraints) == ["against", "concentric"]
    start = room.poses[1].actInv(room.poses[2])
    for held, target in ((1, at(x=0.1, y=0.2, rpy=(0.3, 0.2, 0.1))), (2, at(y=-0.1, z=0.3, rpy=(1.0, -0.4, 0.2)))):
        result = room.move(target, held)
        assert result.residual < 1e-9 and set(result.poses) == {1, 2}
        assert np.abs(room.poses[held].homogeneous - target.homogeneous).max() < 1e-6
        now = room.poses[1].actInv(room.poses[2])
        assert now.translation == pytest.approx(start.translation, abs=1e-9)


def test_a_subassembly_is_stopped_by_what_its_other_end_hits():
    ring = housing(0.01, 0.01, 0.02)
    wall = box(0.2, 0.2, 0.02)
    room = Room([wall, flanged_shaft(), ring], [at(z=-0.1), at(), at(z=0.04)])
    room.update()
    result = room.move(at(z=-0.5), held=2)
    assert result.blocked
    assert 0.0 < room.poses[1].translation[2] + 0.09 < 1e-4  # the shaft's end, on the wall
    assert room.poses[2].translation[2] == pytest.approx(room.poses[1].translation[2] + 0.04, abs=1e-9)


@pytest.mark.parametrize("accept", [False, True])
def test_what_is_carried_does_not_drift_when_it_is_blocked(accept):
    """Two boxes side by side, held by one: the other runs into a wall, is pressed on it and slides, as one piece."""
    bodies = [box(1.0, 1.0, 0.02), box(0.04, 0.04, 0.04), box(0.04, 0.04, 0.06), box(0.03, 0.03, 0.03)]
    room = Room(bodies, [at(), at(z=0.06), at(x=0.04, z=0.06), at(x=0.3, z=0.2)], accept=accept)
    room.update()
    start = [room.poses[1].actInv(room.poses[i]) for i in (2, 3)]
    rng = np.random.default_rng(3)
    blocked = 0
    for k in range(60):
        wish = at(x=0.006 * k, y=0.01 * np.sin(k), z=0.02, rpy=rng.uniform(-0.4, 0.4, 3))
        result = room.move(wish, carried=(2, 3))
        blocked += result.blocked
        assert set(result.poses) == {1, 2, 3}
        for i, relative in zip((2, 3), start, strict=True):
            off = relative.actInv(room.poses[1].actInv(room.poses[i]))
            assert np.abs(pin.log6(off).vector).max() < 1e-9
    # 1 and 2 touch all along, to the last bit or not; what counts is that neither gets into the wall
    assert blocked > 45 and not (room.world.colliding_surfaces([2, 3])[:, 0] == 0).any()
    room.move(at(z=0.3))
    assert (room.poses[2].translation[2] < 0.2) != accept  # let go of, it comes only if its constraints bring it


def test_a_body_is_carried_once_and_by_a_held_one():
    room = Room([box(1, 1, 0.01), box(0.1, 0.1, 0.1), box(0.1, 0.1, 0.1)], [at(), at(z=0.2), at(z=0.4)], accept=False)
    for wanted, carried in (({1: at()}, {1: (1,)}), ({1: at()}, {1: (2, 2)}), ({1: at()}, {2: (1,)})):
        with pytest.raises(ConstraintsError, match="carried"):
            room.motion.step(wanted, room.poses, [1, 2], carried)


def test_parts_that_may_not_move_hold_the_others():
    room = Room([box(0.1, 0.1, 0.1), flanged_shaft(), housing(0.01, 0.01, 0.02)], [at(x=1.0), at(), at(z=0.04)])
    room.update()
    room.move(at(x=0.1, z=0.5, rpy=(0, 0, 1.0)), held=2, movable=[2])
    assert room.poses[1] == at()
    assert room.poses[2].translation == pytest.approx([0, 0, 0.04], abs=1e-9)
    assert abs(pin.log3(room.poses[2].rotation)[2]) == pytest.approx(1.0, abs=1e-6)


def test_removing_a_constraint_in_the_middle_of_a_motion_makes_its_surfaces_solid_again():
    room = bored(clearance=1e-4)
    (id,) = room.manager.accepted
    room.move(at(z=0.025))
    assert room.world.ignored_surfaces(0, 1)
    room.manager.remove(id)
    room.manager.rules.clear()
    room.move(at(x=0.05, z=0.025))
    assert not room.world.ignored_surfaces(0, 1)
    assert abs(room.poses[1].translation[0]) < 3e-4  # the bore holds it
    assert len(room.world.colliding_surfaces()) == 0


def test_same_input_same_bits():
    def run():
        room = bored(clearance=1e-4)
        for k in range(25):
            room.move(at(x=0.01, z=0.03 - 0.002 * k, rpy=(0.01, 0.02, 0.3 * k)))
        return room.poses[1].homogeneous.tobytes()

    assert run() == run()


def steps(count):
    """Greatest distance from the constraints over many steps of a shaft that turns and slides in its bore."""
    room = bored()
    (constraint,) = room.manager.constraints
    worst = 0.0
    for k in range(count):
        room.move(at(x=0.003, z=0.03 + 0.015 * np.sin(0.01 * k), rpy=(0.01, 0.0, 0.05 * k)))
        if k % max(1, count // 1000) == 0:
            worst = max(worst, float(np.abs(constraint.residual(*room.poses)).max()))
    rotation = room.poses[1].rotation
    return max(worst, float(np.abs(rotation.T @ rotation - np.eye(3)).max()))


def test_no_drift():
    assert steps(2000) < 1e-9


@pytest.mark.slow
@pytest.mark.timeout(3000)
def test_no_drift_in_a_million_steps():
    assert steps(1_000_000) < 1e-9


def test_quadratic_program_against_every_active_set():
    """Random rows, some of them twice or opposed, some of them without a solution."""
    rng = np.random.default_rng(2)
    solved = 0
    for trial in range(120):
        n, m = int(rng.integers(1, 5)), int(rng.integers(1, 6))
        root = rng.normal(size=(n, n))
        h, g, c = root @ root.T + 0.1 * np.eye(n), rng.normal(size=n), rng.normal(size=(m, n))
        lower = -rng.uniform(0.0, 1.0, m) + (trial % 3 == 0)
        if trial % 2:
            twins = rng.integers(0, m, 3)
            c = np.vstack([c, c[twins], -c[:1]])
            lower = np.concatenate([lower, lower[twins] - [0.0, 0.0, 0.1], -lower[:1] - rng.choice([0.0, 0.5, -0.5])])
        m = len(lower)
        best = np.inf
        for size in range(min(n, m) + 1):
            for active in map(list, combinations(range(m), size)):
                k = np.block([[h, c[active].T], [c[active], np.zeros((size, size))]])
                try:
                    y = np.linalg.solve(k, np.concatenate([-g, lower[active]]))[:n]
                except np.linalg.LinAlgError:
                    continue
                if (c @ y >= lower - 1e-9).all():
                    best = min(best, 0.5 * y @ h @ y + g @ y)
        found = quadratic_program(h, g, c, lower)
        assert (found is None) == (best == np.inf)
        if found is None:
            continue
        solved += 1
        y, pressed = found
        assert (c @ y >= lower - 1e-9).all()
        assert 0.5 * y @ h @ y + g @ y == pytest.approx(best, abs=1e-8)
        assert all(abs(c[k] @ y - lower[k]) < 1e-8 for k in pressed)
        force, *_ = np.linalg.lstsq(c[pressed].T, h @ y + g, rcond=None)
        assert c[pressed].T @ force == pytest.approx(h @ y + g, abs=1e-8)
    assert 60 < solved < 120


def test_a_quadratic_program_without_solution_says_so():
    c = np.array([[1.0], [-1.0]])
    assert quadratic_program(np.eye(1), np.zeros(1), c, np.array([1.0, 1.0])) is None


def test_a_quadratic_program_that_runs_out_of_changes_is_not_taken_for_one_without_solution():
    n = 6
    c, lower = np.eye(n), np.ones(n)  # each row becomes active in turn
    y, pressed = quadratic_program(np.eye(n), np.zeros(n), c, lower)
    np.testing.assert_allclose(y, 1.0)
    assert len(pressed) == n
    with pytest.raises(UndecidedError, match="6 unknowns is undecided after 3 changes"):
        quadratic_program(np.eye(n), np.zeros(n), c, lower, most_changes=3)


def test_adjacent_surfaces_of_a_turned_part():
    mesh = flanged_shaft().mesh
    assert adjacent_surfaces(mesh, [1]) == (0, 2)
    assert adjacent_surfaces(mesh, [0, 1]) == (2,)
    assert adjacent_surfaces(box(1, 1, 1).mesh, [0]) == (2, 3, 4, 5)
    assert adjacent_surfaces(shaft().mesh, [0, 1, 2]) == ()


def test_tolerance_sets_the_distance_kept():
    room = Room([box(1.0, 1.0, 0.02), box(0.04, 0.04, 0.04)], [at(), at(z=0.05)])
    room.world = CollisionManager(Tolerance(linear=1e-4))
    for body, pose in ((box(1.0, 1.0, 0.02), at()), (box(0.04, 0.04, 0.04), at(z=0.05))):
        room.world.add(body.mesh, pose)
    room.motion = Motion(room.world, room.manager, Tolerance(linear=1e-4))
    room.move(at(z=0.0))
    assert 4e-5 < room.poses[1].translation[2] - 0.03 < 4e-4


def test_back_faces_of_thin_plates_do_not_count_as_facing():
    room = Room([box(0.3, 0.3, 1e-3), box(0.1, 0.1, 1e-3)], [at(), at(z=0.0012)], accept=False)
    for x in np.linspace(0.0, 0.05, 6):
        room.move(at(x=x, z=0.0))
        assert room.poses[1].translation == pytest.approx([x, 0.0, 0.00102], abs=2e-6)


def test_poses_that_are_none_are_refused_before_anything_moves():
    room = bored()
    before = room.world.pose(1)
    bad = at()
    bad.translation = np.array([0.0, np.nan, 0.0])
    with pytest.raises(ConstraintsError, match="body 1 is not finite"):
        room.move(bad)
    assert room.world.pose(1) == before


def test_a_hand_that_holds_nothing_moves_nothing():
    room = bored()
    result = room.motion.step({}, room.poses, room.movable)
    assert result.poses == {} and not result.blocked


def test_two_hands_on_two_parts():
    """One hand holds the ring, the other the shaft it sits on; what both want together cannot be, so they share it."""
    room = Room([box(0.1, 0.1, 0.1), flanged_shaft(), housing(0.01, 0.01, 0.02)], [at(x=1.0), at(), at(z=0.04)])
    room.update()
    result = room.motion.step({1: at(x=0.01), 2: at(x=-0.01, z=0.04)}, room.poses, room.movable)
    assert result.residual < 1e-9
    assert all(0.001 < shift < 0.019 for shift, _ in result.remaining.values())
    turned = {1: at(rpy=(0, 0, 0.3)), 2: at(z=0.04, rpy=(0, 0, -0.4))}
    result = room.motion.step(turned, [room.poses[0], result.poses[1], result.poses[2]], room.movable)
    for body, pose in turned.items():
        assert np.abs(pin.log3(result.poses[body].rotation.T @ pose.rotation)).max() < 1e-6
