"""`vpframe new`: the first script of a model runs."""

from dataclasses import replace

import pytest

from vpframe.app import scaffold as first_task
from vpframe.app import task_runner as study
from vpframe.app.options import load
from vpframe.errors import VpframeError


def test_a_new_task_runs_and_is_not_overwritten(tmp_path) -> None:
    from vpframe.scene import modelling as m

    m.write_step(
        tmp_path / "two.step",
        {"base": m.box(0.1, 0.1, 0.01), "knob": m.cylinder(0.01, 0.02).translated(0.05, 0.05, 0.05)},
    )
    assert study.new_task(tmp_path / "first.py", tmp_path / "two.step") == ""
    text = (tmp_path / "first.py").read_text()
    assert 'FILE = "two.step"' in text
    assert '"knob": 3 surfaces' in text
    assert study.run_task(tmp_path / "first.py") == 0
    with pytest.raises(VpframeError, match="exists already"):
        study.new_task(tmp_path / "first.py", tmp_path / "two.step")


def test_a_new_task_takes_a_part_out_by_the_axis_that_holds_it(tmp_path) -> None:
    from vpframe.scene import modelling as m

    block = m.box(0.04, 0.04, 0.02).translated(-0.02, -0.02, 0.0) - m.cylinder(0.005, 0.02)
    peg = m.revolve([(0.0, 0.0), (0.005, 0.0), (0.005, 0.02), (0.008, 0.02), (0.008, 0.025), (0.0, 0.025)])
    m.write_step(tmp_path / "pegged.step", {"block": block, "peg": peg})
    assert study.new_task(tmp_path / "first.py", tmp_path / "pegged.step") == ""
    assert 'hand.pull("axis", until="free")' in (tmp_path / "first.py").read_text()
    assert study.run_task(tmp_path / "first.py") == 0


def test_a_new_task_of_which_nothing_comes_out_says_what_to_change(tmp_path) -> None:
    from vpframe.scene import modelling as m

    shell = m.box(0.04, 0.04, 0.04) - m.box(0.02, 0.02, 0.02).translated(0.01, 0.01, 0.01)
    m.write_step(
        tmp_path / "shut.step", {"shell": shell, "cube": m.box(0.018, 0.018, 0.018).translated(0.011, 0.011, 0.011)}
    )
    scene = load(tmp_path / "shut.step")
    scene["shell"].fixed = True
    stops = first_task.new_task(tmp_path / "first.py", scene, tmp_path / "shut.step")
    assert "cube" in stops
    text = (tmp_path / "first.py").read_text()
    assert "# cube did not come out: " in text and "give another direction" in text
    assert study.run_task(tmp_path / "first.py") == 0, "what is written runs"
    tried = text.partition(f"# {first_task.REMEDY}\n")[2].partition("\n\n")[0]
    (tmp_path / "tried.py").write_text(text.replace(tried, tried.replace("# ", "")))
    assert study.run_task(tmp_path / "tried.py") == 1, "and what was tried fails"


ODD = (
    'M3 "pan" {0}', "a\\b'c", "100 % # x", "'''", "<b>{part}</b>", "ключ №5", "-rf", "$x", "hand",
    "e\u0301 \u202e", "cube", "x",
)  # fmt: skip


@pytest.mark.parametrize("named", [pytest.param(None, marks=pytest.mark.slow), 0, 4], ids=["any", "quotes", "braces"])
@pytest.mark.parametrize("kind", ["enclosed", "pressed", "loose"])
def test_a_new_task_of_many_parts_with_odd_names_runs(tmp_path, kind: str, named: int | None) -> None:
    """Twelve shapes in a block: in closed pockets, drawn into it, or on top; what is written ends well in any case."""
    from vpframe.scene import modelling as m

    block = m.box(0.16, 0.05, 0.04)
    parts = {}
    for k, name in enumerate(ODD):
        size, (x, y) = 0.008 + 1e-4 * k, (0.02 * (k % 6) + 0.01, 0.02 * (k // 6) + 0.005)
        if kind == "enclosed":
            block = block - m.box(0.012, 0.012, 0.012).translated(x, y, 0.01)
        z = {"enclosed": 0.011, "pressed": 0.036, "loose": 0.04}[kind]
        parts[name] = m.box(size, size, size).translated(x + 0.001, y + 0.001, z)
    m.write_step(tmp_path / "odd.step", {"block": block, **parts})
    part = None if named is None else list(load(tmp_path / "odd.step").names)[named + 1]
    stops = study.new_task(tmp_path / "first.py", tmp_path / "odd.step", part=part, budget=2.0)
    assert bool(stops) == (kind == "enclosed") or kind == "pressed"
    assert study.run_task(tmp_path / "first.py") == 0
    expected = [line for line in (tmp_path / "first.py").read_text().splitlines() if "session.expect_free(" in line]
    assert [line.lstrip().startswith("#") for line in expected] == [bool(stops)]


def test_a_named_part_for_which_planning_finds_nothing_is_slid_straight(tmp_path, monkeypatch) -> None:
    from vpframe import planning
    from vpframe.scene import modelling as m

    block = m.box(0.04, 0.04, 0.02).translated(-0.02, -0.02, 0.0)
    m.write_step(
        tmp_path / "slot.step",
        {
            "block": block - m.box(0.01, 0.04, 0.02).translated(-0.005, -0.02, 0.01),
            "key": m.box(0.01, 0.04, 0.01).translated(-0.005, -0.02, 0.01),
        },
    )
    whole = planning.removal

    def nothing(*given, **named):
        return replace(whole(*given, **named), verdict="not found", way=None)

    monkeypatch.setattr(planning, "removal", nothing)
    path = tmp_path / "first.py"
    assert study.new_task(path, tmp_path / "slot.step", part="key") == ""
    assert "hand.slide(" in path.read_text()
    assert study.run_task(path) == 0


def test_a_new_task_removes_what_stands_in_the_way_of_a_named_part(tmp_path) -> None:
    from vpframe.scene import modelling as m

    cup = m.box(0.04, 0.04, 0.04) - m.box(0.03, 0.03, 0.035).translated(0.005, 0.005, 0.005)
    m.write_step(
        tmp_path / "cup.step",
        {"cup": cup, "cube": m.box(0.01, 0.01, 0.01).translated(0.015, 0.015, 0.005),
         "lid": m.box(0.04, 0.04, 0.004).translated(0.0, 0.0, 0.04)},
    )  # fmt: skip
    path = tmp_path / "first.py"
    scene = load(tmp_path / "cup.step")
    scene["cup"].fixed = True
    assert first_task.new_task(path, scene, tmp_path / "cup.step", "cube") == ""
    assert '    hand.remove(["lid", "cube"])\n    session.expect_free("cube")' in path.read_text()
    assert study.run_task(path) == 0
    told = first_task.new_task(tmp_path / "short.py", scene, tmp_path / "cup.step", "cube", budget=0.01)
    assert told.endswith("used up its budget of 0.01 s: give more with --budget 0.02s")
    assert f"# cube did not come out: {told}\n" in (tmp_path / "short.py").read_text()
    assert study.run_task(tmp_path / "short.py") == 0
