"""Bad files: one line that says what, where and how to mend it; never a crash, never silence about what was lost."""

import os
import random
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

import vpframe as vp
from tests.vpframe.importers.damaged import fault, stand_in, written
from tests.vpframe.importers.test_mesh_files import PRIMITIVE, write_glb
from vpframe.scene import modelling as m


def test_missing_folder_unknown_empty(tmp_path):
    assert "no such file" in fault(tmp_path / "none.step")
    (tmp_path / "folder.step").mkdir()
    assert "folder" in fault(tmp_path / "folder.step")
    assert ".dwg" in fault(written(tmp_path / "a.dwg", "x"))
    for suffix in ("step", "igs", "stl", "obj", "ply", "glb"):
        assert "empty" in fault(written(tmp_path / f"a.{suffix}", b" \n"))


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


def test_numbers_that_make_no_model_are_one_line(tmp_path):
    box = trimesh.creation.box()
    faces = "".join("f {} {} {}\n".format(*(f + 1)) for f in box.faces)

    def obj(vertices: np.ndarray) -> str:
        return "".join(f"v {' '.join(map(repr, row))}\n" for row in vertices.tolist()) + faces

    assert "line 1 gives a vertex 2 of" in fault(written(tmp_path / "two.obj", obj(box.vertices[:, :2])))
    assert "line 21 gives a vertex 1 of" in fault(written(tmp_path / "one.obj", obj(box.vertices) + "v 7\n"))
    for size in (1e30, 1e200):
        assert "not read" in fault(written(tmp_path / "big.obj", obj(box.vertices * size)))
        assert "not read" in fault(written(tmp_path / "far.obj", obj(box.vertices + size)))
    fault(written(tmp_path / "small.obj", obj(box.vertices * 1e-200)))
    big = trimesh.Trimesh(box.vertices * 1e30, box.faces, process=False)
    for form in ("stl", "ply", "glb"):
        big.export(tmp_path / f"big.{form}")
        assert "1e+06 m are not read" in fault(tmp_path / f"big.{form}")


BOX_FACES = "".join("f {} {} {}\n".format(*(f + 1)) for f in trimesh.creation.box().faces)
BOX_OBJ = "".join(f"v {x} {y} {z}\n" for x, y, z in trimesh.creation.box().vertices) + BOX_FACES


@pytest.mark.parametrize("library", ["pipe.mtl", "x" * 5000, "folder.mtl", "/dev/zero", "sparse.mtl", "../pipe.mtl"])
def test_a_material_file_that_is_no_file_does_not_keep_a_mesh_from_being_read(tmp_path, library):
    inner = tmp_path / "inner"
    inner.mkdir()
    for folder in (tmp_path, inner):
        os.mkfifo(folder / "pipe.mtl")
    (inner / "folder.mtl").mkdir()
    with open(inner / "sparse.mtl", "wb") as file:
        file.truncate(40 << 30)
    assert len(vp.load(written(inner / "a.obj", f"mtllib {library}\n{BOX_OBJ}")).parts) == 1


def test_a_path_that_names_no_file_is_one_line(tmp_path):
    assert "File name too long" in fault(tmp_path / f"{'x' * 5000}.stl")
    assert "no such file" in fault(Path("a\0b.stl"))
    os.mkfifo(tmp_path / "a.stl")
    assert "is a pipe or device" in fault(tmp_path / "a.stl")


@pytest.mark.parametrize("where", ["node", "mesh", "note"])
def test_a_name_that_no_encoding_has_is_replaced(tmp_path, where):
    """JSON can name half of a surrogate pair, which cannot be written."""
    node = {"mesh": 0, "name": "b\ud800x"} if where == "node" else {"mesh": 0, "name": "box"}
    mesh = {"primitives": [PRIMITIVE]} | ({"name": "m\udfff"} if where == "mesh" else {})
    lines = {"name": "\ud83d", "primitives": [{"attributes": {"POSITION": 0}, "mode": 1}]}
    nodes = [node, {"mesh": "x", "name": "\udc00"}] if where == "note" else [node]
    scene = vp.load(write_glb(tmp_path / "a.glb", nodes=nodes, meshes=[mesh, lines]))
    text = " ".join([*scene.names, *scene.all_notes()])
    assert text.encode("utf-8") and len(scene) == 1
    assert "\ufffd" in text


