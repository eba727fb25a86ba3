"""Recognition against known truth: precision and recall over noise in pose, over deflection, and on real models.

Families of generated assemblies whose mates are known by construction (shafts, keys, bolted flanges, ball joints,
hinges, gears); AS1, the Factory peg in its hole and the M16 nut on its bolt, where VPFRAME_DATA names the folder of
real models. The strawman "boxes" takes every two faces whose boxes overlap for touching.
"""

from __future__ import annotations

import os
import platform
import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import vpframe as vp
from collision import CONTACT_DTYPE, CollisionManager, Tolerance
from constraints import ConstraintManager, Motion, recognise
from constraints.geometry.surfaces import Cylinder
from constraints.recognition.recognise import contacts_within
from vpframe.analysis.static import base_parts, threaded_features
from vpframe.scene import modelling as m

Truth = Counter[tuple[str, str, str]]
Family = Callable[[np.random.Generator], tuple[dict[str, Any], Truth]]

NOISE = (0.0, 0.1, 0.25, 0.5, 1.0)
"""mm and degrees: greatest shift and turn of each part"""
DEFLECTION = (1e-5, 5e-5, 2e-4)
"""m"""
EXACT = replace(Tolerance(), reach=0.0, reach_angular=0.0)
NEAR = Tolerance()
WIDE = replace(Tolerance(), reach=2.5e-3, reach_angular=0.05)


def truth(*mates: tuple[str, str, str]) -> Truth:
    """A multiset of (kind, part, part), parts in alphabetical order."""
    return Counter((kind, *sorted(parts)) for kind, *parts in mates)


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([x, y, z]))


def shafts(rng: np.random.Generator) -> tuple[dict[str, Any], Truth]:
    """A stepped shaft in a stepped bore, seated on the shoulder."""
    r, clearance = rng.uniform(0.005, 0.015), rng.choice([0.0, 1e-5, 2e-5, 5e-5])
    big, length, flange = 1.5 * r, rng.uniform(0.02, 0.04), 0.015
    shaft = m.cylinder(r, length) + m.cylinder(big, flange).translated(z=length)
    housing = m.cylinder(3 * r, length + 0.01)
    housing = housing - m.cylinder(r + clearance, length) - m.cylinder(big + clearance, 0.01).translated(z=length)
    mates = truth(
        ("concentric", "housing", "shaft"), ("concentric", "housing", "shaft"), ("against", "housing", "shaft")
    )
    return {"housing": housing, "shaft": shaft}, mates


def keys(rng: np.random.Generator) -> tuple[dict[str, Any], Truth]:
    """A parallel key between shaft and hub."""
    r, width = rng.uniform(0.009, 0.014), rng.choice([0.005, 0.006, 0.008])
    low, high = r - 0.6 * width, r + 0.4 * width
    slot = m.box(width, high - low, 0.02).translated(-width / 2, low, 0.01)
    shaft = m.cylinder(r, 0.06) - m.box(width, r, 0.024).translated(-width / 2, low, 0.008)
    hub = m.cylinder(2.2 * r, 0.03) - m.cylinder(r, 0.03) - m.box(width, high, 0.03).translated(-width / 2, 0.0, 0.0)
    mates = [("concentric", "hub", "shaft")] + [("against", "key", "shaft")] * 3 + [("against", "hub", "key")] * 3
    return {"shaft": shaft, "hub": (hub, at(z=0.005)), "key": slot}, truth(*mates)


