"""Verbs of hands: generators of motion segments, so that several hands can work in the same steps.

A verb yields `MotionSegment`s, receives the `Outcome` of each, and returns the outcome of the whole. It decides from
the scene at the start of each segment.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any, Concatenate, ParamSpec, TypeVar

from vpframe.hands.paths import Path


@dataclass(frozen=True)
class Outcome:
    """How a verb ended."""

    done: bool
    """whether it arrived or its `until` held"""
    reason: str
    """one line: "arrived", the condition that held, or the obstacle"""
    time: float
    """session time at the end, s"""

    def __bool__(self) -> bool:
        return self.done


@dataclass(frozen=True, eq=False)
class Condition:
    """A predicate that is evaluated after a step; `text` names it in reports."""

    text: str
    test: Callable[[Any, Any], bool]
    """function of the session and the hand (None without a hand)"""

    def __call__(self, session: Any, hand: Any = None) -> bool:
        return bool(self.test(session, hand))

    def __and__(self, other: Condition) -> Condition:
        return Condition(f"{self.text} and {other.text}", lambda s, h: self(s, h) and other(s, h))

    def __or__(self, other: Condition) -> Condition:
        return Condition(f"{self.text} or {other.text}", lambda s, h: self(s, h) or other(s, h))

    def __invert__(self) -> Condition:
        return Condition(f"not {self.text}", lambda s, h: not self(s, h))

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, eq=False)
class MotionSegment:
    """One segment of a hand's motion. `path` moves the held part, or the empty hand."""

    text: str
    path: Path
    until: Condition | None = None
    required: bool = True
    """whether the task fails if the path ends before `until` holds (or, without `until`, away from its end)"""


P = ParamSpec("P")
T = TypeVar("T")
Steps = Generator[MotionSegment, Outcome, T]
"""generator of motion segments with a return value"""
Verb = Steps[Outcome]


def verb(make: Callable[Concatenate[Any, P], Verb]) -> Callable[Concatenate[Any, P], Outcome]:
    """Turn a generator method of a hand into a verb, which runs the session until the generator has ended."""

    @functools.wraps(make)
    def perform(hand: Any, *given: P.args, **options: P.kwargs) -> Outcome:
        outcome: Outcome = hand.session.perform(hand, make(hand, *given, **options))
        return outcome

    return perform


def steps(verb: Callable[P, Outcome], *given: P.args, **options: P.kwargs) -> Verb:
    """Return the generator of a hand's verb, for use within another verb: `yield from steps(hand.move_to, pose)`."""
    method: Any = verb
    generator: Verb = method.__wrapped__(method.__self__, *given, **options)
    return generator