def test_a_mesh_reader_that_crashes_is_one_line(tmp_path, monkeypatch):
    stand_in(tmp_path, monkeypatch, "os.kill(os.getpid(), signal.SIGSEGV)")
    assert "the mesh reader crashed (SIGSEGV)" in fault(written(tmp_path / "a.obj", BOX_OBJ))


@pytest.mark.parametrize(
    ("node", "word"),
    [
        ({"matrix": [float("nan")] * 16}, "finite"),
        ({"scale": [float("nan"), 1, 1]}, "finite"),
        ({"translation": [float("inf"), 0, 0]}, "again"),
        ({"scale": [1e30, 1e30, 1e30]}, "not read"),
        ({"scale": [0, 0, 0]}, "positive area"),
        ({"matrix": [1, 2, 3]}, "again"),
        ({"mesh": 7}, "again"),
    ],
)
def test_placements_of_a_glb_file_that_make_no_model_are_one_line(tmp_path, node, word):
    assert word in fault(write_glb(tmp_path / "a.glb", nodes=[{"mesh": 0, "name": "box", **node}]))


def test_a_glb_file_with_bad_text_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "charset_normalizer", None)
    path = write_glb(tmp_path / "a.glb")
    assert "JSON is damaged" in fault(written(path, path.read_bytes().replace(b'"box"', b'"b\xe4x"')))
    assert "compression" in fault(write_glb(path, extensionsRequired=["KHR_draco_mesh_compression"]))


@pytest.mark.parametrize(
    ("surface", "number"), [("TOROIDAL", 1), ("TOROIDAL", 2), ("CONICAL", 1), ("CONICAL", 2), ("CYLINDRICAL", 1)]
)
@pytest.mark.parametrize("value", ["0.", "-1."])
def test_a_surface_without_size_is_a_scene_or_one_line(tmp_path, surface, number, value):
    solids = {
        "TOROIDAL": m.torus(0.02, 0.005),
        "CONICAL": m.cone(0.02, 0.01, 0.03),
        "CYLINDRICAL": m.cylinder(0.01, 0.1),
    }
    path = m.write_step(tmp_path / "a.step", {"odd": solids[surface], "box": m.box(0.1, 0.1, 0.1)})
    numbers = r"[-+.0-9E]+"
    pattern = rf"({surface}_SURFACE\('',#\d+,{f'{numbers},' * (number - 1)}){numbers}"
    text, times = re.subn(pattern, rf"\g<1>{value}", path.read_text())
    assert times == 1
    scene = vp.load(written(path, text))
    assert "box" in scene.names
    if "odd" not in scene.names:
        assert any("odd" in note for note in scene.notes)


def test_parameters_out_of_range(tmp_path, step):
    assert "deflection" in fault(step, deflection=0.0)
    assert "angular" in fault(step, angular=float("nan"))
    assert "timeout" in fault(step, timeout=-1.0)
    assert "unit" in fault(step, unit="mm")
    trimesh.creation.box().export(tmp_path / "a.stl")
    assert "parsec" in fault(tmp_path / "a.stl", unit="parsec")


@pytest.mark.slow
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


@pytest.mark.parametrize("alone", [False, True])
def test_a_part_without_a_triangle_of_positive_area_is_named_or_refused(tmp_path, alone):
    parts = {"ring": m.torus(0.01, 0.002)} | ({} if alone else {"box": m.box(0.01, 0.01, 0.01)})
    path = m.write_step(tmp_path / "a.step", parts)
    text = path.read_text()
    path.write_text(re.sub(r"CIRCLE\(''(,#\d+),2\.\)", r"CIRCLE(''\1,1.E-300)", text))
    assert path.read_text() != text
    if alone:
        assert "holds no triangle of positive area" in fault(path)
    else:
        scene = vp.load(path)
        assert scene.names == ("box",)
        assert scene.notes == ("part ring is lost: it has no triangle of positive area",)
