"""From raw arrays to a `Scene`: surfaces typed and oriented, features grouped, mass properties filled in."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import SurfaceMesh, Tolerance
from constraints.features import group_features
from constraints.fits import allowed, fit_surface
from constraints.geometry import Cone, Cylinder, Freeform, Geometry, Plane, Sphere, Torus
from vpframe.importers.raw import RawFace, RawScene, RawShape
from vpframe.scene import Edge, Part, Scene, Shape, Surface

Array = NDArray[np.float64]


def scene(raw: RawScene, source: str | None = None, progress: Callable[[float, str], None] | None = None) -> Scene:
    """The scene of a raw scene; parts that share a shape share the object. `progress` hears how far it is."""
    shapes, done, total = [], 0, max(sum(len(s.faces) for s in raw.shapes), 1)
    for s, name in zip(raw.shapes, _shape_names(raw), strict=True):
        if progress is not None:
            progress(done / total, f"surfaces of {name}")
        shapes.append(shape(s, name))
        done += len(s.faces)
    parts = (
        Part(p.name, shapes[p.shape], pin.SE3(p.rotation, p.translation), density=p.density)
        if p.color is None
        else Part(p.name, shapes[p.shape], pin.SE3(p.rotation, p.translation), p.color, p.density)
        for p in raw.parts
    )
    return Scene(parts, source=source, notes=raw.notes)


def _shape_names(raw: RawScene) -> list[str]:
    first: dict[int, str] = {}
    for part in raw.parts:
        first.setdefault(part.shape, part.name)
    return [first.get(i, f"shape {i}") for i in range(len(raw.shapes))]


def shape(raw: RawShape, name: str = "shape") -> Shape:
    """The shape of raw arrays: zero-area triangles dropped and counted, faces typed, features grouped."""
    notes = list(raw.notes)
    closed = is_closed(raw.triangles) if raw.closed is None else raw.closed
    triangles, faces, kept = _drop_flat(raw, notes)
    mesh = SurfaceMesh(raw.vertices, triangles, faces, name)
    vectors = triangle_area_vectors(raw.vertices, triangles)
    surfaces = tuple(
        _surface(i, raw.faces[k], mesh, vectors[mesh.triangles_of(i)], mesh.triangles_of(i)) for i, k in enumerate(kept)
    )
    volume, center, inertia = raw.volume, raw.center, raw.inertia
    if volume is None:
        volume, center, inertia = mass_properties(raw.vertices, triangles)
    senses = [-1 if s.orientation == "concave" else 1 for s in surfaces]
    features = group_features(mesh, [s.geometry for s in surfaces], senses, [s.residual for s in surfaces])
    place = {k: i for i, k in enumerate(kept)}
    edges = tuple(Edge(e.points, tuple(place[f] for f in e.faces if f in place), e.circle) for e in raw.edges)
    return Shape(mesh, surfaces, features, edges, volume, center, inertia, closed, tuple(notes))


def _drop_flat(raw: RawShape, notes: list[str]) -> tuple[NDArray[np.int32], NDArray[np.int32], list[int]]:
    """Triangles of positive area, their surface numbers without gaps, and the raw face of each surface."""
    area = np.linalg.norm(triangle_area_vectors(raw.vertices, raw.triangles), axis=1)
    good = area > 0.0
    dropped = int((~good).sum())
    if dropped:
        notes.append(f"{dropped} triangles of zero area dropped")
    faces = raw.face_of_triangle[good]
    kept, numbers = np.unique(faces, return_inverse=True)
    notes.extend(
        f"{raw.faces[i].name} has no triangle of positive area: it is lost"
        for i in range(len(raw.faces))
        if i not in set(kept.tolist())
    )
    return raw.triangles[good], numbers.reshape(-1).astype(np.int32), kept.tolist()


def _surface(index: int, raw: RawFace, mesh: SurfaceMesh, vectors: Array, triangles: NDArray[np.int32]) -> Surface:
    corners = mesh.triangles[triangles]
    points = mesh.vertices[np.unique(corners)]
    middles = mesh.vertices[corners].mean(axis=1)
    geometry, residual = recognised(raw, points, middles, vectors)
    return Surface(
        index,
        raw.name,
        geometry,
        orientation(geometry, middles, vectors),
        residual,
        float(np.linalg.norm(vectors, axis=1).sum()),
        raw.color,
    )


def raw_geometry(raw: RawFace, points: Array, outward: Array) -> Geometry:
    """The analytic geometry of a typed face; planes point out of the material, cones open towards the face."""
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
            return Freeform() if inner else ring  # the inner sheet of a spindle torus is no surface we know
        case _:
            return Freeform()


def recognised(raw: RawFace, points: Array, middles: Array, vectors: Array) -> tuple[Geometry, float]:
    """Geometry and residual of a face: the file's type, the kernel's recognition if it holds at the face's own
    points, a least-squares fit to them, or freeform."""
    geometry = raw_geometry(raw, points, vectors.sum(axis=0))
    if raw.typed:
        return geometry, 0.0
    tolerance = Tolerance()
    on_surface = np.concatenate([points, raw.samples])
    if not isinstance(geometry, Freeform):
        residual = float(np.abs(geometry.distance(on_surface)).max())
        if residual <= allowed(on_surface, tolerance):
            return geometry, residual
    fit = fit_surface(on_surface, middles, vectors, tolerance)
    return (Freeform(), 0.0) if fit is None else (fit.geometry, fit.residual)


def orientation(geometry: Geometry, middles: Array, vectors: Array) -> str:
    """ "flat" for planes, "convex" or "concave" by the outward triangle normals (area vectors), "free" for freeform."""
    if isinstance(geometry, Freeform):
        return "free"
    if isinstance(geometry, Plane):
        return "flat"
    along = np.einsum("ij,ij->", geometry.normals(middles), vectors)
    return "convex" if along >= 0 else "concave"


def triangle_area_vectors(vertices: Array, triangles: NDArray[np.int32]) -> Array:
    """(m, 3) half cross products: the direction is the outward normal, the length the area in m²."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return 0.5 * np.cross(b - a, c - a)


def is_closed(triangles: NDArray[np.int32]) -> bool:
    """Whether every edge is met as often one way as the other: then the mesh bounds a volume."""
    ends = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    key = ends.min(axis=1) * (int(triangles.max()) + 1) + ends.max(axis=1)
    _, inverse = np.unique(key, return_inverse=True)
    way = np.sign(ends[:, 1] - ends[:, 0])
    return not np.bincount(inverse.reshape(-1), weights=way).any()


def mass_properties(vertices: Array, triangles: NDArray[np.int32]) -> tuple[float, Array, Array]:
    """Volume, centre and inertia about it (density 1) of a closed mesh, by tetrahedra to its first vertex.

    Sums of the second moments of signed tetrahedra (Tonon, J. Math. Stat. 1 (2005) 8).
    """
    origin = vertices[triangles[0, 0]]
    corners = vertices[triangles] - origin
    volumes = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    volume = float(volumes.sum())
    if volume == 0.0:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    sums = corners.sum(axis=1)
    center = (volumes @ sums) / (4.0 * volume)
    second = np.einsum("i,ij,ik->jk", volumes, sums, sums) + np.einsum("i,iaj,iak->jk", volumes, corners, corners)
    second = second / 20.0 - volume * np.outer(center, center)
    second = 0.5 * (second + second.T)
    return volume, origin + center, np.trace(second) * np.eye(3) - second
