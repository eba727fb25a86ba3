"""A mate is offered to a hand when a surface comes to its place, not when it passes by; the better fit keeps its place.

Each case sets three poses: of the step before, of this step, and what the hand wants. Then the hand stops.
"""

import numpy as np
import pinocchio as pin
import pytest

from constraints import ConstraintManager
from constraints.recognition.pairings import FITS
from tests.constraints.shapes import Body, at, box, housing, joined, shaft, turned
from tests.constraints.test_manager import Bench

ON = 0.035
"""m: height of the small box that lies on the large one"""


def boxes() -> list[Body]:
    return [box(0.1, 0.1, 0.02), box(0.05, 0.05, 0.05)]


def loose_shaft() -> list[Body]:
    return [housing(0.0101), shaft(0.01, 0.05)]


def cones() -> list[Body]:
    return [
        turned([(0.01, 0), (0.03, 0), (0.03, 0.04), (0.02, 0.04)]),
        turned([(0, 0), (0.01, 0), (0.02, 0.04), (0, 0.04)]),
    ]


def plain_thread() -> list[Body]:
    return [housing(0.00425, outer=0.02), shaft(0.005, 0.05)]


def offered(bodies: list[Body], before: pin.SE3, now: pin.SE3, wanted: pin.SE3, kinds=FITS, **options) -> tuple:
    """What is offered to a hand on its way, and what once it stops; nothing was on offer before."""
    bench = Bench(bodies, [at(), at(z=0.3)], **options)
    bench.manager.kinds = frozenset()
    bench.go()
    bench.go(before, wanted={1: before})
    bench.manager.kinds = frozenset(kinds)
    return bench.go(now, wanted={1: wanted}), bench.go(wanted={})


def along(angle: float, gap: float) -> pin.SE3:
    """The small box `gap` m above the large one, on a way that ends there and is `angle` degrees off the normal."""
    return at(x=-gap * np.tan(np.radians(angle)), z=ON + gap)


COMES, PASSES = ([("recognised", "against")], []), ([], [("recognised", "against")])


@pytest.mark.parametrize(
    ("before", "now", "wanted", "expected"),
    [
        (at(z=ON + 1e-3), at(z=ON + 5e-5), at(z=ON), COMES),
        (at(z=ON + 1e-3), at(z=ON + 5e-5), at(z=ON - 1e-3), COMES),
        (at(z=ON + 1e-3), at(z=ON + 5e-5), at(z=ON + 5e-5), PASSES),
        (at(x=-1e-3, z=ON + 5e-5), at(z=ON + 5e-5), at(x=1e-3, z=ON + 5e-5), PASSES),
        (at(z=ON + 2e-5), at(z=ON + 5e-5), at(z=ON + 1e-4), PASSES),
        (along(59, 1e-4), along(59, 5e-5), at(z=ON), COMES),
        (along(61, 1e-4), along(61, 5e-5), at(z=ON), PASSES),
        (at(x=-1e-3, z=ON), at(z=ON), at(x=1e-3, z=ON), COMES),
    ],
    ids=["onto", "into", "stops short", "past", "away", "59 degrees", "61 degrees", "slides in place"],
)
def test_a_face_is_offered_that_the_hand_brings_to_its_place(before, now, wanted, expected) -> None:
    assert offered(boxes(), before, now, wanted) == expected


@pytest.mark.parametrize(
    ("before", "now", "wanted", "comes"),
    [
        (at(z=0.062), at(z=0.0595), at(z=0.0595), True),
        (at(x=8e-4, z=0.03), at(x=5e-4, z=0.03), at(x=5e-4, z=0.03), True),
        (at(x=3e-4, z=0.03), at(x=3e-4, z=0.025), at(x=3e-4, z=0.025), True),
        (at(x=3e-4, z=0.03), at(x=3e-4, z=0.035), at(x=3e-4, z=0.035), False),
        (at(x=3e-4, z=0.03), at(x=5e-4, z=0.03), at(x=5e-4, z=0.03), False),
        (at(x=4e-4, z=0.0602), at(x=5e-4, z=0.0602), at(x=5e-3, z=0.0602), False),
        (at(x=-5e-3, z=0.0602), at(x=4e-4, z=0.0602), at(x=5e-3, z=0.0602), False),
        (at(x=5e-5, z=0.03), at(x=5e-5, z=0.035), at(x=5e-5, z=0.035), True),
    ],
    ids=["in", "nearer the axis", "deeper", "out", "off the axis", "leaves", "crosses in one step", "in place"],
)
def test_a_shaft_is_offered_that_comes_to_the_axis_of_its_bore_or_goes_deeper(before, now, wanted, comes) -> None:
    mate = [("recognised", "concentric")]
    moving, stopped = offered(loose_shaft(), before, now, wanted, kinds=["concentric"])
    assert (moving, stopped) == ((mate, []) if comes else ([], mate))


@pytest.mark.parametrize(
    ("before", "now", "wanted", "comes"),
    [
        (at(z=1e-3), at(z=2e-4), at(), True),
        (at(z=1e-4), at(z=2e-4), at(z=3e-4), False),
        (at(x=-2e-4, z=2e-4), at(z=2e-4), at(x=2e-4, z=2e-4), False),
    ],
    ids=["seats", "lifts", "past"],
)
def test_a_cone_is_offered_that_comes_to_its_seat(before, now, wanted, comes) -> None:
    mate = [("recognised", "conical")]
    moving, stopped = offered(cones(), before, now, wanted, kinds=["conical"])
    assert (moving, stopped) == ((mate, []) if comes else ([], mate))