def flanges(rng: np.random.Generator) -> tuple[dict[str, Any], Truth]:
    """Two round flanges held by bolts."""
    n, r, clearance = int(rng.integers(3, 7)), rng.uniform(0.003, 0.005), rng.choice([0.0, 5e-5, 1e-4])
    circle = 8 * r
    flange = m.cylinder(circle + 3 * r, 0.01)
    places = [(circle * np.cos(a), circle * np.sin(a)) for a in 2 * np.pi * np.arange(n) / n]
    for x, y in places:
        flange = flange - m.cylinder(r + clearance, 0.01).translated(x, y)
    bolt = m.cylinder(r, 0.03) + m.hexagon(3.2 * r, 0.7 * r).translated(z=0.03)
    parts: dict[str, Any] = {"base": flange, "cover": (flange, at(z=0.01))}
    mates = [("against", "base", "cover")]
    for k, (x, y) in enumerate(places):
        parts[f"bolt {k}"] = (bolt, at(x, y, -0.01))
        mates += [("concentric", "base", f"bolt {k}"), ("concentric", f"bolt {k}", "cover")]
        mates += [("against", f"bolt {k}", "cover")]
    return parts, truth(*mates)


def balls(rng: np.random.Generator) -> tuple[dict[str, Any], Truth]:
    """A ball joint whose socket reaches past the equator."""
    r = rng.uniform(0.006, 0.015)
    socket = m.box(4 * r, 4 * r, 2.3 * r).translated(-2 * r, -2 * r, -2 * r) - m.sphere(r + rng.choice([0.0, 2e-5]))
    stud = m.sphere(r) + m.cylinder(0.4 * r, 3 * r)
    return {"socket": socket, "stud": stud}, truth(("spherical", "socket", "stud"))


def hinges(rng: np.random.Generator) -> tuple[dict[str, Any], Truth]:
    """Two leaves with a knuckle each, on one pin."""
    r, h = rng.uniform(0.002, 0.004), rng.uniform(0.01, 0.02)
    bore = m.cylinder(r + rng.choice([0.0, 2e-5]), h)
    leaf = m.cylinder(2 * r, h) + m.box(10 * r, 2 * r, h).translated(0, -r, 0) - bore
    other = m.cylinder(2 * r, h) + m.box(10 * r, 2 * r, h).translated(-10 * r, -r, 0) - bore
    pin_ = m.cylinder(r, 2 * h)
    mates = truth(("concentric", "leaf", "pin"), ("concentric", "other", "pin"), ("against", "leaf", "other"))
    return {"leaf": leaf, "other": (other, at(z=h)), "pin": pin_}, mates


def gears(rng: np.random.Generator) -> tuple[dict[str, Any], Truth]:
    """Two wheels as pitch cylinders that roll on one another, on two studs of a plate."""
    a, b, r = rng.uniform(0.012, 0.02), rng.uniform(0.02, 0.03), 0.004
    plate = m.box(0.16, 0.08, 0.01).translated(-0.05, -0.04, -0.01) + m.cylinder(r, 0.015)
    plate = plate + m.cylinder(r, 0.015).translated(x=a + b)
    first, second = (m.cylinder(q, 0.008) - m.cylinder(r, 0.008) for q in (a, b))
    mates = [(kind, "plate", wheel) for kind in ("concentric", "against") for wheel in ("first", "second")]
    parts = {"plate": plate, "first": first, "second": (second, at(x=a + b))}
    return parts, truth(*mates, ("tangent", "first", "second"))


FAMILIES: dict[str, Family] = {
    "shafts": shafts, "keys": keys, "flanges": flanges, "ball joints": balls, "hinges": hinges, "gears": gears,
}  # fmt: skip


def shaken(scene: vp.Scene, noise: float, rng: np.random.Generator) -> list[pin.SE3]:
    """Poses with every part but the first off by up to `noise` mm and degrees, about its own centre."""
    poses = []
    for i, part in enumerate(scene.parts):
        way, axis = rng.normal(size=(2, 3))
        way, axis = way / np.linalg.norm(way), axis / np.linalg.norm(axis)
        size = noise * rng.uniform(0.0, 1.0, 2) if i else np.zeros(2)
        turn = pin.exp3(np.radians(size[1]) * axis)
        center = part.pose.act(np.asarray(part.shape.center))
        move = pin.SE3(turn, center - turn @ center + 1e-3 * size[0] * way)
        poses.append(move * part.pose)
    return poses


