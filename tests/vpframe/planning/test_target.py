"""The least number of removals is that of enumeration: of generated programs, and of assemblies with threads."""

from heapq import heappop, heappush
from itertools import chain, combinations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import vpframe as vp
from tests.vpframe.planning import cases
from vpframe.planning import target, ways
from vpframe.planning.assembly import Assembly
from vpframe.planning.document import table
from vpframe.planning.target import Option, least
from vpframe.scene.modelling import box, cylinder, hexagon
from vpframe.scene.modelling import scene as scene_of

LONG = 600.0


def subsets(items):
    items = sorted(items)
    return chain.from_iterable(combinations(items, k) for k in range(len(items) + 1))


def enumerated(moves, goal):
    """(removals, units carried and last options) of the cheapest plan until the goal is gone, over all states.

    moves: function of the units that are gone -> (units that go now, secondary cost) that may go next.
    """
    queue, best = [(0, 0, frozenset())], {}
    while queue:
        count, extra, gone = heappop(queue)
        if goal in gone:
            return count, extra
        if best.get(gone, (np.inf, 0)) <= (count, extra):
            continue
        best[gone] = count, extra
        for units, cost in moves(gone):
            heappush(queue, (count + 1, extra + cost, gone | units))
    return None


def random_options(random, n):
    options = []
    for u in range(n):
        others, mine = [v for v in range(n) if v != u], []
        for _ in range(random.integers(0, 4)):
            by = frozenset(v for v in others if random.random() < 0.35)
            may = {v: frozenset(w for w in range(n) if w != v and random.random() < 0.2) for v in by}
            carried = {v: own for v, own in may.items() if random.random() < 0.4}
            mine.append(Option(by, carried, bool(random.random() < 0.3)))
        options.append(mine)
    return options


def moves_of(options, goal):
    def moves(gone):
        for u, mine in enumerate(options):
            for option in mine if u not in gone else ():
                for carried in subsets(set(option.carried) - gone - {goal}):
                    group = {u, *carried}
                    waits = option.blockers.union(*(option.carried[v] for v in carried)) - group
                    if waits <= gone:
                        yield frozenset(group), len(carried) + option.last

    return moves


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 100_000), st.integers(2, 7))
@example(315, 5)  # a unit is carried only by a way that another way of its carrier makes look needless
def test_least_removals_with_carried_units_are_those_of_enumeration(seed, n):
    random = np.random.default_rng(seed)
    options, goal = random_options(random, n), int(random.integers(n))
    found, best = least(options, goal), enumerated(moves_of(options, goal), goal)
    if best is None:
        assert found is None
        return
    assert (len(found.chosen), found.bound, found.proven) == (best[0], best[0], True)
    gone = set()
    for removed in found.chosen:
        option = options[removed.unit][removed.option]
        group = {removed.unit, *removed.carried}
        assert set(removed.carried) <= set(option.carried) and goal not in removed.carried
        assert option.blockers.union(*(option.carried[v] for v in removed.carried)) <= gone | group
        assert not group & gone
        gone |= group
    assert goal in gone and found.chosen[-1].unit == goal
    extra = sum(len(r.carried) + options[r.unit][r.option].last for r in found.chosen)
    assert extra == best[1]


def bolted(count):
    """A plate on a base, bolts from above through both, M8 nuts below."""
    width = 0.02 * count
    hole = cylinder(0.0045, 0.02)
    plate, base = box(width, 0.02, 0.01), box(width + 0.03, 0.02, 0.01)
    bolt = cylinder(0.004, 0.03) + hexagon(0.013, 0.005).translated(z=0.03)
    nut = hexagon(0.013, 0.0065) - cylinder(0.0034, 0.0065)
    parts = {}
    for k in range(count):
        x = 0.02 * k + 0.01
        plate, base = plate - hole.translated(x, 0.01), base - hole.translated(x, 0.01)
        parts |= {f"bolt {k}": (bolt, cases.at(x, 0.01, -0.01)), f"nut {k}": (nut, cases.at(x, 0.01, -0.0065))}
    return scene_of({"base": base, "plate": (plate, cases.at(z=0.01)), **parts})


@pytest.mark.parametrize("count", [1, 2, 3, *(pytest.param(k, marks=pytest.mark.slow) for k in (11, 24))])
def test_bolts_are_turned_out_of_their_nuts_where_that_saves_removals(count):
    plan = vp.planning.disassembly(bolted(count), "plate", base=["base"], budget=LONG)
    assert [step.parts for step in plan.steps[-1:]] == [("plate",)]
    assert {step.parts[0].split()[0] for step in plan.steps[:-1]} == {"bolt"}
    assert (len(plan.steps), plan.bound, plan.proven) == (count + 1, count + 1, True)
    assert {name for step in plan.steps for name in step.unsupported} == {f"nut {k}" for k in range(count)}
    assert table(plan).startswith(
        f"plate comes out in {count + 1} steps, the fewest of single parts, alone or with what is screwed onto them, "
        "along the straight ways and threads found\n"
    )


