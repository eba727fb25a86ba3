"""A variant as a task script."""

import subprocess
import sys
from pathlib import Path

from tests.vpframe.studies.scripts import ENDINGS, environment, firsts, written


def test_the_worst_variants_are_scripts_that_run_again(endings, tmp_path: Path) -> None:
    _, out, _ = endings
    one = next(one for one in firsts(out) if one["status"] == "no")
    script = out / "worst" / f"variant_{one['index']:06d}.py"
    done = subprocess.run(
        [sys.executable, "-m", "vpframe", "run", script, "--report", tmp_path / "report"],
        capture_output=True, text=True, timeout=200, env=environment(), cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    assert "expected x is negative" in done.stderr
    assert (tmp_path / "report" / "scene.html").exists()


def test_a_script_of_variants_runs_alone_with_nominal_values(tmp_path: Path) -> None:
    script = written(tmp_path, ENDINGS)
    done = subprocess.run(
        [sys.executable, "-m", "vpframe", "run", script], capture_output=True, text=True, timeout=200, env=environment()
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1].startswith("done: 0.03 s of the task in 2 steps")
