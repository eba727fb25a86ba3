"""The service suite: which parts of an assembly leave it straight, under which rule, and how exactly they come back.

Each part, each subassembly, is drawn out along the world's axes and those of its own largest surfaces until one way is
open and the part strays from it by no more than `STRAY`, by a hand under `leave_all`; then back along the poses it had;
then the same way under `accept_all`, the default rule, where mates may take it aside until they let go. What has left
is taken away, and what stands behind it is asked; a way is asked again once a part that stopped it there has left.
`error` is how far from where it was a part is after both ways (its turn counted at its size). Cases of real models need
VPFRAME_DATA; `--only` takes some models.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from bench_run import chosen
from numpy.typing import NDArray

import vpframe as vp
from vpframe.app.progress import report
from vpframe.hands import paths
from vpframe.session.rules import Rule

Array = NDArray[np.float64]
RULES: dict[str, Rule] = {"leave all": vp.leave_all, "accept all": vp.accept_all}
MODELS = (
    "as1-oc-214.stp", "box_sides.STEP", "v4_engine.step", "um2_head.step", "bearing_20x37x9.stp",
    "bdw_taper_bearing.step", "caxif_dm1-oc-214.stp", "as1_pe_203.stp",
)  # fmt: skip
AXES = tuple(sign * axis for axis in np.eye(3)[::-1] for sign in (1.0, -1.0))
OWN = 3
"""axes of a part's own surfaces that are tried, either way"""
FARTHEST = 0.12
"""m: a part that has come so far, and as far as it is long, is out"""
STRAY = 1e-3
"""m: how far beside its way a part may come (its turn counted at its size)"""
GIVE = 0.01
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
    along: tuple[str, ...]
    """mates along which it slid until their surfaces parted: kind and other part"""
    stray: float
    """m: how far beside its way it came"""
    reason: str
    """where it stopped"""


def scenes(quick: bool) -> dict[str, Callable[[], vp.Scene]]:
    """The session suite's own scenes, then the models of VPFRAME_DATA, by name."""
    import bench_session

    out: dict[str, Callable[[], vp.Scene]] = {
        "bolted cover": bench_session.bolted_cover, "board of 5": lambda: bench_session.board(6)
    }  # fmt: skip
    folder = os.environ.get("VPFRAME_DATA")
    for name in MODELS[: 2 if quick else None] if folder else ():
        out[name] = lambda name=name: vp.load(Path(str(folder)) / "step" / name)  # type: ignore[misc]
    return out


def travel(session: vp.Session, unit: tuple[str, ...], way: Array, far: float) -> Travelled:
    """Take a part in hand, carrying the others of its unit, `far` m along `way` (3,) and back."""
    hand, lead = session.hand(), session.scene[unit[0]]
    start, size = pin.SE3(lead.pose), float(np.ptp(lead.mesh.vertices, axis=0).max())
    back, error = False, np.inf
    begun, heard, steps = time.perf_counter(), len(session.events), session.step_count
    known = len(session.trail(lead.name))
    ended = hand.move_by(far * way, required=False)
    out, reason = bool(ended), ended.reason
    poses = [start, *(pose for _, pose in session.trail(lead.name)[known:])]
    stray = max(_beside(start, pose, way, size) for pose in poses)
    if out:
        track = paths.Track(session.dt * np.arange(len(poses), dtype=np.float64), poses[::-1])
        ended = hand.follow(track, required=False)
        back, reason = bool(ended), ended.reason
        off = start.actInv(lead.pose)
        error = float(np.linalg.norm(off.translation) + size * np.linalg.norm(pin.log3(off.rotation)))
    events = session.events[heard:]
    mates = sum(event.kind in ("accepted", "removed") for event in events)
    along = sorted(
        {
            f"{event.data['constraint']} ({next(name for name in event.parts if name not in unit)})"
            for event in events
            if event.kind == "removed" and "no longer overlap" in event.text
        }
    )
    seconds, steps = time.perf_counter() - begun, session.step_count - steps
    return Travelled(out, back, error, seconds, steps, mates, tuple(along), stray, reason)


def _beside(start: pin.SE3, pose: pin.SE3, way: Array, size: float) -> float:
    """m: how far a pose is beside the straight way (3,) from `start`, its turn counted at `size`."""
    shift = pose.translation - start.translation
    turned = pin.log3(start.rotation.T @ pose.rotation)
    return float(np.linalg.norm(shift - (shift @ way) * way) + size * np.linalg.norm(turned))


