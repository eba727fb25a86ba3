"""The planning suite: ways out of tight pairs, orders of whole assemblies, least sets, and cases without an answer.

Pairs are generated in seven families, each turned as a whole by random rotations, so that nothing lies along the axes
of the world. Planned legs are checked by coal at poses 10 µm apart, and where it finds a contact by exact tests:
`error` is by how much any surfaces then reach deeper into each other than where the parts stand, m. So are the segments
that the planner accepts on its way, and ends of them by arithmetic on integers. A segment deepens an overlap if any
surfaces reach deeper by more than rounding moves a corner (`Check.rounding`). The peers are OMPL planners, where
`ompl` can be imported, on the same intersection queries. Whole assemblies of real models need VPFRAME_DATA.

`--corpus DIR` takes the STEP files of a folder apart instead, each within `--number budget=N` seconds of processor time
(default 300): how many parts come out, stay for a proof, or are held by what overlaps as drawn, and how many have no
answer. `--number cabinet=N` takes cabinets of 25, 50, … parts up to N apart, for the growth of time with parts.
"""

from __future__ import annotations

import importlib.util
import os
import platform
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from bench_run import chosen

import vpframe as vp
from collision import CollisionManager, Tolerance
from collision.query.time_of_impact import ROUNDING
from vpframe.analysis.fasteners import fastenings
from vpframe.app.progress import report
from vpframe.errors import VpframeError
from vpframe.planning.assembly import Assembly, Budget
from vpframe.planning.pushes import Pushes
from vpframe.planning.target import Option, least
from vpframe.planning.verdict import Removal
from vpframe.scene import modelling as m

ORIENTATIONS, SEGMENTS, SETS = 2, 1000, 500
"""of each pair; segments; random assemblies: unless others are asked for"""
STEP = 1e-5
"""m between two poses that are checked"""
MOST_POSES = 4000
"""a leg; of longer ones fewer poses are checked, evenly"""
PRECISE = Tolerance(linear=1e-13, depth=1e-2)
"""of the depths that are measured, for they are found from below: to within 1e-15 m and 1 % of themselves"""
PEER_SECONDS = 10.0
"""of one planner for one pair, a pair of each family; ours has as long"""
PEER_ORIENTATIONS = 5
"""at most, of that pair: what one sampler needs varies tenfold, so medians are compared"""


CORPUS_SECONDS = 300
"""of processor time, of one file of a corpus"""
SMALLEST_CABINET = 25
"""parts"""

Pair = tuple[str, Callable[[], vp.Scene], str]
"""name, scene, the part to take out"""


def pairs() -> Iterator[Pair]:
    """76 of them."""
    for sides in (0, 3, 4, 6):
        for clearance in (1e-5, 2e-5, 5e-5):
            for depth in (0.01, 0.03):
                yield (
                    f"peg {sides} {clearance:g} {depth:g}",
                    lambda s=sides, c=clearance, d=depth: _peg(s, c, d),
                    "mover",
                )
    for slope in (15, 30, 45, 60):
        for clearance in (1e-5, 5e-5, 2e-4):
            yield f"dovetail {slope} {clearance:g}", lambda a=slope, c=clearance: _dovetail(a, c), "mover"
    for head in (0.002, 0.004, 0.006, 0.008):
        for clearance in (1e-5, 1e-4):
            yield f"tee {head:g} {clearance:g}", lambda h=head, c=clearance: _tee(h, c), "mover"
    for angle in (30, 45, 60, 75, 90, 105, 120, 135):
        yield f"bayonet {angle}", lambda a=angle: _bayonet(a), "mover"
    for mouth in (4.4, 4.8, 5.2, 5.6, 6.0, 6.6, 7.2, 8.0):
        yield f"clip {mouth:g}", lambda w=mouth: _clip(w * 1e-3), "mover"
    for first in (0.005, 0.01, 0.015, 0.02):
        for clearance in (5e-5, 2e-4):
            yield f"elbow {first:g} {clearance:g}", lambda f=first, c=clearance: _elbow(f, c), "mover"
    for foot in (12.5, 13.0, 13.5, 14.0, 14.5, 15.0, 15.5, 16.0):
        yield f"hook {foot:g}", lambda f=foot: _hook(f * 1e-3), "mover"


def _scene(fixed: m.Solid, mover: m.Solid) -> vp.Scene:
    return m.scene({"fixed": fixed, "mover": mover})