def overlapping_boxes(scene: vp.Scene, poses: list[pin.SE3]) -> np.ndarray:
    """The strawman: a contact row for every two faces of different parts whose world boxes overlap."""
    boxes = []
    for part, pose in zip(scene.parts, poses, strict=True):
        v = part.mesh.vertices @ pose.rotation.T + pose.translation
        faces = [v[part.mesh.triangles[part.mesh.triangles_of(s)]].reshape(-1, 3) for s in range(part.mesh.n_surfaces)]
        boxes.append([(f.min(axis=0), f.max(axis=0)) for f in faces])
    keys_ = [
        (i, s, j, t)
        for i in range(len(boxes))
        for j in range(i + 1, len(boxes))
        for s, (low, high) in enumerate(boxes[i])
        for t, (low_, high_) in enumerate(boxes[j])
        if (low <= high_).all() and (low_ <= high).all()
    ]
    rows = np.zeros(len(keys_), CONTACT_DTYPE)
    for name, column in zip(("object_a", "surface_a", "object_b", "surface_b"), np.array(keys_).T, strict=True):
        rows[name] = column
    return rows


def judge(scene: vp.Scene, poses: list[pin.SE3], tolerance: Tolerance, method: str) -> tuple[Truth, float]:
    """What is recognised, and the seconds that contacts and recognition took."""
    world = CollisionManager(tolerance)
    for part, pose in zip(scene.parts, poses, strict=True):
        world.add(part.mesh, pose)
    features, threads = threaded_features(scene)
    start = time.perf_counter()
    rows = (
        overlapping_boxes(scene, poses) if method == "boxes" else world.contacts(contacts_within(features, tolerance))
    )
    found = recognise(features, poses, rows, tolerance, threads=threads)
    seconds = time.perf_counter() - start
    return truth(*((c.kind, scene.names[c.bodies[0]], scene.names[c.bodies[1]]) for c in found)), seconds


class Score:
    """Counts over many assemblies."""

    def __init__(self) -> None:
        self.hits = self.found = self.true = 0
        self.seconds: list[float] = []

    def add(self, found: Truth, true: Truth, seconds: float) -> None:
        self.hits += (found & true).total()
        self.found += found.total()
        self.true += true.total()
        self.seconds.append(seconds)

    @property
    def precision(self) -> float:
        return self.hits / self.found if self.found else 1.0

    @property
    def recall(self) -> float:
        return self.hits / self.true if self.true else 1.0

    def row(self, case: str, method: str, **more: Any) -> dict[str, Any]:
        """error: 1 - F1 (the harmonic mean of precision and recall)."""
        total = self.precision + self.recall
        f1 = 2 * self.precision * self.recall / total if total else 0.0
        return {
            "case": case, "method": method, "seconds": float(np.median(self.seconds)), "error": 1.0 - f1,
            "unit": "1 - F1 of mates", "n": self.true, "precision": self.precision, "recall": self.recall, **more,
        }  # fmt: skip


METHODS: dict[str, tuple[Tolerance, Iterable[float]]] = {
    "as it stands": (EXACT, (0.0,)),
    "reach 1 mm, 1°": (NEAR, NOISE),
    "reach 2.5 mm, 2.9°": (WIDE, NOISE),
    "boxes": (NEAR, NOISE),
}


