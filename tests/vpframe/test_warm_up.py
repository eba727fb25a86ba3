"""Other processes compile what a command needs; they end with it, and none is started where there is nothing to do."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from collision.numeric import kernel_cache
from collision.numeric.kernel import compilation
from tests.vpframe.waiting import is_gone, wait_until
from vpframe import processes, warm_up

ROOT = Path(__file__).parents[2]
EXAMPLES = """
import gc, sys
from collision.numeric.kernel import _Kernel
from vpframe.warm_up import USES
for share in USES[sys.argv[1]]:
    for example in share:
        example()
kernels = [k for k in gc.get_objects() if isinstance(k, _Kernel) and k.overloads]
print(*(f"{k.__module__}.{k.__name__}" for k in kernels))
"""
NEAR = {
    "collision.broad_phase.follow", "collision.broad_phase.near_pairs", "collision.bvh.build.build_surfaces",
    "collision.bvh.build.close_top", "collision.bvh.build.order_groups", "collision.bvh.build.order_surfaces",
    "collision.query.distance.clearance", "collision.query.distance.contacts", "constraints.geometry.overlap._facing",
}  # fmt: skip
SOLVE = {
    "constraints.motion.unknowns._add_gaps", "constraints.motion.unknowns._add_rows",
    "constraints.solve.jacobians.evaluate", "constraints.solve.kernels.solve_all",
    "constraints.solve.ranks.null_basis", "constraints.solve.ranks.pivoted_qr",
}  # fmt: skip
KERNELS = {
    "session": NEAR | SOLVE | {
        "collision.broad_phase.place", "collision.query.intersection.intersect",
        "collision.query.time_of_impact.advance",
        "constraints.motion.quadratic_program._goldfarb_idnani", "vpframe.view.raster.draw_segments",
        "vpframe.view.raster.fill_triangles",
    },
    "disassemble": NEAR | SOLVE | {
        "collision.query.intersection.intersect", "collision.query.penetration.deepest",
        "collision.query.time_of_impact.advance", "vpframe.planning.tree.grow", "vpframe.planning.tree.meets_within",
    },
    "clash": NEAR | {
        "collision.query.containment.which_wind", "collision.query.intersection.intersect",
        "collision.query.penetration.deepest", "collision.query.signed_distance.depths_at",
    },
    "mates": NEAR | SOLVE,
}  # fmt: skip
"""kernels that Python calls, by use"""


def share(use: str, number: int, cache: Path) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "vpframe.warm_up", use, str(number)],
        env=os.environ | {"PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(cache)},
        stdin=subprocess.PIPE,
    )


@pytest.fixture
def commands(monkeypatch, tmp_path) -> list[list[str]]:
    """The processes that `start` would have started, with an empty cache."""
    found: list[list[str]] = []
    monkeypatch.setattr(kernel_cache, "folder", lambda package: tmp_path)
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    monkeypatch.setattr(subprocess, "Popen", lambda command, **options: found.append(command))
    monkeypatch.setattr(warm_up, "_helpers", [])
    return found


def test_one_process_a_share_and_none_when_all_is_done(commands, tmp_path):
    warm_up.start("session")
    assert [command[-2:] for command in commands] == [["session", "0"], ["session", "1"]]
    warm_up._done(tmp_path, "session", 0).touch()
    warm_up.start("session")
    assert [command[-2:] for command in commands[2:]] == [["session", "1"]]
    warm_up._done(tmp_path, "session", 1).touch()
    warm_up.start("session")
    assert len(commands) == 3


def test_none_after_a_run_that_compiled_nothing(commands, monkeypatch):
    monkeypatch.setattr(compilation, "kernels", 1)
    warm_up.note_enough("clash")
    warm_up.start("clash")
    assert len(commands) == 2
    monkeypatch.setattr(compilation, "kernels", 0)
    warm_up.note_enough("clash")
    warm_up.start("clash")
    assert len(commands) == 2
    warm_up.start("mates")
    assert len(commands) == 4


def test_none_where_nothing_is_kept_or_there_is_one_core(commands, monkeypatch):
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    warm_up.start("clash")
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    monkeypatch.setattr(kernel_cache, "folder", lambda package: None)
    warm_up.start("clash")
    assert commands == []


def test_they_end_with_the_process_that_started_them(tmp_path):
    starts = "import subprocess, sys\nfrom vpframe.processes import environment, with_parent\n"
    starts += "subprocess.run(with_parent('vpframe.warm_up', 'session', '1'), env=environment())"
    first = subprocess.Popen([sys.executable, "-c", starts], env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)})
    while not list(tmp_path.rglob("*.lock")):  # the second process compiles
        assert first.poll() is None
        time.sleep(0.01)
    (helper,) = set(processes.family(first.pid)) - {first.pid}
    first.kill()
    first.wait()
    wait_until(lambda: is_gone(helper))
    assert not list(tmp_path.rglob("*.done"))


@pytest.mark.timeout(900)  # all kernels of a use are compiled where none is kept
@pytest.mark.parametrize(
    "use", [pytest.param(use, marks=[pytest.mark.slow] * (use == "disassemble")) for use in warm_up.USES]
)
def test_the_examples_of_a_use_call_its_kernels(use):
    """Loaded or compiled in a process of its own: what a command needs and no example calls would be missing here."""
    done = subprocess.run(
        [sys.executable, "-P", "-c", EXAMPLES, use],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert set(done.stdout.split()) >= KERNELS[use], done.stdout


@pytest.mark.slow
def test_they_compile_what_the_demo_needs(tmp_path):
    for number in (0, 1):
        assert share("session", number, tmp_path / "cache").wait(timeout=600) == 0
    compiled = set((tmp_path / "cache").rglob("*.nbc"))
    done = subprocess.run(
        [sys.executable, "-m", "vpframe", "demo", "--out", tmp_path / "out"],
        env=os.environ | {"PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(tmp_path / "cache")},
        stdout=subprocess.DEVNULL,
    )
    missed = set((tmp_path / "cache").rglob("*.nbc")) - compiled
    assert done.returncode == 0 and len(compiled) > 100 and len(missed) < 10, sorted(path.name for path in missed)