def square_stud(nuts_above=1):
    """A stud with a square middle in the square hole of a plate, a nut below and nuts above: it cannot be turned."""
    hole = box(0.0102, 0.0102, 0.01).translated(-0.0051, -0.0051)
    plate = box(0.05, 0.04, 0.01).translated(-0.025, -0.02) - hole
    stud = cylinder(0.004, 0.05).translated(z=-0.02) + box(0.01, 0.01, 0.01).translated(-0.005, -0.005)
    nut = hexagon(0.013, 0.0065) - cylinder(0.0034, 0.0065)
    above = {f"above {k}": (nut, cases.at(z=0.0101 + 0.007 * k)) for k in range(nuts_above)}
    return scene_of({"plate": plate, "stud": stud, "below": (nut, cases.at(z=-0.0066)), **above})


@pytest.mark.parametrize("above", [1, 2])
def test_a_stud_that_cannot_turn_is_drawn_out_with_its_nuts(above):
    plan = vp.planning.disassembly(square_stud(above), "stud", base=["plate"], budget=LONG)
    assert (plan.bound, plan.proven) == (2, True)
    first, last = (set(step.parts) for step in plan.steps)
    nuts = {f"above {k}" for k in range(above)}
    assert (first, last) in [({"below"}, {"stud", *nuts}), ({"above 0"}, {"stud", "below"})][: 3 - above]
    assert plan.steps[1].motion == "straight" and abs(plan.steps[1].way.direction[2]) == pytest.approx(1.0)


def clamped():
    """A cover under the nut of a stud that cannot turn, on its plate."""
    cover = box(0.03, 0.03, 0.004).translated(-0.015, -0.015) - cylinder(0.0045, 0.004)
    scene = square_stud(0)
    nut = hexagon(0.013, 0.0065) - cylinder(0.0034, 0.0065)
    added = scene_of({"cover": (cover, cases.at(z=0.0101)), "nut": (nut, cases.at(z=0.0142))})
    return vp.Scene([*scene.parts, *added.parts])


def stack():
    """A cap over a nut over a stud: the cap first."""
    scene = square_stud(1)
    cap = box(0.02, 0.02, 0.03).translated(-0.01, -0.01) - box(0.016, 0.016, 0.028).translated(-0.008, -0.008)
    return vp.Scene([*scene.parts, *scene_of({"cap": (cap, cases.at(z=0.0102))}).parts])


@pytest.mark.parametrize(
    ("scene", "goal", "base"),
    [
        (lambda: bolted(1), "plate", "base"),
        (lambda: bolted(2), "plate", "base"),
        (square_stud, "stud", "plate"),
        (lambda: square_stud(2), "above 0", "plate"),
        (clamped, "cover", "plate"),
        (stack, "stud", "plate"),
        (cases.latched_box, "content", "box"),
    ],
)
def test_plans_of_assemblies_are_the_shortest_over_all_orders_groups_and_turns(scene, goal, base):
    """Sets of parts and groups are enumerated, and every sweep is made anew."""
    scene = scene()
    assembly, names = Assembly(scene), scene.names
    stays = scene.index(base)
    swept = {}

    def stopped(i, j, way):
        key = i, j, id(way)
        if key not in swept:
            swept[key] = assembly.sweeps.stop(i, j, way.knots) is not None
        return swept[key]

    def tried(i):
        others = [j for j in range(len(names)) if j != i]
        cone, _ = ways.cone_of(assembly, (i,), others)
        found = [ways.straight(assembly, (i,), others, d) for d in ways.directions(assembly, (i,), others, cone)]
        return [*found, *ways.screws(assembly, (i,), others)]

    own = {i: tried(i) for i in range(len(names)) if i != stays}
    screwed = {
        i: {
            j
            for j in own
            if assembly.size(j) < assembly.size(i) and "screw" in {m.kind for m in assembly.mates_of(i, j)}
        }
        for i in own
    }

    def moves(gone):
        there = set(range(len(names))) - gone
        for i in there - {stays}:
            for way in own[i]:
                for carried in subsets((screwed[i] & there) - {scene.index(goal)} if way.motion == "straight" else ()):
                    group = {i, *carried}
                    if not any(stopped(m, j, way) for m in group for j in there - group):
                        yield frozenset(group), 0

    best = enumerated(moves, scene.index(goal))
    plan = vp.planning.disassembly(scene, goal, base=[base], budget=LONG)
    assert plan.proven and len(plan.steps) == plan.bound == best[0]


def test_a_program_that_the_clock_cuts_off_is_given_processor_time(monkeypatch):
    """A clock that runs much faster than the processor, as on a busy machine."""
    from types import SimpleNamespace

    import scipy.optimize

    solve, limits = scipy.optimize.milp, []

    def busy(*arguments, options, **given):
        limits.append(options["time_limit"])
        if options["time_limit"] < 8.0:
            return SimpleNamespace(x=None, status=1, mip_dual_bound=None)
        return solve(*arguments, options=options, **given)

    monkeypatch.setattr(scipy.optimize, "milp", busy)
    assert target.least([[Option(frozenset())]], 0, seconds=1.0).proven
    assert limits == [1.0, 2.0, 4.0, 8.0]
