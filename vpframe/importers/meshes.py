"""STL, OBJ, PLY and GLB through trimesh: welded, segmented into surfaces, in metres."""

from __future__ import annotations

import io
import json
import logging
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from collision import Tolerance
from vpframe.errors import LoadError
from vpframe.importers.build import raw_numbers
from vpframe.importers.checks import STL_HEADER, checked_format, far_check, is_binary_stl
from vpframe.importers.names import numbered
from vpframe.importers.polyhedron import mass_properties, open_edges, triangle_area_vectors, without_flat
from vpframe.importers.raw import Array, Color, RawFace, RawPart, RawScene, RawShape
from vpframe.importers.segmentation import segment
from vpframe.scene.units import METRES

Progress = Callable[[float, str], None]

logging.getLogger("trimesh").addHandler(logging.NullHandler())  # else messages about damaged files go to stderr

_MATERIALS = re.compile(rb"mtllib([^\r\n]*)")
_TRIANGLES = 4
_UNREAD = {"primitives of points": (0,), "primitives of lines": (1, 2, 3), "triangle fans": (6,)}
"""unsupported modes of glTF primitives (glTF 2.0, 5.24)"""
_MILLIMETRES_ABOVE = 2.0
"""extent above which a file without a unit is read in millimetres: few parts serviced by hand exceed two metres, and
few are below two millimetres"""


@dataclass
class _Piece:
    """A unit of the file: an object, a group or the triangles of a material."""

    name: str
    vertices: Array
    triangles: NDArray[np.int64]
    color: Color | None
    rotation: Array
    translation: Array
    source: int
    """pieces of one source are instances of one shape"""


def files_of(path: Path, form: str) -> list[Path]:
    """Return the file and its material files; empty if it refers to others."""
    data = path.read_bytes()
    if form == "glb" and b'"uri"' in data:
        return []
    names = _MATERIALS.findall(data) if form == "obj" else []
    beside = (path.parent / name.strip().decode("utf-8", "replace") for name in names)
    return [path, *(file for file in beside if file.is_file())]


def read(path: Path, form: str, unit: str | None, tolerance: Tolerance, progress: Progress | None) -> RawScene:
    """Return the raw scene of a mesh file; LoadError with one line if it has no usable triangles."""
    raw = RawScene()
    pieces = _load(path, form, raw)
    return _made(path, raw, pieces, _scale(path, form, unit, pieces, raw), tolerance, progress)


def read_object(
    source: trimesh.Trimesh | trimesh.Scene, unit: str | None, tolerance: Tolerance, progress: Progress | None
) -> RawScene:
    """Return the raw scene of a trimesh mesh or scene; its `units` are the default of `unit`."""
    raw = RawScene()
    name = str(source.metadata.get("name") or source.metadata.get("file_name") or "mesh")
    path = Path(name)
    scene = source if isinstance(source, trimesh.Scene) else trimesh.Scene()
    if isinstance(source, trimesh.Trimesh):
        scene.add_geometry(source, node_name=path.stem, geom_name=path.stem)
    pieces = _pieces(path, "trimesh", scene, set())
    if unit is None and source.units is not None:
        try:
            scale = float(trimesh.units.unit_conversion(source.units, "meters"))
        except (KeyError, ValueError):
            raise LoadError(f"{path}: its units are {source.units!r}, which are unknown; give unit=", name) from None
    else:
        scale = _scale(path, "trimesh", unit, pieces, raw)
    return _made(path, raw, pieces, scale, tolerance, progress)


def read_scaled(path: Path, factors: tuple[float, ...], tolerance: Tolerance) -> RawScene:
    """Read a mesh file in metres with its coordinates scaled by `factors` (3,), as in robot models."""
    form = checked_format(path)
    if form not in ("stl", "obj", "ply", "glb"):
        raise LoadError(f"{path}: is {form.upper()}, no mesh; convert it to STL, OBJ, PLY or GLB", str(path))
    raw = RawScene()
    pieces = _load(path, form, raw)
    if factors != (1.0, 1.0, 1.0):
        for piece in pieces:
            piece.vertices = (piece.vertices @ piece.rotation.T + piece.translation) * np.array(factors)
            piece.rotation, piece.translation, piece.source = np.eye(3), np.zeros(3), -1 - len(pieces) - piece.source
            if np.prod(factors) < 0.0:
                piece.triangles = piece.triangles[:, [0, 2, 1]]
    return _made(path, raw, pieces, 1.0, tolerance, None)


