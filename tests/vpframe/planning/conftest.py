import pytest

from tests.vpframe.planning import cases
from vpframe.scene.modelling import write_step


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    path = tmp_path_factory.mktemp("bolted") / "bolted.step"
    return write_step(path, cases.bolted_plate_solids())
