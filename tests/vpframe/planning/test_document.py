"""The outputs of a plan: its headline, its proofs, its reasons."""

import pytest

import vpframe as vp
from tests.vpframe.planning import cases
from vpframe.planning import assembly as planning_assembly
from vpframe.planning.document import document, reason, table
from vpframe.scene.modelling import box
from vpframe.scene.modelling import scene as scene_of


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
    plan = vp.planning.disassembly(scene(), base=base.split(","), motion="mates", budget=6.0)
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
