"""A peg and its block on the workbench, and what a page asks of it."""

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

import vpframe as vp
from vpframe.app.workbench import Workbench
from vpframe.session.requests import Request
from vpframe.session.session import Session


def ask(bench: Workbench, action: str, number: int | None = None, client: int = 1, **given: Any) -> None:
    bench.do(Request(action, number, given, client))


def peg(bench: Workbench) -> np.ndarray:
    return bench.session.scene["peg"].pose.homogeneous


def grab(bench: Workbench, name: str = "peg", client: int = 1) -> None:
    ask(bench, "grab", client=client, part=bench.session.scene.names.index(name), level=0, surface=-1)


def drag(bench: Workbench, *places: tuple[float, float, float], point=(0.0, 0.0, 0.0), free=False, client=1) -> None:
    """A gesture of the mouse: a point of the held part taken to places one after another."""
    bench.hand.held or grab(bench)
    moves = [Request("drag", None, {"point": point, "to": to, "free": free}, client) for to in places]
    bench._requests.extend([*moves[1:], Request("rest", client=client)])
    bench.do(moves[0])
    bench._requests.clear()


def in_bore(bench: Workbench) -> None:
    """The peg in hand, concentric with its bore."""
    grab(bench)
    drag(bench, (0.0, 0.0, 0.0352))
    offer = next(c for c in bench.session.candidates if c.kind == "concentric")
    ask(bench, "accept", offer.id)
    assert [c.kind for c in bench.session.constraints] == ["concentric"]


def replayed(bench: Workbench, model: Path, folder: Path) -> dict[str, np.ndarray]:
    """Poses at the end of the written script, run on a model that is read anew."""
    script = folder / "task.py"
    script.write_text(bench.source(folder))
    module = ModuleType("task")
    exec(compile(script.read_text(), str(script), "exec"), module.__dict__)
    scene = vp.load(folder / module.FILE)
    with Session(scene, **module.OPTIONS) as session:
        module.task(session)
    return {part.name: part.pose.homogeneous for part in scene.parts}
