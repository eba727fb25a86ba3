"""Bad files: one line that says what, where and how to mend it; never a crash, never silence about what was lost."""

from __future__ import annotations

import os
import random
import threading
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import trimesh

import vpframe as vp
from vpframe import modelling as m
from vpframe.importers import cad
from vpframe.importers.step_text import scan


@pytest.fixture(scope="module")
def step(tmp_path_factory) -> Path:
    """Two plates with bores, a bolt in each, one of its own shape: 4 parts of 3 shapes."""
    plate = m.box(0.1, 0.1, 0.01) - m.cylinder(0.004, 0.01).translated(0.05, 0.05)
    bolt = m.cylinder(0.004, 0.03) + m.hexagon(0.012, 0.005)
    parts = {
        "plate": plate,
        "pair": ({"bolt_1": bolt, "bolt_2": bolt}, None),
        "cap": m.sphere(0.02) - m.box(0.1, 0.1, 0.1),
    }
    return m.write_step(tmp_path_factory.mktemp("step") / "model.step", parts)


def fault(path: Path, **options) -> str:
    with pytest.raises(vp.LoadError) as error:
        vp.load(path, **options)
    message = str(error.value)
    assert "\n" not in message
    assert message.startswith(str(path))
    assert error.value.path == str(path)
    return message


def written(path: Path, data: bytes | str) -> Path:
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return path


def test_missing_folder_unknown_empty(tmp_path):
    assert "no such file" in fault(tmp_path / "none.step")
    (tmp_path / "folder.step").mkdir()
    assert "folder" in fault(tmp_path / "folder.step")
    assert ".dwg" in fault(written(tmp_path / "a.dwg", "x"))
    for suffix in ("step", "igs", "stl", "obj", "ply", "glb"):
        assert "empty" in fault(written(tmp_path / f"a.{suffix}", b" \n"))


def test_mislabelled(tmp_path, step):
    cube = trimesh.creation.box()
    files = {"step": step.read_bytes()} | {
        f: trimesh.exchange.export.export_mesh(cube, None, f) for f in ("stl", "ply", "glb")
    }
    for form, data in files.items():
        for suffix in ("step", "igs", "stl", "ply", "glb"):
            if suffix != form:
                message = fault(written(tmp_path / f"{form}_as.{suffix}", data))
                assert f"is a {form.upper()} file" in message and f".{form}" in message
    noise = np.random.default_rng(0).bytes(5000)
    for suffix in ("step", "igs", "stl", "obj", "ply", "glb"):
        fault(written(tmp_path / f"noise.{suffix}", noise))