def run(quick: bool = False) -> dict[str, Any]:
    """Rows with precision and recall; `error` is 1 - F1."""
    count = 2 if quick else 8
    rows: list[dict[str, Any]] = []
    for name, family in FAMILIES.items():
        scores: dict[tuple[str, float, float], Score] = {}
        for seed in range(count):
            parts, true = family(np.random.default_rng(seed))
            for deflection in DEFLECTION[1:2] if quick else DEFLECTION:
                scene = m.scene(parts, deflection=deflection, angular=0.8)
                for method, (tolerance, noises) in METHODS.items():
                    for noise in noises:
                        poses = shaken(scene, noise, np.random.default_rng(seed))
                        score = scores.setdefault((method, noise, deflection), Score())
                        found, seconds = judge(scene, poses, tolerance, method)
                        score.add(found, true, seconds)
        for (method, noise, deflection), score in scores.items():
            case = f"{name}, noise {noise:g} mm/°, deflection {1e3 * deflection:g} mm"
            rows.append(score.row(case, method, family=name, noise=noise, deflection=deflection))
    rows += real_models()
    moved = motion(quick)
    clean = [r for r in rows if r.get("noise") == 0.0 and r["method"] == "as it stands"]
    return {
        "suite": "constraints recognition",
        "machine": platform.platform(),
        "rows": rows + moved,
        "ratios": {
            **{f"steps a second, {r['case']}": 1.0 / r["seconds"] for r in moved},
            "least recall as it stands": min(r["recall"] for r in clean),
            "least precision as it stands": min(r["precision"] for r in clean),
        },
    }


def real_models() -> list[dict[str, Any]]:
    """AS1, the peg in its hole and the nut on its bolt; none without VPFRAME_DATA."""
    folder = os.environ.get("VPFRAME_DATA")
    if not folder:
        return []
    rows = []
    scene = vp.load(str(Path(folder) / "step" / "as1-oc-214.stp"))
    score = Score()
    found, seconds = judge(scene, [p.pose for p in scene.parts], EXACT, "contacts")
    kinds: Truth = Counter()
    for (kind, *_), n in found.items():
        kinds[kind, "", ""] += n
    score.add(kinds, Counter({("against", "", ""): 16, ("concentric", "", ""): 22}), seconds)
    rows.append(score.row("AS1: 16 against, 22 concentric", "as it stands"))
    for case, files, depth, kinds_ in (
        (
            "Factory peg Ø7.995 in hole Ø8.1",
            ("factory_round_hole_8mm_subdiv_3x", "factory_round_peg_8mm_tight"),
            0.0,
            ("concentric",),
        ),
        (
            "Factory M16 nut on bolt",
            ("factory_bolt_m16_tight", "factory_nut_m16_tight_subdiv_3x"),
            0.01,
            ("screw",),
        ),
    ):
        scenes = [vp.load(str(Path(folder) / "mesh" / f"{f}.obj")) for f in files]
        pair = vp.Scene()
        for k, s in enumerate(scenes):
            part = s.parts[0]
            part.name = f"part {k}"
            part.pose = at(z=k * depth)
            pair.add(part)
        score = Score()
        found, seconds = judge(pair, [p.pose for p in pair.parts], EXACT, "contacts")
        score.add(found, truth(*((kind, "part 0", "part 1") for kind in kinds_)), seconds)
        rows.append(score.row(f"{case}: one {' and one '.join(kinds_)}", "as it stands"))
    return rows


def motion(quick: bool) -> list[dict[str, Any]]:
    """Seconds a step of constrained motion, and how far off its constraints it ends at worst."""
    scene = m.scene(shafts(np.random.default_rng(1))[0])
    count = 200 if quick else 1000
    rows = [
        steps("motion, one part against one: shaft turns and slides in its bore", scene, ["shaft"], count, 1.0),
        steps("motion, one part against one: the same, pressed on its seat", scene, ["shaft"], count, -1.0),
    ]
    folder = os.environ.get("VPFRAME_DATA")
    if folder:
        as1 = vp.load(str(Path(folder) / "step" / "as1-oc-214.stp"))
        rod = [name for name in as1.names if name.startswith("rod-assembly")]
        # its steps differ by where the nut is: a quick run takes them all too
        rows.append(steps("motion, AS1 with three moving parts: rod and nuts", as1, rod[::-1], 250, 1.0))
    return rows


