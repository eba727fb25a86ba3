"""The session suite: seconds a whole step of a session, beside coal's bare answer about the parts that moved.

A hand holds a part (with what it carries) and goes 2 mm out and back, rest to rest, so that all stays near. A step is
all that a session does: the hand's way, contacts, recognition, constrained motion, events. The peer is coal alone in
the same run at the same poses: all contacts of the moved parts with those whose boxes overlap theirs, the boxes chosen
outside the clock. Cases of real models need VPFRAME_DATA.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

import vpframe as vp
from vpframe.app.progress import report
from vpframe.hands.paths import smooth
from vpframe.scene import modelling as m

STAGES = ("motion", "collision", "constraints", "physics", "observers")
CARRIED, WHOLE = "board lifted with its 63 components", "one part of as many triangles"
METALS = {"plate": (0.6, 0.6, 0.65), "bolt": (0.8, 0.7, 0.3)}


@dataclass(frozen=True)
class Case:
    """A scene, the part that the hand holds, what it carries, and the way out (m, world) and back."""

    name: str
    scene: Callable[[], vp.Scene]
    part: str
    way: tuple[float, float, float]
    carry: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class OutAndBack:
    """To `start` + `way` and back to `start` in `duration` s."""

    start: pin.SE3
    way: tuple[float, float, float]
    duration: float

    def pose(self, t: float) -> pin.SE3:
        """World pose at `t` s."""
        share = smooth(2.0 * t / self.duration) - smooth(2.0 * t / self.duration - 1.0)
        return pin.SE3(self.start.rotation, self.start.translation + share * np.array(self.way))


def cases() -> Iterator[Case]:
    """The project's own scenes, then those of VPFRAME_DATA."""
    yield Case("shaft drawn out of its bore", shaft_in_bore, "shaft", (0.0, 0.0, 0.002))
    bolts = tuple(f"bolt_{k}" for k in range(20))
    yield Case("cover lifted with its 20 bolts", bolted_cover, "cover", (0.0, 0.0, 0.002), bolts)
    yield Case("one of 200 parts", crowd, "block_105", (0.0, 0.0, 0.002))
    chips = tuple(f"board/chip_{k}" for k in range(63))
    yield Case(CARRIED, lambda: board(64), "board/plate", (0.0, 0.0, 0.002), chips)
    yield Case(WHOLE, lambda: board(64, whole=True), "board", (0.0, 0.0, 0.002))
    folder = os.environ.get("VPFRAME_DATA")
    if not folder:
        return
    as1 = Path(folder) / "step" / "as1-oc-214.stp"
    bracket = "l-bracket-assembly_1/"
    screws = tuple(f"{bracket}nut-bolt-assembly_{k}/{name}" for k in (1, 2, 3) for name in ("bolt_1", "nut_3"))
    yield Case("AS1: nut in hand", lambda: vp.load(as1), "rod-assembly_1/nut_2", (-0.002, 0.0, 0.0))
    nuts = ("rod-assembly_1/nut_1", "rod-assembly_1/nut_2")
    yield Case("AS1: rod with both nuts", lambda: vp.load(as1), "rod-assembly_1/rod_1", (0.0, 0.0, 0.002), nuts)
    yield Case("AS1: l-bracket", lambda: vp.load(as1), f"{bracket}l-bracket_1", (0.0, 0.0, 0.002))
    yield Case(
        "AS1: l-bracket with its screws", lambda: vp.load(as1), f"{bracket}l-bracket_1", (0.0, 0.0, 0.002), screws
    )
    head = Path(folder) / "step" / "um2_head.step"
    fan = "1313-Z1P-A_1/Fan "
    yield Case(
        "print head: fan with its rotor",
        lambda: vp.load(head),
        f"{fan}Base 30x30",
        (-0.002, 0.0, 0.0),
        (f"{fan}Rotor 30x30",),
    )


def shaft_in_bore() -> vp.Scene:
    """The demo's housing and shaft, the shaft in its seat."""
    from tempfile import TemporaryDirectory

    from vpframe.app import demo

    with TemporaryDirectory() as folder:
        scene = vp.load(demo.build(Path(folder) / demo.MODEL))
    scene["shaft"].pose = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.045]))
    scene["housing"].fixed = True
    return scene