def test_cut_short(tmp_path, step):
    data = step.read_bytes()
    for part in (0.1, 0.5, 0.9, 0.999):
        assert "cut short" in fault(written(tmp_path / "cut.step", data[: int(len(data) * part)]))
    cube = trimesh.creation.icosphere()
    for form in ("stl", "glb", "stl_ascii", "ply"):
        whole = trimesh.exchange.export.export_mesh(cube, None, form)
        whole = whole.encode() if isinstance(whole, str) else whole
        cut = written(tmp_path / f"cut.{form.split('_')[0]}", whole[: len(whole) // 2])
        message = fault(cut)
        assert "again" in message


def test_nothing_solid_in_it(tmp_path, step):
    text = step.read_text()
    head, rest = text.split("DATA;", 1)
    assert "no" in fault(written(tmp_path / "void.step", f"{head}DATA;\nENDSEC;{rest.rsplit('ENDSEC;', 1)[1]}"))
    sheet = text.replace("MANIFOLD_SOLID_BREP", "SHELL_BASED_SURFACE_MODEL")
    fault(written(tmp_path / "sheet.step", sheet))


def test_meshes_without_use(tmp_path):
    assert "finite" in fault(written(tmp_path / "nan.obj", "v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n"))
    flat = trimesh.Trimesh(np.eye(3), [[0, 0, 1]], process=False)
    flat.export(tmp_path / "flat.stl")
    assert "positive area" in fault(tmp_path / "flat.stl")
    fault(written(tmp_path / "points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n"))
    fault(written(tmp_path / "index.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"))
    nan = trimesh.creation.box()
    nan.vertices[3, 1] = np.nan
    for form in ("stl", "ply", "glb"):
        nan.export(tmp_path / f"nan.{form}")
        assert "finite" in fault(tmp_path / f"nan.{form}")


def test_parameters_out_of_range(tmp_path, step):
    assert "deflection" in fault(step, deflection=0.0)
    assert "angular" in fault(step, angular=float("nan"))
    assert "timeout" in fault(step, timeout=-1.0)
    assert "unit" in fault(step, unit="mm")
    trimesh.creation.box().export(tmp_path / "a.stl")
    assert "parsec" in fault(tmp_path / "a.stl", unit="parsec")


def test_changed_bytes_end_in_one_line_or_in_a_scene_that_names_what_it_lost(tmp_path, step, capfd):
    data = step.read_bytes()
    whole = sum(len(part.surfaces) for part in vp.load(step).parts)
    outcomes = set()
    for seed, changes in enumerate([2, 4, 8, 16, 40, 100]):
        rng = random.Random(seed)
        bad = bytearray(data)
        for _ in range(changes):
            bad[rng.randrange(data.index(b"DATA;"), len(data) - 100)] = rng.randrange(256)
        path = written(tmp_path / f"bad_{seed}.step", bytes(bad))
        try:
            scene = vp.load(path)
        except vp.LoadError as error:
            assert "\n" not in str(error)
            outcomes.add("refused")
        else:
            outcomes.add("read")
            if sum(len(part.surfaces) for part in scene.parts) < whole:
                assert scene.notes
    assert outcomes == {"refused", "read"}
    assert capfd.readouterr() == ("", "")


def test_lost_parts_and_faces_are_named(tmp_path, step):
    lines = step.read_text().replace("\n  ", " ")
    face = next(line for line in lines.splitlines() if "= ADVANCED_FACE" in line)
    scene = vp.load(written(tmp_path / "face.step", lines.replace(face, face.replace("ADVANCED_FACE", "ADVANCED_FCE"))))
    assert any("plate is incomplete: 6 of its 7 faces" in note for note in scene.notes)
    solid = next(line for line in lines.splitlines() if "= MANIFOLD_SOLID_BREP" in line)
    scene = vp.load(
        written(tmp_path / "solid.step", lines.replace(solid, solid.replace(" MANIFOLD_SOLID_BREP(", " ((")))
    )
    assert "plate" not in scene.names
    assert any("plate" in note for note in scene.notes)
    assert any(f"#{solid.split()[0].strip('#=')}" in note and "line" in note for note in scene.notes)


def test_the_text_tells_what_a_step_file_holds(step):
    text = scan(step.read_bytes())
    assert text.damage == []
    assert dict(text.instances) == {"plate": 1, "bolt_1": 2, "cap": 1}
    assert text.faces["plate"] == 7
    assert text.lost(text.instances, text.faces) == []


def test_the_text_is_read_in_linear_time_whatever_it_holds():
    quotes = b"DATA;\n" + b"#1=A('" + b"''" * 200_000 + b";\n" + b"#2=B(('x')\n" * 2000 + b"ENDSEC;"
    assert scan(quotes).damage  # by backtracking this would take hours


READER = """
import json, os, signal, sys, time
request = json.loads(sys.argv[1])
def say(**message):
    print(json.dumps(message), flush=True)
say(fraction=0.1, text="meshing a", shape=0)
{body}
"""


def stand_in(tmp_path, monkeypatch, body: str) -> None:
    (tmp_path / "stand_in_reader.py").write_text(READER.format(body=body))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(cad, "READER", "stand_in_reader")


def test_a_shape_that_crashes_the_kernel_is_skipped_and_the_rest_is_read(tmp_path, step, monkeypatch):
    real = "vpframe.importers._reader"
    stand_in(
        tmp_path,
        monkeypatch,
        f"""
if request["skip"] != [0]:
    os.kill(os.getpid(), signal.SIGSEGV)
import runpy
runpy.run_module("{real}", run_name="__main__")
""",
    )
    scene = vp.load(step)
    assert "plate" not in scene.names and "cap" in scene.names
    assert any("plate is lost" in note and "crash" in note for note in scene.notes)


def test_a_kernel_that_always_crashes_hangs_or_gives_up_is_one_line(tmp_path, step, monkeypatch):
    stand_in(tmp_path, monkeypatch, "os.kill(os.getpid(), signal.SIGSEGV)")
    assert "SIGSEGV" in fault(step)
    stand_in(tmp_path, monkeypatch, "raise MemoryError('no room')")
    assert "no room" in fault(step)
    stand_in(tmp_path, monkeypatch, "time.sleep(60)")
    assert "no answer within 1 s" in fault(step, timeout=1.0)


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


def test_two_parts_of_one_name_are_refused(step):
    scene = vp.load(step)
    with pytest.raises(vp.VpframeError, match=r"two parts are called 'plate'"):
        scene.add(scene["plate"])


def test_an_interrupt_as_reading_begins_leaves_nothing_behind(tmp_path, monkeypatch):
    """Ctrl-C can come between any two lines; the clock that limits the reading must not keep the program alive."""
    file = m.write_step(tmp_path / "box.step", {"box": (m.box(0.1, 0.1, 0.1), pin.SE3.Identity(), (0.5, 0.5, 0.5))})
    started: list[threading.Timer] = []
    start = threading.Timer.start

    def interrupted(timer: threading.Timer) -> None:
        started.append(timer)
        start(timer)
        raise KeyboardInterrupt

    monkeypatch.setattr(threading.Timer, "start", interrupted)
    with pytest.raises(KeyboardInterrupt):
        vp.load(file)
    assert len(started) == 1 and started[0].daemon
    started[0].join(5.0)
    assert not started[0].is_alive()
