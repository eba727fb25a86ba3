"""Runs that are killed half-way, and what a run that takes their place must have in common with one that was not."""

from collections.abc import Callable, Sequence

import pytest

from vpframe.events import Frame
from vpframe.session.session import Session


class _Killed(Exception):
    """The run ends here."""


def kill(session: Session, task: Callable[[Session], None], after: int) -> None:
    """Run a task until the session has made so many steps, and leave it as a killed process does: nothing is closed
    but the file of the checkpoint, which this process would keep open."""
    step = session.step

    def until_killed() -> Frame:
        if session.step_count == after:
            raise _Killed
        return step()

    session.step = until_killed  # type: ignore[method-assign]
    with pytest.raises(_Killed):
        task(session)
    assert session._journal is not None
    session._journal.close()


def by_value(frames: Sequence[Frame]) -> list[tuple]:
    """All of each frame that is not a timing, with the last bit of every pose."""
    return [
        (
            f.step,
            [(name, pose.homogeneous.tobytes()) for name, pose in f.poses.items()],
            f.colliding.tobytes(),
            [(c.id, c.kind, c.state, c.parts, c.residual, c.why) for c in f.constraints],
            dict(f.freedom),
            dict(f.joint),
            f.clearance,
            [(e.kind, e.text) for e in f.events],
        )
        for f in frames
    ]
