"""STL, OBJ, PLY and GLB: welded, closed pieces apart, in metres.

The reading process runs this on files, so it imports numpy and scipy only, and trimesh and manifold3d where needed:
binary STL is read directly, other files through trimesh. Surfaces are found by `meshes`.
"""

from __future__ import annotations

import io
import json
import logging
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from vpframe.importers import archive
from vpframe.importers.checks import beside, is_binary_stl, too_far
from vpframe.importers.names import numbered
from vpframe.importers.polyhedron import open_edges, signed_volume, triangle_area_vectors, without_flat
from vpframe.importers.raw import Array, Color, RawFace, RawPart, RawScene, RawShape, UnreadableError
from vpframe.scene.units import METRES

if TYPE_CHECKING:
    import trimesh

logging.getLogger("trimesh").addHandler(logging.NullHandler())  # else messages about damaged files go to stderr

_OBJECT = re.compile(rb"^[ \t]*o(?=[ \t\r\n])([^\r\n]*)", re.MULTILINE)
_POLYGON = re.compile(rb"^f((?:[ \t]+[^\s\\]+){4,})[ \t]*\r?$", re.MULTILINE)
_VERTEX = re.compile(rb"^v[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)", re.MULTILINE)
_FLAT = 1e-9
"""least area of a triangle of a fan, relative to those of the fan, at which it counts as turned over"""
_CROSSED = 1e-6
"""relative difference of a polygon's area from that of its triangles above which it crosses itself"""
_MARK = "\x1f"
_MARKED = re.compile(f"{_MARK}\\d+")
"""makes the names of an OBJ file's objects unique while it is parsed"""
_SURROGATE = rb"\\u[dD][%s][0-9a-fA-F]{2}"
_PAIR = _SURROGATE % b"89abAB" + _SURROGATE % b"c-fC-F"
_ESCAPES = re.compile(_PAIR + rb"|(" + _SURROGATE % b"89a-fA-F" + rb")|\\.")
"""escapes of JSON; the group is a surrogate without its other half"""
_TRIANGLES = 4
_UNREAD = {"primitives of points": (0,), "primitives of lines": (1, 2, 3), "triangle fans": (6,)}
"""unsupported modes of glTF primitives (glTF 2.0, 5.24)"""
_MILLIMETRES_ABOVE = 2.0
"""extent above which a file without a unit is read in millimetres: few parts serviced by hand exceed two metres, and
few are below two millimetres"""


@dataclass(eq=False)
class Piece:
    """A unit of the file: an object, a group or the triangles of a material."""

    name: str
    vertices: Array
    triangles: NDArray[np.int64]
    color: Color | None
    rotation: Array
    translation: Array
    source: int
    """pieces of one source are instances of one shape"""


def read_files(tasks: list[dict[str, Any]], out: str, say: Callable[..., None]) -> None:
    """Read files in a reading process: write the archive `i` of each file, or the reason why there is none.

    tasks: arguments of `read_file` for each file. out: folder. say: sends a message to the parent.
    """
    for i, task in enumerate(tasks):
        say(fraction=i / len(tasks), text=f"reading {Path(task['path']).name}")
        try:
            archive.write(read_file(**task, say=say), os.path.join(out, f"{i}.part"))
            os.replace(os.path.join(out, f"{i}.part"), os.path.join(out, f"{i}.archive"))
        except UnreadableError as error:
            Path(out, f"{i}.error").write_text(str(error), encoding="utf-8")
        except Exception as error:
            if not isinstance(error, MemoryError) and not isinstance(error.__context__, MemoryError):
                raise
            say(memory=True)
            return
    say(fraction=1.0, text="read", done=True)


