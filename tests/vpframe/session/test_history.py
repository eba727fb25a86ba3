"""Frames kept for looking back."""

from dataclasses import replace

import numpy as np

from tests.vpframe.watching import pressing_frames


def test_a_long_run_is_thinned_evenly_and_keeps_its_end_and_its_events():
    from vpframe.session.history import History

    history = History(limit=100)
    frames = pressing_frames(1000)
    for frame in frames:
        history.add(frame)
    kept = list(history)
    steps = [frame.step for frame, _ in kept]
    assert 50 <= len(kept) <= 101
    assert steps[0] == 0 and steps[-1] == 999
    assert max(np.diff(steps)) <= 16
    assert [e.kind for _, events in kept for e in events] == ["collided", "recognised", "parted"]
    assert all(event.step <= frame.step for frame, events in kept for event in events)
    assert len(history) == 1000


def test_a_step_that_is_shown_again_is_one_frame_with_the_events_of_both():
    from vpframe.session.history import History

    history = History()
    frames = pressing_frames(40)
    told = next(k for k, frame in enumerate(frames) if frame.events)
    for frame in frames[:told]:
        history.add(frame)
    for _ in range(3):  # as an undone step is, and as a scene that is shown twice
        history.add(replace(frames[told], events=()))
        history.add(frames[told])
        assert len(history) == told + 1 and history.last is frames[told]
        assert history.at(told) == (told, frames[told])
        assert history.events_since(0) == tuple((told, event) for event in frames[told].events)
        history.rewind(frames[told - 1], 0)
        assert len(history) == told and not history.events
    history.add(frames[told - 1])
    assert [frame.step for frame, _ in history] == [frame.step for frame in frames[:told]]
