"""`vpframe demo`: insert a stepped shaft into a bored housing and remove it again."""

from __future__ import annotations

import importlib
import sys
import time
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from vpframe import console, outputs, processes
from vpframe.app import options
from vpframe.app.options import INTERRUPTED
from vpframe.errors import TaskError
from vpframe.outputs import Output, OutputFolder

if TYPE_CHECKING:
    from vpframe.scene.scene import Scene
    from vpframe.session.session import Session
    from vpframe.view.meshcat_viewer import MeshcatViewer

MODEL, RECORDING, REPORT = "shaft_and_housing.step", "demo.rrd", "report"
DATE = "2026-01-01T00:00:00"
"""date in the file of the model: equal files in every run are found in the cache of models"""
_EXPECTED = (6, 2, 1, 2, 6)
_NEEDED_LATER = (
    "vpframe.app.task_runner",
    "vpframe.session.session",
    "vpframe.view.recorder",
    "vpframe.report.writer",
    "vpframe.view.snapshot",
)
_SHOWN = ("grabbed", "released", "recognised", "accepted", "satisfied", "removed", "expectation")


def build(path: Path) -> Path:
    """Write the model as a STEP assembly: a housing with a Ø20.04 mm bore, a stepped shaft with a Ø20 mm journal."""
    from vpframe.scene import modelling as m

    housing = m.box(0.080, 0.080, 0.045).translated(-0.040, -0.040, 0.0) - m.cylinder(0.01002, 0.045)
    for x in (-0.030, 0.030):
        for y in (-0.030, 0.030):
            housing = housing - m.cylinder(0.0033, 0.045).translated(x, y, 0.0)
    housing = housing.filleted(0.008, lambda p: abs(abs(p[0]) - 0.04) < 1e-6 and abs(abs(p[1]) - 0.04) < 1e-6)
    # radius over height: lead-in chamfer, journal, flange, neck, end
    profile = [(0.0, -0.040), (0.0085, -0.040), (0.010, -0.0385), (0.010, 0.0), (0.022, 0.0), (0.022, 0.006)]
    profile += [(0.014, 0.006), (0.014, 0.022), (0.008, 0.022), (0.008, 0.045), (0.0, 0.045)]
    shaft = m.revolve(profile)
    start = pin.SE3(np.eye(3), np.array([0.10, 0.0, 0.045]))
    return m.write_step(
        path,
        {
            "housing": (housing, pin.SE3.Identity(), (0.55, 0.60, 0.66)),
            "shaft": (shaft, start, (0.85, 0.65, 0.25)),
        },
        name="shaft_and_housing",
        date=DATE,
    )


def task(session: Session) -> None:
    """Insert the shaft until its flange is seated, remove it and return it, with expectations at each stage."""
    from vpframe.hands.conditions import constraint

    home = pin.SE3(session.scene["shaft"].pose)
    seat = np.array([0.0, 0.0, 0.045])
    hand = session.hand(at=(0.10, 0.0, 0.12))
    hand.grab("shaft")
    # hands are not exact: 0.15 mm beside the axis, a quarter of a degree off
    tilted = pin.exp3(np.radians([0.25, 0.0, 0.0]))
    hand.move_by((0.0, 0.0, 0.060))
    hand.move_to(pin.SE3(tilted, seat + np.array([0.00015, 0.0, 0.060])), duration=1.5)
    hand.slide("down", until=constraint("concentric", other="housing"))
    session.expect_freedom("shaft", 2)
    hand.slide("down", until=constraint("against", other="housing"))
    session.run(0.2)
    session.expect_constraint("concentric", "shaft", "housing")
    session.expect_constraint("against", "shaft", "housing")
    session.expect_freedom("shaft", 1)
    session.expect_at("shaft", pin.SE3(session.scene["shaft"].pose.rotation, seat), within=1e-6)
    session.expect_no_clash()
    hand.turn(np.pi / 2, about="axis", duration=0.8)
    hand.pull(along="axis", until=~constraint("against"))
    session.expect_freedom("shaft", 2)
    hand.pull(along="axis", until="free")
    session.expect_freedom("shaft", 6)
    hand.move_by((0.0, 0.0, 0.020))
    hand.move_to(home * pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.060])), duration=1.5)
    hand.move_to(home)
    hand.release()


def _checked_task(session: Session) -> None:
    task(session)
    if _freedoms(session) != _EXPECTED:
        raise TaskError(f"expected freedom {_EXPECTED}, found {_freedoms(session)}")


def _freedoms(session: Session) -> tuple[int, ...]:
    """Return the shaft's degrees of freedom, without repetitions."""
    return tuple(n for n, _ in groupby(n for _, n, _ in session.log.freedom.get("shaft", ())))


def load(directory: Path) -> Scene:
    """Build the model and load it as any file: by the STEP reader, or from what the last run left in the cache.

    The CAD kernel builds it in another process while this one imports the modules of session, recording and report;
    imports took half of the time of a warm run.
    """
    path = directory / MODEL
    with processes.start(__name__, str(path)) as building:
        for name in _NEEDED_LATER:
            importlib.import_module(name)
    if building.returncode:
        build(path)  # raises the reason of the failure
    scene = options.load(path)
    scene["housing"].fixed = True
    return scene


def run(out_dir: str | Path, view: bool = False, force: bool = False, wait: bool = False) -> int:
    """Run the demo and write into a folder; return 0 on success, 1 on failure, 130 if interrupted.

    view, wait, force: as in `task_runner.run_task`.
    """
    with (
        OutputFolder(out_dir, {MODEL: outputs.MODEL}, force) as folder,
        Output(folder.path / RECORDING, outputs.RECORDING, force) as recording,
        OutputFolder(folder.path / REPORT, outputs.REPORT_FILES, force) as report,
    ):
        viewer = options.viewer_of(view, wait)
        code = _run(folder, recording, report, viewer)
    if viewer is not None and wait and code != INTERRUPTED:
        viewer.stay()
    return code


def _run(folder: OutputFolder, recording: Output, report: OutputFolder, viewer: MeshcatViewer | None) -> int:
    began = time.perf_counter()
    out = folder.path
    scene = load(out)
    from vpframe.app.task_runner import perform
    from vpframe.session.rules import accept_kinds
    from vpframe.session.session import Session

    surfaces = ", ".join(f"{p.name} ({len(p.surfaces)} surfaces, {p.mesh.n_triangles} triangles)" for p in scene.parts)
    print(f"model      {out / MODEL}: {surfaces}")
    rule = accept_kinds("concentric", "against")
    session = Session(scene, viewer=viewer, record=recording, rule=rule, clearance=True)
    session.on_event(lambda e: console.say(f"{e.time:6.2f} s   {e.kind:<11} {e.text}") if e.kind in _SHOWN else None)
    try:
        code, _ = perform(session, _checked_task)
    finally:
        session.close()
    session.report(report)
    spent = time.perf_counter() - began
    print(f"freedom    of the shaft: {' -> '.join(map(str, _freedoms(session)))}")
    print(f"steps      {session.step_count} of 1/60 s, {spent:.1f} s in all")
    print(f"recording  {out / RECORDING}   look at it: vpframe replay {out / RECORDING}")
    print(f"report     {out / REPORT / 'index.html'}   open it in a browser; numbers in report.json")
    return code


if __name__ == "__main__":
    build(Path(sys.argv[1]))
