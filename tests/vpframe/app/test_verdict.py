""" "Can be done" is said only of a task that ran to its end and of which every expectation held."""

import contextlib
from pathlib import Path

import pytest

from physics import Behaviour
from tests.vpframe.bench_scene import scene
from tests.vpframe.verdicts import report_of, verdict, written
from vpframe.app import task_runner as study
from vpframe.errors import TaskError
from vpframe.session.session import Session

"""lines 1 to 8; the task's own lines follow"""


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("{}['key']", "KeyError: 'key'"),
        ("assert session.time > 9.0", "AssertionError"),
        ("assert False, 'it is\\nso'", "AssertionError: it is so"),
        ("raise SystemExit", "sys.exit() before the end of the task"),
        ("import sys; sys.exit(0)", "sys.exit(0) before the end of the task"),
        ("import sys; sys.exit('all well')", "sys.exit('all well') before the end of the task"),
        ("raise BaseException('odd')", "BaseException: odd"),
        ("raise MemoryError", "MemoryError"),
        ("(lambda f: f(f))(lambda f: f(f))", "RecursionError: maximum recursion depth exceeded"),
        ("session.hand().grab('pegg')", "no part 'pegg' in the scene; did you mean 'peg'?"),
        ("session.hand().seize('peg')", "AttributeError: 'Hand' object has no attribute 'seize'"),
        ("session.run('long')", "TypeError: unsupported operand type(s) for /: 'str' and 'float'"),
        ("session.close(); session.step()", "the session is closed; open a new one"),
        ("session.close(); 1 / 0", "ZeroDivisionError: division by zero"),
        ("session.behave('cube', 3)", "cube: 3 is no Behaviour"),
    ],
)
def test_a_script_that_dies_decides_nothing(tmp_path: Path, capsys, line: str, why: str) -> None:
    assert study.run_task(written(tmp_path, line), report=tmp_path / "report") == 1
    told = capsys.readouterr()
    last = told.err.splitlines()[-1]
    assert last.startswith(f"not decided: script error: {tmp_path / 'task.py'}:9: ")
    assert why in last
    assert told.out.splitlines()[-2].startswith("not decided: 0.05 s of the task in 3 steps")
    document = report_of(tmp_path / "report")
    assert (document["verdict"], document["can_be_done"]) == ("not decided", False)
    assert document["reason"].startswith(f"script error: {tmp_path / 'task.py'}:9: ")
    page = (tmp_path / "report" / "index.html").read_text()
    assert "Not decided: script error: " in page
    assert "can be done" not in page
    assert "Traceback" not in document["reason"] and "\n" not in document["reason"]


def test_a_script_that_gives_up_by_itself_has_failed(tmp_path: Path) -> None:
    assert study.run_task(written(tmp_path, "session.fail('no way found')"), report=tmp_path / "report") == 1
    assert report_of(tmp_path / "report")["reason"] == "no way found"


def test_ctrl_c_that_the_script_catches_decides_nothing(tmp_path: Path, capsys) -> None:
    path = written(tmp_path, "session.interrupt()", "try:", "    session.run(1.0)", "except BaseException:", "    pass")
    assert study.run_task(path, report=tmp_path / "report") == 130
    document = report_of(tmp_path / "report")
    assert (document["verdict"], document["can_be_done"]) == ("not decided", False)
    assert document["reason"] == "interrupted"


def test_a_session_says_so_after_its_end_and_not_before(tmp_path: Path) -> None:
    with Session(scene()) as session:
        session.run(0.05)
        assert verdict(session, tmp_path) == ("not decided", False, "the task has not ended")
    assert verdict(session, tmp_path) == ("can be done", True, "")


def test_a_session_that_an_error_ends_decides_nothing(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), Session(scene()) as session:
        session.run(0.05)
        1 / 0  # noqa: B018
    word, can, reason = verdict(session, tmp_path)
    assert (word, can) == ("not decided", False)
    assert reason.startswith("script error: test_verdict.py:")
    with pytest.raises(KeyboardInterrupt), Session(scene()) as session:
        raise KeyboardInterrupt
    assert verdict(session, tmp_path) == ("not decided", False, "interrupted")
    with pytest.raises(TaskError), Session(scene()) as session:
        session.hand().release()
    assert verdict(session, tmp_path)[:2] == ("cannot be done", False)


