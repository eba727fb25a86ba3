"""Exact overlap of planar faces, beyond the deflection of round faces at their rims.

The border of a plane cut by a bore is a polygon that deviates from the true circle within the plane; normal to it, the
plane is exact. So facing planes are judged by their distance over the shared area, and other planes by the depth of
their triangles away from curved borders.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collision import CollisionManager, SurfaceMesh
from collision.classify import PairClass
from constraints.geometry.overlap import facing_area
from constraints.geometry.surfaces import Plane
from constraints.geometry.words import millimetres
from vpframe.scene.deflection import curved_borders
from vpframe.scene.scene import Scene, Shape

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlaneOverlap:
    """Two planar faces that overlap."""

    key: tuple[int, int, int, int]
    """part a, part b, surface of a, surface of b"""
    depth: float
    """penetration depth, m"""
    why: str


def facing_overlaps(
    scene: Scene, world: CollisionManager, contacts: NDArray[Any], sags: Sequence[Array]
) -> list[PlaneOverlap]:
    """Return overlaps of facing planes by more than `Tolerance.linear` and less than the deflections.

    contacts: of the world, up to `Tolerance.linear` and the greatest deflections of two parts. sags: deflection of each
    surface of each part, m. The shared area must exceed the uncertainty of the two borders.
    """
    worst = [float(sag.max(initial=0.0)) for sag in sags]
    linear, angular = world.tolerance.linear, world.tolerance.angular
    found = []
    for row in contacts[_facing(scene, contacts, angular)] if any(worst) else ():
        a, i, b, j = (int(row[name]) for name in ("object_a", "surface_a", "object_b", "surface_b"))
        first, second = scene.parts[a].surfaces[i], scene.parts[b].surfaces[j]
        p, q = first.geometry, second.geometry
        if not (isinstance(p, Plane) and isinstance(q, Plane)):
            continue
        p, q = p.transformed(scene.parts[a].pose), q.transformed(scene.parts[b].pose)
        if p.normal @ q.normal > -np.cos(angular):
            continue
        one, other = _triangles(world, a, i), _triangles(world, b, j)
        region = facing_area(p.origin, p.normal, one, other, q.origin, q.normal)
        exactly = linear + first.residual + second.residual
        depth = -region.gap_min
        if not exactly < depth <= linear + worst[a] + worst[b]:
            continue
        border = min(_perimeter(world.mesh(a), i), _perimeter(world.mesh(b), j))
        if region.area > (sags[a][i] + sags[b][j] + linear) * border:
            why = f"planes overlap by {millimetres(depth)} over {region.area * 1e6:.4g} mm²"
            found.append(PlaneOverlap((a, b, i, j), depth, why))
    return found


def _facing(scene: Scene, contacts: NDArray[Any], angular: float) -> NDArray[np.bool_]:
    """(n,) whether the two surfaces of each contact row may be planes that face each other within an angle, rad."""
    first = np.cumsum([0, *(len(part.surfaces) for part in scene.parts)])
    geometries = ((part.pose.rotation, face.geometry) for part in scene.parts for face in part.surfaces)
    normals = np.array([r @ g.normal if isinstance(g, Plane) else np.full(3, np.nan) for r, g in geometries])
    sides = (normals[first[contacts["object_" + side]] + contacts["surface_" + side]] for side in "ab")
    return np.asarray((next(sides) * next(sides)).sum(axis=1) <= 1e-9 - np.cos(angular))


def is_exact_overlap(pair: PairClass, shapes: Sequence[Shape], world: CollisionManager, sags: Sequence[Array]) -> bool:
    """Whether two planar faces overlap deeper than `Tolerance.linear`, away from their curved borders."""
    if pair.surfaces is None or pair.depth == 0.0:
        return False
    limit = world.tolerance.linear
    for part, surface in zip(pair.objects, pair.surfaces, strict=True):
        face = shapes[part].surfaces[surface]
        if not isinstance(face.geometry, Plane):
            return False
        limit += face.residual
    for part, surface in zip(pair.objects, pair.surfaces, strict=True):
        near = pair.depth + float(sags[part][surface]) + limit
        borders = curved_borders(shapes[part]).get(surface)
        if borders is not None and _distance(world.pose(part).actInv(pair.witness), borders) <= near:
            return False
    return pair.depth > limit


def _triangles(world: CollisionManager, part: int, surface: int) -> Array:
    """Corners (t, 3, 3) of a surface's triangles, world, m."""
    mesh, pose = world.mesh(part), world.pose(part)
    corners = mesh.vertices[mesh.triangles[mesh.triangles_of(surface)]]
    return np.asarray(corners @ pose.rotation.T + pose.translation)


def _perimeter(mesh: SurfaceMesh, surface: int) -> float:
    """Length of the border of a surface's triangles, m."""
    triangles = mesh.triangles[mesh.triangles_of(surface)]
    sides = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    border, count = np.unique(sides, axis=0, return_counts=True)
    ends = mesh.vertices[border[count == 1]]
    return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum())


def _distance(point: Array, segments: Array) -> float:
    """Distance of a point (3,) from the nearest of segments (k, 2, 3), m."""
    along = segments[:, 1] - segments[:, 0]
    square = np.maximum((along * along).sum(axis=1), np.finfo(np.float64).tiny)
    t = np.clip(((point - segments[:, 0]) * along).sum(axis=1) / square, 0.0, 1.0)
    return float(np.linalg.norm(segments[:, 0] + t[:, None] * along - point, axis=1).min())
