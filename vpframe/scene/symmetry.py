"""Rotational symmetry of parts: rotations that map a part onto itself.

Faces are compared, not vertices, because equal faces are tessellated differently. A rotation about the part's centre is
a symmetry if it maps every face (or group of faces of one analytic surface) to one of the same kind, area, centroid,
second moments and mean normal. The inertia of the surface gives candidate axes: three different principal moments allow
half turns about the principal axes only, two equal ones any rotation about the third axis.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from constraints.geometry.surfaces import Cone, Cylinder, Geometry, Torus
from vpframe.scene.scene import Shape

Array = NDArray[np.float64]

LIKE = 2e-3
"""1: maximum difference of equal lengths, as a fraction of the part's size"""
ALIKE = 2e-2
"""1: maximum relative difference of equal areas and second moments"""
ROUND = 0.1
"""1: the same for centroid and second moments of a face that is completed to a full revolution"""
AXES = 64
"""number of candidate axes for a part whose principal moments are all equal"""
MOST = 120
"""maximum order of a finite rotation group, except cyclic and dihedral ones"""
_TURNS = (1.0, 2.4)
"""test angles, rad: a face unchanged by both is a surface of revolution"""


@dataclass(frozen=True, eq=False)
class Symmetry:
    """The rotations about its centre that map a part onto itself."""

    rotations: tuple[Array, ...]
    """(3, 3) each, part frame, with the identity; in addition to rotations about `axes`"""
    axes: tuple[Array, ...] = ()
    """(3,) unit: axes of revolution; none, one, or two (ball)"""

    def angle(self, rotation: Array) -> float:
        """Least angle of a rotation (3, 3), part frame, modulo symmetry; rad, in [0, π]."""
        if len(self.axes) > 1:
            return 0.0
        if self.axes:
            axis = self.axes[0]
            return min(_angle_between(rotation @ s @ axis, axis) for s in self.rotations)
        return min(float(np.linalg.norm(pin.log3(rotation @ s))) for s in self.rotations)

    @property
    def trivial(self) -> bool:
        """Whether the identity is the only symmetry."""
        return len(self.rotations) == 1 and not self.axes


@lru_cache(maxsize=64)
def symmetry_of(shape: Shape) -> Symmetry:
    """Return the symmetry of a shape, from its mesh."""
    faces = _Faces(shape)
    axes: list[Array] = []
    rotations = [np.eye(3)]
    for axis, most in _candidates(faces):
        if all(faces.unchanged_by(_turn(axis, angle)) for angle in _TURNS):
            axes.append(axis)
            if len(axes) > 1:
                break
            continue
        fold = next((n for n in range(most, 1, -1) if faces.unchanged_by(_turn(axis, 2.0 * np.pi / n))), 1)
        if fold > 1:
            rotations = _closed([*rotations, _turn(axis, 2.0 * np.pi / fold)], max(MOST, 2 * fold))
    if axes:  # one rotation of each coset
        rotations = list({tuple(np.round(s @ axes[0], 3) + 0.0): s for s in reversed(rotations)}.values())
    return Symmetry(tuple(rotations), tuple(axes))


