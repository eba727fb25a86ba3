import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.vpframe.browser import PROGRAM, Browser
from tests.vpframe.readers import forked

ROOT = Path(__file__).parent.parent.parent


@pytest.fixture(scope="session")
def vpframe():
    """Run the command line through its real entry point, the installed script if there is one."""
    script = Path(sys.executable).parent / "vpframe"
    command = [str(script)] if script.exists() else [sys.executable, "-m", "vpframe"]
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))

    def run(*arguments, **options):
        options.setdefault("env", {**os.environ, "PYTHONPATH": path})
        return subprocess.run([*command, *map(str, arguments)], capture_output=True, text=True, **options)

    return run


@pytest.fixture(scope="session", autouse=True)
def readers_start_at_once():
    """The CAD kernel takes a second to import, for each file; tests of the command line start it as users do."""
    if sys.platform != "linux":
        yield
        return
    with forked():
        yield


@pytest.fixture(scope="session")
def chromium():
    """One browser for all modules; each says how large its page is."""
    if PROGRAM is None:
        pytest.skip("no Chromium on the PATH")
    with Browser(1300, 800) as made:
        yield made