def read_file(
    path: str, form: str, unit: str | None, factors: list[float] | None, say: Callable[..., None]
) -> RawScene:
    """Return the raw scene of a mesh file; UnreadableError with one line if it has no usable triangles.

    factors: (3,) for the coordinates of a file in metres, as in robot models; None: `unit` or a guess.
    """
    raw = RawScene()
    file = Path(path)
    pieces = _load(file, form, raw)
    say(found={"triangles": sum(len(piece.triangles) for piece in pieces)})
    if factors is None:
        return made(file.stem, raw, pieces, scale_of(form, unit, pieces, raw))
    if factors != [1.0, 1.0, 1.0]:
        for piece in pieces:
            piece.vertices = (piece.vertices @ piece.rotation.T + piece.translation) * np.array(factors)
            piece.rotation, piece.translation, piece.source = np.eye(3), np.zeros(3), -1 - len(pieces) - piece.source
            if np.prod(factors) < 0.0:
                piece.triangles = piece.triangles[:, [0, 2, 1]]
    return made(file.stem, raw, pieces, 1.0)


def made(stem: str, raw: RawScene, pieces: list[Piece], scale: float) -> RawScene:
    """Return `raw` with the parts that pieces make, scaled to metres; UnreadableError if there is none."""
    for piece in pieces:
        piece.vertices = piece.vertices * scale
        piece.translation = piece.translation * scale
        fault = too_far(piece.name, piece.vertices, piece.translation)
        if fault:
            raise UnreadableError(fault)
    bodies = _bodies(pieces, stem)
    known: dict[int, int] = {}
    for name, members in zip(numbered([b[0] or stem for b in bodies]), (b[1] for b in bodies), strict=True):
        first = members[0]
        if len(members) > 1 or first.source not in known:
            shape = shape_of(members)
            if shape is None:
                raw.notes.append(f"part {name} is lost: it has no triangle of positive area")
                continue
            known[first.source] = len(raw.shapes)
            raw.shapes.append(shape)
        part = RawPart(name, known[first.source], first.rotation, first.translation, first.color)
        raw.parts.append(part)
    if not raw.parts:
        raise UnreadableError("holds no triangle of positive area; export it again, as a surface mesh")
    return raw


def _load(path: Path, form: str, raw: RawScene) -> list[Piece]:
    options: dict[str, Any] = {"split_objects": True, "split_groups": True} if form == "obj" else {}
    data = path.read_bytes()
    if form == "stl" and is_binary_stl(data):
        return [_binary_stl(data, path.stem)]
    import trimesh

    nodes: set[str] = set()
    expected = 0
    if form == "glb":
        data = _without_lone_surrogates(data)
        header = _glb_header(data)
        raw.notes.extend(_no_triangles(header))
        lost, expected = _glb_nodes(header)
        raw.notes.extend(lost)
        nodes = {str(node.get("name")) for node in _listed(header, "nodes")}
    try:
        text = _utf8(data, form)
        file = io.BytesIO(_objects_apart(_polygons_cut(text, raw.notes)) if form == "obj" else text)
        with np.errstate(all="ignore"):  # values that are not finite are found later
            scene = trimesh.load_scene(file, file_type=form, resolver=_resolver(path), process=False, **options)
    except MemoryError:
        raise
    except Exception as error:  # the loaders' errors have no common base
        line = str(error).strip().splitlines() or [type(error).__name__]
        raise UnreadableError(f"cannot be parsed as {form.upper()} ({line[0][:120]}); export it again") from error
    missing = expected - len(scene.graph.nodes_geometry)
    if missing > 0:
        raw.notes.append(f"{missing} of {expected} meshes that its nodes place are lost; export it again")
    return pieces_of(form, scene, nodes)


