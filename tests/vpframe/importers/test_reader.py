"""The reading process: what it runs, what it does not run, and when it ends."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import trimesh

import vpframe as vp
from tests.vpframe.importers.damaged import written
from tests.vpframe.waiting import is_gone, wait_until
from vpframe.scene import modelling as m

BOX_FACES = "".join("f {} {} {}\n".format(*(f + 1)) for f in trimesh.creation.box().faces)


BOX_OBJ = "".join(f"v {x} {y} {z}\n" for x, y, z in trimesh.creation.box().vertices) + BOX_FACES


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
    time.sleep(0.5)  # well into the meshing, which nothing shows from outside
    parent.kill()
    parent.communicate()
    wait_until(lambda: is_gone(children[0]), 5.0)
