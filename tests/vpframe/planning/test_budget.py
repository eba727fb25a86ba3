"""Budgets count questions and processor time after the analysis; a plan names what ended it and what was in the way."""

import time
from functools import cached_property

import cases
import numpy as np
import pytest

import vpframe as vp
from collision.numeric.kernel import compilation, kernel
from vpframe.planning import assembly as planning_assembly
from vpframe.planning.assembly import Assembly, Budget, BudgetError, working
from vpframe.planning.document import document, reason, table
from vpframe.planning.plan import PlanOptions, _Plan
from vpframe.planning.verdict import Removal
from vpframe.scene.modelling import box
from vpframe.scene.modelling import scene as scene_of


def work(seconds):
    """Use processor time."""
    end = time.process_time() + seconds
    while time.process_time() < end:
        sum(range(1000))


def test_a_machine_that_is_busy_with_others_ends_no_search(monkeypatch):
    """Each look at the wall clock is an hour later."""
    now = [0.0]

    def monotonic():
        now[0] += 3600.0
        return now[0]

    monkeypatch.setattr(time, "monotonic", monotonic)
    monkeypatch.setattr(time, "perf_counter", monotonic)
    assert vp.planning.removal(cases.peg(), "peg", budget=5.0)
    assert vp.planning.removal(cases.bayonet(), "plug", budget=20.0)
    assert len(vp.planning.disassembly(cases.latched_box(), budget=20.0).steps) == 3


@pytest.mark.parametrize("ask", ["removal", "disassembly"])
@pytest.mark.parametrize("slow", ["candidates", "overlaps", "_touching"])
def test_a_budget_begins_after_the_analysis(monkeypatch, slow, ask):
    analysis = next(kind.__dict__[slow] for kind in Assembly.__mro__ if slow in kind.__dict__).func

    def slowly(self):
        work(2.0)
        return analysis(self)

    attribute = cached_property(slowly)
    attribute.__set_name__(Assembly, slow)
    monkeypatch.setattr(Assembly, slow, attribute)
    scene = cases.peg()
    vp.planning.removal(cases.peg(), "peg")  # kernels
    if ask == "removal":
        assert vp.planning.removal(scene, "peg", budget=1.5)
    else:
        assert vp.planning.disassembly(scene, "peg", budget=1.5)


def test_what_is_compiled_takes_nothing_from_a_budget():
    @kernel
    def new(x):
        total = 0.0
        for k in range(len(x)):
            total += np.sin(x[k]) * k
        return total

    compiled, began, spent = compilation.kernels, working(), time.process_time()
    new(np.zeros(3))
    spent = time.process_time() - spent
    assert compilation.kernels > compiled and working() - began < 0.5 * spent


def test_the_budget_that_ended_a_search_is_named_with_what_was_in_the_way(monkeypatch):
    monkeypatch.setattr(planning_assembly.time, "process_time", lambda: 0.0)
    found = vp.planning.removal(cases.linked_rings(), "two", budget=0.3)
    assert (found.verdict, found.ended, found.blockers) == ("not found", "150 questions", ("one",))
    plan = vp.planning.disassembly(cases.linked_rings(), "two", budget=1.0, base=["one"])
    text = table(plan)
    assert "not found to come out: two" in text and "in the way: one; the budget of" in text
    stuck = document(plan, 0, 1e-6)["stuck"]["two"]
    assert stuck["ended_by"].endswith("questions") and stuck["in_the_way"] == ["one"]

    late = [0.0]

    def process_time():  # each look at the processor time is a second later
        late[0] += 1.0
        return late[0]

    monkeypatch.setattr(planning_assembly.time, "process_time", process_time)
    found = vp.planning.removal(cases.linked_rings(), "two", budget=60.0)
    assert found.ended == "60 s of processor time" and found.verdict == "not found"


def test_parts_that_were_not_looked_at_name_what_was_seen_in_their_way(monkeypatch):
    monkeypatch.setattr(planning_assembly.time, "process_time", lambda: 0.0)
    plan = vp.planning.disassembly(cases.latched_box(), "content", base=["box", "latch"], budget=0.02)
    assert plan.verdict == "not found" and plan.budget.ended == "10 questions"
    assert plan.stuck["content"].ended == "10 questions"
    assert plan.stuck["content"].blockers
    assert "the budget of 10 questions was used up; a larger --budget may find more" in table(plan)


def test_a_share_that_ends_ends_what_it_is_of_only_where_that_is_used_up_too():
    clock = [0.0]
    budget = Budget(10.0, clock=lambda: clock[0])
    share = budget.share(0.1)
    clock[0] = 2.0
    with pytest.raises(BudgetError, match="1 s of processor time"):
        share.ask()
    budget.give_back(share)
    assert budget.by_clock and not budget.ended and budget.used == 1
    budget.ask()
    budget.take(7.0)  # of workers
    clock[0] = 4.0
    with pytest.raises(BudgetError, match="10 s of processor time"):
        budget.ask()


