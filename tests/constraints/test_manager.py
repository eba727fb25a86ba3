"""The constraint manager: offers with hysteresis, refusals that last, and every way a constraint ends."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from collision import CollisionManager, Tolerance
from constraints import ConstraintManager, ConstraintsError, UnknownConstraintError
from tests.constraints.shapes import Builder, arc_face, at, box, flanged_shaft, housing, rectangles, shaft


class Bench:
    """Bodies whose poses the test sets outright; the surfaces in force are left out of collision, as motion does."""

    def __init__(self, bodies, poses, **options):
        self.manager = ConstraintManager([b.features for b in bodies], **options)
        self.world = CollisionManager()
        self.poses = list(poses)
        for body, pose in zip(bodies, poses, strict=True):
            self.world.add(body.mesh, pose)

    def go(self, pose=None, body=1, wanted=None, **options):
        if pose is not None:
            self.poses[body] = pose
            self.world.set_pose(body, pose)
        rows = self.world.contacts(self.manager.within)
        mated = {
            (a, sa, b, sb)
            for e in self.manager.accepted.values()
            for (a, b), (fa, fb) in [(e.candidate.bodies, e.candidate.surfaces)]
            for sa in fa
            for sb in fb
        }
        names = ("object_a", "surface_a", "object_b", "surface_b")
        rows = rows[[tuple(int(row[n]) for n in names) not in mated for row in rows]]
        changes = self.manager.update(self.poses, rows, wanted, **options)
        return [(c.kind, c.candidate.kind) for c in changes]

    def id(self, kind):
        known = {**self.manager.candidates, **self.manager.refused}
        known |= {i: e.candidate for i, e in self.manager.accepted.items()}
        return next(i for i, c in known.items() if c.kind == kind)


def shaft_bench(**options):
    return Bench([housing(0.0101), flanged_shaft(phase=0.05)], [at(), at(z=0.2)], **options)


def test_in_and_out_again():
    bench = shaft_bench(rules=[lambda c: True])
    assert bench.go() == []
    assert bench.go(at(z=0.03)) == [
        ("recognised", "concentric"),
        ("accepted", "concentric"),
        ("satisfied", "concentric"),
    ]
    assert bench.go(at(z=0.02)) == []
    assert [k for k, c in bench.go(at(z=0.01)) if c == "against"] == ["recognised", "accepted", "satisfied"]
    assert bench.go(wanted={1: at(z=0.0149)}) == []
    assert bench.go(wanted={1: at(z=0.0151)}) == [("removed", "against")]
    assert bench.go(at(z=0.03), wanted={1: at(z=0.03)}) == []
    assert bench.go(at(z=0.0605)) == []
    assert bench.go(at(z=0.0621)) == [("removed", "concentric")]
    assert bench.go(at(z=0.08)) == []


def test_what_does_not_hold_as_drawn_is_not_offered_to_a_hand_that_wants_the_part_there():
    """The flange touches its seat; as drawn it is 0.4 mm off it."""
    for wanted, offered in ((0.0104, False), (0.01, True)):
        bench = shaft_bench(rules=[lambda c: c.kind == "against"])
        bench.manager.drawn = (at(), at(z=0.0104))
        bench.go(at(z=0.03))
        kinds = bench.go(at(z=0.01), wanted={1: at(z=wanted)})
        assert (("accepted", "against") in kinds) is offered, kinds
        assert (("accepted", "against") in bench.go(wanted={1: at(z=0.01)})) is not offered


def test_offers_wait_for_a_decision_and_are_withdrawn():
    bench = shaft_bench()
    assert bench.go(at(z=0.03)) == [("recognised", "concentric")]
    assert bench.go(at(z=0.03)) == []
    assert bench.go(at(z=0.2)) == [("withdrawn", "concentric")]
    assert bench.manager.candidates == {} and bench.manager.constraints == ()


def test_ids_stay_with_their_features():
    bench = shaft_bench()
    bench.go(at(z=0.03))
    first = bench.id("concentric")
    bench.go(at(z=0.2))
    bench.go(at(z=0.01))
    assert bench.id("concentric") == first and bench.id("against") != first


def test_refused_stays_refused_until_the_parts_part():
    bench = shaft_bench()
    bench.go(at(z=0.03))
    bench.manager.refuse(bench.id("concentric"))
    assert bench.go() == [("refused", "concentric")]
    assert bench.go(at(x=9e-5, z=0.05)) == []
    assert bench.go(at(z=0.01)) == [("recognised", "against")]
    assert bench.go(at(z=0.2)) == [("withdrawn", "against")]
    assert bench.manager.refused == {}
    assert bench.go(at(z=0.03)) == [("recognised", "concentric")]


def test_a_refused_candidate_can_still_be_accepted():
    bench = shaft_bench(rules=[lambda c: False if c.kind == "concentric" else None])
    assert bench.go(at(z=0.03)) == [("recognised", "concentric"), ("refused", "concentric")]
    bench.manager.accept(bench.id("concentric"))
    assert bench.go() == [("accepted", "concentric"), ("satisfied", "concentric")]


def test_unknown_ids_are_named():
    bench = shaft_bench()
    for verb in (bench.manager.accept, bench.manager.refuse, bench.manager.remove):
        with pytest.raises(UnknownConstraintError, match="id 7; there are: none") as error:
            verb(7)
        assert error.value.id == 7


@pytest.mark.parametrize("accept", [True, False])
@pytest.mark.parametrize("place", [0.2, 0.0602, 0.05, 0.03, 0.0105, 0.01])
def test_a_shaking_hand_makes_no_event_that_a_still_one_does_not(place, accept):
    """0.1 mm and 0.1° of noise at 60 Hz for five seconds; the part follows the hand as far as its bore lets it."""
    rng = np.random.default_rng(11)
    rule = [lambda c: accept or None]

    def events(noise):
        bench = shaft_bench(rules=rule)
        out = []
        for _ in range(300):
            shift, turn = noise * 1e-4 * rng.uniform(-1, 1, 3), noise * np.radians(0.1) * rng.uniform(-1, 1, 3)
            wanted = at(*(shift + np.array([0, 0, place])), rpy=turn)
            held = bench.manager.accepted
            pose = at(z=wanted.translation[2]) if held else wanted
            out += bench.go(at(z=place) if len(held) == 2 else pose, wanted={1: wanted})
        return [e for e in out if e[0] != "satisfied"]

    assert events(1.0) == events(0.0)


def test_pressing_together_does_not_break_but_pulling_does():
    bench = Bench([box(0.1, 0.1, 0.02), box(0.05, 0.05, 0.05)], [at(), at(z=0.035)], rules=[lambda c: True])
    bench.go()
    assert bench.go(wanted={1: at(z=0.02)}) == []
    assert bench.go(wanted={1: at(x=0.02, z=0.035)}) == []
    assert bench.go(wanted={1: at(z=0.041)}) == [("removed", "against")]


def test_a_broken_mate_comes_back_only_when_the_pull_relaxes():
    bench = Bench([box(0.1, 0.1, 0.02), box(0.05, 0.05, 0.05)], [at(), at(z=0.035)], rules=[lambda c: True])
    bench.go()
    assert bench.go(wanted={1: at(z=0.041)}) == [("removed", "against")]
    for _ in range(5):
        assert bench.go(wanted={1: at(z=0.041)}) == []
    assert ("accepted", "against") in bench.go(wanted={1: at(z=0.0352)})


def test_tilting_breaks():
    bench = Bench([box(0.1, 0.1, 0.02), box(0.05, 0.05, 0.05)], [at(), at(z=0.035)], rules=[lambda c: True])
    bench.go()
    assert bench.go(wanted={1: at(z=0.035, rpy=(0.15, 0, 0))}) == []
    assert bench.go(wanted={1: at(z=0.035, rpy=(0.25, 0, 0))}) == [("removed", "against")]


def test_a_bore_takes_the_tilt_off_the_face_beside_it():
    bench = shaft_bench(rules=[lambda c: True])
    bench.go(at(z=0.01))
    assert len(bench.manager.accepted) == 2
    assert bench.go(wanted={1: at(z=0.01, rpy=(0.3, 0, 0))}) == []
    assert bench.go(wanted={1: at(z=0.02, rpy=(0.3, 0, 0))}) == [("removed", "against")]


def test_a_closed_fit_is_not_pulled_apart_sideways_an_open_one_is():
    closed = shaft_bench(rules=[lambda c: True])
    closed.go(at(z=0.03))
    assert closed.go(wanted={1: at(x=0.05, z=0.03)}) == []
    builder = Builder()
    arc_face(builder, 0.01, np.pi, 2 * np.pi, 0.0, 0.05, -1, n=16)
    half = Bench([builder.body(), shaft(0.01, 0.05, phase=0.1)], [at(), at()], rules=[lambda c: True])
    assert ("accepted", "concentric") in half.go()
    assert half.go(wanted={1: at(y=0.004)}) == []
    assert half.go(wanted={1: at(y=0.006)}) == [("removed", "concentric")]


def test_break_distance_and_force_of_one_constraint():
    bench = shaft_bench()
    bench.go(at(z=0.01))
    bench.manager.accept(bench.id("against"), break_distance=0.02, break_force=50.0)
    bench.go()
    assert bench.go(wanted={1: at(z=0.029)}) == []
    assert bench.go(force={1: 49.0}) == []
    assert bench.go(force={1: 51.0}) == [("removed", "against")]


def test_sliding_off_ends_the_mate():
    bench = Bench([box(0.1, 0.1, 0.02), box(0.05, 0.05, 0.05)], [at(), at(z=0.035)], rules=[lambda c: True])
    bench.go()
    assert bench.go(at(x=0.0749, z=0.035)) == []
    assert bench.go(at(x=0.0751, z=0.035)) == [("removed", "against")]


def test_a_contradicting_acceptance_removes_the_older_constraint():
    floor, step = Builder(), Builder()
    rectangles(floor, [(0, 0, 0.1, 0.1)], 0.0, up=True)
    rectangles(floor, [(0.2, 0, 0.3, 0.1)], 5e-4, up=True)
    rectangles(step, [(0, 0, 0.1, 0.1)], 0.0, up=False)
    rectangles(step, [(0.2, 0, 0.3, 0.1)], 0.0, up=False)
    bench = Bench([floor.body(), step.body()], [at(), at(z=2e-4)], fixed=[0])
    assert bench.go() == [("recognised", "against")] * 2
    low, high = sorted(bench.manager.candidates)
    bench.manager.accept(low)
    assert bench.go() == [("accepted", "against")]
    bench.manager.accept(high)
    assert bench.go() == [("accepted", "against"), ("removed", "against")]
    assert list(bench.manager.accepted) == [high]


def test_what_is_off_by_a_micrometre_goes_together():
    floor, step = Builder(), Builder()
    for b, up, shift in ((floor, True, 1e-6), (step, False, 0.0)):
        rectangles(b, [(0, 0, 0.1, 0.1)], 0.0, up=up)
        rectangles(b, [(0.2, 0, 0.3, 0.1)], shift, up=up)
    bench = Bench([floor.body(), step.body()], [at(), at(z=2e-6)], fixed=[0], rules=[lambda c: True])
    assert bench.go() == [("recognised", "against"), ("accepted", "against")] * 2
    assert len(bench.manager.accepted) == 2


def test_consistent_redundant_constraints_stay():
    bench = Bench([box(0.1, 0.1, 0.02), box(0.05, 0.05, 0.05)], [at(), at(z=0.035)], rules=[lambda c: True], fixed=[0])
    two = Bench([housing(), housing(), flanged_shaft()], [at(), at(z=-0.07), at(z=0.01)], rules=[lambda c: True])
    bench.go(), two.go()
    assert len(bench.manager.accepted) == 1 and len(two.manager.accepted) == 2


def test_a_thread_engages_where_it_is_accepted():
    bench = Bench([housing(0.01), shaft(0.01, 0.05)], [at(), at(z=0.02)], threads={(1, 1): 2e-3})
    assert bench.go() == [("recognised", "screw")]
    bench.go(at(z=0.0207))
    bench.manager.accept(bench.id("screw"))
    assert ("satisfied", "screw") in bench.go()


def test_state_and_restore_give_the_same_future():
    path = [at(z=z) for z in (0.03, 0.02, 0.01, 0.01, 0.03, 0.2)]
    wanted = [at(z=z) for z in (0.03, 0.02, 0.01, 0.03, 0.03, 0.2)]

    def rule(c):
        return c.kind == "against" or None

    one = shaft_bench(rules=[rule])
    for k in range(3):
        one.go(path[k], wanted={1: wanted[k]})
    saved = pickle.loads(pickle.dumps(one.manager.snapshot))
    two = shaft_bench(rules=[rule])
    two.manager.snapshot = saved
    futures = [[b.go(path[k], wanted={1: wanted[k]}) for k in range(3, 6)] for b in (one, two)]
    assert futures[0] == futures[1]
    assert futures[0][0] == [("removed", "against")]


def test_tolerance_sets_what_is_offered():
    bench = shaft_bench(tolerance=replace(Tolerance(), reach=0.0, reach_angular=0.0))
    assert bench.go(at(x=2e-4, z=0.03)) == []
    assert bench.go(at(x=5e-5, z=0.03)) == [("recognised", "concentric")]


def test_a_force_breaks_what_bears_it():
    """Of a force only the part that parts the faces, or that is across the axis, counts."""

    def broken(kind, force, body=1):
        bench = shaft_bench()
        bench.go(at(z=0.01))
        bench.manager.accept(bench.id(kind), break_force=50.0)
        bench.go()
        return ("removed", kind) in bench.go(force={body: force})

    assert broken("against", 60.0) and not broken("against", 40.0)
    assert broken("against", [0.0, 0.0, 60.0])  # the flange off its seat
    assert not broken("against", [0.0, 0.0, -60.0])  # pressed home
    assert not broken("against", [60.0, 0.0, 0.0]) and not broken("against", [60.0, 0.0, 40.0])
    assert broken("against", [0.0, 0.0, -60.0], body=0)  # the seat off the flange
    assert broken("concentric", [40.0, 40.0, 0.0]) and not broken("concentric", [30.0, 30.0, 500.0])


@pytest.mark.parametrize("force", [np.nan, [np.inf, 0.0, 0.0], [1.0, 2.0]])
def test_a_force_that_is_none_is_refused_by_name(force):
    bench = shaft_bench(rules=[lambda c: True])
    bench.go(at(z=0.01))
    with pytest.raises(ConstraintsError, match="force on body 1"):
        bench.go(force={1: force})
