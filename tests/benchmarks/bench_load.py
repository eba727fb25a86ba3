"""The load suite: processor time of `vpframe.load` against that of OpenCascade's own read and mesh of the same file.

Both run in processes of their own, whose start and imports count, at the same deflection and angle; ours without a
cache, then with one. Cases are the STEP files below the folder of `--corpus` alone; by default those below the folder
VPFRAME_DATA, and assemblies that are generated (`--number instances=N` takes one of N instances). `--only` takes some.
`error` is the number of open shapes, `memory` the peak of the largest of our processes. Meshes of 1,000 to 100,000
triangles follow: the processor time in which their surfaces are found, with their number.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from bench_run import chosen

from vpframe.app.progress import report
from vpframe.errors import VpframeError
from vpframe.importers.mesh_files import weld
from vpframe.importers.meshes import segmented
from vpframe.importers.raw import RawFace, RawShape
from vpframe.scene import modelling as m

GENERATED = (100, 500, 2000)
TRIANGLES = (1_000, 10_000, 50_000, 100_000)
DEFLECTION, ANGULAR = 1e-4, 0.35
KERNEL = """
import json, sys, time
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.Message import Message, Message_Printer
from OCP.STEPCAFControl import STEPCAFControl_Reader
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.XCAFDoc import XCAFDoc_DocumentTool, XCAFDoc_ShapeTool
from OCP.collections import Sequence_TDF_Label
Message.DefaultMessenger_s().RemovePrinters(Message_Printer.get_type_descriptor_s())
began = time.process_time()
document = TDocStd_Document(TCollection_ExtendedString("XmlXCAF"))
reader = STEPCAFControl_Reader()
for wanted in ("Name", "Color", "Mat", "Props", "GDT"):
    getattr(reader, f"Set{wanted}Mode")(True)
reader.ReadFile(sys.argv[1])
reader.Transfer(document)
labels = Sequence_TDF_Label()
XCAFDoc_DocumentTool.ShapeTool_s(document.Main()).GetFreeShapes(labels)
solids = 0
for i in range(1, labels.Length() + 1):
    shape = XCAFDoc_ShapeTool.GetShape_s(labels.Value(i))
    BRepMesh_IncrementalMesh(shape, float(sys.argv[2]) * 1e3, False, float(sys.argv[3]), True)
    found = TopExp_Explorer(shape, TopAbs_ShapeEnum.TopAbs_SOLID)
    while found.More():
        solids += 1
        found.Next()
print(json.dumps({"solids": solids, "alone": time.process_time() - began}))
"""
OURS = """
import json, resource, sys
with open("/proc/self/clear_refs", "w") as peak:
    peak.write("5")  # forgets the peak that Linux hands down from the parent
