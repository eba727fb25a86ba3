"""The gap of each pair of faces: from their analytic surfaces, or from facets less their deflection."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from threading import Lock
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from collision.classify import PairClass
from constraints.geometry import gap as analytic
from constraints.geometry.surfaces import Freeform
from vpframe.analysis.fits import Verdict
from vpframe.scene.scene import Scene, Shape

Array = NDArray[np.float64]
EXACT = 1e-9
"""m: facets of less deflection are the surface"""
SEARCH = 0.02
"""1: more than the precision (`Tolerance.depth`, 1 %) to which depths of facets are found"""
_FACES: WeakKeyDictionary[Shape, analytic.Faces] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Gap:
    """Bounds of the signed gap of two faces; negative gaps are depths."""

    low: float
    """m"""
    high: float
    """m"""
    depth: float
    """m: depth of the facets; of the surfaces, where they are known, one that is surely reached; 0 if there is none"""
    point: Array
    """(3,) m, world: between the nearest points, or the deepest"""

    def verdict(self, tolerance: float, clearance: float) -> Verdict | None:
        """Return the verdict on the faces; None for those that are farther apart than `clearance` (m) with certainty.

        A clash is deeper than `tolerance` (m), and a clearance above it, with certainty; other gaps are contacts.
        """
        if self.low > max(tolerance, clearance):
            return None
        kind = "clash" if self.high < -tolerance else "clearance" if self.low > tolerance else "contact"
        return Verdict(kind, max(self.low, 0.0), self.depth)


class PlacedFaces:
    """The trimmed faces of each part of a scene where it stands, derived at first use; several threads may ask."""

    def __init__(self, scene: Scene, sags: Sequence[Array]) -> None:
        self.scene, self.sags = scene, sags
        self._placed: dict[int, analytic.Faces] = {}
        self._lock = Lock()

    def of(self, part: int) -> analytic.Faces:
        """Return the faces of a part by its index, world, m."""
        with self._lock:
            if part not in self._placed:
                shape, pose = self.scene.parts[part].shape, self.scene.parts[part].pose
                self._placed[part] = analytic.moved(_faces(shape, self.sags[part]), pose)
            return self._placed[part]


def gaps_of(placed: PlacedFaces, pairs: Iterable[PairClass], nearest: float) -> dict[tuple[int, ...], Gap]:
    """Return the gaps of pairs of faces, from `classify`, by parts and surfaces.

    nearest: m: gaps that are surely above are not computed exactly.
    """
    out: dict[tuple[int, ...], Gap] = {}
    for pair in pairs:
        if pair.surfaces is None:
            continue
        faces = [placed.scene.parts[i].surfaces[s] for i, s in zip(pair.objects, pair.surfaces, strict=True)]
        low, high = facet_bounds(pair, placed.sags)
        found = Gap(low, high, pair.depth, np.asarray(pair.witness))
        if high - low > EXACT and low <= nearest and not any(isinstance(face.geometry, Freeform) for face in faces):
            (i, j), (s, t) = pair.objects, pair.surfaces
            searched = min(low, low - SEARCH * pair.depth)
            least, most, point = analytic.gap(placed.of(i), s, placed.of(j), t, searched, high, found.point)
            if (least, most) != (searched, high):
                fitted = sum(face.residual for face in faces)
                found = Gap(least - fitted, most + fitted, max(0.0, -most), point)
        out[(*pair.objects, *pair.surfaces)] = found
    return out


def facet_bounds(pair: PairClass, sags: Sequence[Array]) -> tuple[float, float]:
    """Return bounds of the gap, m, of two faces from the distance or the depth of their facets."""
    assert pair.surfaces is not None
    slack = sum(float(sags[i][s]) for i, s in zip(pair.objects, pair.surfaces, strict=True))
    if pair.distance > 0.0:
        return pair.distance - slack, pair.distance + slack
    return -pair.bound - slack, -pair.depth + slack


def _faces(shape: Shape, deflections: Array) -> analytic.Faces:
    if shape not in _FACES:
        geometries = [surface.geometry for surface in shape.surfaces]
        senses = [-1 if surface.orientation == "concave" else 1 for surface in shape.surfaces]
        _FACES[shape] = analytic.faces_of(shape.mesh, geometries, senses, deflections)
    return _FACES[shape]
