"""`vpframe new`: a first task script for a model, tried before it is written.

The smallest parts are tried in turn, each along the axis that holds it and along the main directions, until one comes
out. When none does the script is written all the same, with the reason and what to change in it.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from vpframe import files
from vpframe.app.outputs import SCRIPT, claimed
from vpframe.app.progress import Progress
from vpframe.errors import TaskError, VpframeError
from vpframe.hands.hand import Hand
from vpframe.scene.boxes import half_size
from vpframe.scene.scene import Part, Scene
from vpframe.session.session import Session
from vpframe.text import plain

PARTS = 6
"""how many parts are tried at most"""
SECONDS = 30.0
"""after so many seconds no further way is tried"""
LISTED = 60
"""how many parts the script names"""


@dataclass(frozen=True)
class Way:
    """How a part may come out: a verb of the hand."""

    verb: str
    along: str
    options: tuple[tuple[str, float | str], ...]

    @property
    def line(self) -> str:
        """As the script has it, e.g. `hand.slide("up", distance=0.1)`."""
        options = ", ".join(
            f'{name}="{value}"' if isinstance(value, str) else f"{name}={value:g}" for name, value in self.options
        )
        return f'hand.{self.verb}("{self.along}", {options})'

    def go(self, hand: Hand) -> None:
        """Do it."""
        getattr(hand, self.verb)(self.along, **dict(self.options))


def new_task(path: str | os.PathLike[str], scene: Scene, model: Path) -> str:
    """Write a first task script for the parts of a scene; returns what to know of it, empty when it runs to its end.

    Raises
    ------
    OutputError: the script exists already, or cannot be written.
    """
    output = claimed(path, SCRIPT)
    script = output.path
    with contextlib.suppress(ValueError):  # another drive
        model = Path(os.path.relpath(str(model), str(script.parent)))
    with Progress("looking for a part that comes out") as progress:
        part, way, reason = _found(scene, progress)
    listed = [f"#   {quoted(p.name)}: {len(p.surfaces)} surfaces" for p in scene.parts[:LISTED]]
    if len(scene) > LISTED:
        listed.append(f"#   … and {len(scene) - LISTED} more")
    text = _TEMPLATE.format(
        model=_in_docstring(model.name),
        file=quoted(model.as_posix()),
        parts="\n".join(listed),
        part=quoted(part.name),
        way=way.line,
        note=_STOPS.format(reason=plain(reason)) if reason else "",
    )
    with output:
        files.replace(script, text)
    return reason


def _found(scene: Scene, progress: Progress) -> tuple[Part, Way, str]:
    """A part and a way that it comes out; with the reason why not, if none was found."""
    began = time.monotonic()
    parts = sorted((p for p in scene.parts if not p.fixed), key=lambda p: (p.shape.volume or np.inf, p.name))
    if not parts:
        raise VpframeError("all parts are fixed: there is none to take in hand")
    first: tuple[Part, Way, str] | None = None
    tried = list(dict.fromkeys(part.shape for part in parts))[:PARTS]  # of equal parts the first
    for number, shape in enumerate(tried):
        part = next(p for p in parts if p.shape is shape)
        for way in _ways(scene, part):
            progress(number / len(tried), f"{part.name}: {way.line}")
            reason = _tried(scene, part, way)
            if not reason:
                return part, way, ""
            if first is None or first[1].verb == "pull":  # that there is no axis says less than what stands in the way
                first = (part, way, reason)
            if time.monotonic() - began > SECONDS:
                return first
    assert first is not None
    return first


def _ways(scene: Scene, part: Part) -> Iterator[Way]:
    far = _rounded(1.2 * sum(half_size(p.mesh) for p in {q.shape: q for q in (part, _largest(scene))}.values()))
    if len(scene) > 1:
        yield Way("pull", "axis", (("until", "free"),))
    for direction in ("up", "down", "x", "-x", "y", "-y"):
        yield Way("slide", direction, (("distance", far),))


def _largest(scene: Scene) -> Part:
    return max(scene.parts, key=lambda p: half_size(p.mesh))


def _rounded(length: float) -> float:
    """Two digits are enough, m."""
    return float(f"{length:.2g}")


def _tried(scene: Scene, part: Part, way: Way) -> str:
    """Why the task stops; empty when it runs to its end. The scene is as before."""
    before = {name: pin.SE3(p.pose) for name, p in scene.items()}
    try:
        with Session(scene) as session:
            hand = session.hand()
            hand.grab(part.name)
            way.go(hand)
            hand.release()
            session.expect_free(part.name)
    except TaskError as error:
        return " ".join(str(error).split())
    finally:
        for name, pose in before.items():
            scene[name].pose = pose
    return ""


def quoted(text: str) -> str:
    """As a Python string in double quotes."""
    return plain(json.dumps(text, ensure_ascii=False))


def _in_docstring(text: str) -> str:
    """As it can stand between three double quotes."""
    return quoted(text)[1:-1]


_STOPS = """    # as it stands this stops: {reason}
    # give another direction, or take out first what is in the way
"""
_TEMPLATE = '''"""A first task on {model}: take one part out."""

import vpframe as vp

FILE = {file}

# The parts of the model (lengths in scripts are metres):
{parts}


def task(session):
    hand = session.hand()
    hand.grab({part})
{note}    {way}
    hand.release()
    session.expect_free({part})


if __name__ == "__main__":
    vp.main(__file__)
'''