def _peg(sides: int, clearance: float, depth: float) -> vp.Scene:
    def prism(radius: float, height: float) -> m.Solid:
        if not sides:
            return m.cylinder(radius, height)
        at = 2.0 * np.pi * np.arange(sides) / sides
        return m.extrude([(radius * np.cos(a), radius * np.sin(a)) for a in at], height)

    out = clearance / (np.cos(np.pi / sides) if sides else 1.0)
    if not sides:  # facets of a shaft and its bore would cross: both are prisms of as many sides, as files have them
        out += 0.006 * (1.0 - np.cos(0.175))
    block = m.box(0.03, 0.03, depth + 0.005).translated(-0.015, -0.015, -0.005) - prism(0.006 + out, depth)
    return _scene(block, prism(0.006, depth + 0.005).translated(z=clearance))


def _dovetail(slope: float, clearance: float) -> vp.Scene:
    wide = 0.005 + 0.006 * np.tan(np.radians(slope)) * 0.5
    upright = pin.SE3(pin.exp3(np.array([0.5 * np.pi, 0.0, 0.0])), np.array([0.0, 0.04, 0.0]))
    tongue = m.extrude([(-0.005, 0.001), (0.005, 0.001), (wide, -0.006), (-wide, -0.006)], 0.04).moved(upright)
    c = clearance * 1.5 / np.cos(np.radians(slope))
    groove = m.extrude(
        [(-0.005 - c, 0.001), (0.005 + c, 0.001), (wide + c, -0.006 - clearance), (-wide - c, -0.006 - clearance)], 0.06
    ).moved(pin.SE3(upright.rotation, np.array([0.0, 0.05, 0.0])))
    body = m.box(0.04, 0.04, 0.012).translated(-0.02, 0.0, -0.012) - groove
    return _scene(body, tongue + m.box(0.03, 0.04, 0.01).translated(-0.015, 0.0, clearance))


def _tee(head: float, clearance: float) -> vp.Scene:
    c = clearance
    tee = m.box(0.006, 0.03, 0.01).translated(-0.003) + m.box(0.006 + 2 * head, 0.03, 0.004).translated(
        -0.003 - head, 0.0, -0.004
    )
    slot = m.box(0.006 + 2 * c, 0.03, 0.01).translated(-0.003 - c)
    slot = slot + m.box(0.006 + 2 * head + 2 * c, 0.03, 0.004 + 2 * c).translated(-0.003 - head - c, 0.0, -0.004 - c)
    block = (
        m.box(0.04, 0.03, 0.018).translated(-0.02, 0.0, -0.01)
        - slot
        - m.box(0.04, 0.002, 0.03).translated(-0.02, -0.002, -0.01)
    )
    return _scene(block, tee)


def _sector(inner: float, outer: float, low: float, high: float, start: float, stop: float) -> m.Solid:
    a, b = np.radians(start), np.radians(stop)
    return m.revolve([(inner, low), (outer, low), (outer, high), (inner, high)], b - a).rotated((0, 0, 1), a)


def _bayonet(angle: float) -> vp.Scene:
    socket = m.cylinder(0.015, 0.02) - m.cylinder(0.01, 0.02) - _sector(0.008, 0.013, 0.008, 0.02, -20.0, 20.0)
    socket = socket - _sector(0.008, 0.013, 0.008, 0.012, -20.0, angle + 25.0)
    plug = m.cylinder(0.0097, 0.018).translated(z=0.002) + m.cylinder(0.014, 0.005).translated(z=0.0203)
    plug = plug + m.cylinder(0.0097, 0.001).translated(z=0.0195)
    return _scene(socket, plug + _sector(0.008, 0.0127, 0.0083, 0.0117, angle - 10.0, angle + 20.0))


def _clip(mouth: float) -> vp.Scene:
    bar = m.box(0.01, 0.004, 0.03).translated(-0.005, -0.002)
    frame = bar + m.cylinder(0.02, 0.005).translated(z=0.03) + m.cylinder(0.02, 0.005).translated(z=-0.005)
    clip = m.cylinder(0.01, 0.008) - m.cylinder(0.006, 0.008) - m.box(mouth, 0.02, 0.008).translated(-0.5 * mouth)
    return _scene(frame, clip.translated(z=0.011))


