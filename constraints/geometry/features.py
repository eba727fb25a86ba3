"""`Feature`: one analytic surface of a part, with all faces that lie on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from collision import SurfaceMesh, Tolerance
from constraints.geometry.surfaces import Cone, Cylinder, Freeform, Geometry, Plane, Sphere, Torus
from constraints.recognition.fits import refine


@dataclass(frozen=True, eq=False)
class Feature:
    """The faces of a part that lie on one analytic surface (two half bores are one feature)."""

    geometry: Geometry
    """in the part's frame; a plane's normal points out of the material"""
    surfaces: tuple[int, ...]
    """indices of the faces, ascending"""
    sense: int
    """+1 convex (material inside: a shaft, a ball), -1 concave (a bore, a socket), +1 for planes"""
    samples: NDArray[np.float64]
    """(n, 3) vertices of the faces, part frame, m: they lie on the true surface and bound its extent"""
    triangles: NDArray[np.int32]
    """(t, 3) the faces' triangles as indices into `samples`: what overlap is measured on"""
    residual: float
    """m: greatest distance of `samples` to `geometry`"""
    area: float
    """m²"""


def group_features(
    mesh: SurfaceMesh,
    geometries: Sequence[Geometry],
    senses: Sequence[int],
    residuals: Sequence[float] | None = None,
    tolerance: Tolerance | None = None,
) -> tuple[Feature, ...]:
    """The features of a part: faces on the same analytic surface, with the material on the same side, are one.

    Faces need not touch. Two half bores are one feature, and so is a bore that a groove interrupts, the two ears of a
    hinge, and a plane that pockets split: each means one constraint. Freeform faces belong to no feature.

    Parameters
    ----------
    mesh: the part's mesh, one surface a face.
    geometries: one a face, in the part's frame; planes with their outward normal.
    senses: one a face, +1 or -1 as in `Feature.sense`.
    residuals: m, one a face: above 0 where the geometry was fitted, so that joining faces improves it by a new fit.
    tolerance: `fit` and `angular` decide what counts as the same surface.

    Returns the features ordered by their first face.
    """
    limits = tolerance or Tolerance()
    given = residuals if residuals is not None else np.zeros(len(geometries))
    faces = [_Face.of(mesh, s, geometry) for s, geometry in enumerate(geometries)]
    groups: dict[tuple[str, int], list[int]] = {}
    for s, geometry in enumerate(geometries):
        if not isinstance(geometry, Freeform):
            groups.setdefault((geometry.kind, senses[s]), []).append(s)
    found = []
    for (_, sense), members in groups.items():
        for cluster in _clusters(members, faces, geometries, limits):
            fitted = len(cluster) > 1 and any(given[s] > 0.0 for s in cluster)
            found.append(_feature(mesh, cluster, faces, geometries, sense, fitted, limits))
    return tuple(sorted(found, key=lambda feature: feature.surfaces))


@dataclass(frozen=True, eq=False)
class _Face:
    points: NDArray[np.float64]
    area: float
    origin: NDArray[np.float64]
    """a point of the plane or axis beside the face, or the centre"""
    direction: NDArray[np.float64]
    sizes: NDArray[np.float64]
    """(2,) radii, m, or the half angle, rad"""

    @staticmethod
    def of(mesh: SurfaceMesh, surface: int, geometry: Geometry) -> _Face:
        corners = mesh.triangles[mesh.triangles_of(surface)]
        points = mesh.vertices[np.unique(corners)]
        a, b, c = (mesh.vertices[corners[:, k]] for k in range(3))
        area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
        middle = points.mean(axis=0)
        zero = np.zeros(3)
        match geometry:
            case Plane():
                return _Face(points, area, middle, geometry.normal, np.zeros(2))
            case Cylinder():
                foot = geometry.origin + ((middle - geometry.origin) @ geometry.axis) * geometry.axis
                return _Face(points, area, foot, geometry.axis, np.array([geometry.radius, 0.0]))
            case Cone():
                return _Face(points, area, geometry.apex, geometry.axis, np.array([geometry.half_angle, 0.0]))
            case Sphere():
                return _Face(points, area, geometry.center, zero, np.array([geometry.radius, 0.0]))
            case Torus():
                return _Face(points, area, geometry.center, geometry.axis, np.array([geometry.major, geometry.minor]))
        return _Face(points, area, zero, zero, np.zeros(2))


