"""Kills, long sessions, pages and full disks, a few of each; the modules run as many as one likes."""

from __future__ import annotations

import pytest

from tests.reliability import kills, limits

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
FLAT = 5 * 2**20
"""bytes that memory may grow"""


@pytest.mark.parametrize("kind", kills.KINDS)
def test_a_kill_loses_nothing_that_was_written(kind: str) -> None:
    found = kills.row(kind, 1)
    assert found["faults"] == []


def test_a_long_session_keeps_its_memory() -> None:
    found = limits.steps(3000)
    assert found["count"] >= 3000
    assert found["growth"] < FLAT


def test_many_pages_are_all_heard() -> None:
    found = limits.pages(200)
    assert (found["count"], found["refused"]) == (200, 0)
    assert found["growth"] < 2 * FLAT, "200 pages come and go"


def test_a_full_disk_is_one_line() -> None:
    found = limits.disk(3)
    assert found["faults"] == [] and found["stopped"] > 0


def test_a_small_disk_that_is_filled_is_one_line() -> None:
    if not limits.mountable():
        pytest.skip("needs root, or user namespaces")
    found = limits.full(3)
    assert found["faults"] == [] and found["stopped"] > 0 and found["errno"] == "ENOSPC"
