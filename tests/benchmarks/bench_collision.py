"""Surface collision: the paper's Tables 1-3 on two digger components, ratios to coal, time against error.

One query is: for one pose, the set of (surface of a, surface of b) that meet. `seconds` is per query, the median over
passes of the mean over the poses, the call from Python included; `error` is the mean number of wrong surface pairs a
query, missed and invented together, against the truth that the case names.
"""

from __future__ import annotations

import importlib.util
import os
import platform
import sys
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from types import ModuleType
from typing import Any

import bench_collision_queries as queries
import collision_fcl as fcl
import collision_parry as parry
import collision_peers as peers
import numpy as np
import pinocchio as pin
from bench_collision_queries import CLEARANCE, NEAR

from collision import CollisionManager, Statistics, SurfaceMesh, colliding_surfaces
from collision.methods import examine
from vpframe.app.progress import report

PAPER = {
    "box tests, without OAABB / with": 40.0,
    "time, without OAABB / with": 30.0,
    "time, RAPID / with OAABB": 15.0,
}
"""The paper's ratios, for the table: RAPID's OBB trees stand behind the third, coal's in its place here."""

MANAGER = "manager"
"""`set_pose` and `colliding_surfaces` of a manager of two objects: what a session asks"""
ALONG, ORDER, TURNED = "along the trajectory", "its poses in random order", "poses of random orientation"
GOALS = {
    ALONG: (300.0, 75.0),
    **dict.fromkeys((ORDER, TURNED), (100.0, 25.0)),
    **dict.fromkeys((NEAR, CLEARANCE), (4.0, 4.0)),
}
"""times coal with all contacts, and coal's fastest way"""
METHODS = (MANAGER, "bvh", "oaabb", "brute")


