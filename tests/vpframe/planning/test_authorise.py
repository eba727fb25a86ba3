"""What `authorise` and `ignore` let a plan do: the overlap as drawn and no deeper; everything, and it says so."""

import json

import numpy as np
import pinocchio
import pytest

import vpframe as vp
from collision import Sweeps, Tolerance
from tests.vpframe.planning import cases
from tests.vpframe.planning.cases import CAPTIVE
from vpframe.app.cli import main
from vpframe.planning.assembly import Assembly, translation
from vpframe.planning.plan import removal
from vpframe.scene.modelling import box, cylinder, write_step
from vpframe.scene.modelling import scene as scene_of

LONG = 600.0


@pytest.mark.parametrize(("parts", "part", "other"), CAPTIVE)
@pytest.mark.parametrize("motion", ["straight", "mates"])
def test_an_authorised_overlap_is_no_way_through(parts, part, other, motion):
    scene = scene_of(parts())
    found = vp.planning.removal(scene, part, budget=LONG, motion=motion, authorise=[(part, other)])
    assert found.verdict != "removable" and found.overlaps == ()
    assert not vp.planning.removal(scene, part, budget=LONG, motion="straight")


@pytest.mark.parametrize(("parts", "part", "other"), CAPTIVE)
def test_an_ignored_pair_is_passed_through_and_named(parts, part, other, tmp_path, capsys):
    path = write_step(tmp_path / "captive.step", {**parts(), "far": (box(0.01, 0.01, 0.01), cases.at(0.1))})
    command = ["disassemble", str(path), "--part", part, "--base", other, "--ignore", f"{part}:{other}"]
    assert main(command) == 0
    assert f", ignores {part}–{other}\n" in capsys.readouterr().out
    script = tmp_path / "apart.py"
    assert main([*command, "--json", "--task", str(script)]) == 0
    (step,) = json.loads(capsys.readouterr().out)["steps"]
    assert step["ignores"] == [[part, other]] and step["least_clearance"] is None
    assert f"ignores {part}–{other}" in script.read_text()
    assert main(["run", str(script)]) == 0, capsys.readouterr()


def test_a_way_that_passes_no_ignored_part_names_none():
    scene = scene_of({"base": box(0.01, 0.01, 0.01), "cap": (box(0.01, 0.01, 0.01), cases.at(z=0.01))})
    found = vp.planning.removal(scene, "cap", budget=LONG, ignore=[("cap", "base")], motion="straight")
    assert found.verdict == "removable" and found.clearance.ignored == ((1, 0),)
    assert vp.planning.removal(scene, "cap", budget=LONG, motion="straight").clearance.ignored == ()


@pytest.mark.parametrize("interference", [1e-5, 5e-5, 2e-4])
def test_an_authorised_pin_leaves_its_bore_along_the_axis(interference):
    """It turns in the bore, too, where its facets are others: the fit is excused on its axis, not beside it."""
    block = box(0.04, 0.04, 0.02).translated(-0.02, -0.02) - cylinder(0.005, 0.015).translated(z=0.005)
    pin = cylinder(0.005 + interference, 0.03)
    scene = scene_of({"block": block, "pin": (pin, cases.at(z=0.005))})
    found = vp.planning.removal(scene, "pin", budget=LONG, motion="straight", authorise=[("pin", "block")])
    assert found.verdict == "removable" and np.allclose(found.way.direction, [0.0, 0.0, 1.0])
    assembly = Assembly(scene, [("pin", "block")])
    turned = pinocchio.SE3(pinocchio.exp3(np.array([0.0, 0.0, 0.3])), np.array([0.0, 0.0, 0.002]))
    home = translation(np.zeros(3))
    assert assembly.first_stop([1], [0], home, turned) is None
    assert assembly.first_stop([1], [0], home, translation([1e-4, 0.0, 0.0])) is not None
    assert assembly.first_stop([1], [0], home, translation([0.0, 0.0, -1e-4])) is not None, "into the bottom"