def surfaced(raw: RawShape) -> RawShape:
    """Segment a mesh of one face into surfaces."""
    piece = _Piece("mesh", raw.vertices, raw.triangles.astype(np.int64), None, np.eye(3), np.zeros(3), 0)
    made = _shape(Path("mesh"), [piece], Tolerance())
    return raw if made is None else made


def _made(
    path: Path, raw: RawScene, pieces: list[_Piece], scale: float, tolerance: Tolerance, progress: Progress | None
) -> RawScene:
    for piece in pieces:
        piece.vertices = piece.vertices * scale
        piece.translation = piece.translation * scale
        far_check(path, piece.name, piece.vertices, piece.translation)
    bodies = _bodies(pieces, path.stem)
    known: dict[int, int] = {}
    for i, (name, members) in enumerate(zip(numbered([b[0] for b in bodies]), (b[1] for b in bodies), strict=True)):
        if progress is not None:
            progress(0.1 + 0.9 * i / len(bodies), f"finding the surfaces of {name}")
        first = members[0]
        if len(members) > 1 or first.source not in known:
            shape = _shape(path, members, tolerance)
            if shape is None:
                raw.notes.append(f"part {name} is lost: it has no triangle of positive area")
                continue
            known[first.source] = len(raw.shapes)
            raw.shapes.append(shape)
        part = RawPart(name, known[first.source], first.rotation, first.translation, first.color)
        raw.parts.append(part)
    if not raw.parts:
        raise LoadError(f"{path}: holds no triangle of positive area; export it again, as a surface mesh", str(path))
    return raw


def _load(path: Path, form: str, raw: RawScene) -> list[_Piece]:
    options: dict[str, Any] = {"split_objects": True, "split_groups": True} if form == "obj" else {}
    data = path.read_bytes()
    nodes: set[str] = set()
    if form == "glb":
        header = _glb_header(path, data)
        raw.notes.extend(_no_triangles(header))
        nodes = {str(node.get("name")) for node in header.get("nodes", []) if isinstance(node, dict)}
    try:
        file = io.BytesIO(_utf8(data, form))
        with np.errstate(all="ignore"):  # values that are not finite are found later
            scene = trimesh.load_scene(
                file, file_type=form, resolver=_FolderResolver(str(path)), process=False, **options
            )
    except Exception as error:  # the loaders' errors have no common base
        line = str(error).strip().splitlines() or [type(error).__name__]
        message = f"{path}: cannot be parsed as {form.upper()} ({line[0][:120]}); export it again"
        raise LoadError(message, str(path)) from None
    return _pieces(path, form, scene, nodes)


def _pieces(path: Path, form: str, scene: trimesh.Scene, nodes: set[str]) -> list[_Piece]:
    pieces: list[_Piece] = []
    places = {name: i for i, name in enumerate(scene.geometry)}
    placed = [(places[scene.graph[node][1]], _node_name(str(node), nodes), node) for node in scene.graph.nodes_geometry]
    for number, name, node in sorted(placed, key=lambda p: p[:2]):
        matrix, key = scene.graph[node]
        mesh = scene.geometry[key]
        if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
            continue
        vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
        _check(path, name, vertices, faces, matrix)
        rotation, translation = matrix[:3, :3], matrix[:3, 3]
        source = number
        if not np.allclose(rotation.T @ rotation, np.eye(3), atol=1e-6) or np.linalg.det(rotation) < 0:
            vertices = vertices @ rotation.T
            if np.linalg.det(rotation) < 0:
                faces = faces[:, [0, 2, 1]]
            rotation, source = np.eye(3), -1 - len(pieces)
        pieces.append(_Piece(name, vertices, faces, _color(mesh, form), rotation, translation, source))
    if not pieces:
        raise LoadError(f"{path}: holds no triangles; export it again, as a surface mesh", str(path))
    return pieces


class _FolderResolver(trimesh.resolvers.FilePathResolver):
    """Reads files of the mesh file's folder; materials as UTF-8."""

    def get(self, name: str) -> bytes:
        """Return the content of a file."""
        data: bytes = super().get(name)
        return _utf8(data, "obj") if name.lower().endswith(".mtl") else data


def _utf8(data: bytes, form: str) -> bytes:
    """Return the file with its text in UTF-8, converted from Latin-1 if necessary: names may have umlauts."""
    if form == "glb":
        return data  # UTF-8 by definition
    if form == "stl" and is_binary_stl(data):
        return b" " * STL_HEADER + data[STL_HEADER:]  # the header is not needed
    end = len(data) if form != "ply" else data.find(b"end_header")
    try:
        data[:end].decode("utf-8")
    except UnicodeDecodeError:
        return data[:end].decode("latin-1").encode("utf-8") + data[end:]
    return data


