import io
import time

import pytest

from vpframe.progress import Progress, Watch, duration


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
    assert "15 s left" in progress.line(5.0, 80)
    progress(None, "compiling kernels")
    assert progress.line(5.0, 80) == "work  5 s  compiling kernels"
    assert len(progress.line(5.0, 12)) <= 12


def test_over_counts_items():
    progress = Progress("work", Terminal())
    seen = [(item, progress.line(1.0, 200)) for item in progress.over([10, 20, 30, 40], "files")]
    assert [item for item, _ in seen] == [10, 20, 30, 40]
    assert [line.split("]")[1].split("%")[0].strip() for _, line in seen] == ["0", "25", "50", "75"]


@pytest.mark.parametrize(("seconds", "text"), [(0.4, "0 s"), (59, "59 s"), (185, "3 min 05 s"), (4800, "1 h 20 min")])
def test_durations_as_people_say_them(seconds, text):
    assert duration(seconds) == text


def test_a_watch_speaks_only_of_a_piece_of_work_that_takes_long():
    stream = Terminal()
    watch = Watch("a long step", stream, delay=0.05)
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
    with Watch("a long step", stream, delay=0.0):
        time.sleep(0.05)
    assert stream.getvalue() == ""


def test_an_error_inside_passes_through():
    with pytest.raises(ZeroDivisionError), Progress("work", Terminal(), delay=0.0):
        raise ZeroDivisionError