def _clusters(
    members: list[int], faces: list[_Face], geometries: Sequence[Geometry], limits: Tolerance
) -> list[list[int]]:
    """Faces of one kind and sense, largest first, each put to the first cluster on whose surface it lies.

    The largest face's geometry represents its cluster, so that tolerances do not add up along a chain of faces.
    """
    order = sorted(members, key=lambda s: (-faces[s].area, s))
    kind = geometries[members[0]].kind
    heads: list[int] = []
    clusters: dict[int, list[int]] = {}
    origins, directions, sizes = (np.empty((len(order), n)) for n in (3, 3, 2))
    for s in order:
        face, n = faces[s], len(heads)
        likely = _likely(kind, face, origins[:n], directions[:n], sizes[:n], limits)
        head = next((heads[i] for i in likely if _lies_on(face, geometries[heads[i]], limits)), None)
        if head is None:
            origins[n], directions[n], sizes[n] = face.origin, face.direction, face.sizes
            heads.append(s)
            clusters[s] = [s]
        else:
            clusters[head].append(s)
    return [sorted(cluster) for cluster in clusters.values()]


def _likely(
    kind: str,
    face: _Face,
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
    sizes: NDArray[np.float64],
    limits: Tolerance,
) -> NDArray[np.intp]:
    """Clusters whose surface has the face's direction and sizes and passes near it; by arrays, as there are many."""
    near = np.abs(sizes - face.sizes).max(axis=1) <= (limits.angular if kind == "cone" else limits.fit)
    gap = face.origin - origins
    if kind == "sphere":
        return np.flatnonzero(near & (np.linalg.norm(gap, axis=1) <= limits.fit))
    turn = np.linalg.norm(np.cross(directions, face.direction), axis=1)
    near &= turn <= np.sin(limits.angular)
    along = np.einsum("ij,ij->i", gap, directions)
    if kind == "plane":
        near &= (directions @ face.direction > 0) & (np.abs(along) <= limits.fit)
    elif kind == "cylinder":
        near &= np.linalg.norm(gap - along[:, None] * directions, axis=1) <= limits.fit
    elif kind == "cone":
        near &= directions @ face.direction > 0
    else:
        near &= np.linalg.norm(gap, axis=1) <= limits.fit
    return np.flatnonzero(near)


def _lies_on(face: _Face, geometry: Geometry, limits: Tolerance) -> bool:
    return bool(np.abs(geometry.distance(face.points)).max() <= limits.fit)


def _feature(
    mesh: SurfaceMesh,
    cluster: list[int],
    faces: list[_Face],
    geometries: Sequence[Geometry],
    sense: int,
    fitted: bool,
    limits: Tolerance,
) -> Feature:
    corners = mesh.triangles[np.concatenate([mesh.triangles_of(s) for s in cluster])]
    used, places = np.unique(corners, return_inverse=True)
    samples = mesh.vertices[used]
    geometry = geometries[max(cluster, key=lambda s: (faces[s].area, -s))]
    residual = float(np.abs(geometry.distance(samples)).max())
    if fitted:
        joined = refine(geometry, samples)
        gap = float(np.abs(joined.distance(samples)).max())
        if gap <= max(residual, limits.fit):
            geometry, residual = joined, gap
    triangles = places.reshape(-1, 3).astype(np.int32)
    area = sum(faces[s].area for s in cluster)
    return Feature(geometry, tuple(cluster), sense, samples, triangles, residual, area)