def bolted_cover() -> vp.Scene:
    """A cover on a housing, twenty bolts through both around the rim."""
    angles = 2.0 * np.pi * np.arange(20) / 20
    holes = [(0.08 * np.cos(a), 0.08 * np.sin(a)) for a in angles]
    housing, cover = m.cylinder(0.1, 0.03), m.cylinder(0.1, 0.008)
    for x, y in holes:
        housing = housing - m.cylinder(0.003, 0.03).translated(x, y, 0.0)
        cover = cover - m.cylinder(0.0032, 0.008).translated(x, y, 0.0)
    bolt = m.cylinder(0.00295, 0.02).translated(0.0, 0.0, -0.02) + m.hexagon(0.01, 0.004)
    parts = {
        "housing": (housing, _at(0.0, 0.0, 0.0), METALS["plate"]),
        "cover": (cover, _at(0.0, 0.0, 0.03), METALS["plate"]),
    }
    parts |= {f"bolt_{k}": (bolt, _at(x, y, 0.038), METALS["bolt"]) for k, (x, y) in enumerate(holes)}
    scene = m.scene(parts)
    scene["housing"].fixed = True
    return scene


def board(parts: int, side: int = 8, whole: bool = False) -> vp.Scene:
    """A base plate, and on it a board with parts - 1 components in a grid, each pushed into the board with two pins.

    whole: the board and its components are one part, the components 5 mm above the board so that no face is lost.
    """
    chip = m.box(0.006, 0.006, 0.003) + m.cylinder(0.0005, 0.002).translated(0.002, 0.003, -0.002)
    chip = chip + m.cylinder(0.0005, 0.002).translated(0.004, 0.003, -0.002)
    plate = m.box(0.01 * side, 0.01 * side, 0.002)
    places = [(0.002 + 0.01 * (k % side), 0.002 + 0.01 * (k // side)) for k in range(parts - 1)]
    for x, y in places:
        for dx in (0.002, 0.004):
            plate = plate - m.cylinder(0.0005, 0.002).translated(x + dx, y + 0.003)
    made = {"base": m.box(0.2, 0.2, 0.01).translated(-0.05, -0.05, -0.02)}
    if whole:
        for x, y in places:
            plate = plate + chip.translated(x, y, 0.007)
        scene = m.scene({**made, "board": plate})
        scene["base"].fixed = True
        return scene
    made["board/plate"] = plate
    made |= {f"board/chip_{k}": (chip, pin.SE3(np.eye(3), np.array([x, y, 0.002]))) for k, (x, y) in enumerate(places)}
    scene = m.scene(made)
    scene["base"].fixed = True
    return scene


def crowd() -> vp.Scene:
    """200 blocks on a plate, 5 mm apart."""
    block = m.box(0.02, 0.02, 0.02) - m.cylinder(0.005, 0.02).translated(0.01, 0.01, 0.0)
    places = [(0.025 * (k % 20), 0.025 * (k // 20)) for k in range(200)]
    parts = {"plate": (m.box(0.5, 0.25, 0.01).translated(0.0, 0.0, -0.01), _at(0.0, 0.0, 0.0), METALS["plate"])}
    parts |= {f"block_{k}": (block, _at(x, y, 0.0), METALS["bolt"]) for k, (x, y) in enumerate(places)}
    scene = m.scene(parts)
    scene["plate"].fixed = True
    return scene


def _at(x: float, y: float, z: float) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([x, y, z]))


def measure(case: Case, count: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Median seconds a step (of `count`), by stage and in all, and coal's at the same poses."""
    scene = case.scene()
    with vp.Session(scene) as session:
        hand = session.hand()
        hand.grab(case.part, carry=case.carry)
        moved = [scene.index(name) for name in (case.part, *case.carry)]
        path = OutAndBack(scene[case.part].pose.copy(), case.way, count * session.dt)
        seconds, stages, poses = [], [], []
        hand.give = 1.0  # blocked or not, the hand goes on
        step = session.step

        def timed() -> Any:
            began = time.perf_counter()
            frame = step()
            seconds.append(time.perf_counter() - began)
            stages.append([frame.timings[name] for name in STAGES])
            poses.append([part.pose.copy() for part in scene.parts])
            return frame

        session.step = timed  # type: ignore[method-assign]
        hand.follow(path, required=False)
    own = {
        "case": case.name, "method": "vpframe, whole step", "seconds": float(np.median(seconds)), "error": 0.0,
        "unit": "", "n": len(seconds), "stages": dict(zip(STAGES, np.median(stages, axis=0).tolist(), strict=True)),
    }  # fmt: skip
    peer = Bare(scene)
    bare = [peer.query(moved, at) for at in poses[:: max(1, len(poses) // 40)]]
    return own, {
        "case": case.name, "method": "coal, bare answer", "seconds": float(np.median(bare)), "error": 0.0, "unit": "",
        "n": len(bare),
    }  # fmt: skip


class Bare:
    """coal asked for all contacts of the moved parts, one model a part."""

    def __init__(self, scene: vp.Scene) -> None:
        models: dict[int, Any] = {}
        self.surfaces, self.models, self.corners = [], [], []
        for part in scene.parts:
            if id(part.mesh) not in models:
                model = coal.BVHModelOBBRSS()
                model.beginModel(len(part.mesh.triangles), len(part.mesh.vertices))
                model.addVertices(part.mesh.vertices)
                model.addTriangles(part.mesh.triangles.astype(np.int64))
                model.endModel()
                models[id(part.mesh)] = model
            self.models.append(models[id(part.mesh)])
            self.surfaces.append(part.mesh.surface_of_triangle.tolist())
            self.corners.append(part.mesh.vertices)
        self.request = coal.CollisionRequest()
        self.request.num_max_contacts = 1_000_000
        self.request.enable_contact = True
        self.request.gjk_tolerance = 1e-10

    def query(self, moved: list[int], poses: list[pin.SE3]) -> float:
        """Seconds that coal takes."""
        corners = [v @ p.rotation.T + p.translation for v, p in zip(self.corners, poses, strict=True)]
        low, high = np.array([c.min(0) for c in corners]), np.array([c.max(0) for c in corners])
        pairs = [
            (i, j)
            for i in moved
            for j in range(len(poses))
            if j not in moved and (low[i] <= high[j]).all() and (low[j] <= high[i]).all()
        ]
        at = [coal.Transform3s(p.rotation, p.translation) for p in poses]
        began = time.perf_counter()
        for i, j in pairs:
            result = coal.CollisionResult()
            coal.collide(self.models[i], at[i], self.models[j], at[j], self.request, result)
            contacts = [result.getContact(k) for k in range(result.numContacts())]
            {(self.surfaces[i][c.b1], self.surfaces[j][c.b2]) for c in contacts}
        return time.perf_counter() - began


def run(quick: bool = False) -> dict[str, Any]:
    """Rows of every case, and by case how many times coal's time a whole step takes."""
    rows, ratios = [], {}
    every = list(cases())
    for number, case in enumerate(every):
        report(number / len(every), case.name)
        own, bare = measure(case, 60 if quick else 400)
        rows += [own, bare]
        ratios[f"{case.name}: coal / whole step"] = bare["seconds"] / own["seconds"]
    times = {row["case"]: row["seconds"] for row in rows[::2]}
    ratios["64 parts carried / one part of as many triangles"] = times[CARRIED] / times[WHOLE]
    return {"suite": "session", "machine": platform.platform(), "rows": rows, "ratios": ratios}


def table(result: dict[str, Any]) -> str:
    """A line a case: milliseconds by stage and in all, steps a second, coal's milliseconds, and the ratio."""
    lines = [
        f"{'ms a step':<34} "
        + " ".join(f"{s:>11}" for s in STAGES)
        + f"{'all':>9}{'steps/s':>9}{'coal':>9}{'ratio':>8}"
    ]
    for own, bare in zip(result["rows"][::2], result["rows"][1::2], strict=True):
        stages = " ".join(f"{1e3 * own['stages'][s]:11.3f}" for s in STAGES)
        lines.append(
            f"{own['case']:<34} {stages}{1e3 * own['seconds']:9.3f}{1.0 / own['seconds']:9.0f}"
            f"{1e3 * bare['seconds']:9.3f}{bare['seconds'] / own['seconds']:8.2f}"
        )
    return "\n".join(lines)


def plot(result: dict[str, Any], directory: str | Path) -> None:
    """Milliseconds a step by stage, beside coal's bare answer."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(10, 5))
    own, bare = result["rows"][::2], result["rows"][1::2]
    place, base = np.arange(len(own)), np.zeros(len(own))
    for stage in STAGES:
        ms = np.array([1e3 * row["stages"][stage] for row in own])
        axis.barh(place, ms, left=base, label=stage)
        base += ms
    axis.plot([1e3 * row["seconds"] for row in bare], place, "k|", markersize=18, label="coal, bare answer")
    axis.set_yticks(place, [row["case"] for row in own])
    axis.set_xlabel("ms a step")
    axis.legend()
    figure.tight_layout()
    figure.savefig(Path(directory) / "session.png", dpi=150)
    plt.close(figure)