@pytest.mark.parametrize("buried", [5e-5, 4e-4])
def test_a_fit_excuses_no_end_that_is_drawn_into_the_bottom(buried):
    """A snug pin whose end is drawn into the bottom of its bore comes out; it is not pushed on through the bottom."""
    block = box(0.04, 0.04, 0.02).translated(-0.02, -0.02) - cylinder(0.005, 0.015).translated(z=0.005)
    scene = scene_of({"block": block, "pin": (cylinder(0.005, 0.03), cases.at(z=0.005 - buried))})
    assembly, home = Assembly(scene), translation(np.zeros(3))
    assert assembly.mates_of(0, 1)
    assert assembly.first_stop([1], [0], home, translation([0.0, 0.0, 0.03])) is None
    assert assembly.first_stop([1], [0], home, translation([0.0, 0.0, -0.06])).t == 0.0


def test_a_pair_that_is_authorised_is_among_what_the_clearance_is_of():
    """A key drawn into its slot with 50 µm on either side passes a post of the same part, 2 mm beside it."""
    body = box(0.04, 0.014, 0.02).translated(0.0, -0.004) - box(0.01, 0.01, 0.015).translated(0.01, 0.0, 0.005)
    body += box(0.02, 0.002, 0.02).translated(0.005, -0.004, 0.02)
    scene = scene_of({"body": body, "key": (box(0.0101, 0.01, 0.015), cases.at(0.00995, 0.0, 0.005))})
    found = vp.planning.removal(scene, "key", budget=LONG, motion="straight", authorise=[("key", "body")])
    assert found.verdict == "removable" and found.clearance.ignored == ()
    assert found.clearance.parts == (1, 0)
    assert found.clearance.distance == pytest.approx(0.002, rel=0.01)


@pytest.mark.parametrize("interference", [5e-5, 1e-4, 2e-4])
def test_an_authorised_seal_passes_the_end_of_its_shaft_whichever_of_the_two_moves(interference):
    """Their ends lie over each other as they part, seen from behind: inside the other, not in front of it."""
    seal = cylinder(0.007, 0.005) - cylinder(0.004 - interference, 0.005)
    scene = scene_of({"shaft": cylinder(0.004, 0.03), "seal": (seal, cases.at(z=0.012))})
    assembly, home = Assembly(scene, [("shaft", "seal")]), translation(np.zeros(3))
    for start in (0.0, 0.017):
        away = translation([0.0, 0.0, start]), translation([0.0, 0.0, 0.03])
        assert assembly.first_stop([1], [0], *away) is None
        assert assembly.first_stop([0], [1], *(d.inverse() for d in away)) is None
    assert assembly.first_stop([0], [1], home, translation([1e-4, 0.0, 0.0])) is not None


def cup(over, floor=2e-3):
    """A cup with a floor and a lid, and a slug that fills it: flush, or too large all round."""
    tube = box(0.01, 0.01, 0.008).translated(-0.005, -0.005) - box(0.006, 0.006, 0.008).translated(-0.003, -0.003)
    width = 0.006 + 2.0 * over
    slug = box(width, width, 0.004).translated(-0.5 * width, -0.5 * width, 0.004)
    body = tube + box(0.006, 0.006, floor).translated(-0.003, -0.003, 0.004 - floor)
    out = scene_of({"cup": body, "lid": box(0.01, 0.01, 0.001).translated(-0.005, -0.005, 0.008), "slug": slug})
    out["cup"].fixed = out["lid"].fixed = True
    return out


@pytest.mark.parametrize("motion", ["straight", "mates"])
@pytest.mark.parametrize("over", [0.0, 1e-5, 1e-4])
def test_a_slug_that_fills_its_cup_does_not_pass_through_the_floor_that_it_touches(over, motion):
    """Its lower face has the outline of the floor: beyond it, no two faces meet."""
    assert removal(cup(over), "slug", motion=motion).verdict != "removable"


@pytest.mark.parametrize("length", [1e-5, 1e-3, 3e-3, 2e-2])
def test_equal_boxes_on_each_other_do_not_pass_through_each_other(length):
    equal = box(0.006, 0.006, 0.003)
    scene = scene_of({"lower": equal, "upper": equal.translated(z=0.003)})
    sweeps = Sweeps([p.mesh for p in scene.parts], [p.pose for p in scene.parts], Tolerance(linear=1e-6, slop=1e-6))
    down, up = (pinocchio.SE3(np.eye(3), np.array([0.0, 0.0, sign * length])) for sign in (-1.0, 1.0))
    assert sweeps.stop(1, 0, (pinocchio.SE3.Identity(), down)).t == 0.0
    assert sweeps.stop(1, 0, (pinocchio.SE3.Identity(), up)) is None
