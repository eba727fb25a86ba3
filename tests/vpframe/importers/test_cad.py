"""CAD files are read in a process of their own: its ends, its packages, its interrupts."""

import os
import resource
import threading
from pathlib import Path

import numpy as np
import OCP
import pinocchio as pin
import pytest

import vpframe as vp
from tests.vpframe.importers.damaged import fault, stand_in
from vpframe.importers import cad, guarded, limits
from vpframe.scene import modelling as m


def test_a_kernel_that_always_crashes_hangs_or_gives_up_is_one_line(tmp_path, step, monkeypatch):
    stand_in(tmp_path, monkeypatch, "os.kill(os.getpid(), signal.SIGSEGV)")
    assert "SIGSEGV" in fault(step)
    stand_in(tmp_path, monkeypatch, "raise MemoryError('no room')")
    assert "no room" in fault(step)
    stand_in(tmp_path, monkeypatch, "time.sleep(60)")
    assert "no answer within 1 s" in fault(step, timeout=1.0)


def test_the_memory_of_this_process_is_not_taken_for_that_of_a_reader_that_crashes(tmp_path, step, monkeypatch):
    monkeypatch.setattr(limits, "CROWDED", 100e6 / limits.CAD_MEMORY)
    assert 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss > 110e6
    stand_in(tmp_path, monkeypatch, "os.kill(os.getpid(), signal.SIGSEGV)")
    assert "SIGSEGV" in fault(step)


def test_an_interrupt_while_reading_leaves_no_process_behind(tmp_path, step, monkeypatch):
    pid = tmp_path / "pid"
    stand_in(
        tmp_path,
        monkeypatch,
        f"open({str(pid)!r}, 'w').write(str(os.getpid())); say(fraction=0.2, text='b')\ntime.sleep(60)",
    )

    def interrupt(fraction: float, text: str) -> None:
        if text == "b":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        vp.load(step, progress=interrupt)
    with pytest.raises(ProcessLookupError):
        os.kill(int(pid.read_text()), 0)


def test_packages_are_found_where_this_process_has_them_but_never_beside_the_file():
    (folder,) = {str(Path(module.__file__).parent.parent) for module in (OCP, np)}
    assert guarded.package_folders(Path("/somewhere"), cad.PACKAGES) == [folder]
    assert guarded.package_folders(Path(folder), cad.PACKAGES) == []


def test_an_interrupt_as_reading_begins_leaves_nothing_behind(tmp_path, monkeypatch):
    """Ctrl-C can come between any two lines; the clock that limits the reading must not keep the program alive."""
    file = m.write_step(tmp_path / "box.step", {"box": (m.box(0.1, 0.1, 0.1), pin.SE3.Identity(), (0.5, 0.5, 0.5))})
    started: list[threading.Thread] = []
    start = threading.Thread.start

    def interrupted(thread: threading.Thread) -> None:
        start(thread)
        if getattr(thread, "_target", None) is guarded._watch:
            started.append(thread)
            raise KeyboardInterrupt

    monkeypatch.setattr(threading.Thread, "start", interrupted)
    with pytest.raises(KeyboardInterrupt):
        vp.load(file)
    assert len(started) == 1 and started[0].daemon
    started[0].join(5.0)
    assert not started[0].is_alive()
