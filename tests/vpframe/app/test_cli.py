"""The command line through its real entry point: what it says when it is used wrongly."""

import math
import subprocess
import sys

import pytest

from vpframe.app import cli


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
