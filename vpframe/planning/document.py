"""The outputs of a plan: a JSON document, a text table, track files, a task script."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, fields
from itertools import groupby
from pathlib import Path
from shlex import quote
from typing import Any

import numpy as np
import pinocchio as pin

from collision import Tolerance
from constraints.recognition.fastener_names import base_name
from vpframe import __version__
from vpframe.errors import VpframeError
from vpframe.planning.assembly import Overlap
from vpframe.planning.certify import PathClearance
from vpframe.planning.plan import Disassembly, PlannedStep
from vpframe.planning.verdict import JAMMED, Removal
from vpframe.planning.ways import Leg, RemovalPath
from vpframe.scene.subassembly import listed
from vpframe.text import plain

GENERATOR = "vpframe"
MANY = 30
"""parts of a model beyond which instances of one pattern share a line"""
LINES = 10
"""lines of a kind in the text of such a model"""


def document(plan: Disassembly, seed: int, tolerance: float, tracks: Mapping[str, str] | None = None) -> dict[str, Any]:
    """The plan as JSON; lengths in metres. tracks: file names by part, where tracks were written."""
    files = tracks or {}
    return {
        "generator": GENERATOR,
        "version": __version__,
        "verdict": plan.verdict,
        "target": plan.target,
        "base": list(plan.base),
        "steps": [_step(step, plan.names, files) for step in plan.steps],
        "precedence": {name: list(after) for name, after in plan.precedence.items()},
        "levels": [list(level) for level in plan.levels],
        "minimal": {"proven": plan.proven, "bound": plan.bound, "over": plan.scope},
        "remaining": list(plan.remaining),
        "tried": [{"part": name} | asdict(t) for name, stuck in plan.stuck.items() for t in stuck.tried],
        "stuck": {name: _stuck(stuck) for name, stuck in plan.stuck.items()},
        "proofs": {name: found for name, stuck in plan.stuck.items() if (found := _proof(stuck)) is not None},
        "press_fits": [fit.document() for fit in plan.press_fits],
        "overlaps": [_overlap(o) for o in plan.overlaps],
        "duplicates": [list(names) for names in plan.duplicates],
        "together": [list(names) for names in plan.together],
        "budget": plan.budget.document(),
        "seed": seed,
        "tolerance": tolerance,
        "interrupted": plan.interrupted,
    }


def _step(step: PlannedStep, names: Sequence[str], files: Mapping[str, str]) -> dict[str, Any]:
    way = step.way
    return {
        "parts": list(step.parts),
        "motion": way.motion,
        "direction": [float(x) for x in way.direction],
        "turns": way.turned,
        "legs": [_leg(leg) for leg in way.legs],
        "level": step.level,
        "after": list(step.after),
        "track": {name: files[name] for name in step.parts if name in files},
        "length": step.length,
        "least_clearance": _clearance(step.clearance, names),
        "ignores": [[names[a], names[b]] for a, b in step.clearance.ignored],
        "unsupported": list(step.unsupported),
        "knots": [[float(x) for x in (*k.translation, *pin.Quaternion(k.rotation).coeffs())] for k in way.knots],
    }


def _leg(leg: Leg) -> dict[str, Any]:
    """A leg: a rotation by `angle` rad about a line, and a translation by `shift` m, world."""
    return {"angle": leg.angle, "axis": leg.axis.tolist(), "point": leg.point.tolist(), "shift": leg.shift.tolist()}


def _stuck(found: Removal) -> dict[str, Any]:
    return {
        "verdict": found.verdict,
        "while": list(found.holders),
        "in_the_way": list(found.blockers),
        "stopped_last": [list(s) for s in found.last],
        "ended_by": found.ended,
        "held_by": [_overlap(o) for o in found.clashes],
    }


def _overlap(o: Overlap) -> dict[str, Any]:
    at = None if o.at is None else [float(x) for x in o.at]
    return {"parts": list(o.parts), "surfaces": list(o.surfaces), "depth": o.depth, "at": at, "clash": o.clash}


def _clearance(clearance: PathClearance, names: Sequence[str]) -> dict[str, Any] | None:
    if clearance.parts is None or clearance.surfaces is None or clearance.at is None:
        return None
    (a, b), (i, j) = clearance.parts, clearance.surfaces
    return {
        "distance": clearance.distance,
        "surfaces": [names[a], i, names[b], j],
        "at": [float(x) for x in clearance.at],
    }


def _proof(found: Removal) -> dict[str, Any] | None:
    if found.verdict == "enclosed":
        return {"verdict": "enclosed", "by": list(found.holders)}
    if found.proof is None:
        return None
    return {
        "verdict": "locked",
        "surfaces": [list(s) for s in found.proof.surfaces],
        "multipliers": [str(x) for x in found.proof.multipliers],
        "rows": [[float(x) for x in found.proof.cone.rows[k]] for k in found.proof.lock.rows],
        "margin": found.proof.margin,
        "tolerance": found.proof.tolerance,
    }


def table(plan: Disassembly) -> str:
    """The plan as text: a line per step, then the parts that stay and the reason of each.

    Of more than MANY steps, instances of one pattern that leave alike share a line, and so do overlaps and reasons.
    """
    lines, many = [headline(plan)], len(plan.names) > MANY
    for first, steps in _runs(plan.steps, many):
        step, last = steps[0], first + len(steps) - 1
        what = listed(step.parts) if len(steps) == 1 else f"{len(steps)} × {base_name(step.parts[0])}"
        d = min(each.clearance.distance for each in steps)
        near = "" if not math.isfinite(d) else f", {d * 1e3:.3g} mm clear"
        near += ignores(step.clearance, plan.names)
        far = f", {step.length * 1e3:.4g} mm" if step.motion in ("straight", "screw") else ""
        place = f"{first:3}" if len(steps) == 1 else f"{first:3}–{last}"
        lines.append(f"  {place}  {what}: {step.way.text}{far}{near}")
    lines += [f"  {words}" for words in _some(unsupported(plan, many), many, "losses of support")]
    lines += [f"  {words}" for words in (*stays(plan), *duplicates(plan), *together(plan))]
    lines += [f"  {words}" for words in _some(list(map(str, plan.press_fits)), many, "press fits")]
    lines += [f"  {words}" for words in _some(_overlaps(plan, many), many, "kinds of overlaps")]
    if plan.remaining:
        questions = f"{plan.budget.used} of {plan.budget.questions} questions"
        lines.append(f"  used {plan.seconds:.3g} of {plan.budget.seconds:g} s of processor time, {questions}")
    if plan.interrupted:
        lines.append("  interrupted; these are the steps found until then")
    elif plan.remaining and plan.budget.ended:
        lines.append(f"  the budget of {plan.budget.ended} was used up; a larger --budget may find more")
    return "\n".join(map(plain, lines))


def _runs(steps: Sequence[PlannedStep], many: bool) -> Iterator[tuple[int, list[PlannedStep]]]:
    """The number of the first step, and the steps, of each row of steps that are told in one line."""

    def alike(step: PlannedStep) -> tuple[Any, ...]:
        pattern = base_name(step.parts[0]) if many and len(step.parts) == 1 else step.parts
        return pattern, step.way.text, step.clearance.ignored

    first = 1
    for _, row in groupby(steps, key=alike):
        run = list(row)
        yield first, run
        first += len(run)


def _some(lines: Sequence[str], many: bool, what: str) -> list[str]:
    """The lines, of a plan of many parts only the first LINES."""
    more = len(lines) - LINES if many else 0
    return [*lines[:LINES], f"and {more} more {what} (--json has all)"] if more > 1 else list(lines)


def _overlaps(plan: Disassembly, many: bool) -> list[str]:
    """A line for each pair of parts, or of patterns of parts, that overlap as drawn, the deepest first."""
    alike: dict[tuple[str, str], list[tuple[tuple[str, str], list[float]]]] = {}
    for pair, depths in overlaps_by_parts(plan).items():
        if any(set(pair) <= set(names) for names in plan.duplicates):
            continue
        a, b = map(base_name, pair)
        alike.setdefault((a, b) if many else pair, []).append((pair, depths))
    lines = []
    for (a, b), found in alike.items():
        pair, depths = found[0]
        faces = "" if len(depths) == 1 else f" at most, {len(depths)} pairs of surfaces"
        faces = faces if len(found) == 1 else f" at most, {len(found)} pairs of parts, such as {' – '.join(pair)}"
        quoted = quote(":".join(pair))
        meant = f"; if that is meant: --authorise {quoted}; if they may pass through each other: --ignore {quoted}"
        meant = meant if any(set(each) & plan.stuck.keys() for each, _ in found) else ""
        lines.append(f"overlap from the start, never deepened: {a} – {b}, {depths[0] * 1e3:.3f} mm{faces}{meant}")
    return lines


def duplicates(plan: Disassembly) -> list[str]:
    """A line for each part that is drawn more than once at one place."""
    return [f"drawn {len(names)} times at one place, and leaves as one: {listed(names)}" for names in plan.duplicates]


def together(plan: Disassembly) -> list[str]:
    """A line for each group of parts that left as one and was not taken apart further."""
    return [f"not taken apart further: {listed(names)}" for names in plan.together]


def ignores(clearance: PathClearance, names: Sequence[str]) -> str:
    """The ignored parts that a path may pass through, as a suffix of its text; empty if there are none."""
    pairs = ", ".join(f"{names[a]}–{names[b]}" for a, b in clearance.ignored)
    return f", ignores {pairs}" if pairs else ""


def headline(plan: Disassembly) -> str:
    """The parts that come out and the number of steps, or the parts that do not."""
    what = plan.target or "everything but " + listed(plan.base)
    count = f"{len(plan.steps)} step{'s' * (len(plan.steps) != 1)}"
    if plan.verdict != "removable":
        words = "not found to come out" if plan.verdict == "not found" else plan.verdict
        return f"{words}: {plan.target or listed(plan.remaining)}"
    if not plan.steps:
        return f"nothing to take apart: {listed(plan.base)} is the whole model"
    if plan.proven and len(plan.steps) == 1:
        return f"{what} comes out in {count}: nothing has to go before it"
    n = len(plan.together)
    whole = f"; {n} group{'s' * (n != 1)} of them {'is' if n == 1 else 'are'} not taken apart" if n else ""
    return f"{what} comes out in {count}{f', the fewest of {plan.scope}' if plan.proven else ''}{whole}"


def unsupported(plan: Disassembly, many: bool = False) -> list[str]:
    """A line for each step after which parts have no support; of many parts with few names and without their paths."""

    def names(parts: Sequence[str]) -> str:
        return listed([part.rsplit("/", 1)[-1] for part in parts], 2) if many else listed(parts)

    return [
        f"{names(step.unsupported)} {_stay(step.unsupported)} without support once {names(step.parts)} "
        f"{'is' if len(step.parts) == 1 else 'are'} out"
        for step in plan.steps
        if step.unsupported
    ]


def stays(plan: Disassembly) -> list[str]:
    """A line for each reason why parts stay in; of many parts, patterns are named, not instances."""
    if len(plan.names) <= MANY:
        alike: dict[str, list[str]] = {}
        for name, stuck in plan.stuck.items():
            alike.setdefault(reason(stuck, plan.fasteners), []).append(name)
        return [f"{listed(names)} {'is' if len(names) == 1 else 'are'} {words}" for words, names in alike.items()]
    patterns: dict[tuple[str, str, tuple[str, ...]], list[str]] = {}
    for name, stuck in plan.stuck.items():
        by = stuck.holders or tuple(o.parts[o.parts[0] == name] for o in stuck.clashes) or stuck.blockers
        key = base_name(name), stuck.verdict, tuple(sorted(set(map(base_name, by))))
        patterns.setdefault(key, []).append(name)
    lines = []
    for (pattern, _, _), names in patterns.items():
        of = f"{len(names)} × {pattern}, such as " if len(names) > 1 else ""
        lines.append(f"{of}{names[0]} is {reason(plan.stuck[names[0]], plan.fasteners)}")
    return lines


def reason(found: Removal, fasteners: Mapping[str, str] | None = None) -> str:
    """Why a part stays in: the proof and the parts it assumes, what holds it, or blockers, budget and last contacts.

    fasteners: words for the parts that are fasteners.
    """
    if found.holders:
        return f"{PROVEN[found.verdict]} while {listed(found.holders)} {_stay(found.holders)} (proof)"
    known = fasteners or {}
    blockers = [f"{name} ({known[name]})" if name in known else name for name in found.blockers]
    if found.verdict == "held":
        clashes = [f"{next(p for p in o.parts if p not in found.parts)} by {o.text}" for o in found.clashes]
        if not clashes:
            return f"held by {listed(blockers)}, which does not come out"
        way = "" if found.way is None else f"; without it: {found.way.text}"
        mates = {p for o in found.clashes for p in o.parts}
        more = [word for word, name in zip(blockers, found.blockers, strict=True) if name not in mates]
        return f"held: overlaps {listed(clashes, 3)}{way}{f', once out: {listed(more)}' if more else ''}"
    by = f", in the way: {listed(blockers)}" if blockers else ""
    by += "".join(f"; {t.why}" for t in found.tried if t.way == JAMMED)
    ended = f"; the budget of {found.ended} was used up" if found.ended else ""
    return f"not found to come out{by}{ended}{_last(found)}"


def _last(found: Removal) -> str:
    """The contacts that stopped the last motion, in words; empty if none is known."""
    pairs = [f"surface {a} of {part} at surface {b} of {by}" for part, a, by, b in found.last]
    more = [f"{len(pairs) - 2} more pairs"] if len(pairs) > 3 else pairs[2:]
    return f"; stopped last: {', '.join(pairs[:2] + more)}" if pairs else ""


def _stay(names: Sequence[str]) -> str:
    return "stays" if len(names) == 1 else "stay"


PROVEN = {"locked": "locked: contacts leave it no motion", "enclosed": "enclosed"}


def overlaps_by_parts(plan: Disassembly) -> dict[tuple[str, str], list[float]]:
    """Return the depths (m), deepest first, of the overlapping surfaces of each pair of parts, the worst pair first."""
    found: dict[tuple[str, str], list[float]] = {}
    for o in plan.overlaps:
        found.setdefault(o.parts, []).append(o.depth)
    return found


def track_files(plan: Disassembly) -> dict[str, str]:
    """File names by part, none twice."""
    out: dict[str, str] = {}
    for step in plan.steps:
        for name in step.parts:
            stem = "".join(c if c.isalnum() or c in "-_." else "_" for c in name).strip(".") or "part"
            taken = set(out.values())
            out[name] = next(
                file for k in range(len(out) + 1) if (file := f"{stem}{f'_{k + 1}' if k else ''}.csv") not in taken
            )
    return out


def known_ways(text: str, path: str) -> list[tuple[tuple[str, ...], RemovalPath]]:
    """The paths in the document of an earlier plan, for `--resume`; they are not trusted to be free of collisions.

    Raises VpframeError, naming the file, if it is no such document.
    """
    try:
        out = []
        for step in json.loads(text)["steps"]:
            knots = []
            for row in step["knots"]:
                x = np.array([float(v) for v in row], np.float64)
                if x.shape != (7,) or not np.isfinite(x).all() or np.linalg.norm(x[3:]) < 0.5:
                    raise ValueError("a knot")
                quaternion = pin.Quaternion(x[3:] / np.linalg.norm(x[3:]))
                knots.append(pin.SE3(quaternion.toRotationMatrix(), x[:3]))
            direction = np.array([float(v) for v in step["direction"]], np.float64)
            if len(knots) < 2 or not knots[0].isIdentity(1e-12) or direction.shape != (3,):
                raise ValueError("knots")
            if not np.isfinite(direction).all() or abs(np.linalg.norm(direction) - 1.0) > 1e-6:
                raise ValueError("a direction")
            motion = step["motion"]
            if motion not in ("straight", "screw", "slide", "free"):
                raise ValueError("a motion")
            turns = float(step["turns"]) if motion == "screw" else 0.0
            way = RemovalPath(motion, direction, (pin.SE3.Identity(), *knots[1:]), turns)
            out.append((tuple(str(name) for name in step["parts"]), way))
        return out
    except (KeyError, TypeError, ValueError) as error:
        raise VpframeError(f"{path}: is not a plan to go on from ({error}); leave out --resume") from None


def script(plan: Disassembly, model: str, folder: str, files: Mapping[str, str]) -> str:
    """Return a task script that executes the plan."""
    lines = [f"    session.authorise({_quoted(a)}, {_quoted(b)})" for a, b in plan.authorised]
    lines += [f"    session.ignore({_quoted(a)}, {_quoted(b)})" for a, b in plan.ignored]
    for n, step in enumerate(plan.steps, 1):
        first, carried = step.parts[0], step.parts[1:]
        carry = f", carry={_list(carried)}" if carried else ""
        lines.append(f"    # {n}: {plain(step.way.text + ignores(step.clearance, plan.names))}")
        lines.append(f"    hand.grab({_quoted(first)}{carry})")
        if step.motion == "straight":
            far = float(np.linalg.norm(step.way.knots[-1].translation))
            d = ", ".join(repr(float(x)) for x in step.way.direction)
            lines.append(f"    hand.slide(({d}), distance={far!r})")
        else:
            lines.append(f"    hand.follow(TRACKS / {_quoted(files[first])})")
        lines.append("    hand.release()")
        if n < len(plan.steps):  # removed parts block nothing
            lines += [f"    session.ignore({_quoted(part)})" for part in step.parts]
        lines.append("")
    mates = "".join(f"    ({', '.join(map(_quoted, mate))}),\n" for mate in plan.mates)
    return _TEMPLATE.format(
        mates=mates,
        tolerance="" if plan.tolerance is None else f', "tolerance": vp.Tolerance({_changed(plan.tolerance)})',
        model=_quoted(Path(model).name)[1:-1],
        file=_quoted(model),
        folder=_quoted(folder),
        steps="\n".join(lines),
    )


def _changed(tolerance: Tolerance) -> str:
    """The fields of a tolerance that are not the default, as arguments."""
    given = ((f.name, getattr(tolerance, f.name), f.default) for f in fields(tolerance))
    return ", ".join(f"{name}={value!r}" for name, value, default in given if value != default)


def _list(names: Iterable[str]) -> str:
    return "[" + ", ".join(map(_quoted, names)) + "]"


def _quoted(text: str) -> str:
    return plain(json.dumps(text, ensure_ascii=False))


_TEMPLATE = '''"""Take {model} apart, as planned by `vpframe disassemble`: change what you like, then run it."""

from pathlib import Path

import vpframe as vp

FILE = {file}
TRACKS = Path(__file__).parent / {folder}
MATES = [  # what the ways keep to; parts that only lie against others leave them
{mates}]
OPTIONS = {{"rule": vp.first_of(*(vp.accept_between(a, b, kind) for a, b, kind in MATES)){tolerance}}}


def task(session):
    hand = session.hand()
{steps}

if __name__ == "__main__":
    vp.main(__file__)
'''
