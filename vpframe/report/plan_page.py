"""The page of a plan: a picture a step, what has to go before what, what may go side by side, and an exploded view."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pinocchio as pin

from vpframe.planning.certify import PartTrack
from vpframe.planning.document import headline, ignores, overlaps_by_parts, reason, unsupported
from vpframe.planning.plan import Disassembly, PlannedStep
from vpframe.report import plots
from vpframe.scene.scene import Scene
from vpframe.scene.subassembly import listed
from vpframe.text import escape, rendered
from vpframe.view.camera import Camera, look_at
from vpframe.view.snapshot import Look, png, render

SIZE = (480, 360)
PICTURES = 60
"""steps that are drawn at most"""
GONE = 0.0
FAINT = 0.35
"""opacity of parts that are still there, beside those that come out"""
ROW, WIDTH = 20, 860


def html(
    plan: Disassembly, scene: Scene, title: str, progress: Callable[[float | None, str], None] = lambda f, t: None
) -> str:
    """The whole page; one file without outside parts."""
    steps = []
    for n, step in enumerate(plan.steps[:PICTURES]):
        progress(n / max(1, len(plan.steps)), "pictures")
        caption = f"{n + 1}: {listed(step.parts)}, {step.way.text}{ignores(step.clearance, plan.names)}"
        steps.append((_step_picture(scene, step, gone(plan, n)), caption))
    return rendered(
        "report/plan.html",
        title=title,
        headline=headline(plan),
        good=plan.verdict == "removable",
        facts=[
            ("steps", str(len(plan.steps))),
            ("levels", str(len(plan.levels))),
            ("stays", listed(plan.base)),
            ("fewest", f"of {plan.scope}" if plan.proven else "not proven" if plan.target else "only with --part"),
        ],
        exploded=exploded(scene, plan) if plan.steps else None,
        steps=steps,
        precedence=_precedence(plan),
        lanes=_lanes(plan),
        unsupported=unsupported(plan),
        stuck=[(name, reason(plan.stuck[name])) for name in plan.remaining],
        press_fits=plan.press_fits,
        overlaps=[
            (a, b, f"{depths[0] * 1e3:.3f} mm", len(depths)) for (a, b), depths in overlaps_by_parts(plan).items()
        ],
    )


def exploded(scene: Scene, plan: Disassembly) -> bytes:
    """PNG: every part some way along its way out, those of higher levels, and of the same way, farther."""
    poses = {}
    count = max((step.level for step in plan.steps), default=0) + 1
    for step in plan.steps:
        share = 0.35 + 0.55 * (count - step.level) / count
        for name in step.parts:
            poses[name] = _along(step.tracks[name], share)
    return png(render(scene, poses, size=(960, 720), camera=_camera(scene, poses)))


def gone(plan: Disassembly, n: int) -> set[str]:
    """Parts that are gone before step n; those of a group that it takes apart stand together again."""
    mine, out = set(plan.steps[n].parts), set[str]()
    for step in plan.steps[:n]:
        parts = set(step.parts)
        out = out - parts if mine < parts else out | parts
    return out


def _step_picture(scene: Scene, step: PlannedStep, gone: set[str]) -> bytes:
    poses = {name: _along(track, 0.6) for name, track in step.tracks.items()}
    opacity = {name: GONE if name in gone else 1.0 if name in step.parts else FAINT for name in scene.names}
    there = {name: poses.get(name, part.pose) for name, part in scene.items() if name not in gone}
    return png(render(scene, poses, size=SIZE, camera=_camera(scene, there), look=Look(opacity)))


def _along(track: PartTrack, share: float) -> pin.SE3:
    k = int(np.searchsorted(track.times, share * track.times[-1]))
    return _between(track, min(k, len(track.poses) - 1), share)


def _between(track: PartTrack, k: int, share: float) -> pin.SE3:
    if k == 0:
        return track.poses[0]
    t = share * float(track.times[-1])
    first, last = float(track.times[k - 1]), float(track.times[k])
    return pin.SE3.Interpolate(track.poses[k - 1], track.poses[k], min(1.0, (t - first) / (last - first)))


def _camera(scene: Scene, poses: Mapping[str, pin.SE3]) -> Camera:
    points = [
        part.mesh.vertices @ poses.get(name, part.pose).rotation.T + poses.get(name, part.pose).translation
        for name, part in scene.items()
    ]
    return look_at(np.concatenate(points))


def _precedence(plan: Disassembly) -> str:
    """SVG: a column a level, a line from each part to those that wait for it; implied lines left out."""
    if not plan.steps:
        return ""
    place: dict[str, tuple[float, float]] = {}
    columns = plan.levels
    wide = max(120.0, (WIDTH - 20) / len(columns))
    body = []
    for k, names in enumerate(columns):
        for r, name in enumerate(names):
            place[name] = 10.0 + k * wide, 12.0 + ROW * (r + 1)
    before = plan.precedence
    drawn = [(a, b) for b in before for a in before[b] if a in place and not _implied(before, a, b)]
    for a, b in drawn:
        (x, y), (u, v) = place[a], place[b]
        start = x + min(wide - 24.0, 6.2 * len(_short(a)) + 6.0)
        body.append(
            f'<path d="M{start:.0f} {y - 4:.0f} C{start + 30:.0f} {y - 4:.0f} {u - 34:.0f} {v - 4:.0f} {u - 4:.0f} '
            f'{v - 4:.0f}" fill="none" stroke="#9aa5b5"/>'
        )
    for name, (x, y) in place.items():
        label = escape(_short(name))
        body.append(f'<text x="{x:.0f}" y="{y:.0f}">{label}<title>{escape(name)}</title></text>')
    height = 24 + ROW * max(map(len, columns))
    width = 20.0 + wide * len(columns)
    return f'<svg viewBox="0 0 {width:.0f} {height}" role="img">{"".join(body)}</svg>'


def _implied(before: Mapping[str, tuple[str, ...]], a: str, b: str) -> bool:
    """Whether a has to go before something else that has to go before b."""
    return any(a in before.get(c, ()) for c in before[b] if c != a)


def _short(name: str) -> str:
    tail = name.rsplit("/", 1)[-1]
    return tail if len(tail) <= 24 else tail[:23] + "…"


def _lanes(plan: Disassembly) -> str:
    """SVG: a lane a part; each level begins when the slowest way of the one before has ended."""
    seconds = [
        max(float(t.times[-1]) for s in plan.steps if s.level == k for t in s.tracks.values())
        for k in range(len(plan.levels))
    ]
    start = np.concatenate([[0.0], np.cumsum(seconds)])
    lanes = {
        name: [(f"level {step.level + 1}", start[step.level], start[step.level] + float(step.tracks[name].times[-1]))]
        for step in plan.steps
        for name in step.parts
    }
    return plots.spans(lanes, float(start[-1]))
