"""?"""

import errno
import io
import re
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from collision.numeric import kernel_cache
from collision.numeric.kernel import compilation
from collision.numeric.kernel_cache import kept
from tests.vpframe.terminal import Terminal as Screen
from vpframe.app.progress import Progress, Watch, fitted, report
from vpframe.app.progress import Terminal as Console
from vpframe.console import FEW, LEAST, WINDOW, Remaining, duration
from vpframe.studies.run import _Rate


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_nothing_is_written_before_the_delay():
    stream = Terminal()
    with Progress("work", stream, delay=30.0) as progress:
        progress(0.5, "half")
    assert stream.getvalue() == ""


def test_a_bar_with_the_time_left_appears_after_the_delay_and_is_wiped():
    stream = Terminal()
    with Progress("work", stream, delay=0.01) as progress:
        progress(0.25, "meshing shaft")
        until = time.monotonic() + 5.0
        while "meshing" not in stream.getvalue() and time.monotonic() < until:
            time.sleep(0.01)
    assert "work  [######..................]  25 %" in stream.getvalue()
    assert stream.getvalue().endswith("\r\x1b[K")


@pytest.mark.parametrize("quiet", [True, False])
def test_silent_without_a_terminal_or_when_told(quiet):
    stream = Terminal() if quiet else io.StringIO()
    with Progress("work", stream, delay=0.0, quiet=quiet) as progress:
        progress(0.5)
        time.sleep(0.05)
    assert stream.getvalue() == ""


def test_time_left_is_in_proportion():
    progress = Progress("work", Terminal())
    for n in range(1, 5):
        assert "left" not in progress.line(float(n - 1)), "nothing is known yet"
        progress(0.05 * n)
        progress.line(float(n))
    progress(0.25)
    assert "15 s left" in progress.line(5.0)
    progress(None, "compiling kernels")
    assert progress.line(5.0) == "work  5 s  compiling kernels"
    assert len(fitted(progress.line(5.0), 12)) == 12


def test_the_rate_is_that_of_the_last_seconds():
    remaining = Remaining()
    fast = [remaining.seconds(t, 0.05 * t) for t in np.arange(0.1, 10.0, 0.1)]  # the first half in ten seconds
    assert fast[0] is None, "nothing is known yet"
    assert fast[-1] == pytest.approx(10.1)
    slow = [remaining.seconds(10.0 + t, 0.5 + 0.01 * t) for t in np.arange(0.1, 40.0, 0.1)]  # then five times as slow
    assert slow[-1] == pytest.approx((0.5 - 0.01 * 39.9) / 0.01, rel=0.05)
    assert any(left is None for left in slow), "what was claimed is given up"


@given(st.lists(st.tuples(st.floats(0.01, 20.0), st.floats(0.0, 0.1)), min_size=1, max_size=60))
def test_the_time_left_never_climbs_but_is_given_up(news):
    remaining, worked, fraction, last = Remaining(), 0.0, 0.0, None
    for seconds, more in news:
        worked, fraction = worked + seconds, min(fraction + more, 1.0)
        left = remaining.seconds(worked, fraction)
        if left is not None and last is not None:
            assert left <= last
        last = left


def test_work_that_stands_still_claims_nothing():
    remaining = Remaining()
    for n in range(1, 5):
        left = remaining.seconds(float(n), 0.1 * n)
    assert left == pytest.approx(6.0)
    assert remaining.seconds(5.0 + 2.0 * WINDOW, 0.4) is None


def test_one_line_at_a_time_the_innermost():
    stream = Terminal()
    with Progress("outer", stream, delay=0.0):
        while "outer" not in stream.getvalue():
            time.sleep(0.01)
        with Progress("inner", stream, delay=0.0):
            while "inner" not in stream.getvalue():
                time.sleep(0.01)
            watch = Watch(lambda: "watched", stream, delay=0.0)
            with watch:
                begun = len(stream.getvalue())
                time.sleep(0.5)
            drawn = stream.getvalue()[begun:]
        assert "inner" in drawn and "outer" not in drawn and "watched" not in drawn
        begun = len(stream.getvalue())
        while "outer" not in stream.getvalue()[begun:] and "watched" not in stream.getvalue()[begun:]:
            time.sleep(0.01)
        watch.close()