import vpframe as vp
scene = vp.load(sys.argv[1], deflection=float(sys.argv[2]), angular=float(sys.argv[3]))
shapes = {id(part.shape): part.shape for part in scene.parts}.values()
print(json.dumps({"parts": len(scene), "open": sum(not shape.closed for shape in shapes),
    "memory": 1024 * max(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss,
        *(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmHWM"))),
    "faces": sum(shape.mesh.n_surfaces for shape in shapes), "lost": sum("lost" in n for n in scene.all_notes())}))
"""


def assembly(count: int, folder: Path) -> Path:
    """Write an assembly of `count` instances of ten shapes in rows."""
    shapes = [
        m.box(0.02, 0.02, 0.01 + 0.001 * i).filleted(0.002)
        - m.cylinder(0.003 + 0.0003 * i, 0.05).translated(0.01, 0.01, -0.01)
        for i in range(10)
    ]
    parts = {
        f"part_{i}": (shapes[i % 10], pin.SE3(np.eye(3), np.array([0.03 * (i % 50), 0.03 * (i // 50), 0.0])))
        for i in range(count)
    }
    return m.write_step(folder / f"assembly_{count}.step", parts)


def sheet(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3), m, and about `count` triangles (m, 3) of a wavy sheet, which no analytic surface fits."""
    n = 1 + round((count / 2) ** 0.5)
    x, y = np.meshgrid(*2 * [np.linspace(0.0, 0.1, n)], indexing="ij")
    z = 0.004 * np.sin(60.0 * x) * np.cos(45.0 * y) + 0.002 * np.sin(130.0 * x + 70.0 * y)
    return np.stack([x, y, z], axis=2).reshape(-1, 3), _grid(n, n)


def shaft(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and about `count` triangles of a shaft of cylinders, shoulders and chamfers, 36 segments round."""
    steps = max(1, round(count / (6 * 36)))
    k, turn = np.arange(steps)[:, None], np.linspace(0.0, 2.0 * np.pi, 37)
    profile = np.stack(
        [0.005 + 0.001 * (k % 2) + [0.0, 0.0, 0.0005], 0.004 * k + [0.0, 0.003, 0.0035]], axis=2
    ).reshape(-1, 2)  # radius and height
    radius, height = profile.T
    rings = np.stack(
        [np.outer(radius, np.cos(turn)), np.outer(radius, np.sin(turn)), np.outer(height, turn**0)], axis=2
    )
    return rings.reshape(-1, 3), _grid(len(profile), 37)


def _grid(rows: int, columns: int) -> np.ndarray:
    i = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (corner.ravel() for corner in (i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]))
    return np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])


MESHES = {"wavy sheet": sheet, "shaft": shaft}


def segmentation(name: str, make: Callable[[int], tuple[np.ndarray, np.ndarray]], count: int) -> dict[str, Any]:
    """The row of a mesh: processor time in which its surfaces are found, compiled code at hand."""
    for size in (400, count):  # the first compiles
        points, corners = weld(*make(size))
        raw = RawShape(points, corners, np.zeros(len(corners), np.int32), [RawFace("mesh")], segmented=False)
        began = time.process_time()
        found = segmented(raw)
        seconds = time.process_time() - began
    row = {"case": name, "method": "segmentation", "seconds": seconds, "error": None, "unit": "", "n": 1}
    return row | {"triangles": len(corners), "faces": len(found.faces)}


def cases(counts: Sequence[int], corpus: Path | None = None) -> dict[str, Callable[[Path], Path]]:
    """Return a function that gives the file of each case in a temporary folder."""
    found: dict[str, Callable[[Path], Path]] = {}
    root = corpus or os.environ.get("VPFRAME_DATA")
    files = sorted(Path(root).rglob("*")) if root else []
    for file in files:
        if file.suffix.lower() in (".step", ".stp"):
            found[str(file.relative_to(root or ""))] = lambda folder, file=file: file  # type: ignore[misc]
    if corpus is not None and not found:
        raise VpframeError(f"--corpus {corpus}: holds no STEP file")
    for count in () if corpus is not None else counts:
        found[f"generated, {count} instances"] = lambda folder, count=count: assembly(count, folder)  # type: ignore[misc]
    return found


def measure(script: str, file: Path, cache: str) -> tuple[dict[str, Any], float]:
    """Run a script on a file; return what it prints, and the processor time, s."""
    command = [sys.executable, "-c", script, str(file), str(DEFLECTION), str(ANGULAR)]
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as wrong:
        process = subprocess.Popen(command, stdout=out, stderr=wrong, env={**os.environ, "VPFRAME_CACHE": cache})
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        wrong.seek(0)
        if process.returncode:
            raise RuntimeError(f"{file.name}: {wrong.read().strip().splitlines()[-1]}")
        return json.loads(out.read()), usage.ru_utime + usage.ru_stime


def run(
    quick: bool = False, only: Sequence[str] = (), instances: int | None = None, corpus: Path | None = None
) -> dict[str, Any]:
    """A row a file and method; the ratios of processor time."""
    rows, ratios = [], {}
    counts = (instances,) if instances else GENERATED[: 1 if quick else None]
    with tempfile.TemporaryDirectory(prefix="vpframe-bench-") as folder:
        meshes = (
            {} if corpus or instances else {f"{m}, {n} triangles": (MESHES[m], n) for m in MESHES for n in TRIANGLES}
        )
        for name, make in chosen({**cases(counts, corpus), **meshes}, only).items():
            report(None, name)
            if name in meshes:
                rows.append(segmentation(name, *meshes[name]))
                continue
            file, cache = make(Path(folder)), os.path.join(folder, "cache")
            found, kernel = measure(KERNEL, file, "")
            loaded, first = measure(OURS, file, cache)
            _, second = measure(OURS, file, cache)
            size = file.stat().st_size / 1e6
            each = {"case": name, "unit": "open shapes", "size": size, **found, **loaded}
            for method, seconds in (("OpenCascade", kernel), ("first load", first), ("second load", second)):
                error = loaded["open"] if method != "OpenCascade" else None
                rows.append({**each, "method": method, "seconds": seconds, "error": error, "n": 1})
            ratios[f"{name}: first load x OpenCascade"] = first / kernel
    return {"suite": "load", "machine": platform.platform(), "rows": rows, "ratios": ratios}


def table(result: dict[str, Any]) -> str:
    """A line a file."""
    head = f"{'file':<36}{'MB':>6}{'kernel s':>10}{'alone':>8}{'first s':>9}{'ratio':>7}{'second s':>10}"
    lines = [f"{head}{'solids':>8}{'parts':>7}{'faces':>7}{'open':>6}{'lost':>6}{'MiB':>6}"]
    by_method = {(row["case"], row["method"]): row for row in result["rows"]}
    for row in result["rows"]:
        if row["method"] == "OpenCascade":
            first, second = (by_method[row["case"], f"{which} load"]["seconds"] for which in ("first", "second"))
            times = (
                f"{row['seconds']:>10.2f}{row['alone']:>8.2f}{first:>9.2f}{first / row['seconds']:>7.2f}{second:>10.2f}"
            )
            counts = f"{row['solids']:>8}{row['parts']:>7}{row['faces']:>7}{row['open']:>6}{row['lost']:>6}"
            lines.append(f"{row['case'][-35:]:<36}{row['size']:>6.2f}{times}{counts}{row['memory'] / 2**20:>6.0f}")
    for row in result["rows"]:
        if row["method"] == "segmentation":
            lines.append(f"{row['case']:<36}{row['seconds']:>10.2f} s to segment into {row['faces']} surfaces")
    lines.append("processor time; kernel: OpenCascade's read and mesh with the start of its process, alone: without it")
    return "\n".join([*lines, result["machine"]])


def plot(result: dict[str, Any], directory: str | Path) -> None:
    """Ratio over the size of the file."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(5, 3))
    rows = [row for row in result["rows"] if row["method"] == "first load"]
    axis.loglog([row["size"] for row in rows], [row["seconds"] for row in rows], "o")
    axis.set(xlabel="size of the file, MB", ylabel="processor time of the first load, s")
    Path(directory).mkdir(parents=True, exist_ok=True)
    figure.savefig(Path(directory) / "load.png", bbox_inches="tight", dpi=120)
    plt.close(figure)


if __name__ == "__main__":
    print(table(run(only=sys.argv[1:])))
