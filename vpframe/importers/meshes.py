"""Mesh files through the reading process, and the surfaces of bare meshes."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from collision import Tolerance
from vpframe.errors import LoadError
from vpframe.importers import archive, guarded, limits
from vpframe.importers.checks import beside, checked_format, content
from vpframe.importers.face_geometry import raw_numbers
from vpframe.importers.raw import Options, RawFace, RawScene, RawShape, UnreadableError
from vpframe.importers.segmentation import segment

if TYPE_CHECKING:
    import trimesh

PACKAGES = ("manifold3d", "numpy", "scipy", "trimesh")
"""needed in the reading process"""
_MEND = "it is damaged or too large; export it again, with fewer triangles"
_MATERIALS = re.compile(rb"mtllib([^\r\n]*)")


def files_of(path: Path, form: str) -> list[Path]:
    """Return the file and its material files; empty if it refers to others."""
    data = content(path)
    if form == "glb" and b'"uri"' in data:
        return []
    names = _MATERIALS.findall(data) if form == "obj" else []
    found = (beside(path.parent, name.strip().decode("utf-8", "replace")) for name in names)
    return [path, *dict.fromkeys(file for file in found if file is not None)]


def read(path: Path, form: str, options: Options) -> RawScene:
    """Return the raw scene of a mesh file; LoadError with one line if it has no usable triangles."""
    (raw,) = _read([{"path": path, "form": form, "unit": options.unit, "factors": None}], options)
    if isinstance(raw, LoadError):
        raise raw
    return raw


def read_scaled(wanted: Sequence[tuple[Path, tuple[float, ...]]]) -> list[RawScene | LoadError]:
    """Read mesh files in metres with their coordinates scaled by factors (3,), as in robot models, in one process."""
    found: list[RawScene | LoadError | None] = []
    tasks = []
    for path, factors in wanted:
        try:
            form = checked_format(path)
            if form not in ("stl", "obj", "ply", "glb"):
                why = f"{path}: is {form.upper()}, no mesh; convert it to STL, OBJ, PLY or GLB"
                raise LoadError(why, str(path))
            tasks.append({"path": path, "form": form, "unit": None, "factors": [float(f) for f in factors]})
            found.append(None)
        except LoadError as error:
            found.append(error)
    read = iter(_read(tasks, Options(0.0, 0.0)))
    return [next(read) if each is None else each for each in found]


def read_object(source: trimesh.Trimesh | trimesh.Scene, unit: str | None) -> RawScene:
    """Return the raw scene of a trimesh mesh or scene; its `units` are the default of `unit`."""
    import trimesh

    from vpframe.importers import mesh_files

    raw = RawScene()
    name = str(source.metadata.get("name") or source.metadata.get("file_name") or "mesh")
    path = Path(name)
    scene = source if isinstance(source, trimesh.Scene) else trimesh.Scene()
    if isinstance(source, trimesh.Trimesh):
        scene.add_geometry(source, node_name=path.stem, geom_name=path.stem)
    try:
        pieces = mesh_files.pieces_of("trimesh", scene, set())
        if unit is None and source.units is not None:
            try:
                scale = float(trimesh.units.unit_conversion(source.units, "meters"))
            except (KeyError, ValueError):
                why = f"its units are {source.units!r}, which are unknown; give unit="
                raise UnreadableError(why) from None
        else:
            scale = mesh_files.scale_of("trimesh", unit, pieces, raw)
        return mesh_files.made(path.stem, raw, pieces, scale)
    except UnreadableError as error:
        raise LoadError(f"{path}: {error}", name) from None


def _read(tasks: list[dict[str, Any]], options: Options) -> list[RawScene | LoadError]:
    """Read files in a process; one that reaches a limit or crashes it costs no other."""
    found: list[RawScene | LoadError] = []
    while len(found) < len(tasks):
        left = tasks[len(found) :]
        size = sum(task["path"].stat().st_size for task in left)
        folder_of = left[0]["path"].resolve().parent
        request = {
            "format": "meshes",
            "files": [{**task, "path": str(task["path"].resolve())} for task in left],
            "folders": guarded.package_folders(folder_of, PACKAGES),
        }
        with tempfile.TemporaryDirectory(prefix="vpframe-") as folder:
            outcome = guarded.Reading(limits.of_meshes(size, options.timeout), "the mesh reader")
            guarded.run({**request, "out": folder}, folder, outcome, options.progress)
            for i, task in enumerate(left):
                path, made, refused = task["path"], Path(folder, f"{i}.archive"), Path(folder, f"{i}.error")
                if made.exists() and (options.timeout is None or not outcome.late):
                    found.append(archive.read(made))
                    continue
                how = outcome.error or f"{outcome.how_it_ended()} {outcome.where_it_ended()}"
                why = refused.read_text(encoding="utf-8") if refused.exists() else f"{how}; {_MEND}"
                found.append(LoadError(f"{path}: {why}", str(path)))
                if not refused.exists():
                    break
    return found


def bare(raw: RawShape) -> RawShape:
    """Return a mesh of one face, welded, whose surfaces are found later."""
    from vpframe.importers import mesh_files

    piece = mesh_files.Piece("mesh", raw.vertices, raw.triangles.astype(np.int64), None, np.eye(3), np.zeros(3), 0)
    made = mesh_files.shape_of([piece])
    return raw if made is None else made


def segmented(raw: RawShape) -> RawShape:
    """Return a mesh with its surfaces; the shape itself if it has them."""
    if raw.segmented:
        return raw
    tolerance = Tolerance()
    diagonal = float(np.linalg.norm(np.ptp(raw.vertices, axis=0)))
    found = segment(raw.vertices, raw.triangles, min(tolerance.fit, tolerance.segment_relative * diagonal), tolerance)
    surface = np.empty(len(raw.triangles), np.int32)
    faces = []
    for i, s in enumerate(found):
        surface[s.triangles] = i
        kind, numbers = raw_numbers(s.geometry)
        faces.append(RawFace(f"surface_{i + 1}", kind, numbers, typed=bool(kind), residual=s.residual))
    return replace(raw, face_of_triangle=surface, faces=faces, segmented=True)
