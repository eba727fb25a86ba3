"""Conditions that end a motion or that a task expects; they combine with `&`, `|` and `~`.

```python
hand.slide("axis", until=constraint("against") | contact)
hand.pull(along="axis", until=free & (clearance > 0.002))
```
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from vpframe.errors import TaskError
from vpframe.events import ConstraintView
from vpframe.hands.gripper import Gripper
from vpframe.hands.segment import Condition


def _group(session: Any, hand: Gripper | None, name: str | None, what: str) -> tuple[str, ...]:
    """Return the parts of a name; without a name, the parts that the hand holds and carries."""
    if name is None and (hand is None or hand.held is None):
        raise TaskError(f"{what} needs a part: no hand holds one, so name it")
    group: tuple[str, ...] = session.group(name) if name is not None else hand.parts  # type: ignore[union-attr]
    return group


def _touches(session: Any, hand: Gripper | None) -> bool:
    return bool(session.touching(*_group(session, hand, None, "contact")))


def _is_free(session: Any, hand: Gripper | None) -> bool:
    group = _group(session, hand, None, "free")
    return not (session.constraints_of(*group) or session.touching(*group) or session.held_by(*group))


contact = Condition("contact", _touches)
"""The held part, or a part it carries, touches another part; mated surfaces are left out."""

free = Condition("free", _is_free)
"""No constraint joins the held part, with the parts it carries, to other parts; it touches none, nor is it screwed or
pressed in."""

blocked: Condition = Condition("blocked", lambda session, hand: hand is not None and bool(hand.stopped_by))
"""The held part cannot follow the hand."""


def _any_of(views: Iterable[ConstraintView], kind: str | None, session: Any, other: str | None) -> bool:
    """Whether one of some constraints is of a kind (any if None), with a part of `other` if given."""
    others = None if other is None else set(session.group(other))
    return any(kind in (None, c.kind) and (others is None or not others.isdisjoint(c.parts)) for c in views)


def constraint(kind: str | None = None, part: str | None = None, other: str | None = None) -> Condition:
    """A constraint of that kind (any if None) is active on `part` (default: the held part), with `other` if given.

    Both may be subassemblies.
    """

    def test(session: Any, hand: Gripper | None) -> bool:
        on_it = session.constraints_of(*_group(session, hand, part, "constraint(…)"))
        return _any_of(on_it, kind, session, other)

    text = f"constraint {kind or 'of any kind'}"
    if part:
        text += f" on {part}"
    if other:
        text += f" with {other}"
    return Condition(text, test)


def candidate(kind: str | None = None, other: str | None = None) -> Condition:
    """A candidate of that kind is on offer for the held part."""

    def test(session: Any, hand: Gripper | None) -> bool:
        group = set(_group(session, hand, None, "candidate(…)"))
        return _any_of((c for c in session.candidates if not group.isdisjoint(c.parts)), kind, session, other)

    return Condition(f"candidate {kind or 'of any kind'}", test)


def freedom(n: int, part: str | None = None) -> Condition:
    """`part` (default: the held part with the parts it carries) has `n` degrees of freedom left."""

    def test(session: Any, hand: Gripper | None) -> bool:
        first, *carried = _group(session, hand, part, "freedom(…)")
        return session.freedom(first, carried=carried) == n

    return Condition(f"freedom {n}", test)


@dataclass(frozen=True)
class LeastClearance:
    """Least distance of the held part to all others or to one: `clearance < 0.0005`, `clearance("housing") > 0.01`, m.

    Pairs under an active constraint are left out unless `other` names one.
    """

    other: str | None = None

    def __call__(self, other: str) -> LeastClearance:
        return LeastClearance(other)

    def _of(self, session: Any, hand: Gripper | None) -> float:
        return min(session.clearance(part, self.other) for part in _group(session, hand, None, "clearance"))

    @property
    def _text(self) -> str:
        return f"clearance to {self.other}" if self.other else "clearance"

    def __lt__(self, metres: float) -> Condition:
        return Condition(f"{self._text} < {metres * 1e3:g} mm", lambda s, h: self._of(s, h) < metres)

    def __gt__(self, metres: float) -> Condition:
        return Condition(f"{self._text} > {metres * 1e3:g} mm", lambda s, h: self._of(s, h) > metres)


clearance = LeastClearance()

_NAMED = {"contact": contact, "free": free, "blocked": blocked}


def as_condition(value: Condition | str | None) -> Condition | None:
    """Return a condition from a `Condition`, one of the names "contact", "free", "blocked", or None."""
    if value is None or isinstance(value, Condition):
        return value
    if isinstance(value, str) and value in _NAMED:
        return _NAMED[value]
    raise TaskError(
        f"until={value!r} is no condition; give one of {', '.join(map(repr, _NAMED))}, constraint(kind), clearance < m"
    )