@pytest.mark.parametrize(("seconds", "text"), [(0.4, "0 s"), (59, "59 s"), (185, "3 min 05 s"), (4800, "1 h 20 min")])
def test_durations_as_people_say_them(seconds, text):
    assert duration(seconds) == text


def test_a_watch_is_silent_without_a_terminal():
    stream = io.StringIO()
    with Watch(lambda: "a long step", stream, delay=0.0):
        time.sleep(0.05)
    assert stream.getvalue() == ""


def test_an_error_inside_passes_through():
    with pytest.raises(ZeroDivisionError), Progress("work", Terminal(), delay=0.0):
        raise ZeroDivisionError


def test_a_watch_that_is_always_seen_makes_room_for_what_is_printed(capsys):
    stream = Terminal()
    watch = Watch(lambda: "step 7", stream, delay=0.01)
    with watch:
        pass
    until = time.monotonic() + 5.0
    while "step 7" not in stream.getvalue() and time.monotonic() < until:
        time.sleep(0.01)
    assert stream.getvalue().endswith("step 7")
    Console().say("an event")
    assert capsys.readouterr().out == "an event\n"
    watch.close()
    assert "step 7\r\x1b[K" in stream.getvalue()
    assert stream.getvalue().endswith("\r\x1b[K")


def test_what_runs_inside_tells_the_innermost():
    report(0.5, "nobody hears")
    with Progress("outer", Terminal()) as outer, Progress("inner", Terminal()) as inner:
        report(0.25, "cases")
        assert inner.line(1.0).endswith("25 %  cases")
        assert outer.line(1.0) == "outer  1 s"


def test_kernels_are_counted_while_they_are_compiled_and_not_while_they_are_loaded(monkeypatch):
    with Progress("work", Terminal(), delay=60.0) as progress:
        with compilation.working():
            assert "compiling" not in progress.line(3.0)
            before = kept()
            monkeypatch.setattr(kernel_cache, "kept", lambda: before + 3)
            assert progress.line(3.0) == "work  compiling kernels, once: 3 so far"
            monkeypatch.setattr(compilation, "kernels", compilation.kernels + 5)
            assert progress.line(3.0) == "work  compiling kernels, once: 5 so far"
        assert "compiling" not in progress.line(3.0)


def test_time_of_compiling_is_not_time_of_the_work():
    with Progress("work", Terminal(), delay=60.0) as progress:
        for n in range(1, 5):
            progress(0.1 * n)
            progress.line(2.0 * n)
        with compilation.working():
            time.sleep(0.2)
        progress(0.5)
        left = progress.line(10.2)
    assert left.endswith("50 %  10 s left") and progress.compiled >= 0.2


def test_a_line_that_is_too_long_loses_its_bar_before_its_words() -> None:
    line = f"study task  [{'#' * 20}{'.' * 4}]  83 %  9 s left  415 of 500, 7 without success, 5.9 a second"
    assert fitted(line, 79) == "study task  83 %  9 s left  415 of 500, 7 without success, 5.9 a second"
    assert fitted(line, len(line)) == line


SPEAKING = """
import sys, threading, time, warnings
from vpframe.app.progress import Progress, Terminal, Watch

say, warn = Terminal().say, Terminal().warn

def speak(who):
    for n in range(60):
        time.sleep(0.003 * (n % 7))
        text = f"{who} {n} " + "x" * (n % 9)
        [lambda: print(text), lambda: print(text, file=sys.stderr), lambda: say(text), lambda: warn(text),
         lambda: sys.stdout.writelines([text[:4], text[4:], "\\n"])][n % 5]()

steps = 0
watch = Watch(lambda: f"the step {steps} of the task, which is a long text for a line", delay=0.05)
with watch, Progress("loading Gehäuse 组件装配图纸.step", delay=0.0) as outer:
    outer(0.2, "meshing " + "long name " * 20)
    speak("a")
    with Progress("drawing", delay=0.0) as inner:
        inner(0.5, "図面" * 30)
        thread = threading.Thread(target=speak, args=("b",))
        thread.start()
        while thread.is_alive():
            time.sleep(0.01)
        print("half a line", end="", flush=True)
        time.sleep(0.4)
        print(", and the rest")
    time.sleep(0.3)
    answer = Terminal().ask("accept \\x1b[2J?")
    time.sleep(0.3)
    warnings.warn_explicit("a warning", UserWarning, "task.py", 3)
for n in range(40):
    with watch:
        time.sleep(0.02)
        print("step", n)
    steps += 1
assert input("go on? ") == "yes"
time.sleep(0.3)
with watch:
    time.sleep(0.5)
watch.close()
print("answer", answer, type(sys.stdout).__name__)
"""