def pieces_of(form: str, scene: trimesh.Scene, nodes: set[str]) -> list[Piece]:
    """Return the meshes of a scene, each with its pose; `nodes`: names of the file's nodes."""
    import trimesh

    pieces: list[Piece] = []
    places = {name: i for i, name in enumerate(scene.geometry)}
    placed = [(places[scene.graph[node][1]], _node_name(str(node), nodes), node) for node in scene.graph.nodes_geometry]
    for number, name, node in sorted(placed, key=lambda p: p[:2]):
        matrix, key = scene.graph[node]
        mesh = scene.geometry[key]
        if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
            continue
        vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
        _check(name, vertices, faces, matrix)
        rotation, translation = matrix[:3, :3], matrix[:3, 3]
        source = number
        if not np.allclose(rotation.T @ rotation, np.eye(3), atol=1e-6) or np.linalg.det(rotation) < 0:
            vertices = vertices @ rotation.T
            if np.linalg.det(rotation) < 0:
                faces = faces[:, [0, 2, 1]]
            rotation, source = np.eye(3), -1 - len(pieces)
        pieces.append(Piece(name, vertices, faces, _color(mesh, form), rotation, translation, source))
    if not pieces:
        raise UnreadableError("holds no triangles; export it again, as a surface mesh")
    return pieces


def _resolver(path: Path) -> trimesh.resolvers.Resolver:
    """Return a reader of material files as UTF-8: regular files beside the mesh file; no images: nothing uses them."""
    from trimesh.resolvers import FilePathResolver

    class FolderResolver(FilePathResolver):
        def get(self, name: str) -> bytes:
            """Return the content of a material file; OSError for others."""
            file = beside(path.parent, name)
            if file is None or file.suffix.lower() != ".mtl":
                raise OSError(f"{name}: no material file")
            return _utf8(file.read_bytes(), "obj")

    return FolderResolver(str(path))


def _binary_stl(data: bytes, name: str) -> Piece:
    """Return the triangles of a binary STL file: 12 numbers of 4 bytes and 2 bytes each, after the header."""
    rows = np.frombuffer(data, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")]), -1, 84)
    if not len(rows):
        raise UnreadableError("holds no triangles; export it again, as a surface mesh")
    vertices = rows["corners"].reshape(-1, 3).astype(np.float64)
    faces = np.arange(len(vertices)).reshape(-1, 3)
    _check(name, vertices, faces, np.eye(4))
    return Piece(name, vertices, faces, None, np.eye(3), np.zeros(3), 0)


def _polygons_cut(data: bytes, notes: list[str]) -> bytes:
    """Return an OBJ file without the polygons that a fan of triangles from their first corner does not fill.

    trimesh reads every polygon as such a fan. The others are triangulated (manifold3d).
    """
    found = list(_POLYGON.finditer(data))
    try:
        points = np.array(_VERTEX.findall(data) if found else [], np.float64).reshape(-1, 3)
        faces = [[int(corner.split(b"/")[0]) for corner in face[1].split()] for face in found]
    except ValueError:
        return data  # trimesh refuses it
    sizes = np.array([len(face) for face in faces])
    cut: dict[int, bytes] = {}
    crossed = 0
    for n in np.unique(sizes).tolist():
        which = np.flatnonzero(sizes == n)
        corners = np.array([faces[i] for i in which])
        corners = np.where(corners > 0, corners - 1, corners + len(points))
        valid = ((corners >= 0) & (corners < len(points))).all(axis=1)
        which, corners = which[valid], corners[valid]
        rays = points[corners] - points[corners[:, :1]]
        vectors = 0.5 * np.cross(rays[:, 1:-1], rays[:, 2:])
        whole = vectors.sum(axis=1)
        size = np.linalg.norm(whole, axis=1)
        normals = whole / np.where(size > 0.0, size, 1.0)[:, None]
        along = np.einsum("ijk,ik->ij", vectors, normals)
        for i in np.flatnonzero((along < -_FLAT * np.abs(along).sum(axis=1)[:, None]).any(axis=1)).tolist():
            triangles, good = _triangulated(rays[i], normals[i], float(size[i]))
            crossed += not good
            names = found[which[i]][1].split()
            cut[int(which[i])] = b"\n".join(b"f " + b" ".join(names[k] for k in t) for t in triangles)
    if crossed:
        notes.append(f"{crossed} polygons cross themselves: what their triangles cover is a guess")
    pieces, end = [], 0
    for i in sorted(cut):
        pieces += [data[end : found[i].start()], cut[i]]
        end = found[i].end()
    return b"".join([*pieces, data[end:]])


def _triangulated(points: Array, normal: Array, area: float) -> tuple[list[list[int]], bool]:
    """Return triangles of a polygon (n, 3) with a unit normal, and whether they have its area."""
    import manifold3d

    x = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    x /= np.linalg.norm(x)
    flat = points @ np.column_stack([x, np.cross(normal, x)])
    triangles = np.asarray(manifold3d.triangulate([flat]), np.int64).reshape(-1, 3)
    a, b, c = (flat[triangles[:, k]] for k in range(3))
    u, v = b - a, c - a
    covered = 0.5 * float(np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).sum())
    return triangles.tolist(), abs(covered - area) <= _CROSSED * area


