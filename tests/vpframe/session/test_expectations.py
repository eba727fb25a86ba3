"""Expectations that fail stay failed."""

from pathlib import Path

import pytest

from tests.vpframe.bench_scene import scene
from tests.vpframe.verdicts import report_of, verdict, written
from vpframe.app import task_runner as study
from vpframe.errors import TaskError
from vpframe.session.session import Session


@pytest.mark.parametrize("caught", ["TaskError", "Exception"])
def test_an_expectation_that_failed_is_not_undone_by_catching_it(tmp_path: Path, capsys, caught: str) -> None:
    path = written(
        tmp_path,
        "from vpframe import TaskError",
        "try:",
        "    session.expect_freedom('peg', 2)",
        f"except {caught}:",
        "    pass",
        "session.run(0.05)",
    )
    assert study.run_task(path, report=tmp_path / "report") == 1
    assert "failed: expected peg has 2 degrees of freedom (it has 6)" in capsys.readouterr().err
    document = report_of(tmp_path / "report")
    assert (document["verdict"], document["can_be_done"]) == ("cannot be done", False)
    assert document["steps"] == 6, "the script goes on"


def test_a_failed_expectation_stays_one_without_a_task_runner(tmp_path: Path) -> None:
    with Session(scene()) as session, pytest.raises(TaskError):
        session.expect_freedom("peg", 1)
    assert verdict(session, tmp_path)[:2] == ("cannot be done", False)
