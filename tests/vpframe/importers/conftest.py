from pathlib import Path

import pytest
import trimesh

from tests.vpframe.importers.robots import URDF
from vpframe.importers import cache
from vpframe.scene import modelling as m


@pytest.fixture(autouse=True)
def nothing_is_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VPFRAME_CACHE", "")


@pytest.fixture(scope="module")
def step(tmp_path_factory) -> Path:
    """Two plates with bores, a bolt in each, one of its own shape: 4 parts of 3 shapes."""
    plate = m.box(0.1, 0.1, 0.01) - m.cylinder(0.004, 0.01).translated(0.05, 0.05)
    bolt = m.cylinder(0.004, 0.03) + m.hexagon(0.012, 0.005)
    parts = {
        "plate": plate,
        "pair": ({"bolt_1": bolt, "bolt_2": bolt}, None),
        "cap": m.sphere(0.02) - m.box(0.1, 0.1, 0.1),
    }
    return m.write_step(tmp_path_factory.mktemp("step") / "model.step", parts)


@pytest.fixture
def robot(tmp_path):
    """A URDF in a package, with a mesh in millimetres."""
    (tmp_path / "arm" / "meshes").mkdir(parents=True)
    (tmp_path / "arm" / "urdf").mkdir()
    trimesh.creation.box((200.0, 20.0, 20.0)).export(tmp_path / "arm" / "meshes" / "arm.stl")
    path = tmp_path / "arm" / "urdf" / "arm.urdf"
    path.write_text(URDF)
    return path


@pytest.fixture
def place(tmp_path, monkeypatch) -> Path:
    folder = tmp_path / "cache"
    monkeypatch.setenv(cache.VARIABLE, str(folder))
    return folder
