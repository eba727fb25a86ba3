"""The layout of a recording."""


def test_the_recording_carries_a_blueprint(recorded):
    from rerun.chunk import RrdReader

    reader = RrdReader(recorded[0])
    assert len(reader.recordings()) == 1
    assert len(reader.blueprints()) == 2  # as the session began, and when all that was seen is known
