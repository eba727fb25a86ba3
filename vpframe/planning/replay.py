"""The plan done by a hand in a session: what a recording shows, and a check by other means than the plan's own."""

from __future__ import annotations

from vpframe.hands.paths import Track as HandTrack
from vpframe.planning.plan import Disassembly
from vpframe.session.rules import Rule, accept_between, first_of
from vpframe.session.session import Session


def rule_of(plan: Disassembly) -> Rule:
    """What a session that does the plan accepts: its fits and threads; what only lies against a part leaves it."""
    return first_of(*(accept_between(a, b, kind) for a, b, kind in plan.mates))


def perform(session: Session, plan: Disassembly) -> None:
    """Take the parts out, step by step, in a session with `rule_of(plan)`; what is out stands in nobody's way any more.

    Raises
    ------
    TaskError: the hand was stopped.
    """
    for a, b in plan.authorised:
        session.authorise(a, b)
    for a, b in plan.ignored:
        session.ignore(a, b)
    hand = session.hand()
    for step in plan.steps:
        first, carried = step.parts[0], step.parts[1:]
        track = step.tracks[first]
        hand.grab(first, carry=carried)
        hand.follow(HandTrack(track.times, track.poses))
        hand.release()
        if step is not plan.steps[-1]:
            for part in step.parts:
                session.ignore(part)
