"""Orders of whole assemblies, and least numbers of removals, against known answers, lattices and enumeration."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vpframe as vp
from tests.vpframe.planning import cases
from tests.vpframe.planning.cases import order
from vpframe.planning.target import Option, least
from vpframe.report.plan_page import gone
from vpframe.scene.modelling import scene as scene_of

LONG = 600.0


def test_a_bolted_plate_nut_then_bolt_then_plate():
    plan = vp.planning.disassembly(cases.bolted_plate(), budget=LONG)
    assert plan and order(plan) == [("nut",), ("bolt",), ("plate",)]
    assert plan.levels == (("nut",), ("bolt",), ("plate",))
    assert plan.precedence == {"nut": (), "bolt": ("nut",), "plate": ("bolt",)}
    assert [step.motion for step in plan.steps] == ["screw", "straight", "straight"]
    assert plan.steps[0].way.turns == pytest.approx(0.01 / 0.00125)
    assert plan.base == ("base",) and plan.remaining == ()


def test_latch_then_lid_then_content_and_no_fewer():
    scene = cases.latched_box()
    assert order(vp.planning.disassembly(scene, budget=LONG)) == [("latch",), ("lid",), ("content",)]
    plan = vp.planning.disassembly(scene, "content", budget=LONG)
    assert order(plan) == [("latch",), ("lid",), ("content",)]
    assert (plan.bound, plan.proven) == (3, True)
    lid = vp.planning.disassembly(scene, "lid", budget=LONG)
    assert order(lid) == [("latch",), ("lid",)] and lid.proven


def test_of_a_thread_the_smaller_part_is_turned_and_the_larger_only_where_it_saves_a_removal():
    scene = cases.bolted_plate()
    whole = vp.planning.disassembly(scene, budget=LONG)
    assert order(whole) == [("nut",), ("bolt",), ("plate",)]
    plan = vp.planning.disassembly(scene, "plate", budget=LONG)
    assert order(plan) == [("bolt",), ("plate",)] and plan.proven and plan.bound == 2
    assert plan.steps[0].motion == "screw" and plan.steps[0].unsupported == ("nut",)
    assert (
        plan.scope == "single parts, alone or with what is screwed onto them, along the straight ways and threads found"
    )
    kept = vp.planning.disassembly(scene, "plate", base=["base", "nut"], budget=LONG)
    assert order(kept) == [("bolt",), ("plate",)] and kept.steps[0].motion == "screw"


def test_two_halves_that_hold_each_other_come_out_as_one_and_then_apart():
    scene = cases.interlocked()
    plan = vp.planning.disassembly(scene, budget=LONG)
    assert plan and order(plan)[0] == ("one", "two") and len(plan.steps) == 2
    assert set(plan.steps[0].tracks) == {"one", "two"}
    assert plan.steps[1].level == 1
    assert gone(plan, 0) == gone(plan, 1) == set()  # the picture of the second step shows the group again
    for target in ("one", "two"):
        assert order(vp.planning.disassembly(scene, target, budget=LONG)) == [("one", "two"), (target,)]


def test_what_is_carried_comes_out_as_one():
    plan = vp.planning.disassembly(cases.bolted_plate(), carry=[("bolt", "plate")], budget=LONG)
    assert order(plan) == [("nut",), ("plate", "bolt")]


@pytest.mark.parametrize("seed", range(3))
def test_six_piece_burrs_come_apart_as_a_lattice_search_says(seed):
    cells = {name: c for name, c in cases.burr(seed).items() if c}
    scene = scene_of({name: cases.voxels(c) for name, c in cells.items()})
    base = max(cells, key=lambda name: (len(cells[name]), name))
    plan = vp.planning.disassembly(scene, base=[base], motion="straight", budget=LONG)
    alone = {step.parts[0] for step in plan.steps if len(step.parts) == 1}
    by_lattice = cases.lattice_peel(cells, base)
    assert by_lattice <= alone
    for step in plan.steps:  # whatever came out is free on the lattice, too
        gone = {n for other in plan.steps[: plan.steps.index(step)] for n in other.parts}
        inside = {
            n
            for other in plan.steps[: plan.steps.index(step)]
            if set(step.parts) <= set(other.parts)
            for n in other.parts
        }
        there = (inside or set(cells) - gone) - set(step.parts)
        d = tuple(round(float(x)) for x in step.way.direction)
        assert not any(cases.lattice_blocked(cells[a], cells[b], d) for a in step.parts for b in there)


def test_as1_rod_leaves_its_nuts_in_the_air(real_models):
    scene = vp.load(real_models / "step" / "as1-oc-214.stp")
    rod, nuts = "rod-assembly_1/rod_1", ["rod-assembly_1/nut_1", "rod-assembly_1/nut_2"]
    alone = vp.planning.disassembly(scene, rod, budget=LONG, motion="mates")
    assert order(alone) == [(rod,)] and alone.proven  # it is drawn without a thread, and slides out of both nuts
    assert alone.steps[0].unsupported == tuple(nuts)
    threads = dict.fromkeys(nuts, 1.5e-3)
    for held, loose in (nuts, nuts[::-1]):  # one nut stays on the rod, and the rod turns out of the other
        plan = vp.planning.disassembly(scene, rod, carry=[(rod, held)], threads=threads, budget=LONG, motion="mates")
        assert plan and plan.proven and plan.bound == 1
        assert set(order(plan)[0]) == {rod, held} and plan.steps[0].motion == "screw"
        assert plan.steps[0].unsupported == (loose,)
    assert vp.planning.disassembly(scene, budget=LONG)


def enumerated(blockers, target):
    """The least number of removals by trying all sets of units, the smallest first."""
    n = len(blockers)
    for size in range(1, n + 1):
        for chosen in combinations(range(n), size):
            if target not in chosen:
                continue
            gone = set()
            while True:
                new = {u for u in chosen if u not in gone and any(by <= gone for by in blockers[u])}
                if not new:
                    break
                gone |= new
            if gone == set(chosen):
                return size
    return None


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 100_000), st.integers(2, 8))
def test_least_sets_are_those_of_enumeration(seed, n):
    random = np.random.default_rng(seed)
    blockers = []
    for u in range(n):
        others = [v for v in range(n) if v != u]
        ways = random.integers(0, 4)
        blockers.append([frozenset(v for v in others if random.random() < 0.3) for _ in range(ways)])
    target = int(random.integers(n))
    found = least([[Option(by) for by in own] for own in blockers], target)
    size = enumerated(blockers, target)
    if size is None:
        assert found is None
        return
    assert len(found.chosen) == size and found.bound == size and found.proven
    gone = set()
    for removed in found.chosen:
        assert blockers[removed.unit][removed.option] <= gone
        gone.add(removed.unit)
    assert found.chosen[-1].unit == target