@pytest.mark.parametrize(
    ("turns", "comes"), [(0.0, False), (1.0, True), (0.0, None)], ids=["straight", "turns", "rests"]
)
def test_a_thread_drawn_plain_is_offered_where_it_turns_or_rests(turns, comes) -> None:
    pitch = 1.5e-3  # of M10
    ways = [
        at(z=0.02 + (0.0 if comes is None else k * 5e-4), rpy=(0, 0, turns * k * 2 * np.pi * 5e-4 / pitch))
        for k in range(3)
    ]
    mate = [("recognised", "screw")]
    moving, stopped = offered(plain_thread(), *ways, kinds=["screw", "concentric"], named={1: ["screw"]})
    assert (moving, stopped) == (([], mate) if comes is False else (mate, []))


def test_an_assisted_hand_is_offered_what_it_passes_by() -> None:
    bench = Bench(boxes(), [at(), at(x=-1e-3, z=ON + 5e-5)])
    bench.manager.kinds = frozenset()
    bench.go()
    bench.manager.kinds = frozenset(FITS)
    bench.manager.assisted = True
    assert bench.go(at(z=ON + 5e-5), wanted={1: at(x=1e-3, z=ON + 5e-5)}) == [("recognised", "against")]


def test_a_body_that_no_hand_moves_is_offered_what_it_lies_in() -> None:
    bench = Bench(boxes(), [at(), at(x=-1e-3, z=ON + 5e-5)])
    bench.manager.kinds = frozenset()
    bench.go()
    bench.manager.kinds = frozenset(FITS)
    assert bench.go(at(z=ON + 5e-5), wanted={7: at()}) == [("recognised", "against")]


# ---- two fits that cannot hold together


def pins_in_bores(first: float, second: float, **options) -> Bench:
    """A bar with two pins of radius 10 mm over a plate with two bores of these radii, 0.3 mm nearer each other.

    At z = 0.03 the first pin is in its bore, at z = 0.01 the second, which is shorter, is, too.
    """
    plate = joined([housing(first), housing(second)], [at(), at(x=0.07)])
    bar = joined([shaft(0.01, 0.05), shaft(0.01, 0.02)], [at(), at(x=0.0703, z=0.04)])
    bench = Bench([plate, bar], [at(), at(z=0.3)], fixed=[0], kinds=["concentric"], **options)
    bench.go()
    return bench


def radii(manager: ConstraintManager) -> list[float]:
    """m: of the bores of the fits in force."""
    return [e.candidate.geometries[0].radius for e in manager.accepted.values()]


def test_a_worse_fit_does_not_displace_the_better_one_that_came_before() -> None:
    bench = pins_in_bores(0.01001, 0.011, rules=[lambda candidate: True])
    bench.go(at(z=0.03), wanted={1: at(z=0.03)})
    assert radii(bench.manager) == [0.01001]
    assert bench.go(at(z=0.01), wanted={1: at(z=0.01)}) == [
        ("recognised", "concentric"),
        ("accepted", "concentric"),
        ("refused", "concentric"),
    ]
    assert radii(bench.manager) == [0.01001]
    assert bench.go(at(z=0.009), wanted={1: at(z=0.009)}) == []


def test_a_better_fit_takes_the_place_of_a_worse_one() -> None:
    bench = pins_in_bores(0.011, 0.01001, rules=[lambda candidate: True])
    bench.go(at(z=0.03), wanted={1: at(z=0.03)})
    assert radii(bench.manager) == [0.011]
    bench.go(at(z=0.01), wanted={1: at(z=0.01)})
    assert radii(bench.manager) == [0.01001]


def test_what_the_caller_accepts_takes_the_place_of_a_better_fit() -> None:
    bench = pins_in_bores(0.01001, 0.011)
    bench.go(at(z=0.03), wanted={1: at(z=0.03)})
    bench.manager.accept(bench.id("concentric"))
    bench.go(at(z=0.01), wanted={1: at(z=0.01)})
    (loose,) = bench.manager.candidates
    bench.manager.accept(loose)
    bench.go()
    assert list(bench.manager.accepted) == [loose]


# ---- what a pull is


@pytest.mark.parametrize(("pitch", "goes"), [(1.5e-3, True), (0.0, False)])
def test_a_screw_that_turns_comes_off_its_seat(pitch: float, goes: bool) -> None:
    """A hand that is half a turn ahead has lifted the head by little; without a thread it turns on its seat."""
    bench = Bench([box(0.1, 0.1, 0.02), box(0.02, 0.02, 0.05)], [at(), at(z=ON)], rules=[lambda candidate: True])
    bench.go()
    assert len(bench.manager.accepted) == 1
    changes = bench.go(wanted={1: at(z=ON + 0.5 * pitch, rpy=(0.0, 0.0, 3.1))})
    assert changes == ([("removed", "against")] if goes else [])


@pytest.mark.parametrize(("lean", "goes"), [(0.3, False), (2.0, True), (45.0, True)])
def test_a_pull_that_parts_two_faces_counts_in_full(lean: float, goes: bool) -> None:
    """`lean`: degrees by which a pull of 6 mm leaves the faces; along them a part slides."""
    bench = Bench([box(0.1, 0.1, 0.02), box(0.05, 0.05, 0.05)], [at(), at(z=ON)], rules=[lambda candidate: True])
    bench.go()
    angle = np.radians(lean)
    changes = bench.go(wanted={1: at(x=6e-3 * np.cos(angle), z=ON + 6e-3 * np.sin(angle))})
    assert changes == ([("removed", "against")] if goes else [])
