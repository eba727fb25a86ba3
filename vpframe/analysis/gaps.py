"""The gap of each pair of faces: from their analytic surfaces, or from facets less their deflection."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from collision.classify import PairClass
from constraints.geometry import gap as analytic
from constraints.geometry.surfaces import Freeform
from vpframe.analysis.fits import Verdict
from vpframe.scene.scene import Scene, Shape, Surface

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


def gaps_of(
    scene: Scene, pairs: Iterable[PairClass], sags: Sequence[Array], nearest: float
) -> dict[tuple[int, ...], Gap]:
    """Return the gaps of pairs of faces, by parts and surfaces.

    Parameters
    ----------
    pairs: of faces, from `classify`.
    sags: deflection of each surface of each part, m.
    nearest: m: gaps that are surely above are not computed exactly.
    """
    placed: dict[int, analytic.Faces] = {}
    out: dict[tuple[int, ...], Gap] = {}
    curved: list[PairClass] = []
    for pair in pairs:
        if pair.surfaces is None:
            continue
        low, high = facet_bounds(pair, sags)
        out[(*pair.objects, *pair.surfaces)] = Gap(low, high, pair.depth, np.asarray(pair.witness))
        kinds = (type(face.geometry) for face in _surfaces(scene, pair))
        if high - low > EXACT and low <= nearest and Freeform not in kinds:
            curved.append(pair)
            for i in pair.objects:
                if i not in placed:
                    placed[i] = analytic.moved(_faces(scene.parts[i].shape, sags[i]), scene.parts[i].pose)

    def exact(pair: PairClass) -> None:
        key = i, j, s, t = *pair.objects, *(pair.surfaces or (-1, -1))
        known = out[key]
        searched = min(known.low, known.low - SEARCH * pair.depth)
        least, most, point = analytic.gap(placed[i], s, placed[j], t, searched, known.high, known.point)
        if (least, most) != (searched, known.high):
            fitted = sum(face.residual for face in _surfaces(scene, pair))
            out[key] = Gap(least - fitted, most + fitted, max(0.0, -most), point)

    with ThreadPoolExecutor(os.cpu_count(), "gaps") as pool:
        list(pool.map(exact, curved))
    return out


def _surfaces(scene: Scene, pair: PairClass) -> list[Surface]:
    return [scene.parts[i].surfaces[s] for i, s in zip(pair.objects, pair.surfaces or (), strict=True)]


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