def test_closing_a_session_by_hand_ends_its_task_but_for_an_error(tmp_path: Path) -> None:
    session = Session(scene())
    session.run(0.05)
    assert verdict(session, tmp_path)[0] == "not decided"
    session.close()
    assert verdict(session, tmp_path) == ("can be done", True, "")
    session = Session(scene())
    try:
        try:
            raise KeyError("lost")
        finally:
            session.close()
            in_finally = verdict(session, tmp_path)
    except KeyError:
        with Session(scene()) as another:  # that another error is dealt with meanwhile is not its own
            another.run(0.05)
    assert in_finally[:2] == ("not decided", False)
    assert "KeyError: 'lost'" in in_finally[2]
    assert verdict(another, tmp_path) == ("can be done", True, "")


# ---- errors that the script handles


RULED = """
from tests.vpframe.session.test_threads_of_use import seated as scene

def rule(candidate):
    {body}

OPTIONS = {{"rule": rule}}

def task(session):
    hand = session.hand()
    try:
        hand.grab("peg")
        hand.move_by((0.0, 0.0, 0.01))
    except Exception:
        pass
{more}
"""


@pytest.mark.parametrize("more", ["", "    try:\n        session.run(0.1)\n    except ValueError:\n        pass"])
def test_a_rule_that_always_raises_decides_nothing_whatever_the_script_swallows(tmp_path: Path, capsys, more) -> None:
    path = tmp_path / "task.py"
    path.write_text(RULED.format(body="raise ValueError('no idea')", more=more))
    assert study.run_task(path, report=tmp_path / "report") == 1
    assert "not decided: the rule failed in step 1: ValueError: no idea" in capsys.readouterr().err
    document = report_of(tmp_path / "report")
    assert (document["verdict"], document["can_be_done"], document["steps"]) == ("not decided", False, 0)
    page = (tmp_path / "report" / "index.html").read_text()
    assert "Not looked at: no step was taken." in page and "<b>not looked at</b>" in page


def test_a_rule_that_raises_once_decides_nothing_though_later_steps_are_completed(tmp_path: Path) -> None:
    seen: list[int] = []

    def rule(candidate: object) -> str:
        seen.append(1)
        if len(seen) == 1:
            raise KeyError("first")
        return "accept"

    with Session(scene(), rule=rule) as session:
        hand = session.hand(at=(0.06, 0.0, 0.07))
        hand.grab("peg")
        for _ in range(2):
            try:
                hand.move_to([0.0, 0.0, 0.09])
                hand.slide("down", until="blocked", required=False)
            except KeyError:
                pass
    assert len(seen) > 1 and session.step_count > 0
    word, can, reason = verdict(session, tmp_path)
    assert (word, can) == ("not decided", False)
    assert reason.startswith("the rule failed in step ") and "KeyError: 'first'" in reason


class Pushes(Behaviour):
    """Raises while `fails`."""

    fails = True

    def wrench(self, view: object) -> None:
        if self.fails:
            raise RuntimeError("no fuel")


@pytest.mark.parametrize(("mends", "word"), [(False, "not decided"), (True, "can be done")])
def test_a_step_that_fails_decides_nothing_unless_a_later_one_is_completed(tmp_path: Path, mends: bool, word) -> None:
    push = Pushes()
    with Session(scene()) as session:
        session.run(0.05)
        session.behave("cube", push)
        for _ in range(2):
            try:
                session.step()
            except ValueError:
                push.fails = not mends
    found = verdict(session, tmp_path)
    assert found[0] == word
    assert mends or ("no step was completed after it" in found[2] and "no fuel" in found[2])


def test_a_verb_that_fails_before_the_first_step_decides_nothing(tmp_path: Path) -> None:
    with Session(scene()) as session, contextlib.suppress(TaskError):
        session.hand().release()
    assert verdict(session, tmp_path)[:2] == ("not decided", False)
    with Session(scene()) as session:  # nothing was to be done
        session.expect_free("peg")
    assert verdict(session, tmp_path) == ("can be done", True, "")