class Trials:
    """A session under one rule, in which units are taken in hand and go ways, each as if nothing had been before.

    A scene has one session at a time.
    """

    def __init__(self, scene: vp.Scene, rule: Rule) -> None:
        self.session = vp.Session(scene, rule=rule)
        self.session.hand().give = GIVE
        self._begun = self.session.mark()
        self._held: tuple[str, ...] = ()
        self._ready = self._begun

    def travel(self, unit: tuple[str, ...], way: Array, far: float) -> Travelled:
        """See `travel`."""
        if unit != self._held:
            self.session.undo(self._begun)
            self.session.hand().grab(unit[0], carry=unit[1:])
            self._held, self._ready = unit, self.session.mark()
        try:
            return travel(self.session, unit, way, far)
        finally:
            self.session.undo(self._ready)

    def __enter__(self) -> Trials:
        return self

    def __exit__(self, *error: object) -> None:
        """Leave the scene as it was."""
        self.session.undo(self._begun)
        self.session.close()


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
    """m along `way` after which no box of the others is beside the unit; `FARTHEST` or the unit's length is enough.

    Beyond `Tolerance.break_distance`, up to which a mate holds a part against a pull.
    """

    def heights(part: vp.Part) -> Array:
        return np.asarray((part.mesh.vertices @ part.pose.rotation.T + part.pose.translation) @ way)

    own = np.concatenate([heights(scene[name]) for name in unit])
    high = max(heights(part).max() for part in scene.parts if part.name not in unit)
    most = max(FARTHEST, float(np.ptp(own)))
    return float(np.clip(high - own.min() + 0.005, 2.0 * vp.Tolerance().break_distance, most))


def measure(scene: vp.Scene) -> Iterator[tuple[tuple[str, ...], Array, dict[str, Travelled]]]:
    """Each unit that leaves straight, in rounds: its way, and how it went under each rule."""
    stopped: dict[tuple[tuple[str, ...], int], set[str]] = {}  # by unit and way: parts that stood in it
    while len(scene) > 1:
        gone: set[str] = set()
        out: list[tuple[tuple[str, ...], Array, float, Travelled]] = []
        with Trials(scene, RULES["leave all"]) as trials:
            for unit in units(scene):
                if gone.intersection(unit) or any(scene[name].fixed for name in unit):
                    continue
                for k, way in enumerate(ways(scene, unit)):
                    if (by := stopped.get((unit, k))) and by <= set(scene.names):
                        continue
                    far = clear(scene, unit, way)
                    free = trials.travel(unit, way, far)
                    if free.out and free.stray <= STRAY:
                        out.append((unit, way, far, free))
                        gone.update(unit)
                        break
                    stopped[unit, k] = {name for name in scene.names if name not in unit and name in free.reason}
        with Trials(scene, RULES["accept all"]) as trials:
            for unit, way, far, free in out:
                yield unit, way, {"leave all": free, "accept all": trials.travel(unit, way, far)}
        left = [part for part in scene.parts if part.name not in gone]
        if not gone or len(left) < 2:
            return
        scene = vp.Scene(left)


def run(quick: bool = False, only: Sequence[str] = ()) -> dict[str, Any]:
    """A row a unit and rule; by model, how many leave, and how many of these come back under each rule."""
    rows, ratios = [], {}
    for model, load in chosen(scenes(quick), only).items():
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
                        "along": went.along, "stray": went.stray, "reason": went.reason,
                    }
                )  # fmt: skip
        ratios[f"{model}: units that leave straight"] = len(found)
        slid = (by_rule["accept all"].along for _, _, by_rule in found)
        ratios[f"{model}: mates slid along"] = sum(map(len, slid))
        for rule in RULES:
            ratios[f"{model}: leave, {rule}"] = sum(by_rule[rule].out for _, _, by_rule in found)
            exact = sum(by_rule[rule].back and by_rule[rule].error < 1e-6 for _, _, by_rule in found)
            ratios[f"{model}: back within 1 µm, {rule}"] = exact
    return {"suite": "service", "machine": platform.platform(), "rows": rows, "ratios": ratios}


def table(result: dict[str, Any]) -> str:
    """A line a unit and rule."""
    lines = [f"{'out and back':<70} {'rule':<11}{'out':>4}{'back':>5}{'error':>11}{'mates':>6}{'ms/step':>9}"]
    for row in result["rows"]:
        said = [("no", "yes")[row[key]] for key in ("out", "back")]
        error = f"{1e6 * row['error']:.3g} µm" if np.isfinite(row["error"]) else "-"
        lines.append(
            f"{row['case'][-70:]:<70} {row['method']:<11}{said[0]:>4}{said[1]:>5}{error:>11}{row['mates']:6}"
            f"{1e3 * row['seconds']:9.1f}  " + (", ".join(row["along"]) if row["back"] else row["reason"])
        )
    return "\n".join([*lines, "", *(f"{name}: {value:g}" for name, value in result["ratios"].items())])


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
