"""Budgets of searches: processor time, questions, shares."""

import time
from functools import cached_property

import numpy as np
import pytest

import vpframe as vp
from collision.numeric.kernel import compilation, kernel
from tests.vpframe.planning import cases
from vpframe.planning.assembly import Assembly, Budget, BudgetError, working
from vpframe.planning.plan import PlanOptions, _Plan
from vpframe.planning.verdict import Removal


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
    vp.planning.removal(cases.peg(), "peg")  # kernels
    analysis = next(kind.__dict__[slow] for kind in Assembly.__mro__ if slow in kind.__dict__).func

    def slowly(self):
        work(1.0)
        return analysis(self)

    attribute = cached_property(slowly)
    attribute.__set_name__(Assembly, slow)
    monkeypatch.setattr(Assembly, slow, attribute)
    scene = cases.peg()
    if ask == "removal":
        assert vp.planning.removal(scene, "peg", budget=0.75)
    else:
        assert vp.planning.disassembly(scene, "peg", budget=0.75)


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
