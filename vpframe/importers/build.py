"""Convert raw arrays to a `Scene`: type and orient surfaces, group features, compute mass properties."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import SurfaceMesh, Tolerance
from constraints.errors import GeometryError
from constraints.geometry.features import group_features
from constraints.geometry.surfaces import Cone, Cylinder, Freeform, Geometry, Plane, Sphere, Torus
from constraints.recognition.fits import allowed, fit_surface
from vpframe.importers.mechanism import impose
from vpframe.importers.polyhedron import mass_properties, open_edges, triangle_area_vectors, without_flat
from vpframe.importers.raw import RawEdge, RawFace, RawPart, RawScene, RawShape
from vpframe.scene.scene import Edge, Part, Scene, Shape, Size, Surface

Array = NDArray[np.float64]


def scene(raw: RawScene, source: str | None = None, progress: Callable[[float, str], None] | None = None) -> Scene:
    """Return the scene of a raw scene; parts of one shape share the object. `progress` receives fraction and task."""
    shapes, done, total = [], 0, max(sum(len(s.faces) for s in raw.shapes), 1)
    for s, name in zip(raw.shapes, _shape_names(raw), strict=True):
        if progress is not None:
            progress(done / total, f"surfaces of {name}")
        shapes.append(shape(s, name))
        done += len(s.faces)
    made = Scene((_part(p, shapes[p.shape]) for p in raw.parts), source=source, notes=raw.notes)
    if raw.links:
        impose(made, raw.links, raw.joints)
    return made


def _part(raw: RawPart, of: Shape) -> Part:
    made = Part(raw.name, of, pin.SE3(raw.rotation, raw.translation), density=raw.density)
    if raw.color is not None:
        made.color = raw.color
    if raw.mass is not None:
        made.inertia = pin.Inertia(*raw.mass)
    return made


def _shape_names(raw: RawScene) -> list[str]:
    first: dict[int, str] = {}
    for part in raw.parts:
        first.setdefault(part.shape, part.name)
    return [first.get(i, f"shape {i}") for i in range(len(raw.shapes))]


def tessellated(occ: Any, deflection: float, angular: float, name: str) -> Shape:
    """Return the shape of an OpenCascade shape; `deflection` (m) and `angular` (rad) as in `vpframe.load`."""
    from vpframe.importers import brep  # slow to import

    return shape(brep.tessellate(occ, deflection, angular), name)


def shape(raw: RawShape, name: str = "shape") -> Shape:
    """Return the shape of raw arrays: zero-area triangles dropped, faces typed, features grouped."""
    raw = settled(raw)
    mesh = SurfaceMesh(raw.vertices, raw.triangles, raw.face_of_triangle, name)
    vectors = triangle_area_vectors(raw.vertices, raw.triangles)
    surfaces = tuple(
        _surface(i, face, mesh, vectors[mesh.triangles_of(i)], mesh.triangles_of(i)) for i, face in enumerate(raw.faces)
    )
    senses = [-1 if s.orientation == "concave" else 1 for s in surfaces]
    features = group_features(mesh, [s.geometry for s in surfaces], senses, [s.residual for s in surfaces])
    edges = tuple(Edge(e.points, e.faces, e.circle) for e in raw.edges)
    closed = not len(open_edges(raw.triangles))
    assert raw.volume is not None
    measured = (raw.volume, raw.center, raw.inertia)
    return Shape(mesh, surfaces, features, edges, *measured, closed, tuple(raw.notes), raw.brep)


@np.errstate(over="ignore", invalid="ignore")  # coordinates out of range are refused later, with one line
def settled(raw: RawShape) -> RawShape:
    """Drop faces without triangles, type the others and compute mass properties, which takes time.

    A settled shape is returned as it is. A shape whose triangles all have zero area has no faces.
    """
    if raw.settled:
        return raw
    notes = list(raw.notes)
    triangles, owners, kept = _drop_flat(raw, notes)
    if not kept:
        return RawShape(raw.vertices, triangles, owners, [], notes=notes, settled=True)
    border = open_edges(triangles)
    if len(border):
        x, y, z = 1e3 * raw.vertices[border[0]].mean(axis=0)
        notes.append(
            f"open: at {len(border)} edges, the first near ({x:.6g}, {y:.6g}, {z:.6g}) mm, a face is missing or wound "
            "the wrong way; its volume, and what is inside it, are estimates"
        )
    vectors = triangle_area_vectors(raw.vertices, triangles)
    faces = []
    by_owner = np.split(np.argsort(owners, kind="stable"), np.cumsum(np.bincount(owners, minlength=len(kept)))[:-1])
    for own, k in zip(by_owner, kept, strict=True):
        corners, face = triangles[own], raw.faces[k]
        points, middles = raw.vertices[np.unique(corners)], raw.vertices[corners].mean(axis=1)
        geometry, residual = recognised(face, points, middles, vectors[own])
        kind, numbers = raw_numbers(geometry)
        faces.append(RawFace(face.name, kind, numbers, typed=True, color=face.color, residual=residual, size=face.size))
    place = {k: i for i, k in enumerate(kept)}
    edges = [RawEdge(e.points, tuple(place[f] for f in e.faces if f in place), e.circle) for e in raw.edges]
    volume, center, inertia = raw.volume, raw.center, raw.inertia
    if volume is None:
        volume, center, inertia = mass_properties(raw.vertices, triangles)
    measured = (volume, center, inertia)
    return RawShape(raw.vertices, triangles, owners, faces, edges, *measured, notes, settled=True, brep=raw.brep)


def _drop_flat(raw: RawShape, notes: list[str]) -> tuple[NDArray[np.int32], NDArray[np.int32], list[int]]:
    """Return triangles of positive area, their surface numbers without gaps, and the raw face of each surface."""
    triangles, faces = without_flat(raw.vertices, raw.triangles, raw.face_of_triangle)
    flat = np.linalg.norm(triangle_area_vectors(raw.vertices, raw.triangles), axis=1) == 0.0
    if flat.any():
        notes.append(f"{flat.sum()} triangles of zero area dropped")
    kept, numbers = np.unique(faces, return_inverse=True)
    notes.extend(
        f"{raw.faces[i].name} has no triangle of positive area: it is lost"
        for i in range(len(raw.faces))
        if i not in set(kept.tolist())
    )
    return triangles, numbers.reshape(-1).astype(np.int32), kept.tolist()


def _surface(index: int, raw: RawFace, mesh: SurfaceMesh, vectors: Array, triangles: NDArray[np.int32]) -> Surface:
    corners = mesh.triangles[triangles]
    geometry = raw_geometry(raw, mesh.vertices[np.unique(corners)], vectors.sum(axis=0))
    facing = orientation(geometry, mesh.vertices[corners].mean(axis=1), vectors)
    area = float(np.linalg.norm(vectors, axis=1).sum())
    return Surface(index, raw.name, geometry, facing, raw.residual, area, raw.color, _stated_size(raw, facing))


def _stated_size(raw: RawFace, facing: str) -> Size | None:
    """Return the size of a face, with its class in the spelling of ISO 286: capitals for bores."""
    if raw.size is None:
        return None
    nominal, lower, upper, fit = raw.size
    return Size(nominal, lower, upper, fit.upper() if facing == "concave" else fit.lower())


def raw_geometry(raw: RawFace, points: Array, outward: Array) -> Geometry:
    """Return the analytic geometry of a typed face; planes point out of the material, cones open towards the face."""
    n = np.array(raw.numbers)
    match raw.kind:
        case "plane":
            return Plane(n[:3], n[3:6] if n[3:6] @ outward >= 0 else -n[3:6])
        case "cylinder":
            return Cylinder(n[:3], n[3:6], n[6])
        case "cone":
            axis = n[3:6] if ((points - n[:3]) @ n[3:6]).mean() >= 0 else -n[3:6]
            return Cone(n[:3], axis, n[6])
        case "sphere":
            return Sphere(n[:3], n[3])
        case "torus":
            ring = Torus(n[:3], n[3:6], n[6], n[7])
            inner = ring.major <= ring.minor and np.abs(ring.distance(points)).max() > ring.minor * 1e-3
            return Freeform() if inner else ring  # the inner sheet of a spindle torus is not supported
        case _:
            return Freeform()


def raw_numbers(geometry: Geometry) -> tuple[str, tuple[float, ...]]:
    """Return kind and numbers in the form of `RawFace`: the inverse of `raw_geometry`."""
    if isinstance(geometry, Freeform):
        return "", ()
    values = (np.atleast_1d(np.asarray(v, dtype=np.float64)) for v in vars(geometry).values())
    return geometry.kind, tuple(float(x) for v in values for x in v)


def recognised(raw: RawFace, points: Array, middles: Array, vectors: Array) -> tuple[Geometry, float]:
    """Return geometry and residual of a face: type of the file, recognition of the kernel if it fits the face's points,
    a least-squares fit, or freeform."""
    try:
        geometry = raw_geometry(raw, points, vectors.sum(axis=0))
    except GeometryError:  # a torus of zero minor radius
        geometry = Freeform()
    if raw.typed:
        return geometry, raw.residual
    tolerance = Tolerance()
    on_surface = np.concatenate([points, raw.samples])
    if not isinstance(geometry, Freeform):
        residual = float(np.abs(geometry.distance(on_surface)).max())
        if residual <= allowed(on_surface, tolerance):
            return geometry, residual
    fit = fit_surface(on_surface, middles, vectors, tolerance)
    return (Freeform(), 0.0) if fit is None else (fit.geometry, fit.residual)


def orientation(geometry: Geometry, middles: Array, vectors: Array) -> str:
    """ "flat" for planes, "convex" or "concave" by the outward area vectors, "free" for freeform."""
    if isinstance(geometry, Freeform):
        return "free"
    if isinstance(geometry, Plane):
        return "flat"
    along = np.einsum("ij,ij->", geometry.normals(middles), vectors)
    return "convex" if along >= 0 else "concave"
