"""What `authorise` and `ignore` let hands do: the overlap as drawn and no deeper; everything, and it is named."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

import vpframe as vp
from vpframe.app.cli import main
from vpframe.errors import TaskError
from vpframe.scene.modelling import box, cylinder, write_step
from vpframe.scene.modelling import scene as scene_of
from vpframe.scene.names import ignored_words
from vpframe.session import rules

sys.path.insert(0, str(Path(__file__).parents[1] / "planning"))
from test_authorise import CAPTIVE


def pin_in_bore(interference=1e-4):
    """A pin, too large all round, in a blind bore."""
    block = box(0.04, 0.04, 0.02).translated(-0.02, -0.02) - cylinder(0.005, 0.015).translated(z=0.005)
    return {"block": block, "pin": cylinder(0.005 + interference, 0.03).translated(z=0.005)}


def key_in_slot():
    """A key, 0.1 mm too wide on either side and at its bottom, in an open slot."""
    block = box(0.04, 0.03, 0.02) - box(0.02, 0.008, 0.02).translated(0.01, 0.011, 0.01)
    return {"block": block, "key": box(0.0204, 0.0084, 0.0101).translated(0.0098, 0.0108, 0.0099)}


def wedge_in_plate():
    """A plug whose square shank is driven 0.05 mm into the plate around it."""
    plate = box(0.04, 0.04, 0.01).translated(-0.02, -0.02) - box(0.01, 0.01, 0.01).translated(-0.005, -0.005)
    return {"plate": plate, "plug": box(0.0101, 0.0101, 0.02).translated(-0.00505, -0.00505, -0.005)}


FREED = [(pin_in_bore, "pin", "block"), (key_in_slot, "key", "block"), (wedge_in_plate, "plug", "plate")]


def moved(session, part, way):
    hand = session.hand()
    hand.grab(part)
    outcome = hand.move_by(way, required=False)
    hand.release()
    return outcome


@pytest.mark.parametrize("rule", [rules.leave_all, rules.accept_all])
@pytest.mark.parametrize(("parts", "part", "other"), FREED)
def test_an_authorised_overlap_comes_out_along_its_axis_and_no_other_way(parts, part, other, rule):
    scene = scene_of(parts())
    with vp.Session(scene, rule=rule) as session:
        session.authorise(part, other)
        session.step()
        session.expect_no_clash()
        home = scene[part].pose.translation.copy()
        for way in ((0.002, 0.0, 0.0), (0.0, -0.002, 0.0), (0.001, 0.001, 0.004)):
            outcome = moved(session, part, way)
            assert not outcome and f"{other} stands in its way" in outcome.reason, outcome.reason
            assert np.linalg.norm(scene[part].pose.translation - home) <= 2e-6
        assert moved(session, part, (0.0, 0.0, 0.03))
        assert moved(session, part, (0.03, 0.0, 0.0)), "free of each other"
        fits = parts is pin_in_bore  # any other overlap only shrinks: it is not entered again
        assert moved(session, part, (-0.03, 0.0, 0.0)) and bool(moved(session, part, (0.0, 0.0, -0.03))) is fits
        session.expect_no_clash()
        assert session.ignored == []


@pytest.mark.parametrize(("parts", "part", "other"), FREED[:2])
def test_an_authorised_overlap_is_not_deepened(parts, part, other):
    scene = scene_of(parts())
    with vp.Session(scene, rule=rules.leave_all) as session:
        session.authorise(other, part)
        outcome = moved(session, part, (0.0, 0.0, -0.002))
        assert not outcome and f"{other} stands in its way" in outcome.reason
        assert abs(scene[part].pose.translation[2]) <= 2e-6


@pytest.mark.parametrize(("parts", "part", "other"), CAPTIVE)
def test_a_captive_part_does_not_leave_through_an_authorised_one(parts, part, other):
    scene = scene_of(parts())
    with vp.Session(scene, rule=rules.leave_all) as session:
        session.authorise(part, other)
        for way in ((0.03, 0.0, 0.0), (0.0, 0.0, 0.06), (0.0, 0.0, -0.06)):
            assert not moved(session, part, way)
        session.expect_no_clash()


@pytest.mark.parametrize(("parts", "part", "other"), [*CAPTIVE, *FREED])
def test_an_ignored_pair_passes_and_is_named(parts, part, other, tmp_path):
    scene = scene_of({**parts(), "far": box(0.001, 0.001, 0.001).translated(0.0, 0.2)})
    with vp.Session(scene, rule=rules.leave_all) as session:
        session.ignore(part, other)
        assert moved(session, part, (0.04, 0.0, 0.0))
        session.expect_no_clash()
        session.conclude()
        folder = Path(str(session.report(tmp_path / "report")))
    assert session.ignored == [tuple(name for name in scene.names if name in (part, other))]
    document = json.loads((folder / "report.json").read_text())
    assert document["ignored"] == [list(pair) for pair in session.ignored] and document["can_be_done"]
    words = f"The task can be done, ignores {'–'.join(session.ignored[0])}."
    assert words in (folder / "index.html").read_text()


def test_what_is_taken_away_is_named_once():
    pairs = [("a", "b"), ("a", "c"), ("a", "d"), ("b", "c")]
    assert ignored_words(pairs, 4) == "ignores a–all, b–c"
    assert ignored_words([], 4) == "" and ignored_words([("a", "b")], 2) == "ignores a–b"


def test_both_words_outlive_a_reset_and_a_saved_state():
    scene = scene_of({**key_in_slot(), "lid": box(0.01, 0.01, 0.01).translated(z=0.05)})
    with vp.Session(scene, rule=rules.leave_all) as session:
        session.authorise("key", "block")
        session.ignore("lid")
        saved = session.save()
    with vp.Session(scene, rule=rules.leave_all) as session:
        session.restore(saved)
        assert session.authorised == [("block", "key")]
        assert sorted(session.ignored) == [("block", "lid"), ("key", "lid")]
        session.reset()
        assert not moved(session, "key", (0.002, 0.0, 0.0)) and moved(session, "key", (0.0, 0.0, 0.015))
        assert moved(session, "lid", (0.0, 0.0, -0.045))


def test_forces_know_no_overlap_as_drawn_and_the_pair_is_named():
    with vp.Session(scene_of(key_in_slot()), rule=rules.leave_all) as session:
        session.authorise("key", "block")
        assert session.ignored == []
        session.behave("key", vp.Gravity())
        assert session.ignored == [("block", "key")]


def test_a_part_on_both_sides_is_refused():
    with vp.Session(scene_of(key_in_slot())) as session:
        for verb in (session.authorise, session.ignore):
            with pytest.raises(TaskError, match="a part is on both sides"):
                verb("key", "key")


@pytest.mark.parametrize("press_fit", [None, "u8"])
def test_clash_plan_and_run_agree_on_a_press_fit(press_fit, tmp_path, capsys):
    """Ø10.048 in Ø10: 24 µm radial, beyond s7, within u8."""
    block = box(0.04, 0.04, 0.02).translated(-0.02, -0.02) - cylinder(0.005, 0.015).translated(z=0.005)
    path = write_step(tmp_path / "pressed.step", {"block": block, "pin": cylinder(0.005024, 0.03).translated(z=0.005)})
    options = [] if press_fit is None else ["--press-fit", press_fit]
    script = tmp_path / "out.py"
    code = main(["clash", str(path), *options])
    assert code == (press_fit is None)
    command = ["disassemble", str(path), "--part", "pin", "--motion", "straight", "--task", str(script), *options]
    assert main(command) == code, capsys.readouterr()
    if press_fit is not None:
        capsys.readouterr()
        assert main(["run", str(script)]) == 0, capsys.readouterr()
        assert "press fit, 24 µm radial interference, force not checked" in "".join(capsys.readouterr())
    assert main(["disassemble", str(path), "--press-fit", "q99"]) == 2
