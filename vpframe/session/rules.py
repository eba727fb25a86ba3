"""Rules that accept or refuse candidate constraints: functions from a candidate to a verdict.

A rule receives a candidate as observers do (kind, part names, surfaces, residual, why) and returns `"accept"`,
`"refuse"`, or None to leave it on offer. `first_of` combines rules; the first verdict counts.

```python
session = vp.Session(scene, rule=first_of(refuse_between("shaft", "bench"), accept_kinds("concentric", "against")))
```
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from vpframe import console
from vpframe.events import ConstraintView

Verdict = Literal["accept", "refuse"] | None
Rule = Callable[[ConstraintView], Verdict]


def accept_all(candidate: ConstraintView) -> Verdict:
    """Accept every candidate."""
    return "accept"


def leave_all(candidate: ConstraintView) -> Verdict:
    """Return no verdict: the script accepts and refuses."""
    return None


def accept_standing(candidate: ConstraintView) -> Verdict:
    """Accept the constraints of the initial assembly, and again when parts come back; no verdict on all others."""
    return "accept" if candidate.state == "standing" else None


def accept_kinds(*kinds: str) -> Rule:
    """Return a rule that accepts candidates of these kinds."""
    return lambda candidate: "accept" if candidate.kind in kinds else None


def refuse_kinds(*kinds: str) -> Rule:
    """Return a rule that refuses candidates of these kinds."""
    return lambda candidate: "refuse" if candidate.kind in kinds else None


def accept_between(a: str, b: str, *kinds: str) -> Rule:
    """Return a rule that accepts candidates between two parts, of these kinds if any are given."""
    return lambda c: "accept" if set(c.parts) == {a, b} and (not kinds or c.kind in kinds) else None


def refuse_between(a: str, b: str, *kinds: str) -> Rule:
    """Return a rule that refuses candidates between two parts, of these kinds if any are given."""
    return lambda c: "refuse" if set(c.parts) == {a, b} and (not kinds or c.kind in kinds) else None


def first_of(*rules: Rule) -> Rule:
    """Return a rule that gives the first verdict of several rules."""

    def rule(candidate: ConstraintView) -> Verdict:
        return next((verdict for verdict in (r(candidate) for r in rules) if verdict), None)

    return rule


def ask(candidate: ConstraintView) -> Verdict:
    """Ask the person at the terminal; end of input or an empty line leaves the candidate on offer."""
    a, b = candidate.parts
    answer = console.ask(f"{candidate.kind} between {a} and {b} ({candidate.why}): accept? [y/n]").lower()
    return "accept" if answer.startswith("y") else "refuse" if answer.startswith("n") else None
