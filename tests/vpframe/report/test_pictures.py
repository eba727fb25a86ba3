"""Pictures of the report."""

from dataclasses import replace

from tests.vpframe.report.runs import document, lasting, log_of
from tests.vpframe.watching import pressing_frames, pressing_scene
from vpframe.report import write


def test_of_many_constraints_pictures_leave_out_the_uninvolved_and_the_page_says_so(tmp_path, monkeypatch):
    scene = pressing_scene()
    a, b = scene.names[:2]
    frames = [
        replace(frame, held=(), constraints=tuple(lasting(id, (a, b)) for id in range(7)))
        for frame in pressing_frames(4)
    ]
    few = write(tmp_path / "few", log_of(frames, scene))
    assert "leave out" not in (few / "index.html").read_text()
    monkeypatch.setattr("vpframe.session.log.DRAWN", 5)
    assert log_of(frames, scene).uninvolved() == frozenset(range(7))
    many = write(tmp_path / "many", log_of(frames, scene))
    assert "leave out 7, of parts that no hand held" in (many / "index.html").read_text()
    assert len((many / "scene.html").read_text()) < len((few / "scene.html").read_text())
    assert document(many)["constraints"] == document(few)["constraints"]
    touched = [replace(frame, held=(a,)) for frame in frames]
    assert log_of(touched, scene).uninvolved() == frozenset()