def _objects_apart(data: bytes) -> bytes:
    """Return an OBJ file in which each `o` line begins an object: trimesh merges those of one name."""
    count = iter(range(1, data.count(b"\n") + 2))
    return _OBJECT.sub(lambda found: b"o %s%s%d" % (found[1].strip(), _MARK.encode(), next(count)), data)


def _without_lone_surrogates(data: bytes) -> bytes:
    """Return a GLB file with U+FFFD for each half of a surrogate pair, which JSON can name and no encoding has."""
    end = 20 + int.from_bytes(data[12:16], "little")
    text = _ESCAPES.sub(lambda found: rb"\ufffd" if found[1] else found[0], data[20:end])
    return data[:20] + text + data[end:]


def _listed(header: dict[str, Any], name: str) -> list[dict[str, Any]]:
    """Return the entries of a list of a GLB file's JSON; an empty one for each that is no object."""
    entries = header.get(name)
    return [e if isinstance(e, dict) else {} for e in entries] if isinstance(entries, list) else []


def _glb_nodes(header: dict[str, Any]) -> tuple[list[str], int]:
    """Return a note for each node whose mesh is not read, and the number of meshes that the nodes place.

    Nodes count once for each way from the scene's roots (glTF 2.0, 3.5.3: there is one).
    """
    nodes, meshes, scenes = (_listed(header, name) for name in ("nodes", "meshes", "scenes"))
    drawn = [any(p.get("mode", _TRIANGLES) in (4, 5) for p in _listed(mesh, "primitives")) for mesh in meshes]
    which = header.get("scene", 0)
    roots = scenes[which].get("nodes") if _is_index(which, scenes) else list(range(len(nodes)))
    seen: set[int] = set()
    waiting: list[Any] = list(roots) if isinstance(roots, list) else []
    while waiting:
        i = waiting.pop()
        if _is_index(i, nodes) and i not in seen:
            seen.add(i)
            below = nodes[i].get("children")
            waiting += below if isinstance(below, list) else []
    lost, expected = [], 0
    for i, node in enumerate(nodes):
        if "mesh" not in node:
            continue
        name, mesh = f"node {node.get('name', i)}", node["mesh"]
        if not isinstance(mesh, int) or isinstance(mesh, bool):
            lost.append(f"{name} is left out: its mesh is {mesh!r}, no number; export it again")
        elif i not in seen:
            lost.append(f"{name} is left out: it is in no scene that is read")
        elif _is_index(mesh, meshes):
            expected += drawn[mesh]
    return lost, expected


def _is_index(value: Any, of: list[Any]) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < len(of)


def _utf8(data: bytes, form: str) -> bytes:
    """Return the file with its text in UTF-8, converted from Latin-1 if necessary: names may have umlauts."""
    if form == "glb":
        return data  # UTF-8 by definition
    end = len(data) if form != "ply" else data.find(b"end_header")
    try:
        data[:end].decode("utf-8")
    except UnicodeDecodeError:
        return data[:end].decode("latin-1").encode("utf-8") + data[end:]
    return data


