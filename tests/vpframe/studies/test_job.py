"""The script of a study."""

from pathlib import Path

import pytest

from tests.vpframe.studies.scripts import variant, written
from vpframe.errors import VpframeError
from vpframe.studies.child import Children


def test_a_script_that_cannot_be_read_is_told_in_one_line(tmp_path: Path) -> None:
    pool = Children(written(tmp_path, "import nowhere_to_be_found\n"), 60.0, 0)
    try:
        with pytest.raises(VpframeError, match=r"task.py:1: ModuleNotFoundError: No module named 'nowhere_to_be_"):
            pool.run(variant("ok"))
    finally:
        pool.close()
