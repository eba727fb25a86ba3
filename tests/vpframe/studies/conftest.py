"""Studies that the tests of this folder read."""

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.vpframe.studies.records import VARIABLES, records
from tests.vpframe.studies.scripts import ENDINGS, study, written
from vpframe.studies import report
from vpframe.studies.summary import summary


@pytest.fixture(scope="session")
def endings(tmp_path_factory) -> tuple[Path, Path, subprocess.CompletedProcess[str]]:
    """A study of every ending by one process: script, folder of the results, what was printed."""
    folder = tmp_path_factory.mktemp("endings")
    script = written(folder, ENDINGS.replace(', "exit", "hang"', ""))
    done = study(script, "--samples", 10, "--seed", 5, "--jobs", 1, "--retries", 0, "--out", folder / "one", "--json")
    return script, folder / "one", done


@pytest.fixture(scope="session")
def reported() -> tuple[list[dict[str, Any]], dict[str, Any], str]:
    """Records, document and page of a study."""
    rows = records()
    document = summary(VARIABLES, {"method": "random", "samples": len(rows), "seed": 3}, rows, [], len(rows))
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    return rows, document, report.page(Path("fits.py"), VARIABLES, document, rows)
