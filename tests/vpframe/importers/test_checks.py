"""Formats by content, and checks that files are complete."""

import numpy as np
import pytest
import trimesh
from OCP.IGESControl import IGESControl_Writer

import vpframe as vp
from tests.vpframe.importers.damaged import fault, written
from vpframe.importers.checks import iges_damage
from vpframe.scene import modelling as m


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


@pytest.mark.parametrize("suffix", ["step", "igs", "stl", "obj", "ply", "glb", "urdf"])
def test_a_huge_file_is_one_line(tmp_path, suffix):
    path = tmp_path / f"a.{suffix}"
    with open(path, "wb") as file:
        file.truncate(40 << 30)
    assert "has 42.9 GB, and more than 1 GB are not read" in fault(path)


def test_lines_of_an_iges_file_that_are_missing_or_doubled_are_noted(tmp_path):
    writer = IGESControl_Writer("MM", 0)
    writer.AddShape(m.box(0.01, 0.02, 0.03).occ)
    writer.ComputeModel()
    path = tmp_path / "a.igs"
    assert writer.Write(str(path))
    sound = path.read_bytes()
    assert vp.load(path).notes == () and iges_damage(sound) == ""
    lines = sound.splitlines(keepends=True)
    for i in range(len(lines) - 1):  # without the last one it is cut short, and refused
        assert "not in sequence" in iges_damage(b"".join([*lines[:i], *lines[i + 1 :]]))
        assert f"the first is line {i + 2}" in iges_damage(b"".join([*lines[: i + 1], *lines[i:]]))
    last = lines[-1].replace(b"S      1", b"S      2").replace(b"S0000001", b"S0000002")
    assert last != lines[-1] and "not in sequence" in iges_damage(b"".join([*lines[:-1], last]))
    place = next(i for i, line in enumerate(lines) if line[72:73] == b"P")
    path.write_bytes(b"".join([*lines[: place + 1], *lines[place:]]))
    (note,) = vp.load(path).notes
    assert note == f"damaged: 1 lines are not in sequence, the first is line {place + 2}: faces or parts may be missing"
