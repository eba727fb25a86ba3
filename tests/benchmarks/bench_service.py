"""The service suite: which parts of an assembly leave it straight, under which rule, and how exactly they come back.

Each part, each subassembly, is drawn out along the world's axes and those of its own largest surfaces until one way is
open, by a hand under `leave_all`; then back; then the same way under `accept_all`, the default rule. What has left is
taken away, and what stands behind it is asked. `error` is how far from where it was a part is after both ways (its turn
counted at its size). Cases of real models need VPFRAME_DATA.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

import vpframe as vp
from vpframe.app.progress import report
from vpframe.session.rules import Rule

Array = NDArray[np.float64]
RULES: dict[str, Rule] = {"leave all": vp.leave_all, "accept all": vp.accept_all}
MODELS = ("as1-oc-214.stp", "box_sides.STEP", "v4_engine.step", "um2_head.step")
AXES = tuple(sign * axis for axis in np.eye(3)[::-1] for sign in (1.0, -1.0))
OWN = 3
"""axes of a part's own surfaces that are tried, either way"""
FARTHEST = 0.12
"""m: a part that has come so far is out"""
GIVE = 0.005
"""m: how far a part may stay behind the hand"""


@dataclass(frozen=True)
class Travelled:
    """How one part went out and back under one rule."""

    out: bool
    back: bool
    error: float
    """m, after both"""
    seconds: float
    steps: int
    mates: int
    """that were accepted on the way, and those that were removed"""
    reason: str
    """where it stopped"""


def scenes(quick: bool) -> Iterator[tuple[str, Callable[[], vp.Scene]]]:
    """The session suite's own scenes, then the models of VPFRAME_DATA."""
    import bench_session

    yield "bolted cover", bench_session.bolted_cover
    yield "board of 5", lambda: bench_session.board(6)
    folder = os.environ.get("VPFRAME_DATA")
    for name in MODELS[: 2 if quick else None] if folder else ():
        yield name, lambda name=name: vp.load(Path(str(folder)) / "step" / name)  # type: ignore[misc]


def travel(scene: vp.Scene, unit: tuple[str, ...], way: Array, far: float, rule: Rule) -> Travelled:
    """Take a part, carrying the others of its unit, `far` m along `way` (3,) and back; the scene is left as it was."""
    start = {part.name: pin.SE3(part.pose) for part in scene.parts}
    lead = scene[unit[0]]
    reason = ""
    back, error = False, np.inf
    try:
        with vp.Session(scene, rule=rule) as session:
            hand = session.hand()
            hand.give = GIVE
            hand.grab(unit[0], carry=unit[1:])
            begun, heard, steps = time.perf_counter(), len(session.events), session.step_count
            out = hand.move_by(far * way, required=False)
            reason = out.reason
            if out:
                ended = hand.move_to(start[unit[0]], required=False)
                back, reason = bool(ended), ended.reason
                off = start[unit[0]].actInv(lead.pose)
                size = float(np.ptp(lead.mesh.vertices, axis=0).max())
                error = float(np.linalg.norm(off.translation) + size * np.linalg.norm(pin.log3(off.rotation)))
            mates = sum(event.kind in ("accepted", "removed") for event in session.events[heard:])
            seconds, steps = time.perf_counter() - begun, session.step_count - steps
    finally:
        for name, pose in start.items():
            scene[name].pose = pose
    return Travelled(bool(out), back, error, seconds, steps, mates, reason)


def units(scene: vp.Scene) -> list[tuple[str, ...]]:
    """Each part, and the parts of each innermost subassembly that has several."""
    inside: dict[str, list[str]] = {}
    for name in scene.names:
        inside.setdefault(name.rpartition("/")[0], []).append(name)
    groups = [tuple(names) for folder, names in inside.items() if folder and 1 < len(names) < len(scene)]
    return [(name,) for name in scene.names] + groups


def ways(scene: vp.Scene, unit: tuple[str, ...]) -> list[Array]:
    """(3,) unit directions, world, in which a unit is drawn: the world's axes, then its own."""
    part = scene[unit[0]]
    found = list(AXES)
    for feature in sorted(part.features, key=lambda f: -f.area):
        own = getattr(feature.geometry, "normal", getattr(feature.geometry, "axis", None))
        if own is None or len(found) == len(AXES) + 2 * OWN:
            continue
        axis = part.pose.rotation @ own
        if all(abs(axis @ known) < 1.0 - 1e-6 for known in found):
            found += [axis, -axis]
    return found