def _digger() -> ModuleType:
    """`examples/digger.py`."""
    spec = importlib.util.spec_from_file_location("digger", Path(__file__).parents[2] / "examples" / "digger.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["digger"] = module
    spec.loader.exec_module(module)
    return module


def _as_set(pairs: Any) -> peers.Pairs:
    return pairs if isinstance(pairs, set) else {(int(s), int(t)) for s, t in pairs}


def _timed(query: Callable[[int], Any], n: int, passes: int) -> tuple[float, list[Any]]:
    """(median over passes of seconds a query, the last answers)."""
    answers = [query(k) for k in range(n)]  # also compiles and fills caches
    seconds = []
    for _ in range(passes):
        start = time.perf_counter()
        answers = [query(k) for k in range(n)]
        seconds.append((time.perf_counter() - start) / n)
    return median(seconds), answers


def _wrong(answers: Sequence[Any], truth: Sequence[peers.Pairs]) -> float:
    return float(np.mean([len(_as_set(a) ^ t) for a, t in zip(answers, truth, strict=True)]))


class _Bench:
    def __init__(self, quick: bool) -> None:
        self.passes = 1 if quick else 3
        self.rows: list[dict[str, Any]] = []
        self.counts: list[dict[str, Any]] = []

    def add(self, case: str, method: str, seconds: float, error: float, n: int) -> None:
        self.rows.append(
            {"case": case, "method": method, "seconds": seconds, "error": error, "unit": "wrong pairs/query", "n": n}
        )

    def seconds(self, case: str, method: str) -> float:
        return next(row["seconds"] for row in self.rows if (row["case"], row["method"]) == (case, method))

    def ways(
        self, case: str, a: SurfaceMesh, b: SurfaceMesh, poses: Sequence[pin.SE3], truth: Sequence[peers.Pairs] | None,
        methods: Sequence[str],
    ) -> None:  # fmt: skip
        """Time the methods on the poses; without a truth, the exact answer is it (found by the plain algorithm)."""
        n = len(poses)
        if truth is None:
            truth = [_as_set(colliding_surfaces(a, b, pose, method="oaabb")) for pose in poses]
        for method in methods:
            if method in METHODS:
                query = _ask(a, b, poses, method)
            elif method == "bounding boxes only":
                boxes = peers.surface_boxes(a), peers.surface_boxes(b)
                query = _boxes(boxes, poses)
            elif method == "float32":
                query = _each(peers.float32(a, b), poses)
            elif method.startswith(COAL_FIRST):
                query = _first(peers.FirstContacts(a, b, 1e-6 if method.endswith("1e-6") else 1e-10), poses)
            elif method == FCL_FIRST:
                query = _first(fcl.FirstContacts(a, b), poses)
            elif method == FCL_ALL:
                query = _each(fcl.all_contacts(a, b), poses)
            elif method == PARRY:
                near = [peers.BySurface(a, b).near(pose) for pose in poses]
                seconds, answers = parry.ask("pairs", a, b, poses, self.passes, near)
                self.add(case, method, seconds, _wrong(parry.pairs(answers), truth), n)
                continue
            else:
                tree = "BVHModelOBB" if "OBB trees" in method else "BVHModelOBBRSS"
                gjk = 1e-6 if method.endswith("1e-6") else 1e-10
                query = _each(peers.all_contacts(a, b, tree, gjk), poses)
            seconds, answers = _timed(query, n, 1 if method == "brute" else self.passes)
            self.add(case, method, seconds, _wrong(answers, truth), n)

    def count(self, case: str, a: SurfaceMesh, b: SurfaceMesh, poses: Sequence[pin.SE3], method: str) -> None:
        total = Statistics()
        found = 0
        for pose in poses:
            pairs, cost = examine(a, b, pose, method)  # type: ignore[arg-type]
            total += cost
            found += len(pairs)
        n = len(poses)
        self.counts.append(
            {
                "case": case, "method": method, "box_tests": total.box_tests / n,
                "triangle_tests": total.triangle_tests / n, "exact_fallbacks": total.exact_fallbacks / n,
                "colliding": found / n,
            }
        )  # fmt: skip


def _ask(a: SurfaceMesh, b: SurfaceMesh, poses: Sequence[pin.SE3], method: str) -> Callable[[int], Any]:
    if method == "bvh":
        return lambda k: colliding_surfaces(a, b, poses[k])
    if method == MANAGER:
        manager = CollisionManager()
        manager.add(a, pin.SE3.Identity(), movable=False)
        j = manager.add(b, poses[0])

        def asked(k: int) -> Any:
            manager.set_pose(j, poses[k])
            return manager.colliding_surfaces()[:, 1::2]

        return asked
    return lambda k: colliding_surfaces(a, b, poses[k], method)  # type: ignore[arg-type]


def _each(query: peers.Query, poses: Sequence[pin.SE3]) -> Callable[[int], Any]:
    return lambda k: query(poses[k])


def _first(first: peers.FirstContacts | fcl.FirstContacts, poses: Sequence[pin.SE3]) -> Callable[[int], Any]:
    near = [first.near(pose) for pose in poses]
    return lambda k: first.query(poses[k], near[k])


def _boxes(boxes: tuple[Any, Any], poses: Sequence[pin.SE3]) -> Callable[[int], Any]:
    return lambda k: peers.bounding_volumes(*boxes, poses[k])


COAL_ALL = "coal all contacts"
COAL_FIRST = "coal first contacts"
COAL_OBB = "coal OBB trees, all contacts"
FCL_ALL = "FCL all contacts"
FCL_FIRST = "FCL first contacts"
PARRY = "Parry first contacts"
PEERS = [
    COAL_ALL,
    COAL_FIRST,
    *([] if fcl.MISSING else [FCL_ALL, FCL_FIRST]),
    *([] if parry.MISSING else [PARRY]),
]
"""other programs that are asked for the colliding surface pairs; those that are missing are left out"""


def run(quick: bool = False) -> dict[str, Any]:
    """Measure; `quick` takes fewer poses and one pass, for a look."""
    digger = _digger()
    bench = _Bench(quick)
    n = 60 if quick else 200
    pairs = {
        "digger": (digger.link(), digger.arm(), digger.digger_trajectory(n)),
        "shaft": (digger.shaft(), digger.housing(), digger.shaft_trajectory(n)),
    }
    ratios: dict[str, float] = {}
    for number, (name, (a, b, poses)) in enumerate(pairs.items()):
        report(0.2 * number, name)
        order = np.random.default_rng(0).permutation(n)
        coherent, shuffled = f"{name}: {ALONG}", f"{name}: {ORDER}"
        methods = [MANAGER, "bvh", "oaabb", "brute", *PEERS]
        bench.ways(coherent, a, b, poses, None, [*methods, COAL_OBB] if name == "digger" else methods)
        bench.ways(shuffled, a, b, [poses[k] for k in order], None, [MANAGER, "bvh", *PEERS])
        turned = f"{name}: {TURNED}"
        bench.ways(turned, a, b, digger.unrelated_poses(a, b, n), None, [MANAGER, "bvh", *PEERS])
        for method in ("bvh", "oaabb", "brute"):
            bench.count(coherent, a, b, poses, method)
        for case in (coherent, shuffled, turned):
            for peer in PEERS:
                ratios[f"{case}: {peer} / {MANAGER}"] = bench.seconds(case, peer) / bench.seconds(case, MANAGER)
    case = "digger: along the trajectory"
    counts = {row["method"]: row for row in bench.counts if row["case"] == case}
    ratios["box tests, without OAABB / with"] = counts["brute"]["box_tests"] / counts["oaabb"]["box_tests"]
    ratios["time, without OAABB / with"] = bench.seconds(case, "brute") / bench.seconds(case, "oaabb")
    ratios["time, coal OBB trees / with OAABB"] = bench.seconds(case, COAL_OBB) / bench.seconds(case, "oaabb")
    report(0.4, "error of the facets")
    _against_error(bench, digger, quick)
    report(0.7, "second workload")
    _second_workload(bench, quick, ratios)
    report(0.75, "nearness, time of impact, penetration")
    asked, more = queries.rows(digger, quick)
    ratios |= more
    report(0.8, "a large scene")
    scene = _scene(quick, ratios)
    a, b, _ = pairs["digger"]
    return {
        "suite": "collision",
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}",
        "rows": [*bench.rows, *asked, *scene],
        "ratios": ratios,
        "counts": bench.counts,
        "components": [
            {"component": mesh.name, "surfaces": mesh.n_surfaces, "triangles": mesh.n_triangles} for mesh in (a, b)
        ],
    }