class _Faces:
    """Area, centroid, second moments and mean normal of each face, or of the faces of each feature."""

    def __init__(self, shape: Shape) -> None:
        from scipy.spatial import cKDTree

        mesh = shape.mesh
        corners = mesh.vertices[mesh.triangles]
        normal = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(normal, axis=1)
        # second moment of a triangle: ∫ x xᵀ = area/12 (Σ vᵢ vᵢᵀ + 9 m mᵀ), m its middle
        self.centre = (area[:, None] * corners.mean(axis=1)).sum(0) / area.sum()
        corners = corners - self.centre
        middle = corners.mean(axis=1)
        second = np.einsum("tij,tik->tjk", corners, corners) + 9.0 * np.einsum("tj,tk->tjk", middle, middle)
        second *= (area / 12.0)[:, None, None]
        group = {s: -1 - n for n, feature in enumerate(shape.features) for s in feature.surfaces}
        keys = np.array([group.get(s, s) for s in range(mesh.n_surfaces)])[mesh.surface_of_triangle]
        found, of = np.unique(keys, return_inverse=True)
        self.area = np.bincount(of, area)
        self.centroid = _sums(of, area[:, None] * middle) / self.area[:, None]
        moment = _sums(of, second)
        spread = moment / self.area[:, None, None]
        self.spread = spread - np.einsum("fj,fk->fjk", self.centroid, self.centroid)
        self.normal = _sums(of, normal) / self.area[:, None]
        for i, key in enumerate(found):
            if key < 0:
                self._round(i, shape.features[-1 - key].geometry)
        kinds = [(f.geometry.kind, f.sense) for f in shape.features]
        known = [kinds[-1 - key] if key < 0 else ("freeform", 0) for key in found]
        names = sorted(set(known))
        self.kind = np.array([names.index(kind) for kind in known])
        self.size = float(np.sqrt((corners**2).sum(axis=2).max()))
        self.moment = moment.sum(0)
        self.tree = cKDTree(self.centroid)

    def _round(self, i: int, geometry: Geometry) -> None:
        """Make a face that is almost a full revolution exactly round, whatever its triangles.

        Features that break the revolution, such as a keyway, have faces of their own.
        """
        if not isinstance(geometry, Cylinder | Cone | Torus):
            return
        axis, point = geometry.axis, geometry.apex if isinstance(geometry, Cone) else _point_of(geometry)
        on_axis = point - self.centre + axis * (axis @ (self.centroid[i] - point + self.centre))
        along = axis @ self.spread[i] @ axis
        across = 0.5 * (np.trace(self.spread[i]) - along)
        whole = along * np.outer(axis, axis) + across * (np.eye(3) - np.outer(axis, axis))
        off = np.linalg.norm(self.centroid[i] - on_axis)
        if off <= ROUND * np.sqrt(across) and np.abs(self.spread[i] - whole).max() <= ROUND * across:
            self.centroid[i], self.spread[i] = on_axis, whole
            self.normal[i] = axis * (axis @ self.normal[i])

    def unchanged_by(self, rotation: Array) -> bool:
        """Whether the rotation maps every face to an equal face."""
        there = self.centroid @ rotation.T
        spread = rotation @ self.spread @ rotation.T
        normal = self.normal @ rotation.T
        for i, place in enumerate(there):
            j = np.array(self.tree.query_ball_point(place, LIKE * self.size), dtype=np.int64)
            j = j[(self.kind[j] == self.kind[i]) & (np.abs(self.area[j] - self.area[i]) <= ALIKE * self.area[i])]
            j = j[np.linalg.norm(self.normal[j] - normal[i], axis=1) <= ALIKE]
            allowed = ALIKE * np.trace(self.spread[i]) + (LIKE * self.size) ** 2
            if not (np.abs(self.spread[j] - spread[i]).max(axis=(1, 2), initial=0.0) <= allowed).any():
                return False
        return True


def _candidates(faces: _Faces) -> Iterator[tuple[Array, int]]:
    """Yield candidate axes from the second moments of the surface, each with its maximum fold."""
    values, vectors = np.linalg.eigh(faces.moment)
    close = np.diff(values) <= ALIKE * values[2]
    most = max(2, min(len(faces.area), 360))
    lines = _lines(faces)
    if close.all():
        yield from ((line, most) for line in lines[:AXES])
        return

    def exact(axis: Array) -> Array:
        """Return the line nearest to a principal axis, which is only as exact as the tessellation."""
        best = max(lines, key=lambda line: abs(line @ axis))
        return best if abs(best @ axis) >= np.cos(0.02) else axis

    if not close.any():
        yield from ((exact(vectors[:, k]), 2) for k in range(3))
        return
    main = exact(vectors[:, 0] if close[1] else vectors[:, 2])
    yield main, most
    for line in (*lines, *vectors.T):
        if abs(line @ main) < 0.02:
            across = line - (line @ main) * main
            yield across / np.linalg.norm(across), 2


def _lines(faces: _Faces) -> list[Array]:
    """Return the directions of centroids and mean normals, and the bisectors of pairs, largest faces first."""
    order = np.argsort(-faces.area, kind="stable")[:AXES]
    tips = np.concatenate([faces.normal[order], faces.centroid[order] / faces.size])
    found: list[Array] = []
    for tip in [*tips, *(a + b for k, a in enumerate(tips[:12]) for b in tips[:k]), *np.eye(3)]:
        length = float(np.linalg.norm(tip))
        if length > 0.1:
            line = tip / length
            if all(abs(line @ other) < 1.0 - 1e-6 for other in found):
                found.append(line)
    return found


def _closed(rotations: list[Array], most: int) -> list[Array]:
    """Return all products of the rotations, up to about `most`."""
    found: list[Array] = []
    waiting = list(rotations)
    while waiting and len(found) <= most:
        new = waiting.pop(0)
        if all(np.trace(new @ old.T) < 3.0 - 1e-4 for old in found):
            found.append(new)
            waiting += [new @ old for old in rotations]
    return found


def _point_of(geometry: Cylinder | Torus) -> Array:
    return geometry.origin if isinstance(geometry, Cylinder) else geometry.center


def _sums(of: NDArray[np.int64], values: Array) -> Array:
    """Sums of `values` (t, …) by group number `of` (t,)."""
    out = np.zeros((of.max() + 1, *values.shape[1:]))
    np.add.at(out, of, values)
    return out


def _turn(axis: Array, angle: float) -> Array:
    return np.asarray(pin.exp3(angle * axis))


def _angle_between(a: Array, b: Array) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
