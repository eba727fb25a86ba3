"""What a person asks for at a viewer is what the session does."""

import numpy as np
import pytest

from tests.vpframe.bench_scene import SEAT, scene
from vpframe.events import Frames
from vpframe.hands.conditions import candidate
from vpframe.session.controls import Controls, Request
from vpframe.session.rules import leave_all
from vpframe.session.session import Session


class Watcher(Frames):
    """A viewer without a page."""

    def __init__(self):
        super().__init__()
        self.controls = Controls()


@pytest.fixture
def offered():
    """A session in which concentric is on offer, its watcher, and the candidate."""
    watcher = Watcher()
    with Session(scene(), viewer=watcher, rule=leave_all) as session:
        hand = session.hand(at=(0.06, 0.0, 0.08))
        hand.grab("peg")
        hand.move_to(SEAT + np.array([0.0, 0.0, 0.02]), duration=0.5)
        hand.slide("down", until=candidate("concentric"))
        yield session, watcher, session.candidates[0]


def test_accepted_and_removed_from_the_page(offered):
    session, watcher, offer = offered
    assert session.constraints == ()
    watcher.controls.put(Request("accept", offer.id))
    session.step()
    assert [c.id for c in session.constraints] == [offer.id]
    watcher.controls.put(Request("remove", offer.id))
    session.step()
    assert offer.id not in [c.id for c in session.constraints]


def test_refused_from_the_page(offered):
    session, watcher, offer = offered
    watcher.controls.put(Request("refuse", offer.id))
    session.step()
    assert offer.id not in [c.id for c in session.candidates]
    assert "refused" in [event.kind for event in session.events]


def test_a_click_on_what_is_gone_does_nothing(offered):
    session, watcher, offer = offered
    for request in (Request("accept", 999), Request("remove", offer.id), Request("refuse", -1)):
        watcher.controls.put(request)
    session.step()
    assert session.constraints == ()
    assert session.failure == ""