def _glb_header(data: bytes) -> dict[str, Any]:
    """Return the JSON header of a GLB file (glTF 2.0, section 4.4)."""
    length = int.from_bytes(data[12:16], "little")
    try:
        header = json.loads(data[20 : 20 + length].decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise UnreadableError(f"its JSON is damaged ({error}); export it again") from None
    if not isinstance(header, dict):
        raise UnreadableError("its JSON is no object; export it again")
    required = header.get("extensionsRequired")
    compressed = [e for e in required if "compression" in str(e)] if isinstance(required, list) else []
    if compressed:
        raise UnreadableError(f"{compressed[0]} is not read; export it again, without compression")
    return header


def _no_triangles(header: dict[str, Any]) -> list[str]:
    """Return a line for each mesh of a GLB file with unsupported primitives."""
    notes = []
    for i, mesh in enumerate(_listed(header, "meshes")):
        modes = [p.get("mode", _TRIANGLES) for p in _listed(mesh, "primitives")]
        for words, kinds in _UNREAD.items():
            count = sum(mode in kinds for mode in modes)
            if count:
                name = mesh.get("name", f"number {i}")
                notes.append(f"mesh {name}: {words} left out ({count}); only triangles and triangle strips are read")
    return notes


def _node_name(name: str, nodes: set[str]) -> str:
    """Return the node's name without the random suffix that the reader gives to further primitives of a mesh."""
    stem = re.sub("_[0-9a-f]{6}$", "", name)
    return _MARKED.sub("", stem if name not in nodes and stem in nodes else name)


def _check(name: str, vertices: Array, faces: NDArray[np.int64], matrix: Array) -> None:
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        message = f"vertices of {name} have shape {vertices.shape}; three numbers a vertex are needed"
        raise UnreadableError(f"{message}: export it again")
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        at = f"vertex {bad[0]} of {name}"
        message = f"{at} is {vertices[bad[0]].tolist()}; coordinates must be finite: export it again"
        raise UnreadableError(message)
    if not np.isfinite(matrix).all():
        row = next(row for row in matrix.tolist() if not np.isfinite(row).all())
        message = f"{name} is placed by a matrix with the row {row}; numbers must be finite: export it again"
        raise UnreadableError(message)
    bad = np.flatnonzero(((faces < 0) | (faces >= len(vertices))).any(axis=1))
    if len(bad):
        message = f"triangle {bad[0]} of {name} names a vertex that does not exist; export it again"
        raise UnreadableError(message)


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
    linear = form == "glb" or hasattr(material, "baseColorFactor")  # trimesh's PBRMaterial
    return (_srgb(r), _srgb(g), _srgb(b), a) if linear else (r, g, b, a)


def _srgb(linear: float) -> float:
    """Convert a linear value to sRGB, both in 0 … 1 (IEC 61966-2-1)."""
    return 12.92 * linear if linear <= 0.0031308 else 1.055 * linear ** (1.0 / 2.4) - 0.055


def scale_of(form: str, unit: str | None, pieces: list[Piece], raw: RawScene) -> float:
    """Return metres a unit of length of a file: of its format, of `unit`, else guessed from the size, with a note."""
    if form == "glb":
        return 1.0  # metres by definition
    if unit is not None:
        return METRES[unit]
    corners = np.concatenate([p.vertices @ p.rotation.T + p.translation for p in pieces])
    extent = float(np.ptp(corners, axis=0).max())
    guess = "mm" if extent > _MILLIMETRES_ABOVE else "m"
    raw.notes.append(f"{form.upper()} files name no unit: {extent:g} is taken as {guess}; give unit= if that is wrong")
    return METRES[guess]


def _bodies(pieces: list[Piece], stem: str) -> list[tuple[str, list[Piece]]]:
    """Group pieces into parts: closed or isolated pieces alone, pieces that share borders together."""
    if len(pieces) == 1:
        return [(stem, pieces)]
    open_pieces = [p for p in pieces if len(open_edges(weld(p.vertices, p.triangles)[1]))]
    group = _touching(open_pieces)
    bodies: list[tuple[str, list[Piece]]] = []
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


def _touching(pieces: list[Piece]) -> list[int]:
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
    """Merge vertices within single-precision noise, directly or over others, and drop unused ones.

    Returns vertices (k, 3) and int32 triangles (m, 3).
    """
    used, places = np.unique(triangles, return_inverse=True)
    points = vertices[used]
    noise = 4.0 * float(np.finfo(np.float32).eps) * float(np.abs(points - points.mean(axis=0)).max())
    # points in one cell of a grid are within noise; so the pairs of cells are few, whatever the number of points
    cell = np.floor(points * (2.0 / noise)) if noise > 0.0 else points
    _, first, which = np.unique(cell, axis=0, return_index=True, return_inverse=True)
    which = which.reshape(-1)
    pairs = cKDTree(points[first]).query_pairs(noise, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(first), len(first)))
    group = connected_components(graph, directed=False)[1][which]
    earliest = np.full(group.max() + 1, len(points))
    np.minimum.at(earliest, group, np.arange(len(points)))
    return points[earliest], group[places].reshape(-1, 3).astype(np.int32)


