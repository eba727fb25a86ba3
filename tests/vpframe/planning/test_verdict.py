"""Verdicts of one part, cases with known answers: the way, or the proof that there is none."""

import pytest

import vpframe as vp
from constraints.freedom.escape import holds
from tests.vpframe.planning import cases
from vpframe.planning import enclosure, ways
from vpframe.planning.assembly import LINEAR, Assembly, Budget
from vpframe.planning.verdict import find

LONG = 600.0
"""s: no case may end by the clock on a slow machine; each ends by itself"""
"""m: no way presses surfaces deeper than where the parts stand by more"""


def test_the_blockers_of_a_pin_with_two_heads_are_named():
    found = vp.planning.removal(cases.headed_pin(), "pin", motion="straight", budget=LONG)
    assert found.verdict == "not found"
    assert set(found.blockers) <= {"lower", "upper"}
    up = next(t for t in found.tried if t.way == "straight along (0, 0, 1)")
    assert up.stopped_by == ("lower", "upper")
    assert up.reached == pytest.approx(1e-4, abs=1e-5)
    assert {(a, b) for a, _, b, _ in up.surfaces} >= {("pin", "lower")}


def test_linked_rings_are_not_found_and_never_locked():
    found = vp.planning.removal(cases.linked_rings(), "two", budget=1.0)
    assert found.verdict == "not found" and found.proof is None
    assert max(t.reached for t in found.tried) > 1e-3


@pytest.mark.parametrize(
    ("scene", "part"),
    [
        (cases.linked_rings, "two"), (cases.headed_pin, "pin"), (cases.peg, "peg"), (cases.dovetail, "slide"),
        (cases.l_hook, "hook"), (cases.bayonet, "plug"), (cases.interlocked, "one"),
        pytest.param(cases.c_clip, "clip", marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_what_can_move_is_neither_locked_nor_enclosed(scene, part):
    scene = scene()
    assembly, i = Assembly(scene), scene.index(part)
    others = [j for j in range(len(scene)) if j != i]
    cone, _ = ways.cone_of(assembly, (i,), others)
    assert cone.lock() is None
    assert enclosure.enclosed_by(assembly, (i,), others) is None
    assert enclosure.caged_by(assembly, (i,), others) is None


def test_a_block_in_its_pocket_is_locked_by_a_proof_that_holds_exactly():
    found = vp.planning.removal(cases.box_in_pocket(), "block", budget=LONG)
    assert found.verdict == "locked"
    proof = found.proof
    assert holds(proof.cone.rows[list(proof.lock.rows)], proof.multipliers)
    assert {(a, b) for a, _, b, _ in proof.surfaces} == {("block", "housing")}
    assert proof.tolerance == LINEAR


def test_the_same_seed_gives_the_same_answer_and_another_seed_another():
    def once(seed):
        budget = Budget(0.6, clock=lambda: 0.0)  # 300 questions, whatever time they take
        found = find(Assembly(cases.linked_rings()), (1,), (0,), budget, seed=seed)
        return [(t.way, t.reached, t.stopped_by) for t in found.tried], found.questions

    assert once(3) == once(3)
    assert once(3) != once(4)


def test_a_search_ends_when_its_questions_are_used_up():
    budget = Budget(0.2, clock=lambda: 0.0)
    found = find(Assembly(cases.linked_rings()), (1,), (0,), budget)
    assert found.verdict == "not found" and not budget.by_clock
    assert budget.questions == 100 and 100 <= found.questions < 120


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"part": "nut2"}, "no part"),
        ({"part": ("nut", "nut")}, "name each once"),
        ({"part": "nut", "motion": "up"}, "known are straight"),
        ({"part": "nut", "budget": -1.0}, "positive number of seconds"),
        ({"part": "nut", "clearance": float("nan")}, "length of at least 0"),
        ({"part": "nut", "authorise": [("nut", "bolt")]}, "no part 'bolt'"),
    ],
)
def test_bad_questions_are_answered_in_one_line(arguments, words):
    with pytest.raises(vp.VpframeError, match=words):
        vp.planning.removal(cases.m16(0.01), **arguments)