@pytest.mark.parametrize("columns", [24, *(pytest.param(columns, marks=pytest.mark.slow) for columns in (60, 200))])
def test_bars_and_text_of_every_kind_leave_each_line_whole(tmp_path: Path, columns: int) -> None:
    script = tmp_path / "speaking.py"
    script.write_text(SPEAKING)
    with Screen(program=[str(script)], cwd=tmp_path, columns=columns) as terminal:
        terminal.wait_for(r"accept \\x1b\[2J\?")
        terminal.press(b"y\n")
        terminal.wait_for(r"go on\?")
        time.sleep(0.7)  # the watch must not draw over the prompt
        terminal.press(b"yes\n")
        assert terminal.end() == 0
        shown = terminal.screen()
        drawn = terminal.text
    for words in ("the step", "loading", "drawing"):
        assert words in drawn, "each line was drawn"
    spoken = [f"{who} {n} " + "x" * (n % 9) for who in "ab" for n in range(60)]
    expected = [
        *spoken, "half a line, and the rest", r"accept \x1b[2J? y", "task.py:3: UserWarning: a warning",
        *(f"step {n}" for n in range(40)), "go on? yes", "answer y TextIOWrapper",
    ]  # fmt: skip
    wrapped = [line[k : k + columns].rstrip() for line in expected for k in range(0, len(line), columns)]
    assert sorted(filter(None, shown)) == sorted(line for line in wrapped if line)


def test_the_width_is_that_of_the_terminal_also_where_output_is_a_file(tmp_path: Path) -> None:
    script = tmp_path / "long.py"
    script.write_text(
        "import time\nfrom vpframe.app.progress import Progress\n"
        "with Progress('x' * 70, delay=0.0):\n    time.sleep(0.5)\n"
    )
    with Screen(program=[str(script)], cwd=tmp_path, columns=30, stdout=tmp_path / "out.txt") as terminal:
        assert terminal.end() == 0
        assert "x…x" in terminal.text and list(filter(None, terminal.screen())) == []


@pytest.mark.parametrize(
    ("environment", "drawn"), [({"TERM": "dumb"}, False), ({"NO_COLOR": "1", "TERM": "xterm"}, True)]
)
def test_a_dumb_terminal_gets_no_line_and_colours_there_are_none(
    environment: dict[str, str], drawn: bool, tmp_path: Path
) -> None:
    script = tmp_path / "bar.py"
    script.write_text(
        "import time\nfrom vpframe.app.progress import Progress\n"
        "with Progress('work', delay=0.0):\n    time.sleep(0.4)\n"
    )
    with Screen(program=[str(script)], cwd=tmp_path, **environment) as terminal:
        assert terminal.end() == 0
        assert ("work" in terminal.text) is drawn
        assert set(re.findall(r"\x1b[^a-zA-Z]*[a-zA-Z]", terminal.text)) <= {"\x1b[K"}


def test_a_terminal_that_is_gone_ends_nothing(tmp_path: Path) -> None:
    class Gone(Terminal):
        def write(self, text: str) -> int:
            raise OSError(errno.EIO, "Input/output error")

    with Progress("work", Gone(), delay=0.0) as progress:
        time.sleep(0.3)
        progress(0.5, "goes on")
    assert progress.quiet


