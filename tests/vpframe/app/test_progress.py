import io
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from collision.numeric.kernel import compilation
from collision.numeric.kernel_cache import kept
from vpframe.app.progress import WINDOW, Progress, Remaining, Watch, duration, fitted, report, say


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
    progress(0.25)
    assert "15 s left" in progress.line(5.0)
    progress(None, "compiling kernels")
    assert progress.line(5.0) == "work  5 s  compiling kernels"
    assert len(fitted(progress.line(5.0), 12)) == 12


def test_over_counts_items():
    progress = Progress("work", Terminal())
    seen = [(item, progress.line(1.0)) for item in progress.over([10, 20, 30, 40], "files")]
    assert [item for item, _ in seen] == [10, 20, 30, 40]
    assert [line.split("]")[1].split("%")[0].strip() for _, line in seen] == ["0", "25", "50", "75"]


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
    assert remaining.seconds(5.0, 0.5) == pytest.approx(5.0)
    assert remaining.seconds(6.0 + 2.0 * WINDOW, 0.5) is None


def test_one_line_at_a_time_the_innermost():
    stream = Terminal()
    with Progress("outer", stream, delay=0.0):
        while "outer" not in stream.getvalue():
            time.sleep(0.01)
        with Progress("inner", stream, delay=0.0):
            while "inner" not in stream.getvalue():
                time.sleep(0.01)
            watch = Watch(lambda: "watched", stream, delay=0.0, always=True)
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


def test_a_watch_speaks_only_of_a_piece_of_work_that_takes_long():
    stream = Terminal()
    watch = Watch(lambda: "a long step", stream, delay=0.05)
    for _ in range(1000):
        with watch:
            pass
    assert stream.getvalue() == ""
    with watch:
        until = time.monotonic() + 5.0
        while "a long step" not in stream.getvalue() and time.monotonic() < until:
            time.sleep(0.01)
    watch.close()
    assert "a long step" in stream.getvalue()
    assert stream.getvalue().endswith("\r\x1b[K")


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
    watch = Watch(lambda: "step 7", stream, delay=0.01, always=True)
    with watch:
        pass
    until = time.monotonic() + 5.0
    while "step 7" not in stream.getvalue() and time.monotonic() < until:
        time.sleep(0.01)
    assert stream.getvalue().endswith("step 7")
    say("an event")
    assert capsys.readouterr().out == "an event\n"
    watch.close()
    assert "step 7\r\x1b[K" in stream.getvalue()
    assert stream.getvalue().endswith("\r\x1b[K")


def test_what_runs_inside_tells_the_innermost():
    report(0.5, "nobody hears")
    with Progress("outer", Terminal()) as outer, Progress("inner", Terminal()) as inner:
        report(0.25, "cases")
        assert inner.line(1.0).endswith("25 %  3 s left  cases")
        assert outer.line(1.0) == "outer  1 s"


def test_kernels_are_counted_while_they_are_compiled():
    with Progress("work", Terminal(), delay=60.0) as progress:
        with compilation.working():
            assert progress.line(3.0) == f"work  compiling kernels, once: {max(kept(), compilation.kernels)} so far"
        assert "compiling" not in progress.line(3.0)


def test_time_of_compiling_is_not_time_of_the_work():
    with Progress("work", Terminal(), delay=60.0) as progress:
        progress(0.5)
        with compilation.working():
            time.sleep(0.2)
        left = progress.line(10.2)
    assert left.endswith("50 %  10 s left") and progress._line.compiled >= 0.2


def test_a_line_that_is_too_long_loses_its_bar_before_its_words() -> None:
    line = f"study task  [{'#' * 20}{'.' * 4}]  83 %  9 s left  415 of 500, 7 without success, 5.9 a second"
    assert fitted(line, 79) == "study task  83 %  9 s left  415 of 500, 7 without success, 5.9 a second"
    assert fitted(line, len(line)) == line