def _glb_header(path: Path, data: bytes) -> dict[str, Any]:
    """Return the JSON header of a GLB file (glTF 2.0, section 4.4)."""
    length = int.from_bytes(data[12:16], "little")
    try:
        header = json.loads(data[20 : 20 + length].decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise LoadError(f"{path}: its JSON is damaged ({error}); export it again", str(path)) from None
    if not isinstance(header, dict):
        raise LoadError(f"{path}: its JSON is no object; export it again", str(path))
    compressed = [e for e in header.get("extensionsRequired", []) if "compression" in str(e)]
    if compressed:
        raise LoadError(f"{path}: {compressed[0]} is not read; export it again, without compression", str(path))
    return header


def _no_triangles(header: dict[str, Any]) -> list[str]:
    """Return a line for each mesh of a GLB file with unsupported primitives."""
    notes = []
    for i, mesh in enumerate(header.get("meshes", [])):
        modes = [p.get("mode", _TRIANGLES) for p in mesh.get("primitives", [])] if isinstance(mesh, dict) else []
        for words, kinds in _UNREAD.items():
            count = sum(mode in kinds for mode in modes)
            if count:
                name = mesh.get("name", f"number {i}")
                notes.append(f"mesh {name}: {words} left out ({count}); only triangles and triangle strips are read")
    return notes


def _node_name(name: str, nodes: set[str]) -> str:
    """Return the node's name without the random suffix that the reader gives to further primitives of a mesh."""
    stem = re.sub("_[0-9a-f]{6}$", "", name)
    return stem if name not in nodes and stem in nodes else name


def _check(path: Path, name: str, vertices: Array, faces: NDArray[np.int64], matrix: Array) -> None:
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        message = f"{path}: vertices of {name} have shape {vertices.shape}; three numbers a vertex are needed"
        raise LoadError(f"{message}: export it again", str(path))
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        at = f"vertex {bad[0]} of {name}"
        message = f"{path}: {at} is {vertices[bad[0]].tolist()}; coordinates must be finite: export it again"
        raise LoadError(message, str(path))
    if not np.isfinite(matrix).all():
        row = next(row for row in matrix.tolist() if not np.isfinite(row).all())
        message = f"{path}: {name} is placed by a matrix with the row {row}; numbers must be finite: export it again"
        raise LoadError(message, str(path))
    bad = np.flatnonzero(((faces < 0) | (faces >= len(vertices))).any(axis=1))
    if len(bad):
        message = f"{path}: triangle {bad[0]} of {name} names a vertex that does not exist; export it again"
        raise LoadError(message, str(path))


def _color(mesh: trimesh.Trimesh, form: str) -> Color | None:
    """Return a part's colour, sRGB. GLB has linear values, and white for materials without colour (glTF 2.0, 5.22)."""
    visual = mesh.visual
    if visual is None or not visual.defined:
        return None
    material = getattr(visual, "material", None)
    value = getattr(material, "main_color", None) if material is not None else getattr(visual, "main_color", None)
    if form == "glb" and material is not None and getattr(material, "baseColorFactor", value) is None:
        value = (255, 255, 255, 255)
    if value is None or len(value) < 3:
        return None
    r, g, b, a = (float(c) / 255.0 for c in (*value[:3], value[3] if len(value) > 3 else 255))
    linear = form == "glb" or isinstance(material, trimesh.visual.material.PBRMaterial)
    return (_srgb(r), _srgb(g), _srgb(b), a) if linear else (r, g, b, a)


def _srgb(linear: float) -> float:
    """Convert a linear value to sRGB, both in 0 … 1 (IEC 61966-2-1)."""
    return 12.92 * linear if linear <= 0.0031308 else 1.055 * linear ** (1.0 / 2.4) - 0.055


def _scale(path: Path, form: str, unit: str | None, pieces: list[_Piece], raw: RawScene) -> float:
    if form == "glb":
        return 1.0  # metres by definition
    if unit is not None:
        return METRES[unit]
    corners = np.concatenate([p.vertices @ p.rotation.T + p.translation for p in pieces])
    extent = float(np.ptp(corners, axis=0).max())
    guess = "mm" if extent > _MILLIMETRES_ABOVE else "m"
    raw.notes.append(f"{form.upper()} files name no unit: {extent:g} is taken as {guess}; give unit= if that is wrong")
    return METRES[guess]


def _bodies(pieces: list[_Piece], stem: str) -> list[tuple[str, list[_Piece]]]:
    """Group pieces into parts: closed or isolated pieces alone, pieces that share borders together."""
    if len(pieces) == 1:
        return [(stem, pieces)]
    open_pieces = [p for p in pieces if len(open_edges(weld(p.vertices, p.triangles)[1]))]
    group = _touching(open_pieces)
    bodies: list[tuple[str, list[_Piece]]] = []
    shared = sum(group.count(g) > 1 for g in set(group))
    for piece in pieces:
        if piece not in open_pieces:
            bodies.append((piece.name, [piece]))
            continue
        g = group[open_pieces.index(piece)]
        members = [p for p, k in zip(open_pieces, group, strict=True) if k == g]
        if members[0] is piece:
            name = stem if len(members) > 1 and shared == 1 else piece.name
            bodies.append((name, members))
    return bodies


def _touching(pieces: list[_Piece]) -> list[int]:
    """Return the group of each piece; pieces that share vertices, directly or indirectly, have the same group."""
    if not pieces:
        return []
    placed = [p.vertices @ p.rotation.T + p.translation for p in pieces]
    owner = np.repeat(np.arange(len(pieces)), [len(v) for v in placed])
    _, where = np.unique(_snap(np.concatenate(placed)), axis=0, return_inverse=True)
    order = np.argsort(where.reshape(-1), kind="stable")
    same = where.reshape(-1)[order][1:] == where.reshape(-1)[order][:-1]
    a, b = owner[order][:-1][same], owner[order][1:][same]
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(len(pieces), len(pieces)))
    return connected_components(graph, directed=False)[1].tolist()


