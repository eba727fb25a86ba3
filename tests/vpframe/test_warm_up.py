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
from vpframe.app import warm_up

ROOT = Path(__file__).parents[2]


def share(use: str, number: int, cache: Path) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "vpframe.app.warm_up", use, str(number)],
        env=os.environ | {"PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(cache)},
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
    helper = share("session", 1, tmp_path)
    while not list(tmp_path.rglob("*.lock")):  # it compiles
        assert helper.poll() is None
        time.sleep(0.01)
    helper.stdin.close()
    assert helper.wait(timeout=20.0) == 0
    assert not list(tmp_path.rglob("*.done"))


@pytest.mark.parametrize("use", warm_up.USES)
def test_every_share_can_be_asked(use):
    for number in range(len(warm_up.USES[use])):
        for ask in warm_up.USES[use][number]:
            ask()


@pytest.mark.slow
def test_they_compile_what_the_demo_needs(tmp_path):
    for number in (0, 1):
        assert share("session", number, tmp_path / "cache").wait(timeout=600) == 0
    compiled = set((tmp_path / "cache").rglob("*.nbc"))
    done = subprocess.run(
        [sys.executable, "-m", "vpframe", "demo", "--out", tmp_path / "out"],
        env=os.environ | {"PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(tmp_path / "cache")},
        stdout=subprocess.DEVNULL,
    )
    missed = set((tmp_path / "cache").rglob("*.nbc")) - compiled
    assert done.returncode == 0 and len(compiled) > 100 and len(missed) < 10, sorted(path.name for path in missed)