def reported(pieces: list[tuple[float, float]], step: float = 0.1) -> Iterator[tuple[float, float, float | None]]:
    """Time, fraction and claim every `step` seconds of work that reports pieces: (seconds, fraction more)."""
    remaining, ends = Remaining(), np.cumsum(pieces, axis=0)
    for t in np.arange(step, ends[-1, 0], step):
        done = np.searchsorted(ends[:, 0], t, side="right")
        fraction = float(ends[done - 1, 1]) if done else 0.0
        yield t, fraction, remaining.seconds(t, fraction)


@given(
    seconds=st.floats(4.0, 100.0),
    count=st.integers(8, 400),
    seed=st.integers(0, 2**32 - 1),
)
def test_what_is_claimed_of_steady_work_is_true_and_claimed_in_time(seconds, count, seed):
    weights = np.random.default_rng(seed).uniform(0.85, 1.15, count)
    pieces = [(seconds / count, w) for w in weights / weights.sum()]
    each, claims = seconds / count, []
    for t, _, left in reported(pieces):
        if left is not None:
            assert t >= LEAST and t >= FEW * each, "nothing is claimed while it is unknown"
            truth = seconds - t
            assert truth / 1.5 - each - 1.0 <= left <= 1.5 * truth + each + 1.0, (t, truth, left)
            claims.append(t)
    assert claims and claims[0] <= max(LEAST, (FEW + 2) * each) + 0.5
    assert len(claims) * 0.1 >= 0.8 * (seconds - claims[0] - each) - 0.5, "and claimed to the end"


@given(
    phases=st.lists(st.tuples(st.floats(0.5, 30.0), st.floats(0.02, 1.0), st.integers(1, 40)), min_size=1, max_size=6)
)
def test_after_a_change_of_rate_the_claim_is_that_of_the_new_rate_or_none(phases):
    """Phases of (seconds, share, updates), as a load has them: one jump, then many small ones."""
    total = sum(share for _, share, _ in phases)
    pieces = [(s / n, share / total / n) for s, share, n in phases for _ in range(n)]
    ends = np.cumsum([s for s, _, _ in phases])
    for t, fraction, left in reported(pieces):
        phase = int(np.searchsorted(ends, t, side="right"))
        if phase == len(phases):
            break
        seconds, share, updates = phases[phase]
        begun = ends[phase] - seconds
        if left is not None and t - begun > 2.0 * WINDOW and (t - begun) / seconds * updates > 2 * FEW + 2:
            as_now = (1.0 - fraction) * seconds / (share / total)
            assert left <= 1.5 * as_now + seconds / updates + 1.0, "of what is known now, never of a slower past"


def test_a_jump_at_the_start_claims_nothing():
    """As a file that is read in one go and then meshed: "14 %  19 s left" stood there, of 2 s that were left."""
    loading = [(3.0, 0.135), (0.4, 0.18), *((0.05, 0.02) for _ in range(30))]
    assert all(left is None or left < 4.0 for _, _, left in reported(loading))


def test_claims_that_were_given_up_come_back_later_and_later():
    remaining, worked, fraction, waits, last = Remaining(), 0.0, 0.0, [], None
    rate, dropped = 0.02, None
    while fraction < 0.9 and len(waits) < 3:
        worked, fraction = worked + 0.1, fraction + 0.1 * rate
        left = remaining.seconds(worked, fraction)
        if left is None and last is not None:
            dropped = worked
        if left is not None and last is None and dropped is not None:
            waits.append(worked - dropped)
        if left is not None and worked > 3.0 and (last is None or dropped is None):
            rate /= 2.5
            dropped = worked if dropped is None else dropped
        last = left
    assert waits == sorted(waits) and waits[-1] > LEAST


def test_the_rate_of_a_study_is_that_of_the_last_seconds():
    rate = _Rate(1000, 0, 0)
    texts = [rate.after(False, 0.1 * n)[1] for n in range(200)] + [rate.after(n == 0, 20.0 + n)[1] for n in range(30)]
    assert texts[FEW - 1] == f"{FEW} of 1000, 0 without success"
    assert texts[199] == "200 of 1000, 0 without success, 10 a second"
    assert texts[-1] == "230 of 1000, 1 without success, 1 a second"