def _against_error(bench: _Bench, digger: ModuleType, quick: bool) -> None:
    """The same shaft and bore at several deflections, against the true surfaces of revolution."""
    poses = digger.shaft_trajectory(40 if quick else 120)
    truth = [_as_set(digger.true_pairs(pose)) for pose in poses]
    for sectors in (12, 24, 48, 96)[: 3 if quick else 4]:
        a, b = digger.shaft(sectors, None), digger.housing(sectors, None)
        deflection = 0.0101 * (1 - np.cos(np.pi / sectors))
        case = f"shaft against true surfaces, deflection {deflection * 1e6:.1f} µm"
        methods = [
            "bvh", "oaabb", "brute", "float32", *PEERS, f"{COAL_ALL}, gjk 1e-6", "bounding boxes only",
        ]  # fmt: skip
        bench.ways(case, a, b, poses, truth, methods)


def _second_workload(bench: _Bench, quick: bool, ratios: dict[str, float]) -> None:
    """FCL's recorded motion of two parts, where the environment names a folder that has it."""
    folder = os.environ.get("VPFRAME_DATA")
    path = Path(folder or ".") / "motion" / "fcl_manyframes_1.xml"
    if not folder or not path.is_file():
        return
    a, b, poses = read_fcl(path)
    poses = poses[:: 10 if quick else 1]
    case = "fcl_manyframes_1: its 501 frames" if not quick else "fcl_manyframes_1: every tenth frame"
    bench.ways(case, a, b, poses, None, ["bvh", "oaabb", *PEERS])
    for peer in PEERS:
        ratios[f"{case}: {peer} / best"] = bench.seconds(case, peer) / bench.seconds(case, "bvh")