def _elbow(first: float, clearance: float) -> vp.Scene:
    """A block in a channel that goes round a corner: along x, then up."""
    c, size = clearance, 0.01
    channel = m.box(first + size + 2 * c, size + 2 * c, size + 2 * c).translated(-c, -c, -c)
    channel = channel + m.box(size + 2 * c, size + 2 * c, 0.03).translated(first - c, -c, -c)
    block = m.box(first + 0.03, 0.03, 0.03).translated(-0.01, -0.01, -0.01)
    return _scene(block - channel, m.box(size, size, size))


def _hook(foot: float) -> vp.Scene:
    plate = m.box(0.06, 0.04, 0.002).translated(-0.03, -0.02) - m.box(0.012, 0.008, 0.002).translated(0.0, -0.004)
    hook = m.box(0.003, 0.006, 0.026).translated(0.001, -0.003, -0.006)
    hook = hook + m.box(foot, 0.006, 0.003).translated(0.001, -0.003, -0.006)
    return _scene(plate, hook + m.box(0.003, 0.02, 0.003).translated(0.001, -0.01, 0.02))


def turned(scene: vp.Scene, seed: int) -> vp.Scene:
    """The scene, turned as a whole; as it is for seed 0."""
    if seed:
        q = np.random.default_rng(seed).normal(size=4)
        rotation = pin.SE3(pin.Quaternion(q / np.linalg.norm(q)).toRotationMatrix(), np.zeros(3))
        for part in scene.parts:
            part.pose = rotation * part.pose
    return scene


class Check:
    """By how much the surfaces of part i reach deeper into the others' than where the parts stand, on legs; fits and
    threads are left out. Contacts are coal's, at poses STEP apart; depths are ours, where coal finds any."""

    def __init__(self, assembly: Assembly, i: int) -> None:
        self.assembly, self.i = assembly, i
        corners = [assembly.sweeps.corners(j) for j in range(len(assembly))]
        self.rounding = ROUNDING * 2.0 * max(float(np.linalg.norm(c, axis=1).max()) for c in corners)
        """m: by how much rounding moves a corner at a pose of a leg, that of either part"""
        self.worlds = []
        for j in (j for j in range(len(assembly)) if j != i):
            world, exact = CollisionManager(method="coal"), CollisionManager(PRECISE)
            for manager in (world, exact):
                for k in (i, j):
                    manager.add(assembly.meshes[k], assembly.poses[k])
                for mine, theirs in assembly.excused(i, j):
                    manager.ignore_surfaces(0, mine, 1, theirs)
            known = {(r["surface_a"], r["surface_b"]): r["depth"] for r in exact.penetration(0, 1)}
            self.worlds.append((j, world, exact, known))

    def deepest(self, start: pin.SE3, end: pin.SE3) -> float:
        """m, on one leg."""
        way, out = pin.log6(start.actInv(end)), 0.0
        far = max(np.linalg.norm(end.act(p) - start.act(p)) for p in self.assembly.sweeps.corners(self.i)[:64])
        for s in np.linspace(0.0, 1.0, min(MOST_POSES, 2 + int(far / STEP))):
            pose = start * pin.exp6(way * s) * self.assembly.poses[self.i]
            for _, world, exact, known in self.worlds:
                world.set_pose(0, pose)
                if len(world.colliding_surfaces()):
                    exact.set_pose(0, pose)
                    for r in exact.penetration(0, 1) if len(exact.colliding_surfaces()) else ():
                        out = max(out, r["depth"] - known.get((r["surface_a"], r["surface_b"]), 0.0))
        return out

    def disagreements(self, at: pin.SE3) -> int:
        """Pairs of surfaces of which our test and integers say different things about whether they meet."""
        meets, out = _exact_triangles(), 0
        pose = at * self.assembly.poses[self.i]
        mesh = self.assembly.meshes[self.i]
        for _, _, exact, _ in self.worlds:
            exact.set_pose(0, pose)
            other, relative = exact.mesh(1), exact.relative_pose(0, 1)
            a = mesh.vertices[mesh.triangles]
            b = moved(other.vertices, relative)[other.triangles]
            low, high = a.min(axis=1)[:, None] <= b.max(axis=1), b.min(axis=1) <= a.max(axis=1)[:, None]
            ours, theirs = {tuple(row) for row in exact.colliding_surfaces()[:, [1, 3]].tolist()}, set()
            enabled = exact.enabled_surfaces(0, 1)
            for s, t in np.argwhere((low & high).all(axis=2)).tolist():
                pair = int(mesh.surface_of_triangle[s]), int(other.surface_of_triangle[t])
                left_out = enabled is not None and not enabled[pair]
                if pair not in theirs and not left_out and meets(np.concatenate([a[s], b[t]])):
                    theirs.add(pair)
            out += len(ours ^ theirs)
        return out


