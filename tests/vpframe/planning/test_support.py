"""Parts that stay without support once a part is taken out are named beside the plan."""

import json

import pytest

import vpframe as vp
from tests.vpframe.planning import cases
from vpframe.app.cli import main
from vpframe.planning.document import table
from vpframe.planning.plan import disassembly
from vpframe.scene.modelling import box, cylinder, write_step
from vpframe.scene.modelling import scene as scene_of

LONG = 600.0


def frame():
    """Two posts with holes along x, on a plate."""
    hole = cylinder(0.0051, 0.2).rotated((0, 1, 0), 1.5707963267948966).translated(-0.1, 0.0, 0.02)
    post = box(0.01, 0.03, 0.03).translated(0.0, -0.015)
    return box(0.1, 0.04, 0.01).translated(-0.05, -0.02, -0.01) + (
        post.translated(-0.04) + post.translated(0.03) - hole
    )


def rod_with_nuts():
    """A rod in both posts, a ring that fits it snugly beside each post, in the air."""
    along = ((0, 1, 0), 1.5707963267948966)
    rod = cylinder(0.005, 0.12).rotated(*along).translated(-0.06, 0.0, 0.02)
    ring = (cylinder(0.009, 0.006) - cylinder(0.005, 0.006)).rotated(*along)
    return {
        "frame": frame(), "rod": rod, "left ring": (ring, cases.at(-0.048, 0.0, 0.02)),
        "right ring": (ring, cases.at(0.042, 0.0, 0.02)),
    }  # fmt: skip


def shelf():
    """A shelf on two ledges, a block on the shelf."""
    rack = box(0.06, 0.04, 0.04) - box(0.05, 0.04, 0.035).translated(0.005, 0.0, 0.005)
    ledge = box(0.004, 0.04, 0.004)
    rack = rack + ledge.translated(0.005, 0.0, 0.015) + ledge.translated(0.051, 0.0, 0.015)
    return {
        "rack": rack, "shelf": (box(0.0498, 0.05, 0.003), cases.at(0.0051, -0.005, 0.019)),
        "block": (box(0.01, 0.01, 0.01), cases.at(0.025, 0.015, 0.022)),
    }  # fmt: skip


def pin_through_a_ring_on_a_table():
    """The ring lies on the table when the pin is gone; the washer hung on the pin's collar falls."""
    table_ = box(0.06, 0.06, 0.01).translated(-0.03, -0.03, -0.01) - cylinder(0.0031, 0.01).translated(z=-0.01)
    ring = cylinder(0.01, 0.005) - cylinder(0.0035, 0.005)
    pin = cylinder(0.003, 0.04).translated(z=-0.005) + cylinder(0.005, 0.002).translated(z=0.02)
    washer = cylinder(0.008, 0.001) - cylinder(0.0035, 0.001)
    return {"table": table_, "ring": ring, "pin": pin, "washer": (washer, cases.at(z=0.022))}


def pressed():
    """A block pressed between two walls, by 0.05 mm each side, and a tray under it that only it keeps nothing from."""
    walls = box(0.04, 0.03, 0.03) - box(0.02, 0.03, 0.025).translated(0.01, 0.0, 0.005)
    return {
        "walls": walls, "block": (box(0.0201, 0.01, 0.008), cases.at(0.00995, 0.01, 0.02)),
        "tray": (box(0.0198, 0.03, 0.003), cases.at(0.0101, 0.0, 0.0169)),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("parts", "goal", "base", "dropped"),
    [
        (rod_with_nuts, "rod", "frame", ("left ring", "right ring")),
        (shelf, "shelf", "rack", ("block",)),
        (pin_through_a_ring_on_a_table, "pin", "table", ()),  # the washer goes first
        (pin_through_a_ring_on_a_table, "washer", "table", ()),
        (pressed, "tray", "walls", ()),  # the block stays, pressed in
    ],
)
def test_what_nothing_holds_any_more_is_named(parts, goal, base, dropped):
    plan = disassembly(scene_of(parts()), goal, base=[base], budget=LONG)
    assert plan and plan.steps[-1].unsupported == dropped
    assert ("without support" in table(plan)) == bool(dropped)


def test_it_stands_in_the_text_the_document_and_the_page(tmp_path, capsys):
    model = write_step(tmp_path / "rod.step", rod_with_nuts())
    given = ["disassemble", str(model), "--part", "rod", "--base", "frame"]
    assert main([*given, "--report", str(tmp_path / "page")]) == 0
    words = "left ring, right ring stay without support once rod is out"
    assert f"  {words}\n" in capsys.readouterr().out
    assert words in (tmp_path / "page" / "index.html").read_text()
    document = json.loads((tmp_path / "page" / "plan.json").read_text())
    assert document["steps"][-1]["unsupported"] == ["left ring", "right ring"]


def test_what_was_in_the_air_before_is_not_named():
    floating = {"frame": frame(), "cube": (box(0.01, 0.01, 0.01), cases.at(0.2, 0.0, 0.0)),
                "lid": (box(0.02, 0.02, 0.002), cases.at(0.2, 0.0, 0.01))}  # fmt: skip
    plan = vp.planning.disassembly(scene_of(floating), "cube", base=["frame"], budget=LONG)
    assert plan and plan.steps[-1].unsupported == ()


def test_all_that_stood_on_a_target_without_base_is_named():
    scene = scene_of({"plate": box(0.06, 0.06, 0.01), "cube": (box(0.01, 0.01, 0.01), cases.at(0.02, 0.02, 0.01))})
    plan = vp.planning.disassembly(scene, "plate", budget=LONG)
    assert plan and plan.steps[-1].unsupported == ("cube",)
