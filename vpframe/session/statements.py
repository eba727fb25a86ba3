"""Constraints that a script states, checked against those in force."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from constraints.kinds.stated import contradiction
from constraints.kinds.stated import stated as stated_candidate
from vpframe.analysis.statements import Place, statement, words
from vpframe.errors import TaskError
from vpframe.events import ConstraintView
from vpframe.session.engine import Engine
from vpframe.session.readings import Readings
from vpframe.session.state import Decision


class ContradictionError(TaskError):
    """A constraint of two `parts` contradicts the constraints in force: deviation `off`, in `unit` "m" or "rad"."""

    def __init__(self, message: str, parts: tuple[str, ...], off: float, unit: str) -> None:
        super().__init__(message)
        self.parts = parts
        self.off = off
        self.unit = unit


def stated(
    engine: Engine,
    readings: Readings,
    kind: str,
    a: Place,
    b: Place,
    parameters: Mapping[str, Any],
    bears: tuple[tuple[str, float], ...],
) -> tuple[Decision, ConstraintView]:
    """Return the decision that imposes a stated constraint, and the view of that constraint.

    bears: limits at which it breaks, see `limits`.

    Raises
    ------
    As `statement` does; and ContradictionError if it contradicts the constraints in force after pending decisions.
    """
    engine.start()
    mates, scene, poses = engine.mates, engine.scene, engine.poses
    features = mates.recogniser.features
    constraint = statement(scene, features, poses, kind, a, b, parameters, engine.tolerance)
    held, imposed = {id: e.candidate for id, e in mates.accepted.items()}, 0
    for decision in engine.decisions:
        if decision.stated is not None:
            held[decision.id], imposed = decision.stated, imposed + 1
        elif decision.verb == "accept":
            offered = mates.candidates.get(decision.id) or mates.refused.get(decision.id)
            held |= {} if offered is None else {decision.id: offered}
        else:
            held.pop(decision.id, None)
    candidate = stated_candidate(constraint, poses, features, mates.known + imposed, words(constraint))
    id = mates.id_of(candidate, imposed)
    names = tuple(scene.names[i] for i in constraint.bodies)
    if any(c.key == candidate.key for c in held.values()):
        raise TaskError(f"constrain {constraint.kind}: these surfaces of {' and '.join(names)} have it already")
    fixed = [i for i, part in enumerate(scene.parts) if part.fixed]
    others = [c.constraint for c in held.values()]
    off = contradiction(constraint, others, poses, fixed, engine.tolerance, scene.names)
    if off is not None:
        message = f"constrain {constraint.kind} between {' and '.join(names)}: refused, {off.text}"
        raise ContradictionError(message, names, off.off, off.unit)
    return Decision("impose", id, bears, candidate), readings.view(id, candidate, "active")


def limits(verb: str, break_distance: float | None, break_force: float | None) -> tuple[tuple[str, float], ...]:
    """Return the given break limits by name; TaskError if one is not positive."""
    given = (("break_distance", break_distance), ("break_force", break_force))
    for name, value in given:
        if value is not None and not value > 0.0:
            raise TaskError(f"{verb}: {name} is {value!r}; give a positive number")
    return tuple((n, v) for n, v in given if v is not None)
