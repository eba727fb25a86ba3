"""The library draws nothing and leaves the process as it is; only the console of the command line draws."""

import io
import sys
from pathlib import Path

import pytest

from tests.vpframe.terminal import Terminal
from vpframe import console

STEPPING = """
import builtins, os, signal, sys, threading, warnings

def process():
    handlers = {number: signal.getsignal(number) for number in signal.valid_signals()}
    hooks = sys.excepthook, threading.excepthook, warnings.showwarning, sys.displayhook
    return builtins.input, builtins.print, sys.stdin, sys.stdout, sys.stderr, handlers, hooks, threading.active_count()

before = process()
import pinocchio as pin
import vpframe as vp
from tests.vpframe.watching import box
imported = process()
shape, seen = box((0.1, 0.1, 0.1)), []
at = lambda x: pin.SE3(pin.SE3.Identity().rotation, pin.SE3.Identity().translation + [x, 0.0, 0.0])

class Observer:
    def begin(self, scene): seen.append(process())
    def frame(self, frame): seen.append(process())
    def end(self): seen.append(process())

scene = vp.Scene([vp.Part("a", shape, at(0.0), fixed=True), vp.Part("b", shape, at(0.3))])
session = vp.Session(scene, observers=[Observer()])
session.on_event(lambda event: seen.append(process()))
hand = session.hand()
hand.grab("b")
hand.move_by((0.0, 0.0, 0.05))
try:
    hand.slide("-x", 0.5)  # it is stopped
except vp.TaskError:
    pass
session.close()
assert len(seen) > 20 and all(state == imported for state in seen), "while it steps"
assert process() == imported, "afterwards"
assert before[:2] == imported[:2] and before[2:5] == imported[2:5], "by the import"
"""


def test_stepping_a_session_in_a_library_patches_nothing_and_draws_nothing(tmp_path: Path) -> None:
    script = tmp_path / "library.py"
    script.write_text(STEPPING)
    quiet = {"NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING": "1"}  # colorama would write an escape sequence at exit
    with Terminal(program=[str(script)], cwd=tmp_path, **quiet) as terminal:
        assert terminal.end() == 0, terminal.text
    assert [line for line in terminal.screen() if line and not line.startswith("compiling ")] == []
    assert "\x1b" not in terminal.text


def test_progress_is_a_callback_of_the_console_that_is_installed() -> None:
    heard: list[tuple[str, float | None, str]] = []

    class Listening(console.Console):
        def progress(self, title: str):
            class Work:
                def __enter__(self):
                    return lambda fraction, text="": heard.append((title, fraction, text))

                def __exit__(self, *exc: object) -> None:
                    pass

            return Work()

    def work() -> None:
        with console.progress("loading") as progress:
            progress(0.5, "meshing")

    work()
    with console.installed(Listening()):
        work()
    work()
    assert heard == [("loading", 0.5, "meshing")]


def test_lines_are_escaped_and_a_question_returns_the_typed_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("yes \n"))
    console.say("a\x1b[2J")
    console.warn("b\x07")
    assert console.ask("sure\x1b?") == "yes"
    assert console.ask("again?") == "", "the end of input"
    printed = capsys.readouterr()
    assert printed.out == "a\\x1b[2J\n"
    assert printed.err == "b\\x07\nsure\\x1b? \nagain? \n"