def moved(vertices: Any, pose: pin.SE3) -> Any:
    """(n, 3) vertices at a pose, by the sums in the order in which the kernels make them."""
    r, (x, y, z) = pose.rotation, vertices.T
    return np.stack([r[k, 0] * x + r[k, 1] * y + r[k, 2] * z + pose.translation[k] for k in range(3)], axis=1)


def _exact_triangles() -> Callable[[Any], bool]:
    """The test of triangles by integers that the tests of `collision` use."""
    path = Path(__file__).resolve().parents[1] / "collision" / "exact.py"
    spec = importlib.util.spec_from_file_location("exact_triangles", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.triangles_meet  # type: ignore[no-any-return]


def deepest(scene: vp.Scene, found: Removal) -> tuple[float, int]:
    """(m, legs): by how much surfaces reach deeper on a way than where the parts stand, fits and threads left out."""
    assert found.way is not None
    check = Check(Assembly(scene), scene.index(found.parts[0]))
    legs = list(pairwise(found.way.knots))
    return max((check.deepest(start, end) for start, end in legs), default=0.0), len(legs)


def _segments(rows: list[dict[str, Any]], family: Sequence[Pair], each: int) -> None:
    """Segments that the planner accepts: from displacements reached, towards random ones, until something stops them.

    `error` is by how much any surfaces then reach deeper; of each tenth the end is looked at by integers, too.
    """
    for name, make, part in family:
        checked, worst, deepened, wrong, began = 0, 0.0, 0, 0, time.perf_counter()
        seed = zlib.crc32(name.encode())
        scene = turned(make(), seed)
        assembly, i, random = Assembly(scene), scene.index(part), np.random.default_rng(seed)
        check = Check(assembly, i)
        pushes = Pushes(assembly, (i,), [j for j in range(len(scene)) if j != i], Budget(1e6))
        for _ in range(20 * each):
            if checked == each:
                break
            start = pushes.nodes[int(random.integers(len(pushes.nodes)))].at
            twist = random.normal(size=6) * np.array([1.0] * 3 + [1.0 / pushes.length] * 3)
            twist *= pushes.length * 10.0 ** random.uniform(-3.0, 0.0) / np.linalg.norm(twist[:3])
            if random.random() < 0.5:
                twist[3:] = 0.0
            middle = pushes.center
            end = start * _at(*middle) * pin.exp6(0.5 * twist) * _at(*(-middle))
            reached, stop = pushes.push(start, end)
            if pushes.distance(start, reached) < 1e-6:
                continue
            pushes.add(0, [reached], stop)
            deeper = check.deepest(start, reached)
            worst, deepened = max(worst, deeper), deepened + (deeper > check.rounding)
            wrong += check.disagreements(reached) if checked % 10 == 0 else 0
            checked += 1
        spent = (time.perf_counter() - began) / max(1, checked)
        more = {"integers": wrong, "deepened": deepened}
        rows.append(_row(f"segments {name}", "vpframe", spent, worst, "m deeper", checked, **more))


def bolted(count: int) -> vp.Scene:
    """A cover on a base, held by `count` // 2 - 1 M6 bolts with nuts: as many parts as asked for."""
    n = count // 2 - 1
    per = int(np.ceil(np.sqrt(n)))
    places = [(0.015 + 0.03 * (k % per), 0.015 + 0.03 * (k // per)) for k in range(n)]
    size = 0.03 * per
    base, cover = m.box(size, size, 0.008), m.box(size, size, 0.006)
    for x, y in places:
        base = base - m.cylinder(0.0033, 0.008).translated(x, y)
        cover = cover - m.cylinder(0.0033, 0.006).translated(x, y)
    bolt = m.cylinder(0.003, 0.022) + m.hexagon(0.01, 0.004).translated(z=0.022)
    nut = m.hexagon(0.01, 0.005) - m.cylinder(0.0025, 0.005)
    parts: dict[str, Any] = {"base": base, "cover": (cover, _at(0.0, 0.0, 0.008))}
    for k, (x, y) in enumerate(places):
        parts[f"bolt_{k}"], parts[f"nut_{k}"] = (bolt, _at(x, y, -0.008)), (nut, _at(x, y, -0.005))
    return m.scene(parts)


def shafts() -> vp.Scene:
    """75 parts: eight shafts with four rings each between a base and a cover with its handle, which bolts hold."""
    size, places = 0.24, [(0.045 + 0.05 * (k % 4), 0.08 + 0.08 * (k // 4)) for k in range(8)]
    rim = [(0.015 + 0.03 * k, y) for k in range(8) for y in (0.015, size - 0.015)]
    base, cover = m.box(size, size, 0.01), m.box(size, size, 0.008)
    for x, y in places:
        base = base - m.cylinder(0.0051, 0.006).translated(x, y, 0.004)
        cover = cover - m.cylinder(0.0051, 0.004).translated(x, y)
    for x, y in rim:
        base, cover = (
            base - m.cylinder(0.0033, 0.01).translated(x, y),
            cover - m.cylinder(0.0033, 0.008).translated(x, y),
        )
    gap = 0.0402
    bolt = m.cylinder(0.003, 0.008 + gap + 0.016) + m.hexagon(0.01, 0.004).translated(z=0.008 + gap + 0.016)
    nut = m.hexagon(0.01, 0.005) - m.cylinder(0.0025, 0.005)
    parts: dict[str, Any] = {"base": base, "cover": (cover, _at(0.0, 0.0, 0.01 + gap))}
    parts["handle"] = m.box(0.06, 0.02, 0.02), _at(0.09, 0.11, 0.018 + gap)
    for k, (x, y) in enumerate(places):
        parts[f"shaft_{k}"] = m.cylinder(0.005, gap + 0.0098), _at(x, y, 0.004)
        for r in range(4):
            ring = m.cylinder(0.012, 0.01) - m.cylinder(0.0051, 0.01)
            parts[f"ring_{k}_{r}"] = ring, _at(x, y, 0.01 + 0.01 * r)
    for k, (x, y) in enumerate(rim):
        parts[f"bolt_{k}"], parts[f"nut_{k}"] = (bolt, _at(x, y, -0.006)), (nut, _at(x, y, -0.005))
    return m.scene(parts)


def cabinet_of(count: int) -> vp.Scene:
    """`count` parts: a case of drawers with a front panel, which two screws hold, and a box in each."""
    drawers = count // 5
    per = int(np.ceil(np.sqrt(drawers)))
    wide, high, wall = 0.06, 0.04, 0.002
    case = m.box(per * wide + wall, 0.1, per * high + wall)
    parts: dict[str, Any] = {}
    for k in range(drawers):
        x, z = wall + wide * (k % per), wall + high * (k // per)
        case = case - m.box(wide - wall, 0.1 - wall, high - wall).translated(x, 0.0, z)
        drawer = m.box(wide - wall - 0.001, 0.09, high - wall - 0.001)
        drawer = drawer - m.box(wide - wall - 0.005, 0.086, high).translated(0.002, 0.002, 0.002)
        front, hole = m.box(wide - wall - 0.001, 0.003, high - wall - 0.001), m.cylinder(0.0017, 0.003)
        upright = pin.SE3(pin.exp3(np.array([0.5 * np.pi, 0.0, 0.0])), np.zeros(3))
        for at in (0.01, 0.04):
            bore = pin.SE3(upright.rotation, np.array([at, 0.003, 0.015]))
            front, drawer = front - hole.moved(bore), drawer - hole.moved(bore)
        y = 0.004
        parts[f"drawer_{k}"] = drawer, _at(x + 0.0005, y, z + 0.0005)
        parts[f"front_{k}"] = front, _at(x + 0.0005, y - 0.003, z + 0.0005)
        parts[f"box_{k}"] = m.box(0.03, 0.05, 0.01), _at(x + 0.01, y + 0.02, z + 0.0025)
        screw = m.cylinder(0.0015, 0.006) + m.cylinder(0.003, 0.002).translated(z=0.006)
        for n, at in enumerate((0.01, 0.04)):
            place = np.array([x + 0.0005 + at, y + 0.003, z + 0.0155])
            parts[f"screw_{k}_{n}"] = screw, pin.SE3(upright.rotation, place)
    return m.scene({"case": case, **parts})


def _at(x: float, y: float, z: float) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([x, y, z]))


def run(
    quick: bool = False, only: Sequence[str] = (), orientations: int | None = None, segments: int | None = None,
    sets: int | None = None, budget: int | None = None, cabinet: int | None = None, corpus: Path | None = None,
) -> dict[str, Any]:  # fmt: skip
    """The cases that are asked for; `quick` takes two pairs of each family, once, and no large assemblies.

    Without numbers the suite ends within ten minutes on two free cores; the goals' own are 10 orientations and 10,000
    segments.
    """
    rows: list[dict[str, Any]] = []
    ratios: dict[str, float] = {}
    cases: dict[str, Callable[[], None]] = {}
    families: dict[str, list[Pair]] = {}
    for pair in pairs():
        families.setdefault(pair[0].split()[0], []).append(pair)
    turns = orientations or (1 if quick else ORIENTATIONS)
    for family, mine in families.items():
        cases[f"pairs: {family}"] = lambda mine=mine[: 2 if quick else None]: _tight(rows, mine, turns)  # type: ignore[misc]
    each = -(-(segments or (152 if quick else SEGMENTS)) // sum(map(len, families.values())))
    for family, mine in families.items():
        cases[f"segments: {family}"] = lambda mine=mine: _segments(rows, mine, each)  # type: ignore[misc]
    for name, make in _wholes(quick).items():
        cases[f"whole: {name}"] = lambda name=name, make=make: _whole(rows, name, make())  # type: ignore[misc]
    cases["least sets"] = lambda: _least(rows, sets or (60 if quick else SETS))
    for name, scene in WITHOUT_ANSWER.items():
        cases[f"without answer: {name}"] = lambda name=name, make=scene: _without_answer(rows, name, make())  # type: ignore[misc]
    if corpus is not None:
        cases = {
            path.relative_to(corpus).as_posix(): lambda path=path: _apart(rows, vp.load(path), path.stem, budget)  # type: ignore[misc]
            for path in sorted(corpus.rglob("*"))
            if path.suffix.lower() in (".step", ".stp")
        }
        if not cases:
            raise VpframeError(f"--corpus {corpus}: holds no STEP file")
    elif cabinet is not None:
        vp.planning.disassembly(cabinet_of(5))  # kernels
        counts = [SMALLEST_CABINET * 2**k for k in range(10) if SMALLEST_CABINET * 2**k <= cabinet]
        cases = {
            f"cabinet of {n}": lambda n=n: _apart(rows, cabinet_of(n), f"cabinet of {n}", budget)  # type: ignore[misc]
            for n in counts
        }
    taken = chosen(cases, only)
    for k, (name, measure) in enumerate(taken.items()):
        report(k / len(taken), name)
        measure()
    _of_pairs(rows, ratios)
    _of_segments(rows, ratios)
    _of_corpus(rows, ratios)
    return {
        "suite": "planning",
        "machine": f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores",
        "rows": rows,
        "ratios": ratios,
    }


def _tight(rows: list[dict[str, Any]], family: Sequence[Pair], turns: int) -> None:
    """Each pair in so many orientations; coal looks at the first, and the peers have some of one pair."""
    for k, (name, make, part) in enumerate(family):
        for seed in range(turns):
            scene = turned(make(), seed + 1)
            began = time.perf_counter()
            way = vp.planning.removal(scene, part, budget=PEER_SECONDS, seed=seed)
            spent = time.perf_counter() - began
            rows.append(_row(name, "vpframe", spent, None, "m deeper", 1, found=bool(way)))
            if way and not seed:
                rows[-1]["error"], rows[-1]["legs"] = deepest(scene, way)
            if seed < PEER_ORIENTATIONS and k == len(family) // 2:
                for planner, spent, solved in _peers(scene, part):
                    rows.append(_row(name, planner, spent, None, "m deeper", 1, found=solved))


def _of_pairs(rows: Sequence[Mapping[str, Any]], ratios: dict[str, float]) -> None:
    """How many pairs were found and how soon; how much longer each peer took for the same pairs."""
    by_method: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        if "found" in row:
            by_method.setdefault(row["method"], []).append(row)
    ours = by_method.pop("vpframe", [])
    if not ours:
        return
    ratios["pairs found"] = float(np.mean([row["found"] for row in ours]))
    ratios["median seconds a pair"] = float(np.median([row["seconds"] for row in ours]))
    ratios["legs checked"] = float(sum(row.get("legs", 0) for row in ours))
    ratios["deepest beyond the start, m"] = max((row["error"] or 0.0 for row in ours), default=0.0)
    for planner, theirs in by_method.items():
        ratios[f"{planner}: found"] = float(np.mean([row["found"] for row in theirs]))
        slower = []
        for case in dict.fromkeys(row["case"] for row in theirs):
            own = [row["seconds"] for row in ours if row["case"] == case][:PEER_ORIENTATIONS]
            took = [row["seconds"] if row["found"] else np.inf for row in theirs if row["case"] == case]
            slower.append(float(np.median(took)) / float(np.median(own)))
        ratios[f"{planner}: slower by, median of orientations, least of families"] = min(slower)


def _of_segments(rows: Sequence[Mapping[str, Any]], ratios: dict[str, float]) -> None:
    """How many segments were checked, and the worst of them."""
    mine = [row for row in rows if "integers" in row]
    if mine:
        ratios["segments checked"] = float(sum(row["n"] for row in mine))
        ratios["segments that deepen an overlap"] = float(sum(row["deepened"] for row in mine))
        ratios["deepest on segments, m"] = max(row["error"] for row in mine)
        ratios["ends that integers see otherwise"] = float(sum(row["integers"] for row in mine))


def _row(case: str, method: str, seconds: float, error: float | None, unit: str, n: int, **more: Any) -> dict[str, Any]:
    return {"case": case, "method": method, "seconds": seconds, "error": error, "unit": unit, "n": n, **more}


def _peers(scene: vp.Scene, part: str) -> Iterator[tuple[str, float, bool]]:
    """OMPL's planners on the same queries: (planner, seconds, found); none where it is not installed."""
    try:
        from planning_ompl import PLANNERS, solve
    except ImportError:
        return
    for planner in PLANNERS:
        yield planner, *solve(scene, part, planner, PEER_SECONDS)


def _wholes(quick: bool) -> dict[str, Callable[[], vp.Scene]]:
    out: dict[str, Callable[[], vp.Scene]] = {"12 bolted parts": lambda: bolted(12)}
    folder = os.environ.get("VPFRAME_DATA")
    if not quick:
        out |= {"75 parts": shafts, "100 bolted parts": lambda: bolted(100)}
    if folder:
        out["AS1"] = lambda: vp.load(Path(folder) / "step" / "as1-oc-214.stp")
    if folder and not quick:
        out["print head"] = lambda: vp.load(Path(folder) / "step" / "um2_head.step")
    return out


def _whole(rows: list[dict[str, Any]], name: str, scene: vp.Scene) -> None:
    began, worked = time.perf_counter(), time.process_time()
    plan = vp.planning.disassembly(scene, budget=300.0, motion="mates")
    spent, worked = time.perf_counter() - began, time.process_time() - worked
    left = float(len(plan.remaining))
    rows.append(_row(name, "vpframe, whole order", spent, left, "parts left", len(scene), processor=worked))


def _apart(rows: list[dict[str, Any]], scene: vp.Scene, name: str, budget: int | None) -> None:
    """Take a model apart; `error` is the share of parts without an answer."""
    worked = time.process_time()
    plan = vp.planning.disassembly(scene, budget=float(budget or CORPUS_SECONDS))
    worked = time.process_time() - worked
    parts, links = len(scene) - len(plan.base), len(fastenings(scene))
    answers = Counter(plan.stuck[part].verdict for part in plan.remaining)
    shares = {
        "out": parts - len(plan.remaining),
        "proven": answers["locked"] + answers["enclosed"],
        "explained": answers["held"],
        "not found": answers["not found"],
    }
    more = {"parts": parts, "links": links, "steps": len(plan.steps), "fewest": plan.proven, **shares}
    rows.append(
        _row(name, "vpframe, apart", worked, shares["not found"] / max(parts, 1), "of the parts", parts, **more)
    )


def _of_corpus(rows: Sequence[Mapping[str, Any]], ratios: dict[str, float]) -> None:
    """Shares of all parts; the exponent by which time grows with parts from the smallest to the largest cabinet."""
    mine = [row for row in rows if "explained" in row]
    parts = sum(row["parts"] for row in mine)
    for share in ("out", "proven", "explained", "not found") if parts else ():
        ratios[f"share {share}"] = sum(row[share] for row in mine) / parts
    cabinets = [row for row in mine if row["case"].startswith("cabinet of ")]
    if len(cabinets) > 1:
        first, last = cabinets[0], cabinets[-1]
        ratios["time grows with parts to the power of"] = float(
            np.log(last["seconds"] / first["seconds"]) / np.log(last["parts"] / first["parts"])
        )


def _least(rows: list[dict[str, Any]], count: int) -> None:
    """Random assemblies of at most 12 units; `error` is how often the least set is not that of enumeration."""
    random, wrong, seconds = np.random.default_rng(0), 0, []
    for k in range(count):
        report(0.85 + 0.1 * k / count, "least sets")
        n = int(random.integers(2, 13))
        ways = [int(random.integers(0, 4)) for _ in range(n)]
        blockers = [
            [frozenset(v for v in range(n) if v != u and random.random() < 0.25) for _ in range(ways[u])]
            for u in range(n)
        ]
        began = time.perf_counter()
        found = least([[Option(by) for by in own] for own in blockers], 0)
        seconds.append(time.perf_counter() - began)
        wrong += (None if found is None else len(found.chosen)) != _enumerated(blockers)
    rows.append(_row("least sets", "vpframe", float(np.median(seconds)), float(wrong), "wrong", count))


def _enumerated(blockers: list[list[frozenset[int]]]) -> int | None:
    for size in range(1, len(blockers) + 1):
        for others in combinations(range(1, len(blockers)), size - 1):
            chosen, gone = {0, *others}, set[int]()
            while new := {u for u in chosen - gone if any(by <= gone for by in blockers[u])}:
                gone |= new
            if gone == chosen:
                return size
    return None


def linked_rings() -> vp.Scene:
    """Two rings, each through the other, and the part to take out."""
    ring = pin.SE3(pin.exp3(np.array([0.5 * np.pi, 0.0, 0.0])), np.array([0.02, 0.0, 0.0]))
    return m.scene({"fixed": m.torus(0.02, 0.003), "mover": (m.torus(0.02, 0.003), ring)})


def two_heads() -> vp.Scene:
    """A pin with a head on both ends, in a plate, with play."""
    plate = m.box(0.04, 0.04, 0.004).translated(-0.02, -0.02) - m.cylinder(0.0062, 0.004)
    head = m.cylinder(0.009, 0.003)
    return _scene(
        plate, m.cylinder(0.006, 0.006).translated(z=-0.001) + head.translated(z=0.005) + head.translated(z=-0.004)
    )


WITHOUT_ANSWER: dict[str, Callable[[], vp.Scene]] = {"linked rings": linked_rings, "two heads": two_heads}


def _without_answer(rows: list[dict[str, Any]], name: str, scene: vp.Scene) -> None:
    """No way leads out: `error` is by how much the budget was exceeded, s."""
    vp.planning.removal(scene, "mover", budget=0.2)  # kernels
    began = time.perf_counter()
    found = vp.planning.removal(scene, "mover", budget=3.0)
    spent = time.perf_counter() - began
    rows.append(_row(name, f"vpframe: {found.verdict}", spent, max(0.0, spent - 3.0), "s over budget", 1))
    assert found.verdict != "removable"


def table(result: dict[str, Any]) -> str:
    """For a person: a line a case, then the goals."""
    lines = [f"planning on {result['machine']}"]
    for row in result["rows"]:
        found = "" if "found" not in row else "  found" if row["found"] else "  not found"
        error = "" if row["error"] is None else f"  {row['error']:.3g} {row['unit']}"
        if "explained" in row:
            shares = ", ".join(f"{row[key]} {key}" for key in ("out", "proven", "explained", "not found"))
            error = f"  {row['parts']} parts, {row['links']} links: {shares}; {row['steps']} steps"
        lines.append(f"  {row['case']:28} {row['method']:22} {row['seconds']:9.3f} s{error}{found}")
    lines += [f"  {name}: {value:.4g}" for name, value in result["ratios"].items()]
    return "\n".join(lines)


def plot(result: dict[str, Any], directory: str) -> None:
    """Seconds a pair, sorted."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(7, 4))
    for method in dict.fromkeys(row["method"] for row in result["rows"] if "found" in row):
        seconds = sorted(row["seconds"] for row in result["rows"] if row["method"] == method and row.get("found"))
        axes.plot(np.arange(1, len(seconds) + 1), seconds, label=method)
    axes.set(xlabel="pairs found", ylabel="s", yscale="log")
    axes.legend()
    Path(directory).mkdir(parents=True, exist_ok=True)
    figure.savefig(Path(directory) / "planning.png", dpi=120, bbox_inches="tight")
    pyplot.close(figure)