# --- proofs and the state that they are made for


def drawer():
    """A drawer in a cabinet behind a bar that slides aside, and not out."""
    cabinet = box(0.08, 0.04, 0.03) - box(0.06, 0.02, 0.02).translated(0.01, 0.01, 0.005)
    cabinet = cabinet - box(0.01, 0.0205, 0.0205).translated(0.07, 0.00975, 0.00475)
    slot = box(0.0055, 0.038, 0.021).translated(0.055, 0.001, 0.0045)
    return scene_of(
        {
            "cabinet": cabinet - slot,
            "drawer": (box(0.02, 0.0198, 0.0198), cases.at(0.0301, 0.0101, 0.0051)),
            "bar": (box(0.005, 0.0215, 0.0205), cases.at(0.0553, 0.0095, 0.0047)),
        }
    )


@pytest.mark.parametrize(
    ("scene", "base", "stuck"),
    [
        (drawer, "cabinet", {"drawer": ("enclosed", {"bar", "cabinet"}), "bar": ("not found", set())}),
        (cases.latched_box, "box,latch", {"content": ("enclosed", {"box", "lid"}), "lid": ("not found", set())}),
    ],
)
def test_a_proof_is_told_of_its_part_and_state_and_the_headline_is_no_other_parts(scene, base, stuck):
    plan = vp.planning.disassembly(scene(), base=base.split(","), motion="mates", budget=600.0)
    text = table(plan)
    assert plan.verdict == "not found" and text.startswith("not found to come out: ")
    for name, (verdict, holders) in stuck.items():
        found = plan.stuck[name]
        assert found.verdict == verdict and holders <= set(found.holders)
        if holders:
            assert f"  {name} is enclosed while {', '.join(found.holders)} stay (proof)" in text
        else:
            assert f"  {name} is not found to come out" in text
    proofs = document(plan, 0, 1e-6)["proofs"]
    assert set(proofs) == {name for name, (verdict, _) in stuck.items() if verdict == "enclosed"}


def test_the_headline_is_a_proof_where_all_that_it_is_about_stays():
    inside = vp.planning.disassembly(cases.ball_in_shell(), base=["shell"], budget=600.0)
    assert inside.verdict == "enclosed" and table(inside).startswith(
        "enclosed: ball\n  ball is enclosed while shell stays"
    )
    block = vp.planning.disassembly(cases.box_in_pocket(), base=["housing"], budget=600.0)
    assert block.verdict == "locked" and "locked: contacts leave it no motion while housing stays (proof)" in table(
        block
    )
    # a ball between a block that is locked by the base, and the base
    both = vp.planning.disassembly(cases.latched_box(), "content", base=["box", "latch", "lid"], budget=600.0)
    assert both.verdict == "enclosed" and {"box", "lid"} <= set(both.stuck["content"].holders)


def test_a_proof_does_not_outlive_its_state():
    """What a search found of a part is forgotten once one of the parts that it names comes out."""
    scene = cases.latched_box()
    plan = _Plan(Assembly(scene), None, PlanOptions(base=["box"], budget=600.0))
    content, lid = (scene.index("content"),), (scene.index("lid"),)
    plan.results = {
        content: Removal(("content",), "enclosed", holders=("box", "lid")),
        (1,): Removal(("other",), "not found", blockers=("box",)),
    }
    known = plan.ways.of((scene.index("latch"),), [])[0]
    plan._take(known, set(range(len(scene))), set(range(len(scene))))
    assert content in plan.results
    known = plan.ways.of(lid, [])[0]
    plan._take(known, set(range(len(scene))), set(range(len(scene))))
    assert content not in plan.results and (1,) in plan.results


def test_a_part_that_is_not_found_to_come_out_names_the_last_contact_and_the_budget_used():
    found = vp.planning.removal(cases.linked_rings(), "two", budget=0.3)
    assert found.verdict == "not found" and found.seconds > 0.0
    (part, surface, by, other), *_ = found.last
    assert (part, by) == ("two", "one")
    assert f"; stopped last: surface {surface} of two at surface {other} of one" in reason(found)
    free = found.tried[-1]
    assert free.way == "free" and free.stopped_by == ("one",) and free.surfaces == found.last
    plan = vp.planning.disassembly(cases.linked_rings(), "two", budget=0.3, base=["one"])
    assert plan.seconds > 0.0
    assert f"  used {plan.seconds:.3g} of 0.3 s of processor time, {plan.budget.used} of 150 questions" in table(plan)
