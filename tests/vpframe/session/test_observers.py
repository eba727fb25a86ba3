"""Observers get copies and read-only frames: nothing that they do reaches the session."""

import json
import os
import subprocess
import sys

import numpy as np
import pinocchio as pin
import pytest

import vpframe as vp
from tests.vpframe.bench_scene import scene


class Meddler(vp.Frames):
    """Changes whatever it is given, as far as it can."""

    def begin(self, scene: vp.Scene) -> None:
        self.scene = scene
        for part in scene.parts:
            part.pose = pin.SE3(np.eye(3), np.ones(3))
            part.fixed = True

    def frame(self, frame: vp.Frame) -> None:
        super().frame(frame)
        for pose in (*frame.poses.values(), *frame.hands.values()):
            pose.translation[:] = 7.0
        for array in (frame.colliding, *(a for c in frame.constraints for a in (c.origin, c.direction))):
            with pytest.raises(ValueError, match="read-only"):
                array[...] = 0
        with pytest.raises(TypeError):
            frame.freedom["peg"] = 0  # type: ignore[index]


def carried(observers: list[vp.Observer]) -> list[bytes]:
    with vp.Session(scene(), observers=observers) as session:
        hand = session.hand(at=(0.06, 0.0, 0.07))
        hand.grab("peg")
        hand.move_by((0.0, 0.0, 0.03))
        return [session.save(), session.scene["peg"].pose.homogeneous.tobytes()]


def test_whatever_an_observer_does_the_session_stays_as_it_is() -> None:
    meddler = Meddler()
    assert carried([meddler]) == carried([])
    assert not any("stopped watching" in e.text for f in meddler.frames for e in f.events)
    first, again = (meddler.frames[3].poses["peg"] for _ in range(2))
    assert first == again
    assert first is not again
    assert any(frame.events for frame in meddler.frames)


def test_every_observer_has_a_scene_of_its_own() -> None:
    class Reader(vp.Frames):
        def begin(self, scene: vp.Scene) -> None:
            self.home = {name: part.pose for name, part in scene.items()}

    reader = Reader()
    carried([Meddler(), reader])
    assert all(reader.home[name] == part.pose for name, part in scene().items())


def test_one_that_cannot_begin_is_ended_and_not_asked_again() -> None:
    calls = []

    class Broken:
        def begin(self, scene: vp.Scene) -> None:
            calls.append("begin")
            raise RuntimeError("no screen")

        def frame(self, frame: vp.Frame) -> None:
            calls.append("frame")

        def end(self) -> None:
            calls.append("end")

    with vp.Session(scene(), observers=[Broken()]) as session:
        session.run(0.1)
        assert any("Broken stopped watching: RuntimeError: no screen" in e.text for e in session.events)
    assert calls == ["begin", "end"]


def test_an_interrupt_while_observers_are_told_tells_nobody_twice() -> None:
    class Interrupts(vp.Frames):
        def frame(self, frame: vp.Frame) -> None:
            super().frame(frame)
            if frame.step == 3:
                raise KeyboardInterrupt

    first, last = Interrupts(), vp.Frames()
    with vp.Session(scene(), observers=[first, last]) as session:
        session.step()
        session.step()
        with pytest.raises(KeyboardInterrupt):
            session.step()
        assert session.step_count == 3
        assert len(last.frames) == 2
        session.step()
    assert [f.step for f in first.frames] == [f.step for f in last.frames] == [1, 2, 3, 4]


@pytest.mark.parametrize("when", ["begin", "frame", "end"])
def test_one_that_raises_is_told_of_once_on_standard_error_and_in_the_report(when: str, tmp_path, caplog) -> None:
    class Breaks(vp.Frames):
        pass

    def breaks(self: object, *given: object) -> None:
        raise RuntimeError("no\nscreen")

    setattr(Breaks, when, breaks)
    with vp.Session(scene(), observers=[Breaks()]) as session:
        session.run(0.1)
    told = [record.getMessage() for record in caplog.records if record.name == "vpframe"]
    assert told == ["Breaks stopped watching: RuntimeError: no\\nscreen"]
    events = json.loads((session.report(tmp_path) / "report.json").read_text())["events"]
    assert len([e for e in events if "Breaks stopped watching" in e["text"]]) == 1
    assert session.step_count == 6


def test_without_handlers_of_its_own_a_program_prints_one_line(tmp_path) -> None:
    script = tmp_path / "s.py"
    script.write_text(
        "import vpframe as vp\nfrom tests.vpframe.bench_scene import scene\n"
        "class Bad(vp.Frames):\n    def frame(self, frame):\n        raise RuntimeError('no screen')\n"
        "with vp.Session(scene(), observers=[Bad()]) as session:\n    session.run(0.1)\n"
    )
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, env={**os.environ, "PYTHONPATH": "."}
    )
    lines = [line for line in done.stderr.splitlines() if "compiling" not in line]
    assert (done.returncode, lines) == (0, ["Bad stopped watching: RuntimeError: no screen"])
