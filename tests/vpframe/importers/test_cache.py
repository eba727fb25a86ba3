"""The second load of a model: the same to the last bit, without the kernel; whatever became of the files meanwhile."""

import os
import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

import vpframe as vp
from tests.vpframe.importers.models import model, same
from vpframe.importers import archive, cache, cad, guarded
from vpframe.scene import modelling as m

ROOT = Path(vp.__file__).parent.parent


@pytest.fixture
def runs(monkeypatch) -> list[str]:
    """The files that the kernel was started to read."""
    started: list[str] = []
    run = guarded.run

    def counted(request, *more):
        if request["format"] != "measure":
            started.append(Path(request["path"]).name)
        return run(request, *more)

    monkeypatch.setattr(guarded, "run", counted)
    return started


def test_the_second_load_is_the_first_to_the_last_bit_without_the_kernel(tmp_path, place, runs):
    path = model(tmp_path / "a.step")
    first = vp.load(path)
    assert same(vp.load(path), first)
    (tmp_path / "moved").mkdir()
    assert same(vp.load(path.rename(tmp_path / "moved" / "a.step")), first)
    assert runs == ["a.step"]
    assert len(list(place.iterdir())) == 1


def test_mass_properties_are_measured_once_when_first_needed(tmp_path, place, monkeypatch):
    requests: list[str] = []
    run = guarded.run
    monkeypatch.setattr(
        guarded, "run", lambda request, *more: requests.append(request["format"]) or run(request, *more)
    )
    solids = {
        "ball": (m.sphere(0.01), 4e-6 / 3 * np.pi),
        "rod": (m.cylinder(0.005, 0.03), 0.75e-6 * np.pi),
        "tube": (m.cylinder(0.01, 0.02) - m.cylinder(0.005, 0.02), 1.5e-6 * np.pi),
        "box": (m.box(0.01, 0.02, 0.03), 6e-6),
    }
    path = m.write_step(tmp_path / "a.step", {name: solid for name, (solid, _) in solids.items()})
    scene = vp.load(path)
    assert requests == ["step"]
    for name, (_, volume) in solids.items():
        shape = scene[name].shape
        assert shape.volume == pytest.approx(volume, rel=1e-9)
        assert shape.enclosed == pytest.approx(volume, rel=0.05)
    assert scene["box"].shape.center == pytest.approx([0.005, 0.01, 0.015])
    assert np.diag(scene["box"].shape.inertia) == pytest.approx(6e-6 / 12 * np.array([13e-4, 10e-4, 5e-4]))
    assert requests == ["step", "measure"]
    again = vp.load(path)
    assert [again[name].shape.volume for name in solids] == [scene[name].shape.volume for name in solids]
    assert requests == ["step", "measure"]


def test_a_solid_that_the_kernel_cannot_measure_has_the_volume_of_its_triangles(tmp_path, place):
    path = m.write_step(tmp_path / "a.step", {"ball": m.sphere(0.01), "box": m.box(0.01, 0.01, 0.01)})
    vp.load(path)
    (entry,) = place.iterdir()
    raw = archive.read(entry)
    raw.shapes[0].brep = b"no B-rep"
    archive.write(raw, entry)
    scene = vp.load(path)
    ball, box = scene["ball"].shape, scene["box"].shape
    assert box.volume == pytest.approx(1e-6, rel=1e-9)
    assert ball.volume == pytest.approx(ball.enclosed, rel=1e-9)
    assert any("cannot be computed" in note for note in ball.notes)


@pytest.mark.slow
def test_another_content_deflection_or_version_is_another_entry(tmp_path, place, runs, monkeypatch):
    path = model(tmp_path / "a.step")
    vp.load(path)
    vp.load(path, deflection=1e-5)
    vp.load(path, angular=0.2)
    model(path, size=0.07)
    assert np.ptp(vp.load(path)["block"].mesh.vertices[:, 0]) == pytest.approx(0.07)
    monkeypatch.setattr(cache, "_versions", lambda: b"of tomorrow")
    vp.load(path)
    assert len(runs) == len(list(place.iterdir())) == 5


def test_files_that_a_file_refers_to_count(tmp_path, place, runs):
    top = m.write_step(
        tmp_path / "top.step", {"plate": m.box(0.1, 0.1, 0.01), "pin": m.cylinder(0.1, 0.1)}, external=True
    )
    whole = vp.load(top)
    text = (tmp_path / "top_pin.stp").read_text()
    (tmp_path / "top_pin.stp").unlink()
    assert vp.load(top).names == ("plate",)
    (tmp_path / "top_pin.stp").write_text(text)
    assert same(vp.load(top), whole)
    assert len(runs) == 2


