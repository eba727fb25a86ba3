"""Plans: kept when cut off, overlaps, names, subassemblies."""

import pytest

import vpframe as vp
from tests.vpframe.planning import cases
from tests.vpframe.planning.cases import order
from vpframe.planning.document import headline
from vpframe.planning.plan import _Plan
from vpframe.scene.modelling import box
from vpframe.scene.modelling import scene as scene_of

LONG = 600.0


def test_ways_are_searched_for_once_all_that_comes_out_easily_is_out(monkeypatch):
    """Linked rings, which come out of a cup as one and never apart, lie over a block."""
    cup = box(0.12, 0.12, 0.11) - box(0.1, 0.1, 0.11).translated(0.01, 0.01, 0.01)
    added = scene_of(
        {"cup": (cup, cases.at(-0.05, -0.06, -0.07)), "under": (box(0.08, 0.08, 0.02), cases.at(-0.03, -0.04, -0.05))}
    )
    scene = vp.Scene([*cases.linked_rings().parts, *added.parts])
    out_before = []
    monkeypatch.setattr(_Plan, "_search", lambda self, *given: out_before.append(set(self.out)))
    plan = vp.planning.disassembly(scene, base=["cup"], budget=LONG)
    assert order(plan) == [("one", "two"), ("under",)]
    assert not plan.remaining and plan.together == (("one", "two"),)
    assert headline(plan).endswith("comes out in 2 steps; 1 group of them is not taken apart")
    assert scene.index("under") in out_before[0]


def test_steps_found_before_ctrl_c_are_kept():
    count = []

    def found(parts, text):
        count.append(parts)
        if len(count) == 2:
            raise KeyboardInterrupt

    plan = vp.planning.disassembly(cases.latched_box(), budget=LONG, found=found)
    assert plan.interrupted and not plan
    assert order(plan) == count == [("latch",), ("lid",)]
    assert plan.remaining == ("content",)


def test_what_was_found_of_a_level_is_kept_when_it_is_cut_off():
    block = cases.box(0.01, 0.01, 0.01)
    blocks = {f"block {k}": (block, cases.at(0.02 * k)) for k in range(4)}
    scene = scene_of({"base": cases.box(0.08, 0.02, 0.01).translated(z=-0.01), **blocks})

    def progress(fraction, text):
        if "part 3 of 4" in text:
            raise KeyboardInterrupt

    plan = vp.planning.disassembly(scene, base=["base"], budget=LONG, progress=progress)
    assert plan.interrupted and order(plan) == [("block 0",), ("block 1",)]
    assert plan.remaining == ("block 2", "block 3")


def test_an_overlap_is_told_never_deepened_and_authorised_on_request():
    press = scene_of(
        {
            "block": cases.box(0.03, 0.03, 0.01) - cases.box(0.01, 0.01, 0.01).translated(0.01, 0.01),
            "wedge": (cases.box(0.0101, 0.01, 0.01), cases.at(0.00995, 0.01, 0.0)),
        }
    )
    plan = vp.planning.disassembly(press, "wedge", budget=LONG, motion="straight")
    assert [o.parts for o in plan.overlaps[:1]] == [("block", "wedge")]
    assert plan.overlaps[0].depth == pytest.approx(5e-5, rel=0.01)
    meant = vp.planning.disassembly(press, "wedge", budget=LONG, motion="straight", authorise=[("block", "wedge")])
    assert meant and meant.overlaps == ()


def tree_of_names():
    """A bolted plate whose parts have paths in a product tree."""
    solids = cases.bolted_plate_solids()
    names = {"base": "frame/base", "plate": "cover/plate", "bolt": "fasteners/m8/bolt", "nut": "fasteners/m8/nut"}
    return scene_of({names[name]: solid for name, solid in solids.items()})


def test_names_are_those_that_a_session_takes():
    scene = tree_of_names()
    plan = vp.planning.disassembly(scene, "plate", base=["base", "m8/nut"], budget=LONG)
    assert plan.target == "cover/plate" and plan.base == ("fasteners/m8/nut", "frame/base")[::-1]
    assert order(plan) == [("fasteners/m8/bolt",), ("cover/plate",)]
    assert vp.planning.removal(scene, "nut", budget=LONG).parts == ("fasteners/m8/nut",)
    ignoring = vp.planning.removal(scene, "bolt", budget=LONG, motion="straight", ignore=[("bolt", "nut")])
    assert ignoring and not vp.planning.removal(scene, "bolt", budget=LONG, motion="straight")
    carried = vp.planning.disassembly(scene, carry=[("bolt", "plate")], budget=LONG)
    assert order(carried) == [("fasteners/m8/nut",), ("cover/plate", "fasteners/m8/bolt")]
    with pytest.raises(vp.UnknownPartError, match="did you mean 'fasteners/m8/nut'"):
        vp.planning.disassembly(scene, "nutt")


def test_a_subassembly_is_taken_out_as_one():
    solids = {"tray": box(0.06, 0.06, 0.01), "unit/foot": (box(0.02, 0.02, 0.01), cases.at(0.01, 0.01, 0.01)),
              "unit/head": (box(0.01, 0.01, 0.01), cases.at(0.01, 0.01, 0.02)),
              "on top/cap": (box(0.005, 0.005, 0.005), cases.at(0.01, 0.01, 0.03))}  # fmt: skip
    plan = vp.planning.disassembly(scene_of(solids), "unit", budget=LONG, motion="straight")
    assert plan.target == "unit" and order(plan) == [("unit/foot", "unit/head")] and plan.proven
    assert plan.steps[0].unsupported == ("on top/cap",)
    with pytest.raises(vp.VpframeError, match="in two groups"):
        vp.planning.disassembly(scene_of(solids), "unit", carry=[("foot", "cap")], budget=LONG)
