"""When a motion ends and what a task expects: conditions are small values that combine with `&`, `|` and `~`.

```python
hand.slide("axis", until=constraint("against") | contact)
hand.pull(along="axis", until=free & (clearance > 0.002))
```
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from vpframe.errors import TaskError
from vpframe.hands.workplace import Holder, Workplace


@dataclass(frozen=True, eq=False)
class Condition:
    """Something that holds or does not, after a step. `text` is how reports put it."""

    text: str
    test: Callable[[Workplace, Holder | None], bool]
    """of the session and the hand that asks (None when no hand does)"""

    def __call__(self, session: Workplace, hand: Holder | None = None) -> bool:
        return bool(self.test(session, hand))

    def __and__(self, other: Condition) -> Condition:
        return Condition(f"{self.text} and {other.text}", lambda s, h: self(s, h) and other(s, h))

    def __or__(self, other: Condition) -> Condition:
        return Condition(f"{self.text} or {other.text}", lambda s, h: self(s, h) or other(s, h))

    def __invert__(self) -> Condition:
        return Condition(f"not {self.text}", lambda s, h: not self(s, h))

    def __str__(self) -> str:
        return self.text


def _part(hand: Holder | None, name: str | None, what: str) -> str:
    if name is not None:
        return name
    if hand is None or hand.held is None:
        raise TaskError(f"{what} needs a part: no hand holds one, so name it")
    return hand.held


def _touches(session: Workplace, hand: Holder | None) -> bool:
    return bool(session.touching(_part(hand, None, "contact")))


def _is_free(session: Workplace, hand: Holder | None) -> bool:
    part = _part(hand, None, "free")
    return not session.constraints_of(part) and not session.touching(part)


contact = Condition("contact", _touches)
"""The held part touches another one, mated surfaces left out."""

free = Condition("free", _is_free)
"""The held part is under no constraint and touches nothing."""

blocked: Condition = Condition("blocked", lambda session, hand: hand is not None and bool(hand.stopped_by))
"""The held part cannot follow the hand."""


def constraint(kind: str | None = None, part: str | None = None, other: str | None = None) -> Condition:
    """An active constraint of that kind (any kind if None) on `part` (the held one if None), with `other` if given."""

    def test(session: Workplace, hand: Holder | None) -> bool:
        subject = _part(hand, part, "constraint(…)")
        return any(
            (kind is None or c.kind == kind) and (other is None or other in c.parts)
            for c in session.constraints_of(subject)
        )

    text = f"constraint {kind or 'of any kind'}"
    if part:
        text += f" on {part}"
    if other:
        text += f" with {other}"
    return Condition(text, test)


def candidate(kind: str | None = None, other: str | None = None) -> Condition:
    """A candidate of that kind is on offer for the held part."""

    def test(session: Workplace, hand: Holder | None) -> bool:
        subject = _part(hand, None, "candidate(…)")
        return any(
            (kind is None or c.kind == kind) and subject in c.parts and (other is None or other in c.parts)
            for c in session.candidates
        )

    return Condition(f"candidate {kind or 'of any kind'}", test)


def freedom(n: int, part: str | None = None) -> Condition:
    """`part` (the held one if None) has `n` degrees of freedom left."""
    return Condition(f"freedom {n}", lambda s, h: s.freedom(_part(h, part, "freedom(…)")) == n)


@dataclass(frozen=True)
class Clearance:
    """`clearance < 0.0005`, `clearance("housing") > 0.01`: least distance of the held part to the rest (or a part), m.

    Pairs under an active constraint are left out unless `other` names one.
    """

    other: str | None = None

    def __call__(self, other: str) -> Clearance:
        return Clearance(other)

    def _of(self, session: Workplace, hand: Holder | None) -> float:
        return session.clearance(_part(hand, None, "clearance"), self.other)

    @property
    def _text(self) -> str:
        return f"clearance to {self.other}" if self.other else "clearance"

    def __lt__(self, metres: float) -> Condition:
        return Condition(f"{self._text} < {metres * 1e3:g} mm", lambda s, h: self._of(s, h) < metres)

    def __gt__(self, metres: float) -> Condition:
        return Condition(f"{self._text} > {metres * 1e3:g} mm", lambda s, h: self._of(s, h) > metres)


clearance = Clearance()

_NAMED = {"contact": contact, "free": free, "blocked": blocked}


def as_condition(value: Condition | str | None) -> Condition | None:
    """A condition from what a script wrote: a `Condition`, one of the names "contact", "free", "blocked", or None."""
    if value is None or isinstance(value, Condition):
        return value
    if isinstance(value, str) and value in _NAMED:
        return _NAMED[value]
    raise TaskError(
        f"until={value!r} is no condition; give one of {', '.join(map(repr, _NAMED))}, constraint(kind), clearance < m"
    )
