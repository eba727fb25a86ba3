"""Assemblies as people draw them: the order of a workshop, what overlaps hold, what is drawn twice, many parts."""

from itertools import pairwise

import numpy as np
import pytest

import vpframe as vp
from tests.vpframe.planning import cases, common_volume
from vpframe.planning.assembly import Budget, BudgetError
from vpframe.planning.document import document, reason, table
from vpframe.scene.modelling import box, cylinder, sphere, torus
from vpframe.scene.modelling import scene as scene_of

LONG = 600.0


def order(plan):
    return [step.parts for step in plan.steps]


def wedged():
    """A key drawn 10 µm into both sides of its slot, which is 10 µm narrower at its mouth, and a pin behind it."""
    slot = box(0.01, 0.01, 0.01).translated(0.005, 0.002, 0.005) + box(0.00999, 0.01, 0.01).translated(
        0.005005, 0.012, 0.005
    )
    key = box(0.01002, 0.006, 0.0099).translated(0.00499, 0.005, 0.00505)
    parts = {"body": box(0.02, 0.022, 0.02) - slot, "key": key}
    return scene_of(parts | {"pin": box(0.004, 0.002, 0.004).translated(0.008, 0.0025, 0.008)})


def test_what_an_overlap_as_drawn_holds_is_named_with_its_depth_and_place():
    plan = vp.planning.disassembly(wedged(), base=["body"], budget=LONG, motion="mates")
    assert plan.verdict == "held" and set(plan.remaining) == {"key", "pin"} and not plan
    key, pin = plan.stuck["key"], plan.stuck["pin"]
    assert key.verdict == pin.verdict == "held"
    assert {o.parts for o in key.clashes} == {("body", "key")} and key.clashes[0].depth == pytest.approx(1e-5, rel=0.1)
    assert key.way.motion == "straight" and np.allclose(key.way.direction, [0, 1, 0])
    assert not pin.clashes and pin.blockers == ("key",)
    assert reason(pin) == "held by key, which does not come out"
    words = reason(key)
    assert (
        words.startswith("held: overlaps body by 0.01 mm as drawn at (")
        and "a clash; without it: straight along (0, 1, 0)" in words
    )
    assert words in table(plan)
    told = document(plan, 0, 1e-6)["stuck"]["key"]
    assert told["verdict"] == "held" and told["held_by"][0]["parts"] == ["body", "key"] and told["held_by"][0]["clash"]


def test_what_is_drawn_twice_at_one_place_leaves_as_one():
    clip = box(0.01, 0.01, 0.01), cases.at(0.02, 0.02, 0.01)
    beside = box(0.01, 0.01, 0.01), cases.at(0.06, 0.02, 0.01)
    scene = scene_of({"plate": box(0.1, 0.1, 0.01), "clip": clip, "clip again": clip, "beside": beside})
    plan = vp.planning.disassembly(scene, budget=LONG)
    assert plan and ("clip", "clip again") in order(plan) and plan.duplicates == (("clip", "clip again"),)
    assert "  drawn 2 times at one place, and leaves as one: clip, clip again" in table(plan)
    assert "clip – clip again" not in table(plan)
    twice = scene_of({"plate": box(0.1, 0.1, 0.01), "plate again": box(0.1, 0.1, 0.01), "clip": clip})
    assert order(vp.planning.disassembly(twice, budget=LONG)) == [("clip",)]  # both plates stay


def with_bearing(name):
    """A ring with a ball in it that an inner ring holds there, in a block: no part of the three comes out alone."""
    race = torus(0.00725, 0.002)
    outer = cylinder(0.011, 0.007) - cylinder(0.009, 0.007) - race.translated(0, 0, 0.0035)
    inner = cylinder(0.0055, 0.007) - cylinder(0.004, 0.007) - race.translated(0, 0, 0.0035)
    block = box(0.04, 0.04, 0.012).translated(-0.02, -0.02, -0.005) - cylinder(0.01101, 0.007)
    balls = {f"{name} ball:{k}": sphere(0.0019).translated(x, 0, 0.0035) for k, x in ((1, 0.00725), (2, -0.00725))}
    return scene_of({"block": block, f"{name} outer": outer, f"{name} inner": inner, **balls})


def test_what_leaves_as_one_is_out_and_named():
    for name, motion in (("608 bearing", "mates"), ("puzzle", "straight")):
        plan = vp.planning.disassembly(with_bearing(name), budget=4.0, motion=motion)
        assert plan and plan.verdict == "removable" and not plan.remaining
        (whole,) = plan.together
        assert set(whole) == set(plan.names) - {"block"}
        assert f"  not taken apart further: {', '.join(whole)}" in table(plan)
        assert document(plan, 0, 1e-6)["together"] == [list(whole)]


