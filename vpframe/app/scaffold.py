"""`vpframe new`: write a first task script for a model, after testing it.

Planning searches a removal path for the smallest parts in turn, and the script uses a verb of the hand for it. A part
that is named and for which none is found is slid along the world's axes; if that does not free it, the script removes
what stands in its way before. If no part can be removed, the script takes one in hand and lets it go, and has the
reason, a remedy and what was tried as comments: a script that is written runs.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vpframe import console, files, planning
from vpframe.app.outline import outline
from vpframe.app.written_task import VerbCall, quoted, script_of
from vpframe.errors import TaskError, VpframeError
from vpframe.hands.reach import spans
from vpframe.outputs import SCRIPT, claimed
from vpframe.scene.scene import Part, Scene
from vpframe.scene.subassembly import listed, parts_named
from vpframe.session.session import Session
from vpframe.text import plain

PARTS = 6
"""maximum number of parts that are tried"""
SECONDS = 5.0
"""time limit of planning for each part, s"""
ALL = 60.0
"""time limit of planning what has to be removed before a part, s, if none is given"""
MARGIN = 5e-3
"""distance by which a slide goes past all other parts, m"""
REMEDY = "this was tried; give another direction, or remove the parts in the way first:"
WORDS = {"up": (0, 0, 1), "down": (0, 0, -1), "x": (1, 0, 0), "-x": (-1, 0, 0), "y": (0, 1, 0), "-y": (0, -1, 0)}


Attempt = list[VerbCall]
"""lines of the script that remove a part, with the expectation that it is out"""
Tried = tuple[Part, Attempt, str]
"""a part, an attempt to remove it, and why that fails, empty if it succeeds"""


def _out(part: str, *calls: VerbCall) -> Attempt:
    return [*calls, VerbCall("session", "expect_free", (part,))]


def _by(part: Part, verb: str, *given: Any, **named: Any) -> Attempt:
    """Return the attempt to remove a part by a verb of the hand that holds it."""
    grab, release = VerbCall("hand", "grab", (part.name,)), VerbCall("hand", "release")
    return _out(part.name, grab, VerbCall("hand", verb, given, named), release)


def new_task(
    path: str | os.PathLike[str], scene: Scene, model: Path, name: str | None = None, budget: float = ALL
) -> str:
    """Write a first task script for a scene; return why it takes no part out, empty if it does.

    name: of the part to remove; None: the first one that can be removed.
    budget: of planning what has to be removed before the named part, s.

    Raises
    ------
    OutputError: the script exists already, or cannot be written. UnknownPartError, TaskError: no part has that name.
    """
    wanted = scene.parts if name is None else (_named(scene, name),)
    output = claimed(path, SCRIPT)
    script = output.path
    with contextlib.suppress(ValueError):  # the model is on another drive
        model = Path(os.path.relpath(str(model), str(script.parent)))
    with console.progress("looking for a part that comes out") as progress:
        part, way, reason = _found(scene, progress, wanted, budget)
    parts = "\n".join(f"#   {line}" for line in outline(scene))
    text = script_of(
        f"A first task on {model.name}: take one part out.",
        f"FILE = {quoted(model.as_posix())}\n\n"
        f"# The parts of the model, the world's axes along their sizes (lengths in scripts are metres):\n{parts}",
        _body(part.name, way, reason),
    )
    with output:
        files.replace(script, text)
    return reason


def _body(part: str, attempt: Attempt, reason: str) -> list[str]:
    """Return the lines of the task; of a way that fails as comments."""
    lines = [call.source for call in attempt]
    if not reason:
        return lines
    notes = (f"{plain(part)} did not come out: {plain(reason)}", REMEDY, *lines)
    return [f"hand.grab({quoted(part)})", "hand.release()", *(f"# {line}" for line in notes)]


def _named(scene: Scene, name: str) -> Part:
    group = parts_named(scene.names, name)
    if len(group) > 1:
        raise TaskError(f"{name} has {len(group)} parts, {listed(group)}; name one of them")
    if scene[group[0]].fixed:
        raise TaskError(f"{group[0]} is fixed in the scene; name a part that moves")
    return scene[group[0]]


def _found(
    scene: Scene, progress: console.Progress, wanted: Sequence[Part], budget: float
) -> tuple[Part, Attempt, str]:
    """Return a part and a way to remove it, with the reason why that fails, empty if it succeeds."""
    parts = sorted((p for p in wanted if not p.fixed), key=lambda p: (p.shape.enclosed or np.inf, p.name))
    if not parts:
        raise VpframeError("all parts are fixed: there is none to take in hand")
    first: Tried | None = None
    tried = list(dict.fromkeys(part.shape for part in parts))[:PARTS]  # one part of each shape
    for number, shape in enumerate(tried):
        part = next(p for p in parts if p.shape is shape)
        progress(number / len(tried), part.name)
        found = planning.removal(scene, part.name, budget=SECONDS, motion="mates")
        for way in _ways(scene, part, found) or (_straight(scene, part) if len(wanted) == 1 and not found else []):
            reason = _tried(scene, way)
            if not reason:
                return part, way, ""
            first = first or (part, way, reason)
        if not found:
            first = first or (part, _by(part, "slide", "up", distance=0.1), _no_way(part, found))
    assert first is not None
    if len(wanted) == 1:
        progress(0.5, f"what has to be removed before {first[0].name}")
        plan = planning.disassembly(scene, first[0].name, budget=budget)
        if plan.verdict != "removable":
            return first[0], first[1], f"{first[2]}; {_none_before(plan)}"
        steps = [(first[0].name,) if first[0].name in step.parts else step.parts for step in plan.steps]
        names = list(dict.fromkeys(name for step in steps for name in step))
        way = _out(first[0].name, VerbCall("hand", "remove", (names,)))
        reason = _tried(scene, way)
        return first[0], way, reason
    return first


def _none_before(plan: planning.Disassembly) -> str:
    """Say that no parts were found whose removal frees the target, or that there are none."""
    spent = plan.budget
    if plan.verdict != "not found":
        return f"it is {plan.verdict}"
    if not (spent.by_clock or spent.used >= spent.questions):
        return "no parts were found whose removal frees it"
    return (
        f"the search for what has to be removed before it used up its budget of {spent.seconds:g} s: give more with "
        f"--budget {2.0 * spent.seconds:g}s"
    )


def _no_way(part: Part, found: planning.Removal) -> str:
    """Say that no path was found, or that there is none."""
    by = f", in its way: {', '.join(found.blockers)}" if found.blockers else ""
    return f"{part.name}: {'no way out was found' if found.verdict == 'not found' else f'it is {found.verdict}'}{by}"


def _ways(scene: Scene, part: Part, found: planning.Removal) -> list[Attempt]:
    """Return the planned path as verbs of a hand, the simplest first; none if it needs several verbs."""
    if found.way is None or found.way.motion not in ("straight", "screw"):
        return []
    if found.way.motion == "screw":
        return [_by(part, "unscrew", until="free")]
    direction = found.way.direction
    far = _rounded(float(np.linalg.norm(found.way.knots[-1].translation)))
    word = next((name for name, axis in WORDS.items() if np.abs(direction - axis).max() < 1e-9), None)
    along = word or tuple(round(float(x), 6) for x in direction)
    slide = _by(part, "slide", along, distance=far)
    return [_by(part, "pull", "axis", until="free"), slide] if len(scene) > 1 else [slide]


def _straight(scene: Scene, part: Part) -> list[Attempt]:
    """Return slides along the world's axes past all other parts, the shortest first: a hand slides along walls to which
    a part has no clearance, and out of fits that overlap as drawn."""
    others = [other for other in scene.parts if other is not part]
    far = {}
    for word, axis in WORDS.items():
        way = np.array(axis, dtype=np.float64)
        far[word] = _rounded(max(spans(others, way)[1] - spans([part], way)[0], MARGIN) + MARGIN) if others else 0.1
    return [_by(part, "slide", word, distance=far[word]) for word in sorted(WORDS, key=far.__getitem__)]


def _rounded(length: float) -> float:
    """Round a length (m) up to two digits."""
    digits = 1 - int(np.floor(np.log10(length)))
    return float(f"{np.ceil(length * 10.0**digits) / 10.0**digits:.2g}")


def _tried(scene: Scene, attempt: Attempt) -> str:
    """Run the task on a copy of the scene; return why it fails, empty if it succeeds."""
    try:
        with Session(scene.copy()) as session:
            for call in attempt:
                call.perform(session, session.hand())
    except TaskError as error:
        return " ".join(str(error).split())
    return ""