def read_fcl(path: Path) -> tuple[SurfaceMesh, SurfaceMesh, list[pin.SE3]]:
    """The two meshes, cut into surfaces along edges of more than 30°, and the poses of the second in the first."""
    root = ElementTree.fromstring(f"<all>{path.read_text()}</all>")  # the file has two roots
    meshes = []
    for number, element in enumerate(root.iter("OBJECT")):
        grid = {g.get("id"): [float(g.get(k, "nan")) for k in "xyz"] for g in element.findall("GRID")}
        index = {name: i for i, name in enumerate(grid)}
        triangles = np.array([[index[t.get(k)] for k in ("g1", "g2", "g3")] for t in element.findall("TRIA")])
        vertices = np.array(list(grid.values()))
        meshes.append(SurfaceMesh(vertices, triangles, _smooth(vertices, triangles), name=f"fcl {number + 1}"))
    poses = []
    for frame in root.iter("FRAME"):
        world = []
        for k in ("obj1", "obj2"):
            rotation = np.array(frame.get(f"{k}_dc", "").split(), float).reshape(3, 3)
            u, _, v = np.linalg.svd(rotation)  # six decimals in the file: the nearest rotation
            world.append(pin.SE3(u @ v, np.array(frame.get(f"{k}_pos", "").split(), float)))
        poses.append(world[0].actInv(world[1]))
    return meshes[0], meshes[1], poses


def _smooth(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    normal = np.cross(*(vertices[triangles[:, k]] - vertices[triangles[:, 0]] for k in (1, 2)))
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = normal / np.where(length > 0, length, 1.0)
    edges = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(triangles)), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges, owner = edges[order], owner[order]
    same = (edges[1:] == edges[:-1]).all(axis=1)
    left, right = owner[:-1][same], owner[1:][same]
    flat = (normal[left] * normal[right]).sum(axis=1) > np.cos(np.radians(30.0))
    size = len(triangles)
    graph = coo_array((np.ones(int(flat.sum())), (left[flat], right[flat])), shape=(size, size))
    return connected_components(graph, directed=False)[1]


def _scene(quick: bool, ratios: dict[str, float]) -> list[dict[str, Any]]:
    """The rows of the large scene, measured by the suite beside this one; it holds no answers against a truth."""
    import bench_collision_scene

    rows = [{**row, "error": None} for row in bench_collision_scene.rows(quick)]
    for row, where in zip(rows[1:3], ("between them", "beside them"), strict=True):
        ratios[f"scene: half as many again that do not move, {where} / without"] = row["seconds"] / rows[0]["seconds"]
    return rows


def table(result: dict[str, Any]) -> str:
    """The paper's Tables 1-3 on our components, then every row and ratio."""
    lines = ["Table 1. Components", f"  {'component':10} {'surfaces':>9} {'triangles':>10}"]
    for row in result["components"]:
        lines.append(f"  {row['component']:10} {row['surfaces']:9d} {row['triangles']:10d}")
    case = "digger: along the trajectory"
    ratios = result["ratios"]
    lines += ["", "Table 2. With and without OAABB, a query along the digger's trajectory"]
    lines.append(f"  {'method':22} {'box tests':>12} {'triangle tests':>15} {'ms':>9} {'colliding pairs':>16}")
    names = {"brute": "without OAABB", "oaabb": "with OAABB", "bvh": "hierarchy (ours)"}
    time_of = {row["method"]: row["seconds"] for row in result["rows"] if row["case"] == case}
    for method, label in names.items():
        row = next(r for r in result["counts"] if (r["case"], r["method"]) == (case, method))
        lines.append(
            f"  {label:22} {row['box_tests']:12.0f} {row['triangle_tests']:15.1f} {1e3 * time_of[method]:9.4f}"
            f" {row['colliding']:16.2f}"
        )
    for ratio in ("box tests, without OAABB / with", "time, without OAABB / with"):
        lines.append(f"  {ratio}: {ratios[ratio]:.1f}x (the paper: {PAPER[ratio]:.0f}x)")
    lines += ["", "Table 3. Against OBB trees, a query along the digger's trajectory"]
    labels = {"oaabb": "with OAABB", COAL_OBB: COAL_OBB, **{peer: peer for peer in PEERS}, "bvh": "hierarchy (ours)"}
    lines += [f"  {labels[m]:30} {1e3 * time_of[m]:9.4f} ms" for m in labels if m in time_of]
    lines += [f"  {missing}" for missing in (fcl.MISSING, parry.MISSING) if missing]
    paper = PAPER["time, RAPID / with OAABB"]
    lines.append(
        f"  coal's OBB trees / with OAABB: {ratios['time, coal OBB trees / with OAABB']:.1f}x"
        f" (the paper, RAPID in coal's place: {paper:.0f}x)"
    )
    lines += ["", *_where_they_differ(result), "", "All rows"]
    width = max(len(row["case"]) for row in result["rows"])
    for row in result["rows"]:
        error = "" if row["error"] is None else f"{row['error']:.3g} "
        lines.append(
            f"  {row['case']:{width}} {row['method']:30} {1e6 * row['seconds']:12.1f} µs"
            f" {error:>10}{row['unit']} (n={row['n']})"
        )
    lines += ["", "Ratios", *(f"  {name}: {value:.3g}{_goal(name, value)}" for name, value in ratios.items())]
    return "\n".join(lines)


