import pytest

from tests.vpframe.report.runs import log_of
from tests.vpframe.watching import pressing_frames
from vpframe.report import write


@pytest.fixture(scope="session")
def written(tmp_path_factory):
    """A report's folder, and the frames it is about."""
    frames = pressing_frames(120)
    folder = write(tmp_path_factory.mktemp("report") / "deep" / "out", log_of(frames), task="press")
    return folder, frames
