"""Conditions that end a motion or that a task expects; they combine with `&`, `|` and `~`.

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
    """A predicate that is evaluated after a step; `text` names it in reports."""

    text: str
    test: Callable[[Workplace, Holder | None], bool]
    """function of the session and the hand (None without a hand)"""

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


def _group(session: Workplace, hand: Holder | None, name: str | None, what: str) -> tuple[str, ...]:
    """Return the parts of a name; without a name, the parts that the hand holds and carries."""
    part = _part(hand, name, what)
    return session.group(part) if name is not None or hand is None else (part, *hand.carried)


def _touches(session: Workplace, hand: Holder | None) -> bool:
    return bool(session.touching(*_group(session, hand, None, "contact")))


def _is_free(session: Workplace, hand: Holder | None) -> bool:
    group = _group(session, hand, None, "free")
    return not session.constraints_of(*group) and not session.touching(*group)


contact = Condition("contact", _touches)
"""The held part, or a part it carries, touches another part; mated surfaces are left out."""

free = Condition("free", _is_free)
"""No constraint joins the held part, with the parts it carries, to other parts, and it touches none."""

blocked: Condition = Condition("blocked", lambda session, hand: hand is not None and bool(hand.stopped_by))
"""The held part cannot follow the hand."""


def constraint(kind: str | None = None, part: str | None = None, other: str | None = None) -> Condition:
    """A constraint of that kind (any if None) is active on `part` (default: the held part), with `other` if given.

    Both may be subassemblies.
    """

    def test(session: Workplace, hand: Holder | None) -> bool:
        group = _group(session, hand, part, "constraint(…)")
        others = None if other is None else set(session.group(other))
        return any(
            (kind is None or c.kind == kind) and (others is None or not others.isdisjoint(c.parts))
            for c in session.constraints_of(*group)
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
        group = set(_group(session, hand, None, "candidate(…)"))
        others = None if other is None else set(session.group(other))
        return any(
            (kind is None or c.kind == kind)
            and not group.isdisjoint(c.parts)
            and (others is None or not others.isdisjoint(c.parts))
            for c in session.candidates
        )

    return Condition(f"candidate {kind or 'of any kind'}", test)


def freedom(n: int, part: str | None = None) -> Condition:
    """`part` (default: the held part with the parts it carries) has `n` degrees of freedom left."""

    def test(session: Workplace, hand: Holder | None) -> bool:
        first, *carried = _group(session, hand, part, "freedom(…)")
        return session.freedom(first, carried=carried) == n

    return Condition(f"freedom {n}", test)


@dataclass(frozen=True)
class Clearance:
    """Least distance of the held part to all others or to one: `clearance < 0.0005`, `clearance("housing") > 0.01`, m.

    Pairs under an active constraint are left out unless `other` names one.
    """

    other: str | None = None

    def __call__(self, other: str) -> Clearance:
        return Clearance(other)

    def _of(self, session: Workplace, hand: Holder | None) -> float:
        return min(session.clearance(part, self.other) for part in _group(session, hand, None, "clearance"))

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
    """Return a condition from a `Condition`, one of the names "contact", "free", "blocked", or None."""
    if value is None or isinstance(value, Condition):
        return value
    if isinstance(value, str) and value in _NAMED:
        return _NAMED[value]
    raise TaskError(
        f"until={value!r} is no condition; give one of {', '.join(map(repr, _NAMED))}, constraint(kind), clearance < m"
    )