def _goal(name: str, value: float) -> str:
    """What was aimed at for a ratio, and whether it is met."""
    case, _, ways = name.partition(": ")[2].partition(": ")
    if case not in GOALS or not ways.startswith("coal"):
        return ""
    goal = GOALS[case][0 if ways.startswith(COAL_ALL) else 1]
    return f" (goal {goal:g}: {'met' if value >= goal else 'missed'})"


def _where_they_differ(result: dict[str, Any]) -> list[str]:
    ratios = result["ratios"]
    lines = ["Where this differs from the paper, and why"]
    lines.append(
        "  RAPID is not run: coal's OBB trees (BVHModelOBB, every contact) stand in its place; coal does not count its"
        " box tests."
    )
    lines.append(
        "  Components and trajectory are built to the paper's counts of surfaces and triangles; the paper's own are not"
        " public."
    )
    for name, said in PAPER.items():
        ours = ratios["time, coal OBB trees / with OAABB" if "RAPID" in name else name]
        word = "more" if ours > said else "less"
        lines.append(f"  {name}: {ours:.1f}x here, {said:.0f}x there ({word}).")
    lines.append(
        "  Both ways a surface pair ends at its first hit, so what OAABB saves depends on how many of the overlapping"
        " surface pairs do not collide."
    )
    return lines


def plot(result: dict[str, Any], directory: str | Path) -> list[Path]:
    """Time a query against wrong surface pairs, one point a method and deflection; the files written."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    folder = Path(directory)
    folder.mkdir(parents=True, exist_ok=True)
    chosen = [row for row in result["rows"] if row["case"].startswith("shaft against true surfaces")]
    figure, axes = plt.subplots(figsize=(8, 5.5))
    for method in dict.fromkeys(row["method"] for row in chosen):
        rows = [row for row in chosen if row["method"] == method]
        axes.plot([1e6 * r["seconds"] for r in rows], [r["error"] for r in rows], "o-", label=method, alpha=0.8)
        for r in rows if method == "bvh" else []:
            axes.annotate(
                r["case"].rsplit(" ", 2)[-2] + " µm", (1e6 * r["seconds"], r["error"]), rotation=35, fontsize=8
            )
    axes.set(xscale="log", xlabel="µs a query", ylabel="wrong surface pairs a query")
    axes.set_yscale("symlog", linthresh=0.1)
    axes.set_ylim(-0.02, 3.0 * max(1.0, *(row["error"] for row in chosen)))
    axes.set_title("Shaft in bore, 1 % clearance, at several deflections: time against error")
    axes.grid(True, which="both", alpha=0.3)
    axes.legend(fontsize=8)
    figure.tight_layout()
    path = folder / "collision_speed_against_error.png"
    figure.savefig(path, dpi=120)
    plt.close(figure)
    return [path]


if __name__ == "__main__":
    print(table(run(quick="--quick" in sys.argv)))