def shape_of(pieces: list[Piece]) -> RawShape | None:
    """Return the shape of one part: several pieces are its surfaces; a single piece is not segmented yet."""
    first = pieces[0]
    inverse = first.rotation.T
    vertices = [(p.vertices @ p.rotation.T + p.translation - first.translation) @ inverse.T for p in pieces]
    starts = np.cumsum([0, *(len(v) for v in vertices)])
    triangles = np.concatenate([p.triangles + s for p, s in zip(pieces, starts, strict=False)])
    owner = np.repeat(np.arange(len(pieces), dtype=np.int32), [len(p.triangles) for p in pieces])
    points, corners = weld(np.concatenate(vertices), triangles)
    notes: list[str] = []
    good = np.linalg.norm(triangle_area_vectors(points, corners), axis=1) > 0.0
    if not good.any():
        return None
    once = _once(corners, good, notes)
    corners, owner, good = corners[once], owner[once], good[once]
    if not len(open_edges(corners)) and signed_volume(points, corners) < 0.0:
        corners = corners[:, [0, 2, 1]]
        notes.append("the mesh was wound inside out and has been turned")
    flat = int((~good).sum())
    if flat:
        notes.append(f"{flat} triangles of zero area dropped")
    corners, owner = without_flat(points, corners, owner)
    kept, numbers = np.unique(owner, return_inverse=True)
    faces = [RawFace(pieces[k].name, color=pieces[k].color) for k in kept]
    whole = len(pieces) > 1
    return RawShape(points, corners, numbers.reshape(-1).astype(np.int32), faces, notes=notes, segmented=whole)


def _once(corners: NDArray[np.int32], good: NDArray[np.bool_], notes: list[str]) -> NDArray[np.bool_]:
    """Return which triangles to keep of those with the same three corners, which would double areas and volumes.

    Of triangles wound alike the first is kept. Triangles wound oppositely are two sides: of a wall inside, which takes
    no part in the volume, or of every triangle, when the file has each face twice: then the first is kept too.
    """
    start = corners.argmin(axis=1)
    cyclic = np.take_along_axis(corners, (start[:, None] + np.arange(3)) % 3, axis=1)
    ahead = cyclic[:, 1] < cyclic[:, 2]
    _, which = np.unique(np.sort(corners, axis=1), axis=0, return_inverse=True)
    which = which.reshape(-1)
    once = ~good
    for side in (ahead, ~ahead):
        members = np.flatnonzero(good & side)
        once[members[np.unique(which[members], return_index=True)[1]]] = True
    doubled = int((~once).sum())
    if doubled:
        notes.append(f"{doubled} triangles that the file has twice dropped")
    members = np.flatnonzero(once & good)
    _, first, count = np.unique(which[members], return_index=True, return_counts=True)
    if (count == 2).all():
        once[members] = False
        once[members[first]] = True
        notes.append(f"each of {len(first)} triangles has its back as another triangle: backs dropped")
    elif (count == 2).any():
        notes.append(f"{int((count == 2).sum())} triangles have their back as another triangle: walls of no thickness")
    return once
