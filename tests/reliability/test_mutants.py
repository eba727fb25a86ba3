"""Damaged files, a few of each format; `python -m tests.reliability.mutants` reads as many as one likes."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

import vpframe as vp
from tests.reliability import mutants

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


@pytest.mark.parametrize("form", mutants.FORMATS)
def test_a_damaged_file_is_a_scene_or_one_line(form: str) -> None:
    found = mutants.row(form, 4 if form in ("step", "iges") else 80)
    assert found["faults"] == []
    assert found["read"] + found["refused"] == found["mutants"]
    assert found["refused"] and (found["read"] or form == "iges"), "of IGES, four in a row may all be refused"
    assert found["memory"] < mutants.MEMORY


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
