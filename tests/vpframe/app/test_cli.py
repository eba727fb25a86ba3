"""The command line through its real entry point: what it says when it is used wrongly."""

import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from vpframe import processes
from vpframe.app import cli
from vpframe.scene import modelling as m


def test_help_needs_none_of_the_heavy_imports():
    code = (
        "import sys; from vpframe.app.cli import main\n"
        "try: main(['--help'])\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'numba', 'pinocchio', 'OCP', 'rerun', 'meshcat', 'trimesh'}\n"
        "print('HEAVY', sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "HEAVY []" in done.stdout, done.stdout + done.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["frobnicate"],
        ["clash"],
        ["clash", "x.step", "--clearance", "5 furlong"],
        ["clash", "x.step", "--clearance", "0.5"],
        ["mates", "x.step", "--deflection", "0.1"],
        ["bench", "nothing"],
        ["new", "t.py"],
        ["mates", "no_such_file.step"],
        ["clash", "no_such_file.step", "--json"],
        ["view", "no_such_file.step"],
        ["run", "no_such_task.py"],
        ["replay", "no_such.rrd"],
    ],
    ids=" ".join,
)
def test_bad_usage_is_one_line_and_exit_2(arguments, tmp_path, vpframe):
    done = vpframe(*arguments, cwd=tmp_path, timeout=120)
    assert done.returncode == 2, (done.stdout, done.stderr)
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1 and done.stderr.startswith("vpframe: ")
    assert "internal error" not in done.stderr


def test_the_line_names_the_file(tmp_path, vpframe):
    done = vpframe("mates", "no_such_file.step", cwd=tmp_path)
    assert "no_such_file.step" in done.stderr


def test_a_length_without_a_unit_is_refused_with_the_unit_it_may_have_meant(tmp_path, vpframe):
    done = vpframe("clash", "no_such_file.step", "--clearance", "0.5", cwd=tmp_path)
    assert done.returncode == 2 and "0.5mm" in done.stderr and "no_such_file" not in done.stderr


@pytest.mark.parametrize("unit", ["um", "µm", "μm"])
def test_micrometres_are_a_unit_wherever_one_is_taken(unit, tmp_path, vpframe):
    from tests.vpframe.watching import pressing_scene
    from vpframe.importers import load
    from vpframe.scene.stl import write_stl

    mesh = pressing_scene()["rod"].mesh
    path = write_stl(tmp_path / "rod.stl", mesh.vertices, mesh.triangles, scale=1e6)
    (part,) = load(path, unit=unit).parts
    assert abs(part.mesh.vertices[:, 2].max() - 0.025) < 1e-9
    command = ["clash", str(path), str(path), "--unit", unit, "--clearance", f"20{unit}"]
    given = cli._parser().parse_args(command)
    assert load(path, unit=given.unit).parts[0].mesh.vertices.max() == part.mesh.vertices.max()
    if unit == "um":
        found = vpframe(*command, cwd=tmp_path)
        assert found.returncode == 1, found.stderr  # two in one place


def test_angles_are_degrees() -> None:
    for command in (["clash", "a.step"], ["disassemble", "a.step"], ["mates", "a.step"], ["view", "a.step"]):
        assert cli._parser().parse_args([*command, "--angular", "20"]).angular == math.radians(20.0)
        with pytest.raises(cli.UsageError, match=r"--angular: invalid number of degrees value: 'steep'"):
            cli._parser().parse_args([*command, "--angular", "steep"])


def test_a_missing_library_of_the_system_is_one_line_without_the_packages_that_need_it(tmp_path):
    (tmp_path / "pinocchio.py").write_text(
        "raise ImportError('libgomp.so.1: cannot open shared object file: No such file or directory')"
    )
    code = "import sys; from vpframe.app.cli import main; sys.exit(main(['clash']))"
    for script, line in (
        (code, "vpframe: the following arguments are required: FILE; see vpframe clash --help\n"),
        (
            code.replace("'clash'", "'mates', 'a.stl'"),
            "vpframe: libgomp.so.1 is missing, a library of the system: "
            "install it (Debian: apt install libgl1 libgomp1)\n",
        ),
    ):
        (tmp_path / "a.stl").write_text("solid a\nendsolid a\n")
        path = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); "
        done = subprocess.run([sys.executable, "-c", path + script], cwd=tmp_path, capture_output=True, text=True)
        assert (done.returncode, done.stdout, done.stderr) == (2, "", line)


@pytest.mark.skipif(sys.platform != "linux", reason="processes are found in /proc")
def test_an_interrupt_ends_a_load_with_its_reading_processes(tmp_path: Path) -> None:
    solid = m.box(0.02, 0.02, 0.02).filleted(0.002) - m.cylinder(0.003, 0.05).translated(0.01, 0.01)
    path = m.write_step(tmp_path / "large.step", {f"part_{i}": solid.translated(i, 0.0, 0.0) for i in range(60)})
    command = [sys.executable, "-m", "vpframe", "clash", str(path)]
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(command, env={**os.environ, "VPFRAME_CACHE": ""}, start_new_session=True, **silent)
    readers: set[int] = set()
    while not readers and process.poll() is None:  # until the file is being read
        readers = set(processes.family(process.pid)) - {process.pid}
        time.sleep(0.01)
    time.sleep(0.5)
    readers |= set(processes.family(process.pid)) - {process.pid}
    process.send_signal(signal.SIGINT)
    _, words = process.communicate(timeout=60)
    assert process.returncode == 130, words
    assert "Traceback" not in words
    assert readers
    for _ in range(500):  # the system ends the forked ones after their parent
        if not any(map(_is_running, readers)):
            return
        time.sleep(0.01)
    raise AssertionError("a reading process is left")


def _is_running(pid: int) -> bool:
    try:
        return processes.stat_of(f"/proc/{pid}/stat")[0] not in "ZX"
    except OSError:
        return False
