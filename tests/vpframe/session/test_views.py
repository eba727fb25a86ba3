"""Views of constraints: drawn when they are looked at, and the same whenever that is."""

import pickle
from collections.abc import Sequence

from tests.benchmarks.bench_session import board
from vpframe.events import ConstraintView, Frame, Frames
from vpframe.session import rules
from vpframe.session.session import Session

Shown = list[tuple[int, str, bytes, bytes, float]]


def shown(views: Sequence[ConstraintView]) -> Shown:
    return [(c.id, c.state, c.origin.tobytes(), c.direction.tobytes(), c.residual) for c in views]


class Looking(Frames):
    """Looks at each frame at once."""

    def __init__(self) -> None:
        super().__init__()
        self.shown: list[Shown] = []

    def frame(self, frame: Frame) -> None:
        super().frame(frame)
        self.shown.append(shown(frame.constraints))


def carried_about(watcher: Frames) -> None:
    with Session(board(4), rule=rules.accept_all, observers=[watcher]) as session:
        hand = session.hand(at=(0.03, 0.03, 0.02))
        hand.grab("board")
        hand.move_by((0.0, 0.0, 0.02), duration=0.3)
        hand.turn(0.3, "z", duration=0.3)
        hand.release()
        hand.grab("board/chip_0")
        hand.move_by((0.0, 0.0, 0.01), duration=0.2, required=False)


def test_a_frame_shows_the_same_whenever_it_is_looked_at() -> None:
    """Also when the run is over, the last frame first, and as a copy that goes to another process."""
    looking, later = Looking(), Frames()
    carried_about(looking)
    carried_about(later)
    assert len(later.frames) == len(looking.shown) > 30
    for expected, frame in zip(reversed(looking.shown), reversed(later.frames), strict=True):
        copy = pickle.loads(pickle.dumps(frame.constraints))
        assert isinstance(copy, tuple)
        assert shown(copy) == shown(frame.constraints) == expected
    assert len({len(views) for views in looking.shown}) > 1
    assert len({tuple(views) for views in looking.shown}) > 5, "what is drawn moves with the parts"
