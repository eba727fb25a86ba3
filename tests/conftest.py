import os
import shutil
import tempfile
from pathlib import Path

import pytest
from hypothesis import settings

# a busy machine fails no test
settings.register_profile("vpframe", deadline=None)
settings.load_profile("vpframe")

# before numpy is imported, as the command line does it: small matrices, and perhaps a busy machine
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# a file that a test loads twice is read once, as it is for users; the tests of the importers read every time
MODELS = tempfile.mkdtemp(prefix="vpframe-tests-")
os.environ["VPFRAME_CACHE"] = MODELS


def pytest_xdist_auto_num_workers() -> int:
    """One worker more than cores: tests of pages and of clusters wait for other processes."""
    return (os.cpu_count() or 1) + 1


def pytest_unconfigure() -> None:
    shutil.rmtree(MODELS, ignore_errors=True)


@pytest.fixture(scope="session")
def real_models() -> Path:
    """The folder of real models, which are not ours to give."""
    if "VPFRAME_DATA" not in os.environ:
        pytest.skip("VPFRAME_DATA names no folder of real models")
    return Path(os.environ["VPFRAME_DATA"])