def test_a_part_of_a_budget_is_kept_for_what_does_not_come_out():
    budget = Budget(1.0, clock=lambda: 0.0, reserve=0.1)
    budget.ask(450)
    with pytest.raises(BudgetError):
        budget.ask(1)
    assert budget.ended == "500 questions"
    budget.release()
    budget.ask(49)
    assert budget.ended == "500 questions"  # that ended the search before
    with pytest.raises(BudgetError):
        budget.ask(1)


def pegboard(count):
    """A block with pegs in its top and in its front, named by turns."""
    block = box(0.02 * count, 0.05, 0.05)
    peg = cylinder(0.003, 0.02)
    parts = {}
    for k in range(count):
        up, front = cylinder(0.0032, 0.02), cylinder(0.0032, 0.02).rotated((1, 0, 0), 0.5 * np.pi)
        block = block - up.translated(0.01 + 0.02 * k, 0.035, 0.03) - front.translated(0.01 + 0.02 * k, 0.02, 0.015)
        parts[f"peg:{2 * k}"] = peg.translated(0.01 + 0.02 * k, 0.035, 0.031)
        parts[f"peg:{2 * k + 1}"] = peg.rotated((1, 0, 0), 0.5 * np.pi).translated(0.01 + 0.02 * k, 0.019, 0.015)
    return scene_of({"block": block, **parts})


def test_one_side_is_taken_apart_after_the_other():
    plan = vp.planning.disassembly(pegboard(5), budget=LONG, motion="straight")
    sides = [tuple(np.round(step.way.direction)) for step in plan.steps]
    assert plan and len(sides) == 10 and sum(a != b for a, b in pairwise(sides)) == 1
    assert [int(step.parts[0].split(":")[1]) // 2 for step in plan.steps[:5]] == list(range(5))  # the next one beside


def test_instances_of_one_pattern_share_a_line_in_models_of_many_parts():
    plan = vp.planning.disassembly(pegboard(16), budget=LONG, motion="straight")
    text = table(plan)
    rows = [line for line in text.splitlines() if " × peg: straight along" in line]
    assert len(rows) == 2 and all("16 × peg" in row for row in rows) and rows[0].startswith("    1–16  ")


def test_a_part_is_looked_at_again_only_once_something_in_its_way_is_gone(monkeypatch):
    looked = []
    free = vp.planning.order.Ways.free
    monkeypatch.setattr(vp.planning.order.Ways, "free", lambda self, u, p: looked.append(u) or free(self, u, p))
    tower = {f"block {k}": (box(0.02, 0.02, 0.01), cases.at(0.0, 0.0, 0.01 * k)) for k in range(1, 7)}
    tube = box(0.03, 0.03, 0.08) - box(0.0204, 0.0204, 0.08).translated(0.0048, 0.0048, 0.01)
    scene = scene_of({"tube": (tube, cases.at(-0.005, -0.005, 0.0)), **tower})
    plan = vp.planning.disassembly(scene, base=["tube"], budget=LONG, motion="straight")
    assert order(plan) == [(f"block {k}",) for k in range(6, 0, -1)]
    assert len(looked) <= 12  # six at first, and one more after each that leaves


def test_a_budget_that_ends_keeps_what_was_found_and_says_so_of_every_other_part():
    part = vp.planning.disassembly(pegboard(4), budget=0.02, motion="straight")
    assert part.budget.ended and {*part.remaining, *(name for (name,) in order(part))} == {f"peg:{k}" for k in range(8)}
    assert part.steps and part.remaining and all(part.stuck[name].ended for name in part.remaining)


@pytest.mark.parametrize(
    "scene", [cases.bolted_plate, cases.latched_box, cases.bayonet, cases.interlocked, lambda: pegboard(3)]
)
def test_no_common_volume_grows_on_a_planned_way(scene):
    scene = scene()
    plan = vp.planning.disassembly(scene, budget=LONG)
    words, looked, none = common_volume.grown(scene, plan)
    assert plan.steps and looked and not words and not none


def test_the_check_sees_a_way_through_a_part():
    scene = scene_of({"plate": box(0.04, 0.04, 0.01), "block": (box(0.01, 0.01, 0.01), cases.at(0.01, 0.01, 0.01))})
    plan = vp.planning.disassembly(scene, budget=LONG, motion="straight")
    assert not common_volume.grown(scene, plan)[0] and plan.steps[0].way.direction[2] == 1.0
    scene["block"].pose = cases.at(0.01, 0.01, -0.0105)  # its way up now leads through the plate
    assert len(common_volume.grown(scene, plan)[0]) == 1


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tophat", "zendstop", "lite6", "stealth9", "bowden_module", "arm"])
def test_no_common_volume_grows_on_the_ways_of_real_models(name, real_models):
    scene = vp.load(real_models / "real" / f"{name}.step")
    plan = vp.planning.disassembly(scene, budget=300.0)
    words, looked, _ = common_volume.grown(scene, plan)
    assert plan.steps and looked and not words