def steps(case: str, scene: vp.Scene, names: list[str], count: int, way: float) -> dict[str, Any]:
    """The first of `names` is turned and drawn along its axis, up (way 1) and back; its fits hold, its seats do not."""
    world = CollisionManager()
    for part in scene.parts:
        world.add(part.mesh, part.pose)
    poses = [part.pose for part in scene.parts]
    base = base_parts(scene)
    manager = ConstraintManager([p.features for p in scene.parts], EXACT, rules=[lambda c: True], fixed=base)
    manager.update(poses, world.contacts(manager.within))
    movable = [scene.index(name) for name in names]
    for id, entry in list(manager.accepted.items()):
        if entry.candidate.kind == "against" and not set(movable).isdisjoint(entry.candidate.bodies):
            manager.remove(id)
    mover = Motion(world, manager, NEAR)
    held = movable[0]
    cylinders = [f.geometry for f in scene.parts[held].features if isinstance(f.geometry, Cylinder)]
    start, axis = poses[held], cylinders[0].axis
    seconds, worst = [], 0.0
    for k in range(count):
        wanted = start * pin.SE3(pin.exp3(0.02 * k * axis), way * 1e-3 * (1.0 - np.cos(0.02 * k)) * axis)
        began = time.perf_counter()
        result = mover.step({held: wanted}, poses, movable)
        seconds.append(time.perf_counter() - began)
        for body, pose in result.poses.items():
            poses[body] = pose
        worst = max(worst, result.residual)
    return {
        "case": case, "method": "vpframe", "seconds": float(np.median(seconds)), "error": worst,
        "unit": "m or rad off the constraints", "n": count,
    }  # fmt: skip


def table(result: dict[str, Any]) -> str:
    """Precision and recall by family, method and noise, over all deflections; then the real models."""
    lines = [f"{'recognition':<14} {'method':<20} " + " ".join(f"{f'{n:g} mm/°':>13}" for n in NOISE)]
    lines.append(f"{'':<14} {'':<20} " + " ".join(f"{'prec / recall':>13}" for _ in NOISE))
    generated = [r for r in result["rows"] if "family" in r]
    for family in dict.fromkeys(r["family"] for r in generated):
        for method in METHODS:
            cells = []
            for noise in NOISE:
                rows = [r for r in generated if (r["family"], r["method"], r["noise"]) == (family, method, noise)]
                worst = min(rows, key=lambda r: r["precision"] + r["recall"], default=None)
                cells.append(f"{worst['precision']:.2f} / {worst['recall']:.2f}" if worst else "-")
            lines.append(f"{family:<14} {method:<20} " + " ".join(f"{c:>13}" for c in cells))
    for r in result["rows"]:
        if "precision" in r and "family" not in r:
            lines.append(
                f"{r['case']}: precision {r['precision']:.2f}, recall {r['recall']:.2f}, {1e3 * r['seconds']:.1f} ms"
            )
    for r in result["rows"]:
        if "precision" not in r:
            lines.append(f"{r['case']}: {1e3 * r['seconds']:.3f} ms a step, {r['error']:.1e} off at worst")
    lines += [f"{name}: {value:.3g}" for name, value in result["ratios"].items()]
    return "\n".join(lines)


def plot(result: dict[str, Any], directory: str | Path) -> None:
    """Recall and precision against noise, one line a method, over all families and deflections."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(10, 4), sharey=True)
    generated = [r for r in result["rows"] if "family" in r and r["method"] != "as it stands"]
    for axis, quantity in zip(axes, ("recall", "precision"), strict=True):
        for method in dict.fromkeys(r["method"] for r in generated):
            means = [
                np.mean([r[quantity] for r in generated if r["method"] == method and r["noise"] == n]) for n in NOISE
            ]
            axis.plot(NOISE, means, marker="o", label=method)
        axis.set(xlabel="greatest noise of each part's pose, mm and °", title=quantity, ylim=(0.0, 1.05))
        axis.grid(True, alpha=0.3)
    axes[0].legend()
    figure.tight_layout()
    figure.savefig(Path(directory) / "constraints_recognition.png", dpi=150)
    plt.close(figure)
