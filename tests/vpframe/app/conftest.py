from collections.abc import Iterator
from pathlib import Path

import pytest

import vpframe as vp
from tests.vpframe.bench_model import write_bench
from vpframe.app.workbench import Workbench


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bench(tmp_path_factory.mktemp("model") / "bench.step")


@pytest.fixture
def bench(model: Path) -> Iterator[Workbench]:
    made = Workbench(vp.load(model), model, {})
    made.session.show()
    yield made
    made.session.close()
