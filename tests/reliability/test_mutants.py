"""Damaged files, a few of each format; `python -m tests.reliability.mutants` reads as many as one likes."""

from __future__ import annotations

import argparse
import os
import signal
import time
from pathlib import Path

import pytest

import vpframe as vp
from tests.reliability import mutants, results
from tests.vpframe.readers import forked
from vpframe.importers import limits

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


@pytest.mark.parametrize("form", mutants.FORMATS)
def test_a_damaged_file_is_a_scene_or_one_line(form: str) -> None:
    found = mutants.row(form, 60 if form in mutants.KERNEL else 200)
    assert found["faults"] == []
    assert found["read"] + found["refused"] == found["count"]
    assert min(found["read"], found["refused"]) > 5
    assert found["memory"] < mutants.MEMORY


@pytest.mark.parametrize("form", mutants.KERNEL)
def test_a_forked_reader_finds_what_a_started_one_does(form: str) -> None:
    def found(fork: bool) -> list[tuple[object, ...]]:
        ones = mutants.outcomes(form, 6, fork=fork)
        return [tuple(one.get(name) for name in ("seed", "outcome", "silent", "changed")) for one in ones]

    assert found(True) == found(False)


def test_a_volume_that_the_kernel_finds_infinite_is_that_of_the_triangles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VPFRAME_CACHE", "")
    _, suffix, data = mutants.mutant("step", 8459, mutants.models(tmp_path)["step"])
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(data)
    scene = vp.load(path)
    assert 0.0 < scene["plate"].shape.volume < 1e-3
    assert any("its exact volume, -inf mm³, is not that of its triangles" in note for note in scene.all_notes())


def test_the_end_of_a_forked_reader_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (suffix, data), *_ = mutants.models(tmp_path)["step"]
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(data)
    monkeypatch.setenv("VPFRAME_CACHE", "")

    def children() -> set[int]:
        files = Path("/proc/self/task").glob("*/children")
        return {int(pid) for file in files for pid in file.read_text().split()}

    with forked():
        before = children()
        assert vp.load(path).names == ("plate", "pair/pin_1", "pair/ring", "tip")
        others = children()
        assert len(others - before) == 1, "the zygote, which the first reader starts"
        with pytest.raises(vp.LoadError, match=r"the CAD kernel crashed \(SIGSEGV\)"):
            vp.load(path, progress=lambda fraction, text: [os.kill(pid, signal.SIGSEGV) for pid in children() - others])
        with pytest.raises(vp.LoadError, match=r"no answer within 0\.001 s"):
            vp.load(path, timeout=0.001)
        monkeypatch.setattr(limits, "CAD_MEMORY", 100 << 20)
        # where it ends before its memory was looked at, its signal is all that is known
        with pytest.raises(vp.LoadError, match=r"GB of memory are needed|crashed \(SIGSEGV\)"):
            vp.load(path)


def test_shards_add_up_and_are_not_run_again(tmp_path: Path) -> None:
    calls = []

    def row(name: str, count: int, first: int) -> dict[str, object]:
        calls.append((name, count, first))
        return {"what": name, "first": first, "count": count, "read": count - 1, "slowest": 0.1 * first, "faults": []}

    given = argparse.Namespace(first=0, jobs=2, results=tmp_path / "results.jsonl")
    results.run(row, ["a", "b"], 5, 3, given)
    results.run(row, ["a", "b"], 9, 3, given)
    assert sorted(calls) == [(name, *each) for name in "ab" for each in ((1, 8), (2, 3), (3, 0), (3, 5))]
    rows = results.load(given.results)  # in the order in which they ended
    (a, b) = results.totals(rows)
    assert results.totals(rows[::-1]) == [a, b]
    assert (a["what"], a["count"], a["read"], a["slowest"]) == ("a", 9, 5, 0.8)
    assert b | {"what": "a"} == a


@pytest.mark.parametrize("mutation", mutants.STEP_MUTATIONS, ids=lambda mutation: mutation.__name__)
def test_the_grammar_stays_one(mutation: mutants.Mutation, tmp_path: Path) -> None:
    sound = STEP.get("step") or STEP.setdefault("step", mutants.models(tmp_path)["step"][0][1])
    made = {mutation(sound, mutants.random.Random(seed)) for seed in range(20)}
    assert sound not in made or len(made) > 1
    for data in made - {sound}:
        assert data.startswith(b"ISO-10303-21;") and data.rstrip().endswith(b"END-ISO-10303-21;")
        assert mutants.ENTITY.search(data)


STEP: dict[str, bytes] = {}


def test_a_unit_that_is_none_is_refused_at_once(tmp_path: Path) -> None:
    (suffix, data), *_ = mutants.models(tmp_path)["step"]
    path = tmp_path / f"unit.{suffix}"
    path.write_bytes(data.replace(b"SI_UNIT(.MILLI.,.METRE.)", b"SI_UNIT(.MILLI.,$)"))
    began = time.monotonic()
    with pytest.raises(vp.LoadError, match="is no length unit that is known"):
        vp.load(path)
    assert time.monotonic() - began < 30.0, "the kernel takes it for a unit, and meshes for more than a minute"


def test_the_page_shows_what_was_found() -> None:
    rows = results.load(results.RESULTS)
    again = "the results have changed: put what python -m tests.reliability.results prints into the page"
    assert results.table(rows) in results.PAGE.read_text(encoding="utf-8"), again
    assert not [row["faults"] for row in rows if row["faults"]]
