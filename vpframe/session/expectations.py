"""Checks behind `Session.expect_…`: each returns whether it holds and the text of the event."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from vpframe.analysis.clash import between
from vpframe.analysis.fits import BAD_KINDS, press_fits
from vpframe.hands.arguments import as_pose
from vpframe.scene.boxes import middle
from vpframe.scene.scene import Part
from vpframe.scene.subassembly import listed
from vpframe.scene.symmetry import symmetry_of

Verdict = tuple[bool, str]


def constraint(session: Any, kind: str, a: str, b: str) -> Verdict:
    """Check that a constraint of that kind is active between two parts or subassemblies."""
    own, others = set(session.group(a)), set(session.group(b))
    between = [c for c in session.constraints_of(a) if not (set(c.parts) - own).isdisjoint(others)]
    have = [c.kind for c in between]
    found = "" if kind in have else f" (there is: {', '.join(have) or 'none'})"
    return kind in have, f"{kind} between {a} and {b}{found}"


def freedom(session: Any, part: str, n: int, to: str | None = None, carried: Sequence[str] = ()) -> Verdict:
    """Check the degrees of freedom of a part or subassembly with the parts it carries, to all others or to `to`."""
    have = session.freedom(part, to, carried)
    group, found = f" with {listed(carried)}" if carried else "", f" (it has {have})" if have != n else ""
    return have == n, f"{part}{group} has {n} degree{'s' * (n != 1)} of freedom{f' to {to}' if to else ''}{found}"


def free(session: Any, part: str, carried: Sequence[str] = ()) -> Verdict:
    """Check that no constraint holds a part or subassembly, with the parts it carries, and that it touches nothing."""
    held = ", ".join(dict.fromkeys(c.kind for c in session.constraints_of(part, *carried)))
    touched = listed(tuple(session.touching(part, *carried)))
    why = "; ".join([f"constrained: {held}"] * bool(held) + [f"touches {touched}"] * bool(touched))
    return not why, f"{part}{f' with {listed(carried)}' if carried else ''} is free" + (f" ({why})" if why else "")


def no_clash(session: Any) -> Verdict:
    """Check that no parts clash, as `vpframe.analysis.clash` judges them where surfaces intersect that are neither
    mated nor of an authorised pair; press fits in force are named, and overlaps as drawn that are meant counted."""
    parts = session.scene.parts
    names = session.scene.names
    mated = {
        (frozenset(c.parts), frozenset(faces))
        for c in session.constraints
        for faces in product(*([(name, s) for s in own] for name, own in zip(c.parts, c.surfaces, strict=True)))
    }
    bad = []
    for a, b in sorted({(a, b) for a, _, b, _ in (*session.clashes().tolist(), *session.misfits().tolist())}):
        rows = between(parts[a], parts[b], (parts[a].pose, parts[b].pose), session.tolerance, session.scene.rules)
        for key, row in rows.items():
            own = frozenset(zip((names[a], names[b]), key, strict=False))
            if row.kind in BAD_KINDS and (frozenset((names[a], names[b])), own) not in mated:
                bad.append((a, b, key, row))
    found = ""
    if bad:
        a, b, key, row = max(bad, key=lambda entry: entry[3].depth)
        faces = f"face {key[0]} of {names[a]} and face {key[1]} of {names[b]}" if key else f"{names[a]} and {names[b]}"
        more = f", and {len(bad) - 1} more" if len(bad) > 1 else ""
        found = f" ({faces} overlap by {row.depth * 1e3:.3f} mm{more})"
    pressed = press_fits((c.parts, c.press) for c in session.constraints)
    meant = Counter(meaning.kind for meaning in session.meanings)
    counted = [f"{n} x {kind}, as drawn" for kind, n in meant.items()]
    return not bad, "; ".join([f"no clash{found}", *counted, *map(str, pressed)])


def at(session: Any, part: str, pose: pin.SE3 | ArrayLike, within: float, angle: float) -> Verdict:
    """Check the centre of a part (within m) and its rotation modulo symmetry (angle, rad) against a pose.

    A position (3,) is compared with the origin of the part's frame, for the part's present rotation and for its
    rotation at the start of the session; rotation itself is not checked.
    """
    first, *rest = session.group(part)
    body = session.scene[first]
    for name in rest if first in session.start else ():
        seat = session.start[first].actInv(session.start[name])
        holds, text = _at(session, session.scene[name], body.pose * seat, within, angle)
        if not holds:
            return False, f"{part} in one piece: {text} from where it was on {first}"
    return _at(session, body, pose, within, angle)


def _at(session: Any, body: Part, pose: pin.SE3 | ArrayLike, within: float, angle: float) -> Verdict:
    part, here, centre = body.name, body.pose, _centre(body)
    goal = as_pose(pose, here)
    far = float(np.linalg.norm(goal.act(centre) - here.act(centre)))
    named = f"{part} within {within * 1e3:g} mm of its place"
    if not isinstance(pose, pin.SE3) and np.shape(pose) == (3,):
        begun = pin.SE3(session.start.get(part, here).rotation, goal.translation)
        far = min(far, float(np.linalg.norm(begun.act(centre) - here.act(centre))))
        return far <= within, f"{named} (its centre is {far * 1e3:.3f} mm off; rotation is not compared)"
    turned, way = float(np.linalg.norm(pin.log3(goal.rotation.T @ here.rotation))), ""
    if turned > angle:  # computing the symmetry is expensive
        symmetry = symmetry_of(body.shape)
        turned = symmetry.angle(goal.rotation.T @ here.rotation)
        way = "" if symmetry.trivial else " from the nearest pose that looks the same"
    text = f"{named} (its centre is {far * 1e3:.3f} mm off, it is turned by {np.degrees(turned):.2f}°{way})"
    return far <= within and turned <= angle, text


def _centre(part: Part) -> NDArray[np.float64]:
    """Centre of volume (3,), part frame, m; for an open mesh the centre of its bounding box."""
    if part.shape.closed and part.shape.volume > 0.0:
        return np.asarray(part.shape.center)
    return middle(part.mesh)
