import pytest

from physics.joints.articulated_body import ArticulatedBody


@pytest.fixture(params=["coordinates", "rows"])
def way(request, monkeypatch):
    """Both ways in which joints are held: joint coordinates, and rows beside those of contacts."""
    if request.param == "rows":
        monkeypatch.setattr(ArticulatedBody, "build", classmethod(lambda cls, *_: None))
    return request.param
