"""Bad files: one line that says what, where and how to mend it; never a crash, never silence about what was lost."""

from __future__ import annotations

import os
import random
import re
import resource
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import OCP
import pinocchio as pin
import pytest
import trimesh
from OCP.IGESControl import IGESControl_Writer

import vpframe as vp
from tests.vpframe.importers.test_meshes import PRIMITIVE, write_glb
from vpframe.importers import cad, guarded, limits
from vpframe.importers.checks import iges_damage
from vpframe.importers.step_text import scan
from vpframe.scene import modelling as m


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


@pytest.mark.parametrize("suffix", ["step", "igs", "stl", "obj", "ply", "glb", "urdf"])
def test_a_huge_file_is_one_line(tmp_path, suffix):
    path = tmp_path / f"a.{suffix}"
    with open(path, "wb") as file:
        file.truncate(40 << 30)
    assert "has 42.9 GB, and more than 1 GB are not read" in fault(path)


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


def test_a_mesh_that_takes_too_much_memory_or_time_is_one_line(tmp_path, monkeypatch):
    path = written(tmp_path / "a.obj", BOX_OBJ)
    stand_in(tmp_path, monkeypatch, "while True: pass")
    assert "no answer within 0.2 s of processor time" in fault(path, timeout=0.2)
    monkeypatch.setattr(limits, "MESH_MEMORY", 100_000_000)
    stand_in(tmp_path, monkeypatch, "x = bytes([1]) * 200_000_000; time.sleep(60)")
    assert "more than 0.1 GB of memory are needed" in fault(path)


def test_a_mesh_reader_that_crashes_is_one_line(tmp_path, monkeypatch):
    stand_in(tmp_path, monkeypatch, "os.kill(os.getpid(), signal.SIGSEGV)")
    assert "the mesh reader crashed (SIGSEGV)" in fault(written(tmp_path / "a.obj", BOX_OBJ))


def test_nothing_that_lies_beside_a_mesh_is_run(tmp_path, monkeypatch):
    for name in ("json", "numpy", "trimesh", "scipy", "pickle", "vpframe", "sitecustomize", "PIL/__init__"):
        spy = tmp_path / f"{name}.py"
        spy.parent.mkdir(exist_ok=True)
        spy.write_text(f"open({str(tmp_path / 'run')!r}, 'a').write({name!r})\nraise SystemExit(3)\n")
    path = written(tmp_path / "a.obj", BOX_OBJ)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    assert vp.load(path).names == vp.load("a.obj").names == ("a",)
    assert not (tmp_path / "run").exists()


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


def uses_of(text: str) -> dict[str, tuple[str, str, str]]:
    """Statement, parent and child of each use of a product, by the name of the use."""
    found = re.findall(r"(#\d+ = NEXT_ASSEMBLY_USAGE_OCCURRENCE\('\d+','(\w+)','',(#\d+),(#\d+),\$\);)", text)
    return {name: (statement, parent, child) for statement, name, parent, child in found}


@pytest.mark.parametrize("user, used", [("plate", "plate"), ("pair", "pair"), ("root", "root"), ("pair", "root")])
def test_an_assembly_used_in_itself_loses_that_use_alone(user, used, tmp_path, step):
    text = step.read_text()
    uses = uses_of(text)
    root = uses["plate"][1]
    parent, child = (root if name == "root" else uses[name][2] for name in (user, used))
    more = f"#99999 = NEXT_ASSEMBLY_USAGE_OCCURRENCE('9','loop','',{parent},{child},$);"
    path = written(tmp_path / "loop.step", text.replace("DATA;", f"DATA;\n{more}", 1).encode())
    scene = vp.load(path)
    assert scene.names == vp.load(step).names
    assert any("is used in itself" in note for note in scene.notes)
    assert not any("lost" in note for note in scene.notes)


def test_a_part_whose_use_was_overwritten_by_a_loop_is_named(tmp_path, step):
    text = step.read_text()
    statement, parent, child = uses_of(text)["cap"]
    path = written(tmp_path / "loop.step", text.replace(statement, statement.replace(parent, child)).encode())
    scene = vp.load(path)
    assert {"plate", "pair/bolt_1", "pair/bolt_2"} <= {name.removeprefix("assembly/") for name in scene.names}
    assert any("cap is used in itself" in note for note in scene.notes)