def clear(scene: vp.Scene, unit: tuple[str, ...], way: Array) -> float:
    """m along `way` after which no box of the others is beside the unit, at most `FARTHEST`."""

    def heights(part: vp.Part) -> Array:
        return np.asarray((part.mesh.vertices @ part.pose.rotation.T + part.pose.translation) @ way)

    low = min(heights(scene[name]).min() for name in unit)
    high = max(heights(part).max() for part in scene.parts if part.name not in unit)
    return float(np.clip(high - low + 0.005, 0.005, FARTHEST))


def measure(scene: vp.Scene) -> Iterator[tuple[tuple[str, ...], Array, dict[str, Travelled]]]:
    """Each unit that leaves straight, in rounds: its way, and how it went under each rule."""
    while len(scene) > 1:
        gone: set[str] = set()
        for unit in units(scene):
            if gone.intersection(unit) or any(scene[name].fixed for name in unit):
                continue
            for way in ways(scene, unit):
                far = clear(scene, unit, way)
                free = travel(scene, unit, way, far, RULES["leave all"])
                if not free.out:
                    continue
                yield unit, way, {"leave all": free, "accept all": travel(scene, unit, way, far, RULES["accept all"])}
                gone.update(unit)
                break
        left = [part for part in scene.parts if part.name not in gone]
        if not gone or len(left) < 2:
            return
        scene = vp.Scene(left)


def run(quick: bool = False) -> dict[str, Any]:
    """A row a unit and rule; by model, how many leave, and how many of these come back under each rule."""
    rows, ratios = [], {}
    for model, load in scenes(quick):
        report(None, model)
        found = list(measure(load()))
        for unit, way, by_rule in found:
            along = ", ".join(f"{x + 0.0:.3g}" for x in np.round(way, 3))
            for rule, went in by_rule.items():
                rows.append(
                    {
                        "case": f"{model}: {' + '.join(unit)} along ({along})", "method": rule,
                        "seconds": went.seconds / max(went.steps, 1), "error": went.error, "unit": "m",
                        "n": went.steps, "out": went.out, "back": went.back, "mates": went.mates,
                        "reason": went.reason,
                    }
                )  # fmt: skip
        for rule in RULES:
            exact = sum(by_rule[rule].back and by_rule[rule].error < 1e-6 for _, _, by_rule in found)
            ratios[f"{model}: back within 1 µm, {rule}"] = exact / max(len(found), 1)
    return {"suite": "service", "machine": platform.platform(), "rows": rows, "ratios": ratios}


def table(result: dict[str, Any]) -> str:
    """A line a unit and rule."""
    lines = [f"{'out and back':<70} {'rule':<11}{'out':>4}{'back':>5}{'error':>11}{'mates':>6}{'ms/step':>9}"]
    for row in result["rows"]:
        said = [("no", "yes")[row[key]] for key in ("out", "back")]
        error = f"{1e6 * row['error']:.3g} µm" if np.isfinite(row["error"]) else "-"
        lines.append(
            f"{row['case'][-70:]:<70} {row['method']:<11}{said[0]:>4}{said[1]:>5}{error:>11}{row['mates']:6}"
            f"{1e3 * row['seconds']:9.1f}" + ("" if row["back"] else f"  {row['reason']}")
        )
    return "\n".join([*lines, "", *(f"{name}: {value:.0%}" for name, value in result["ratios"].items())])


def plot(result: dict[str, Any], directory: str | Path) -> None:
    """The error of each way back, by rule."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(8, 4))
    for rule in RULES:
        errors = sorted(max(row["error"], 1e-18) for row in result["rows"] if row["method"] == rule)
        axis.plot(errors, ".", label=rule)
    axis.axhline(1e-6, color="k", linewidth=0.5)
    axis.set_yscale("log")
    axis.set_ylabel("m from where it was")
    axis.legend()
    figure.tight_layout()
    figure.savefig(Path(directory) / "service.png", dpi=150)
    plt.close(figure)
