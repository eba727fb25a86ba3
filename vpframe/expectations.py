"""What a task may expect of a session: whether it holds, and the words that say so."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from vpframe.interaction.arguments import as_pose

if TYPE_CHECKING:
    from vpframe.session import Session

Verdict = tuple[bool, str]


def constraint(session: Session, kind: str, a: str, b: str) -> Verdict:
    """Of an active constraint of that kind between two parts."""
    have = [c.kind for c in session.constraints_of(a) if session.scene[b].name in c.parts]
    found = "" if kind in have else f" (there is: {', '.join(have) or 'none'})"
    return kind in have, f"{kind} between {a} and {b}{found}"


def freedom(session: Session, part: str, n: int) -> Verdict:
    """Of the degrees of freedom that a part has left."""
    have = session.freedom(part)
    return have == n, f"{part} has {n} degrees of freedom" + (f" (it has {have})" if have != n else "")


def free(session: Session, part: str) -> Verdict:
    """Of a part that no constraint holds and that touches nothing."""
    held = ", ".join(c.kind for c in session.constraints_of(part))
    touched = ", ".join(session.touching(part))
    why = "; ".join([f"held by {held}"] * bool(held) + [f"touches {touched}"] * bool(touched))
    return not why, f"{part} is free" + (f" ({why})" if why else "")


def no_clash(session: Session) -> Verdict:
    """Of no surfaces that intersect but mated ones and authorised pairs."""
    rows = session.clashes()
    found = ""
    if len(rows):
        a, sa, b, sb = rows[0].tolist()
        names = session.scene.names
        found = f" ({len(rows)} surface pairs meet, first {names[a]} {sa} and {names[b]} {sb})"
    return not found, f"no clash{found}"


def at(session: Session, part: str, pose: pin.SE3 | ArrayLike, within: float, angle: float) -> Verdict:
    """Of a part at a pose (or position), within metres and radians."""
    body = session.scene[part]
    off = as_pose(pose, body.pose).actInv(body.pose)
    far, turned = float(np.linalg.norm(off.translation)), float(np.linalg.norm(pin.log3(off.rotation)))
    text = f"{part} within {within * 1e3:g} mm of its place (it is {far * 1e3:.3f} mm, {np.degrees(turned):.2f}° off)"
    return far <= within and turned <= angle, text
