"""Who accepts a candidate constraint: rules, small functions from a candidate to a verdict.

A rule sees the candidate as an observer does (kind, part names, surfaces, residual, why) and answers `"accept"`,
`"refuse"`, or None to leave it on offer. Rules combine with `first_of`; the first that answers wins.

```python
session = vp.Session(scene, rule=first_of(refuse_between("shaft", "bench"), accept_kinds("concentric", "against")))
```
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Literal

from vpframe.session.events import ConstraintView

Verdict = Literal["accept", "refuse"] | None
Rule = Callable[[ConstraintView], Verdict]


def accept_all(candidate: ConstraintView) -> Verdict:
    """Accept whatever is recognised."""
    return "accept"


def leave_all(candidate: ConstraintView) -> Verdict:
    """Decide nothing: the script accepts and refuses."""
    return None


def accept_standing(candidate: ConstraintView) -> Verdict:
    """Accept what the assembly has when the session begins; decide nothing of what comes about later."""
    return "accept" if candidate.state == "standing" else None


def accept_kinds(*kinds: str) -> Rule:
    """Accept candidates of these kinds; say nothing of others."""
    return lambda candidate: "accept" if candidate.kind in kinds else None


def refuse_kinds(*kinds: str) -> Rule:
    """Refuse candidates of these kinds; say nothing of others."""
    return lambda candidate: "refuse" if candidate.kind in kinds else None


def accept_between(a: str, b: str, *kinds: str) -> Rule:
    """Accept candidates (of these kinds, if any are given) between two parts; say nothing of others."""
    return lambda c: "accept" if set(c.parts) == {a, b} and (not kinds or c.kind in kinds) else None


def refuse_between(a: str, b: str, *kinds: str) -> Rule:
    """Refuse candidates (of these kinds, if any are given) between two parts; say nothing of others."""
    return lambda c: "refuse" if set(c.parts) == {a, b} and (not kinds or c.kind in kinds) else None


def first_of(*rules: Rule) -> Rule:
    """The first rule that has an answer decides."""

    def rule(candidate: ConstraintView) -> Verdict:
        return next((verdict for verdict in (r(candidate) for r in rules) if verdict), None)

    return rule


def ask(candidate: ConstraintView) -> Verdict:
    """Ask the person at the terminal; end of input or an empty line leaves the candidate on offer."""
    a, b = candidate.parts
    sys.stderr.write(f"{candidate.kind} between {a} and {b} ({candidate.why}): accept? [y/n] ")
    sys.stderr.flush()
    answer = sys.stdin.readline().strip().lower()
    return "accept" if answer.startswith("y") else "refuse" if answer.startswith("n") else None
