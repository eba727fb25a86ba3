"""Limits of memory and time."""

import os
import re

import pytest
import trimesh

import vpframe as vp
from tests.vpframe.importers.damaged import fault, stand_in, written
from tests.vpframe.importers.guarding import ended
from vpframe.importers import limits
from vpframe.importers.limits import ReadingLimits
from vpframe.scene import modelling as m

BOX_FACES = "".join("f {} {} {}\n".format(*(f + 1)) for f in trimesh.creation.box().faces)


BOX_OBJ = "".join(f"v {x} {y} {z}\n" for x, y, z in trimesh.creation.box().vertices) + BOX_FACES


def test_a_mesh_that_takes_too_much_memory_or_time_is_one_line(tmp_path, monkeypatch):
    path = written(tmp_path / "a.obj", BOX_OBJ)
    stand_in(tmp_path, monkeypatch, "while True: pass")
    assert "no answer within 0.2 s of processor time" in fault(path, timeout=0.2)
    monkeypatch.setattr(limits, "MESH_MEMORY", 100_000_000)
    stand_in(tmp_path, monkeypatch, "x = bytes([1]) * 200_000_000; time.sleep(60)")
    assert "more than 0.1 GB of memory are needed" in fault(path)


def test_a_shape_that_takes_too_much_memory_is_named_and_the_rest_is_read(tmp_path, monkeypatch):
    path = m.write_step(tmp_path / "a.step", {"box": m.box(0.01, 0.01, 0.01), "ball": m.sphere(0.1)})
    monkeypatch.setattr(limits, "CAD_MEMORY", 1200 << 20)
    scene = vp.load(path, deflection=1e-7)
    assert scene.names == ("box",)
    (note,) = scene.notes
    assert re.fullmatch(r"part ball is lost: its geometry takes more than 1\.\d GB to mesh", note)


def test_the_limit_of_time_grows_with_the_file_and_is_told(tmp_path, step, monkeypatch):
    assert limits.of_cad(1000).seconds == limits.of_cad(1_000_000).seconds == 60.0
    assert limits.of_cad(50_000_000).seconds == 3000.0
    monkeypatch.setattr(limits, "CAD_SECONDS", 0.5)
    stand_in(tmp_path, monkeypatch, "say(fraction=0.2, text='reading'); time.sleep(60)")
    message = fault(step)
    assert (
        "no answer within 0.5 s of processor time, the limit for 0.1 MB, while reading" in message
        and "timeout" in message
    )


pytestmark = pytest.mark.skipif(not os.path.exists("/proc/self/stat"), reason="needs /proc")


SPIN = "end = time.process_time() + {}\nwhile time.process_time() < end: pass"


def test_limits_grow_with_what_was_found(tmp_path, monkeypatch):
    limits = ReadingLimits(0.5, 5e7, (("faces", 0.01, 1e6), ("shapes", 0.1, 0.0)))
    assert limits.grown({"faces": 100, "shapes": 2, "other": 9}) == ReadingLimits(0.5 + 1.0 + 0.2, 1.5e8)
    work = SPIN.format(0.8) + "\nx = bytes([1]) * 80_000_000\ntime.sleep(0.1)"
    outcome = ended(tmp_path, monkeypatch, f"say(found={{'faces': 100}})\n{work}", limits)
    assert outcome.done and outcome.peak > 8e7
    (tmp_path / "out" / "empty").rmdir()
    (tmp_path / "out" / "words").unlink()
    (tmp_path / "out").rmdir()
    assert not ended(tmp_path, monkeypatch, work, limits).done
