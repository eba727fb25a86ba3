"""What `authorise` and `ignore` let hands do: the overlap as drawn and no deeper; everything, and it is named."""

import json
from pathlib import Path

import pytest

import vpframe as vp
from tests.vpframe.fitted import key_in_slot, moved, pin_in_bore, wedge_in_plate
from tests.vpframe.planning.cases import CAPTIVE
from vpframe.app.cli import main
from vpframe.errors import TaskError
from vpframe.scene.modelling import box, cylinder, write_step
from vpframe.scene.modelling import scene as scene_of
from vpframe.scene.names import ignored_words
from vpframe.session import rules

FREED = [(pin_in_bore, "pin", "block"), (key_in_slot, "key", "block"), (wedge_in_plate, "plug", "plate")]


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
