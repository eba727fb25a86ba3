"""Binary STL files."""

import pytest

from tests.vpframe.report.runs import document, log_of
from tests.vpframe.watching import box, pressing_frames
from vpframe.report import SweptVolume, write


def test_swept_volumes_are_written_as_stl_in_millimetres(tmp_path):
    import trimesh

    mesh = box((0.1, 0.2, 0.3)).mesh
    volume = SweptVolume("shaft/1", mesh.vertices, mesh.triangles, 1e-4, ("wall",))
    folder = write(tmp_path, log_of(pressing_frames(5)), swept=[volume])
    (told,) = document(folder)["swept"]
    assert told["clashes"] == ["wall"]
    read = trimesh.load(folder / told["file"])
    assert read.is_watertight
    assert read.volume == pytest.approx(100 * 200 * 300, rel=1e-6)
