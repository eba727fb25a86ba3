"""The command line through its real entry point: what it says when it is used wrongly."""

import subprocess
import sys

import pytest


def test_help_needs_none_of_the_heavy_imports():
    code = (
        "import sys; from vpframe.cli import main\n"
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