def _snap(points: Array) -> Array:
    """Round coordinates to remove single-precision noise (files have seven digits)."""
    grid = 4.0 * float(np.finfo(np.float32).eps) * max(float(np.abs(points).max()), np.finfo(float).tiny)
    return np.round(points / grid) * grid


def weld(vertices: Array, triangles: NDArray[np.int64]) -> tuple[Array, NDArray[np.int32]]:
    """Merge vertices within single-precision noise and drop unused ones.

    Returns vertices (k, 3) and int32 triangles (m, 3).
    """
    used, places = np.unique(triangles, return_inverse=True)
    points = vertices[used]
    noise = 4.0 * float(np.finfo(np.float32).eps) * float(np.abs(points - points.mean(axis=0)).max())
    pairs = cKDTree(points).query_pairs(noise, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    _, group = connected_components(graph, directed=False)
    first = np.full(group.max() + 1, len(points))
    np.minimum.at(first, group, np.arange(len(points)))
    return points[first], group[places].reshape(-1, 3).astype(np.int32)


def _shape(path: Path, pieces: list[_Piece], tolerance: Tolerance) -> RawShape | None:
    """Return the shape of one part: several pieces are its surfaces; a single piece is segmented."""
    first = pieces[0]
    inverse = first.rotation.T
    vertices = [(p.vertices @ p.rotation.T + p.translation - first.translation) @ inverse.T for p in pieces]
    starts = np.cumsum([0, *(len(v) for v in vertices)])
    triangles = np.concatenate([p.triangles + s for p, s in zip(pieces, starts, strict=False)])
    owner = np.repeat(np.arange(len(pieces), dtype=np.int32), [len(p.triangles) for p in pieces])
    points, corners = weld(np.concatenate(vertices), triangles)
    notes = []
    good = np.linalg.norm(triangle_area_vectors(points, corners), axis=1) > 0.0
    if not good.any():
        return None
    if not len(open_edges(corners)) and mass_properties(points, corners)[0] < 0.0:
        corners = corners[:, [0, 2, 1]]
        notes.append("the mesh was wound inside out and has been turned")
    flat = int((~good).sum())
    if flat:
        notes.append(f"{flat} triangles of zero area dropped")
    corners, owner = without_flat(points, corners, owner)
    if len(pieces) > 1:
        kept, numbers = np.unique(owner, return_inverse=True)
        faces = [RawFace(pieces[k].name, color=pieces[k].color) for k in kept]
        return RawShape(points, corners, numbers.reshape(-1).astype(np.int32), faces, notes=notes)
    diagonal = float(np.linalg.norm(np.ptp(points, axis=0)))
    segments = segment(points, corners, min(tolerance.fit, tolerance.segment_relative * diagonal), tolerance)
    surface = np.empty(len(corners), np.int32)
    faces = []
    for i, s in enumerate(segments):
        surface[s.triangles] = i
        kind, values = raw_numbers(s.geometry)
        faces.append(RawFace(f"surface_{i + 1}", kind, values))
    return RawShape(points, corners, surface, faces, notes=notes)
