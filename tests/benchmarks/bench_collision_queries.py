"""Nearness, time of impact and penetration beside named peers, in one run: the rows that `bench_collision` adds.

`error` is the greatest difference from the peer that a case names as its truth, in m (times: parts of the motion).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any

import collision_fcl as fcl
import collision_parry as parry
import collision_peers as peers
import numpy as np
import pinocchio as pin

from collision import CollisionManager, SurfaceMesh

WITHIN = 1e-3
"""m"""
NEAR, CLEARANCE, IMPACT, DEPTH = "all surface pairs within 1 mm", "clearance", "time of impact", "penetration"
OURS, WHOLE, BY_SURFACE = "manager", "coal distance", "coal distance a surface pair"
FCL_WHOLE, FCL_BY_SURFACE, PARRY = "FCL distance", "FCL distance a surface pair", "Parry distance"
STEPS = 200
STEPPED, FCL_STEPPED = (f"{peer} at {STEPS} poses, then bisection" for peer in ("coal", "FCL"))
SAMPLED = "libigl signed distance of points"
SPACING = 1e-3
"""m: between the points of a surface whose depths are taken as the penetration"""


def rows(digger: ModuleType, quick: bool) -> tuple[list[dict[str, Any]], dict[str, float]]:
    """The rows and ratios."""
    bench = _Rows(2 if quick else 5)
    n = 12 if quick else 40
    pairs = {
        "shaft": (digger.shaft(), digger.housing(), digger.shaft_trajectory(40), [(0, 13), (5, 30)]),
        "digger": (digger.link(), digger.arm(), digger.digger_trajectory(40), [(0, 20), (39, 25)]),
    }
    aside = pin.SE3(np.eye(3), np.array([0.002, 0.0, 0.0]))
    for name, (a, b, poses, motions) in pairs.items():
        manager = CollisionManager()
        i, j = manager.add(a, pin.SE3.Identity(), movable=False), manager.add(b, poses[0])
        nearness(bench, name, manager, (a, b), poses[:: len(poses) // n])
        _impact(bench, f"{name}: {IMPACT}", manager, (a, b), [(poses[p], poses[q]) for p, q in motions])
        deep = [poses[26] * aside, poses[30] * aside] if name == "shaft" else [poses[12], poses[20], poses[28]]
        _penetration(bench, f"{name}: {DEPTH}", manager, (i, j), deep[: 1 if quick else None])
    return bench.rows, bench.ratios


class _Rows:
    def __init__(self, passes: int) -> None:
        self.passes = passes
        self.rows: list[dict[str, Any]] = []
        self.ratios: dict[str, float] = {}

    def add(self, case: str, method: str, ask: Callable[[Any], Any], given: Sequence[Any], error: float) -> None:
        """Time a method: seconds a question, of each question the least of the passes."""
        ask(given[0])
        least = np.full(len(given), np.inf)
        for _ in range(self.passes):
            for k, question in enumerate(given):
                start = time.perf_counter()
                ask(question)
                least[k] = min(least[k], time.perf_counter() - start)
        self.measured(case, method, float(least.mean()), len(given), error)

    def measured(self, case: str, method: str, seconds: float, n: int, error: float) -> None:
        """Add a row, and its ratio to ours."""
        unit = "of the motion" if IMPACT in case else "m"
        self.rows.append({"case": case, "method": method, "seconds": seconds, "error": error, "unit": unit, "n": n})
        if method != OURS:
            ours = next(row["seconds"] for row in self.rows if (row["case"], row["method"]) == (case, OURS))
            self.ratios[f"{case}: {method} / {OURS}"] = seconds / ours


def nearness(
    bench: _Rows, name: str, manager: CollisionManager, meshes: tuple[SurfaceMesh, SurfaceMesh], poses: list[pin.SE3]
) -> None:
    whole, by_surface = peers.distance(*meshes), peers.SurfaceDistances(*meshes)
    near = {id(pose): by_surface.near(pose, WITHIN) for pose in poses}

    def contacts(pose: pin.SE3) -> dict[tuple[int, int], float]:
        manager.set_pose(1, pose)
        return {(int(r["surface_a"]), int(r["surface_b"])): float(r["distance"]) for r in manager.contacts(WITHIN)}

    def asked(pose: pin.SE3) -> Any:
        manager.set_pose(1, pose)
        return manager.contacts(WITHIN)

    def clearance(pose: pin.SE3) -> Any:
        manager.set_pose(1, pose)
        return manager.clearance(0, 1)

    off = 0.0
    for pose in poses:
        ours, theirs = contacts(pose), by_surface.distances(pose, near[id(pose)])
        assert set(ours) <= set(theirs)
        off = max(off, *(abs(ours.get(pair, WITHIN) - min(d, WITHIN)) for pair, d in theirs.items()), 0.0)
    case = f"{name}: {NEAR}"
    bench.add(case, OURS, asked, poses, off)
    bench.add(case, WHOLE, whole, poses, 0.0)
    bench.add(case, BY_SURFACE, lambda pose: by_surface.distances(pose, near[id(pose)]), poses, 0.0)
    exact = {id(pose): max(whole(pose), 0.0) for pose in poses}

    def error(answer: Callable[[pin.SE3], float]) -> float:
        return max(abs(max(answer(pose), 0.0) - exact[id(pose)]) for pose in poses)

    if not fcl.MISSING:
        fcl_whole, fcl_by_surface = fcl.distance(*meshes), fcl.FirstContacts(*meshes)
        bench.add(case, FCL_BY_SURFACE, lambda pose: fcl_by_surface.distances(pose, near[id(pose)]), poses, 0.0)
    case = f"{name}: {CLEARANCE}"
    bench.add(case, OURS, clearance, poses, error(lambda pose: float(clearance(pose)["distance"][0])))
    bench.add(case, WHOLE, whole, poses, 0.0)
    if not fcl.MISSING:
        bench.add(case, FCL_WHOLE, fcl_whole, poses, error(fcl_whole))
    if not parry.MISSING:
        seconds, answers = parry.ask("distance", *meshes, poses, bench.passes)
        found = {id(pose): distance for pose, (distance,) in zip(poses, answers, strict=True)}
        bench.measured(case, PARRY, seconds, len(poses), error(lambda pose: found[id(pose)]))


def _impact(
    bench: _Rows, case: str, manager: CollisionManager, meshes: tuple[SurfaceMesh, SurfaceMesh],
    motions: list[tuple[pin.SE3, pin.SE3]],
) -> None:  # fmt: skip
    def ours(motion: tuple[pin.SE3, pin.SE3]) -> float:
        manager.set_pose(1, motion[0])
        return manager.time_of_impact({1: motion[1]}).t

    def stepped(motion: tuple[pin.SE3, pin.SE3], meet: peers.Query) -> float:
        start, twist = motion[0], pin.log6(motion[0].actInv(motion[1]))

        def collide(t: float) -> bool:
            return meet(start * pin.exp6(pin.Motion(t * twist.vector)))

        after = next((k / STEPS for k in range(STEPS + 1) if collide(k / STEPS)), None)
        if after is None:
            return 1.0
        before = max(0.0, after - 1.0 / STEPS)
        while after - before > 1e-7:
            middle = 0.5 * (before + after)
            before, after = (before, middle) if collide(middle) else (middle, after)
        return before

    coal = peers.first_contact(*meshes)
    times = [stepped(motion, coal) for motion in motions]
    bench.add(case, OURS, ours, motions, max(abs(ours(m) - t) for m, t in zip(motions, times, strict=True)))
    bench.add(case, STEPPED, lambda motion: stepped(motion, coal), motions, 0.0)
    if not fcl.MISSING:
        meet = fcl.first_contact(*meshes)
        off = max(abs(stepped(m, meet) - t) for m, t in zip(motions, times, strict=True))
        bench.add(case, FCL_STEPPED, lambda motion: stepped(motion, meet), motions, off)


def _penetration(
    bench: _Rows, case: str, manager: CollisionManager, ids: tuple[int, int], poses: list[pin.SE3]
) -> None:
    def ours(pose: pin.SE3) -> Any:
        manager.set_pose(ids[1], pose)
        return manager.penetration(*ids)

    try:
        sampled = peers.SampledDepth(manager.mesh(ids[0]), manager.mesh(ids[1]), SPACING)
    except ImportError:  # libigl comes with the tests
        bench.add(case, OURS, ours, poses, np.nan)
        return
    off = max(abs(float(ours(pose)["depth"].max(initial=0.0)) - sampled.query(pose)) for pose in poses)
    bench.add(case, OURS, ours, poses, off)
    bench.add(case, SAMPLED, sampled.query, poses, 0.0)
