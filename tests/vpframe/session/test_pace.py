"""Time left of a run."""

from types import SimpleNamespace

from vpframe.console import LEAST
from vpframe.session import pace


def test_a_run_claims_time_left_by_the_speed_of_the_last_seconds(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(pace.clock, "monotonic", lambda: now[0])
    path = SimpleNamespace(duration=10.0)
    hand = SimpleNamespace(name="hand", segment=SimpleNamespace(path=path, until=None), clock=0.0, doing="hand moves")
    recent = pace.Pace()
    texts = []
    for n in range(100):
        now[0], hand.clock = now[0] + 0.2, 0.05 * n
        texts.append(pace.under_way(hand.clock, [hand], recent, False))
    assert texts[0] == "0.00 s of the task  hand moves 0 %"
    assert all("left" not in text for text in texts[: int(LEAST / 0.2)])
    assert texts[-1] == "4.95 s of the task  hand moves 50 %, 20 s left"
    hand.segment = SimpleNamespace(path=path, until=None)  # the next motion, as far as the first
    assert "left" not in pace.under_way(5.0, [hand], recent, False)