def test_assemblies_in_other_files_are_no_lost_parts(tmp_path):
    """A node whose shape lies in another file, where it is an assembly, has no faces of its own."""
    tail = {"fin": m.box(0.01, 0.02, 0.001), "boom": m.cylinder(0.002, 0.05)}
    m.write_step(tmp_path / "TAIL.step", tail, name="TAIL")
    top = m.write_step(
        tmp_path / "top.step", {"TAIL": m.box(0.01, 0.01, 0.01), "plate": m.box(0.1, 0.1, 0.01)}, external=True
    )
    (tmp_path / "top_TAIL.stp").write_bytes((tmp_path / "TAIL.step").read_bytes())
    scene = vp.load(top)
    assert set(scene.names) == {"TAIL/fin", "TAIL/boom", "plate"}
    assert not any("left out" in note or "lost" in note for note in scene.notes)


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
    monkeypatch.setattr(guarded, "READER", tmp_path / "stand_in_reader.py")


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


def test_nothing_that_lies_beside_a_file_is_run(tmp_path, step, monkeypatch):
    """Reading a file must not run code from its folder, nor from where the user or the reading process is."""
    for name in ("json", "numpy", "pickle", "vpframe", "sitecustomize", "usercustomize", "OCP/__init__"):
        spy = tmp_path / f"{name}.py"
        spy.parent.mkdir(exist_ok=True)
        spy.write_text(f"open({str(tmp_path / 'run')!r}, 'a').write({name!r})\nraise SystemExit(3)\n")
    path = written(tmp_path / "model.step", step.read_bytes())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    assert vp.load(path).names == vp.load("model.step").names == vp.load(step).names
    assert not (tmp_path / "run").exists()


def test_a_source_checkout_reads_with_its_own_package(tmp_path, step):
    """Run from a checkout by PYTHONPATH, the reading process uses that checkout, though it is on nobody's path."""
    root = Path(vp.__file__).parent.parent
    checkout = tmp_path / "checkout"
    shutil.copytree(root / "vpframe", checkout / "vpframe", ignore=shutil.ignore_patterns("__pycache__", "view*"))
    for package in ("collision", "constraints"):
        (checkout / package).symlink_to(root / package)
    with open(checkout / "vpframe" / "importers" / "document.py", "a") as file:
        file.write(f"\nopen({str(tmp_path / 'read_by')!r}, 'w').write(__file__)\n")
    script = f"import vpframe as vp; print(vp.__file__); print(*vp.load({str(step)!r}).names)"
    run = subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, "PYTHONPATH": str(checkout)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == [str(checkout / "vpframe" / "__init__.py"), *vp.load(step).names]
    assert (tmp_path / "read_by").read_text() == str(checkout / "vpframe" / "importers" / "document.py")


def test_packages_are_found_where_this_process_has_them_but_never_beside_the_file():
    (folder,) = {str(Path(module.__file__).parent.parent) for module in (OCP, np)}
    assert guarded.package_folders(Path("/somewhere"), cad.PACKAGES) == [folder]
    assert guarded.package_folders(Path(folder), cad.PACKAGES) == []


def test_reading_ends_with_the_process_that_asked_for_it(tmp_path):
    """After `kill -9` of the parent, while the kernel meshes and holds the GIL, nothing goes on computing."""
    path = m.write_step(tmp_path / "ball.step", {"ball": m.sphere(0.1)})
    script = f"""
import vpframe as vp
vp.load({str(path)!r}, deflection=3e-7, progress=lambda fraction, text: print(text, flush=True))
"""
    parent = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    while "meshing" not in parent.stdout.readline():
        assert parent.poll() is None
    children = [int(n) for f in Path(f"/proc/{parent.pid}/task").glob("*/children") for n in f.read_text().split()]
    assert len(children) == 1
    time.sleep(0.5)
    parent.kill()
    parent.communicate()
    end = time.monotonic() + 5.0
    while running(children[0]) and time.monotonic() < end:
        time.sleep(0.05)
    assert not running(children[0])


def running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


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


def test_two_parts_of_one_name_are_refused(step):
    scene = vp.load(step)
    with pytest.raises(vp.VpframeError, match=r"two parts are called 'plate'"):
        scene.add(scene["plate"])


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
