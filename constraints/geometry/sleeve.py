"""Face pairs that cannot intersect while a shaft is coaxial with its bore, or while two planes are face to face.

While the axes coincide, a face inside the shaft's cylinder cannot meet a face outside the bore's cylinder, whatever
their facets do: a nut of equal radius runs off the end of its bolt although the two rims are polygons that cross. A
flange or a shoulder is outside the shaft's cylinder and stays solid. Likewise faces behind one of two planes in contact
cannot meet faces behind the other, so that the rims of two equal holes do not keep a plate from its seat.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from collision import SurfaceMesh
from constraints.geometry.features import Feature
from constraints.geometry.surfaces import Cylinder, Plane, cross, perpendicular
from constraints.recognition.candidate import Candidate

Array = NDArray[np.float64]


def sleeve(
    candidate: Candidate,
    features: Sequence[Sequence[Feature]],
    meshes: tuple[SurfaceMesh, SurfaceMesh],
    slack: float,
) -> tuple[tuple[int, ...], tuple[int, ...]] | None:
    """Return faces of a candidate's first body, and faces of its second, that cannot intersect while it holds.

    features: of every body. meshes: of the candidate's two bodies. slack: m, see `faces_within`. None for candidates
    that are neither a shaft in a bore nor planes face to face.
    """
    a, fa, b, fb, _ = candidate.key
    first, second = candidate.geometries
    if candidate.kind == "against" and isinstance(first, Plane) and isinstance(second, Plane):
        return faces_behind(meshes[0], first, slack), faces_behind(meshes[1], second, slack)
    if candidate.kind not in ("concentric", "screw"):
        return None
    if not (isinstance(first, Cylinder) and isinstance(second, Cylinder)):
        return None
    one, other = features[a][fa], features[b][fb]
    if one.sense > 0:
        return faces_within(meshes[0], _crest(first, one), slack), faces_without(meshes[1], second, other.surfaces)
    return faces_without(meshes[0], first, one.surfaces), faces_within(meshes[1], _crest(second, other), slack)


def _crest(cylinder: Cylinder, shaft: Feature) -> Cylinder:
    """The cylinder about all of a shaft: of a thread, whose own is at its mean radius, that of its crests."""
    return replace(cylinder, radius=cylinder.radius + max(0.0, float(cylinder.distance(shaft.samples).max())))


def faces_behind(mesh: SurfaceMesh, plane: Plane, slack: float) -> tuple[int, ...]:
    """Faces whose vertices are at most `slack` (m) in front of a plane of their own part, ascending."""
    height = plane.distance(mesh.vertices)[mesh.triangles].max(axis=1)
    highest = np.full(mesh.n_surfaces, -np.inf)
    np.maximum.at(highest, mesh.surface_of_triangle, height)
    return tuple(np.flatnonzero(highest <= slack).tolist())


def faces_within(mesh: SurfaceMesh, shaft: Cylinder, slack: float) -> tuple[int, ...]:
    """Faces of the shaft's part whose vertices are at most `slack` (m) outside its radius, ascending."""
    radius = np.linalg.norm(_flat(mesh, shaft), axis=2).max(axis=1)
    widest = np.zeros(mesh.n_surfaces)
    np.maximum.at(widest, mesh.surface_of_triangle, radius)
    return tuple(np.flatnonzero(widest <= shaft.radius + slack).tolist())


def faces_without(mesh: SurfaceMesh, bore: Cylinder, surfaces: tuple[int, ...]) -> tuple[int, ...]:
    """Faces of the bore's part that come no nearer to its axis than the bore's own facets, ascending.

    surfaces: the faces of the bore.
    """
    distance = _from_origin(_flat(mesh, bore))
    nearest = np.full(mesh.n_surfaces, np.inf)
    np.minimum.at(nearest, mesh.surface_of_triangle, distance)
    least = float(nearest[list(surfaces)].min())
    return tuple(np.flatnonzero(nearest >= least * (1.0 - 1e-9)).tolist())


def _flat(mesh: SurfaceMesh, cylinder: Cylinder) -> Array:
    """(m, 3, 2) the triangles seen along the axis, which is the origin."""
    u = perpendicular(cylinder.axis)
    plane = np.stack([u, cross(cylinder.axis, u)], axis=1)
    return np.asarray(((mesh.vertices - cylinder.origin) @ plane)[mesh.triangles])


def _from_origin(triangles: Array) -> Array:
    """(m,) distance of plane triangles (m, 3, 2) from the origin; 0 where they contain it."""
    start = triangles
    edge = np.roll(triangles, -1, axis=1) - triangles
    length = (edge * edge).sum(axis=2)
    along = np.clip(-(start * edge).sum(axis=2) / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
    distance = np.linalg.norm(start + along[:, :, None] * edge, axis=2).min(axis=1)
    side = start[:, :, 0] * edge[:, :, 1] - start[:, :, 1] * edge[:, :, 0]
    flat = (side == 0.0).all(axis=1)  # seen edge on: it holds nothing
    inside = ((side >= 0.0).all(axis=1) | (side <= 0.0).all(axis=1)) & ~flat
    return np.where(inside, 0.0, distance)