@pytest.mark.parametrize("form", ["stl", "obj", "ply", "glb"])
def test_meshes_are_cached_too(tmp_path, place, form, monkeypatch):
    shape = m.shape(m.box(0.06, 0.04, 0.02) - m.cylinder(0.005, 0.02).translated(0.015, 0.02))
    trimesh.Trimesh(shape.mesh.vertices, shape.mesh.triangles, process=False).export(tmp_path / f"a.{form}")
    first = vp.load(tmp_path / f"a.{form}")

    def refused(*given: object) -> None:
        raise vp.LoadError("a process is started", "")

    monkeypatch.setattr(guarded, "run", refused)
    assert same(vp.load(tmp_path / f"a.{form}"), first)
    if form == "stl":
        with pytest.raises(vp.LoadError, match="a process is started"):
            vp.load(tmp_path / "a.stl", unit="mm")


def test_colours_of_a_material_file_count(tmp_path, place):
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    faces = "".join("f {} {} {}\n".format(*(f + 1)) for f in box.faces)
    vertices = "".join(f"v {x} {y} {z}\n" for x, y, z in box.vertices)
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\n{vertices}usemtl paint\n{faces}")
    for color in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)):
        (tmp_path / "a.mtl").write_text("newmtl paint\nKd {} {} {}\n".format(*color))
        (part,) = vp.load(tmp_path / "a.obj").parts
        assert part.color[:3] == pytest.approx(color)


@pytest.mark.parametrize("times", [2, pytest.param(8, marks=pytest.mark.slow)])
def test_a_damaged_entry_is_made_anew(times, tmp_path, place, runs):
    path = model(tmp_path / "a.step")
    first = vp.load(path)
    (entry,) = place.iterdir()
    whole = entry.read_bytes()
    rng = random.Random(0)
    for n in range(1, times + 1):
        damaged = bytearray(whole[: rng.randrange(len(whole))] if n % 2 else whole)
        for _ in range(200 if n % 2 == 0 else 0):
            damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
        entry.write_bytes(damaged)
        assert same(vp.load(path), first)
        assert len(runs) == n + 1
        assert entry.read_bytes() != damaged
    assert same(vp.load(path), first)
    assert len(runs) == times + 1


def test_what_is_lost_for_want_of_time_is_not_remembered(tmp_path, place, monkeypatch, runs):
    path = model(tmp_path / "a.step")
    once = cad._read_once

    def late(*given):
        outcome, raw = once(*given)
        raw.whole = False
        return outcome, raw

    monkeypatch.setattr(cad, "_read_once", late)
    vp.load(path)
    assert not place.exists()
    monkeypatch.setattr(cad, "_read_once", once)
    vp.load(path)
    assert place.exists()


def test_a_folder_that_cannot_be_written_is_no_hindrance(tmp_path, monkeypatch):
    path = model(tmp_path / "a.step")
    monkeypatch.setenv(cache.VARIABLE, str(path / "cache"))
    assert same(vp.load(path), vp.load(path))


@pytest.mark.slow
def test_the_oldest_entries_go_when_there_are_too_many(tmp_path, place, runs, monkeypatch):
    paths = [model(tmp_path / f"{i}.step", size=0.06 + 0.001 * i) for i in range(4)]
    vp.load(paths[0])
    (entry,) = place.iterdir()
    monkeypatch.setattr(cache, "LARGEST", int(3.5 * entry.stat().st_size))
    (place / "half.tmp").write_bytes(b"written by a process that was killed")
    os.utime(place / "half.tmp", (0, 0))
    for age, path in enumerate((*paths[1:3], paths[0], paths[3])):  # the first is used once more before the last
        vp.load(path)
        for file in place.iterdir():
            os.utime(file, (file.stat().st_atime, file.stat().st_mtime - 100.0))
        assert age == 3 or len(list(place.glob("*.archive"))) == min(age + 2, 3)
    assert len(list(place.glob("*.archive"))) == 3
    assert not (place / "half.tmp").exists()
    before = len(runs)
    vp.load(paths[0])
    assert len(runs) == before
    vp.load(paths[1])
    assert len(runs) == before + 1


def test_processes_that_load_at_once_do_not_disturb_each_other(tmp_path, place):
    path = model(tmp_path / "a.step")
    script = f"""
import vpframe as vp
for _ in range(3):
    scene = vp.load({str(path)!r})
    print(scene.names, sum(p.mesh.n_triangles for p in scene.parts), flush=True)
"""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    processes = [
        subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, env=environment)
        for _ in range(3)
    ]
    answers = [process.communicate(timeout=250)[0] for process in processes]
    assert [process.returncode for process in processes] == [0, 0, 0]
    assert len({line for answer in answers for line in answer.splitlines()}) == 1
    assert [file.suffix for file in place.iterdir()] == [".archive"]
