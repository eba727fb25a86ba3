"""Without a screen no browser is opened."""

from tests.vpframe.watching import fake_session
from vpframe.view.meshcat_viewer import MeshcatViewer


def test_without_a_screen_the_address_is_printed(monkeypatch, capsys):
    monkeypatch.setattr("vpframe.view.meshcat_viewer.has_screen", lambda: False)
    viewer = MeshcatViewer(open_browser=True)
    viewer.begin(fake_session().scene)
    try:
        assert viewer.url in capsys.readouterr().err
    finally:
        viewer.end()
