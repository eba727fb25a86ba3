"""Segmentation of a triangle mesh into the surfaces from which it was tessellated.

The vertices of a tessellated CAD face lie on its true surface, which is more reliable than angles between triangles: at
a tangential transition from a plane to a fillet there is no edge, but the next vertices lie off the plane. Triangles
are joined to flat facets; analytic surfaces are fitted to facets and their neighbours and grown over all triangles
whose vertices lie on them; the surface that explains most vertices beyond its degrees of freedom is taken first.
Remaining triangles form freeform surfaces bounded by sharp edges. Growth from seeds follows Schnabel, Wahl & Klein
(Computer Graphics Forum 26 (2007) 214), with fits in place of random samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from collision import Tolerance
from constraints.errors import GeometryError
from constraints.geometry.surfaces import Cylinder, Freeform, Geometry, Plane, Sphere, Torus
from constraints.recognition.fits import fit_kind, refine
from constraints.recognition.patches import Patch, fit_patches
from vpframe.importers.region_growing import neighbours, packed, reach

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_NEEDED = {"plane": 3, "cylinder": 5, "sphere": 4, "cone": 6, "torus": 7}
_STRONG = 6
"""vertices beyond its degrees of freedom that a curved surface must explain to precede planes"""
_SMALL = 12
"""number of facets below which a curved segment within a freeform surface counts as accidental"""
_FEWEST, _MOST = 4, 1024
"""number of facets whose patches are fitted together: doubled while no surface found covers the next facets"""
_OUTDO = {"cylinder": 1.0, "cone": 1.5, "sphere": 1.5, "torus": 2.5}
"""factor by which a more complex surface must explain more facets than a simpler one: a sphere fits both circles of any
frustum, a torus any two frustums in a row"""


@dataclass(frozen=True, eq=False)
class Segment:
    """Triangles on one surface."""

    triangles: Index
    geometry: Geometry
    residual: float
    """greatest distance of a vertex from `geometry`, m; 0 for freeform"""


def segment(
    vertices: Array, triangles: NDArray[np.int32], tolerance: float, limits: Tolerance | None = None
) -> list[Segment]:
    """Segment a welded mesh; every triangle is in exactly one segment.

    `vertices` (n, 3) m; `triangles` (m, 3), none of zero area; `tolerance` m, maximum distance of a vertex from its
    surface; `limits` gives the angles `flat`, `facet` and `bend`. The result is deterministic, ordered by the first
    triangle of each segment.
    """
    return _Segmentation(vertices, triangles, tolerance, limits or Tolerance()).run()


class _Segmentation:
    def __init__(self, vertices: Array, triangles: NDArray[np.int32], tolerance: float, limits: Tolerance) -> None:
        self.vertices, self.triangles, self.tolerance = vertices, triangles, tolerance
        self.flat, self.agree, self.smooth = np.cos(limits.flat), np.cos(limits.facet), np.cos(limits.bend)
        corners = vertices[triangles]
        vectors = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self.vectors = vectors
        self.areas = np.linalg.norm(vectors, axis=1)
        self.normals = vectors / self.areas[:, None]
        self.middles = corners.mean(axis=1)
        longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        self.needle = 2.0 * self.areas < 10.0 * tolerance * longest  # narrower than the tolerance allows for a normal
        self.across = neighbours(triangles)
        self.label = np.full(len(triangles), -1, np.int64)
        self.segments: list[Segment] = []
        self._mark = np.full(len(triangles), -1, np.int64)
        self._stamp = 0
        self._out = np.empty(len(triangles), np.int64)
        self.facet, self.facets = self._flat_facets()
        self._facet_areas = np.bincount(self.facet, self.areas)
        self.around = self._smooth_neighbours()

    def run(self) -> list[Segment]:
        self._planes(sure=True)
        self._curved(strong=True)
        self._planes(sure=False)
        self._curved(strong=False)
        self._rest()
        self._dissolve()
        return sorted(self.segments, key=lambda s: int(s.triangles.min()))

    def _grow(self, geometry: Geometry, seed: int) -> Index:
        kind, numbers = packed(geometry)
        self._stamp += 1
        count = reach(
            kind, numbers, seed, self.vertices, self.triangles, self.normals, self.needle, self.across, self.label,
            self.tolerance, self.agree, self._mark, self._stamp, self._out,
        )  # fmt: skip
        return np.sort(self._out[:count])

    def _points(self, triangles: Index) -> Array:
        return self.vertices[np.unique(self.triangles[triangles])]

    def _take(self, triangles: Index, geometry: Geometry) -> None:
        self.label[triangles] = len(self.segments)
        residual = 0.0
        if not isinstance(geometry, Freeform):
            residual = float(np.abs(geometry.distance(self._points(triangles))).max())
        self.segments.append(Segment(triangles, geometry, residual))

    def _flat_facets(self) -> tuple[Index, list[Index]]:
        """Group connected coplanar triangles: the facet of each triangle, and the triangles of each facet."""
        facet = np.full(len(self.triangles), -1, np.int64)
        facets: list[Index] = []
        for t in np.argsort(-self.areas, kind="stable"):
            if facet[t] >= 0:
                continue
            plane = Plane(self.middles[t], self.normals[t])
            kind, numbers = packed(plane)
            self._stamp += 1
            count = reach(
                kind, numbers, t, self.vertices, self.triangles, self.normals, self.needle, self.across, facet,
                self.tolerance, self.flat, self._mark, self._stamp, self._out,
            )  # fmt: skip
            members = np.sort(self._out[:count])
            facet[members] = len(facets)
            facets.append(members)
        return facet, facets

    def _smooth_neighbours(self) -> list[list[int]]:
        """Return the facets that meet each facet at a blunt angle, longest common border first."""
        t, n, lengths = self._smooth_edges(self.facet)
        border: list[dict[int, float]] = [{} for _ in self.facets]
        for a, b, length in zip(self.facet[t].tolist(), self.facet[n].tolist(), lengths.tolist(), strict=True):
            border[a][b] = border[a].get(b, 0.0) + length
        return [sorted(d, key=lambda b: (-d[b], b)) for d in border]

    def _curved(self, strong: bool) -> None:
        """Take curved surfaces, best score first, from seeds at every free facet."""
        candidates: list[tuple[int, Geometry, int]] = []
        covered = np.zeros(len(self.triangles), bool)
        order = [f for f in np.argsort(-self._facet_areas, kind="stable").tolist() if self.label[self.facets[f][0]] < 0]
        together, next_ = _FEWEST, 0
        while next_ < len(order):
            seeds: list[int] = []
            while next_ < len(order) and len(seeds) < together:
                if not covered[self.facets[order[next_]][0]]:
                    seeds.append(order[next_])
                next_ += 1
            spared = 0
            for f, fits in zip(seeds, self._fits(seeds), strict=True):
                if covered[self.facets[f][0]]:
                    spared += 1
                    continue
                best = self._best_at(f, fits, strong)
                if best is not None:
                    score, geometry, grown = best
                    candidates.append((score, geometry, int(self.facets[f][0])))
                    covered[grown] = True
            together = min(2 * together, _MOST) if not spared else max(together // 2, _FEWEST)
        while candidates:
            candidates.sort(key=lambda c: -c[0])
            score, geometry, seed = candidates.pop(0)
            if self.label[seed] >= 0:
                continue
            grown = self._grow(geometry, seed)
            now = self._score(geometry, grown)
            if now < score and candidates and now < candidates[0][0]:
                if self._enough(geometry, grown, strong):
                    candidates.append((now, geometry, seed))
                continue
            if self._enough(geometry, grown, strong):
                self._take(grown, geometry)

    def _score(self, geometry: Geometry, grown: Index) -> int:
        return len(np.unique(self.triangles[grown])) - _NEEDED[geometry.kind]

    def _enough(self, geometry: Geometry, grown: Index, strong: bool) -> bool:
        facets = len(np.unique(self.facet[grown]))
        if isinstance(geometry, Torus) and self._circles(geometry, grown) < 4:
            return False  # a torus fits any three coaxial circles
        if not strong:
            beside = {g for f in np.unique(self.facet[grown]).tolist() for g in self.around[f]}
            beside = {g for g in beside - set(self.facet[grown].tolist()) if self.label[self.facets[g][0]] < 0}
            if len(beside) >= facets:
                return False  # a patch of a freeform surface
            areas = np.bincount(self.facet[grown], self.areas[grown])
            areas = areas[areas > 0]
            needed = _STRONG if isinstance(geometry, Sphere | Torus) else 1
            return facets >= 3 and self._score(geometry, grown) >= needed and areas.max() <= 3.0 * np.median(areas)
        return facets >= 4 and self._score(geometry, grown) >= _STRONG * (1 if isinstance(geometry, Cylinder) else 2)

    def _circles(self, torus: Torus, grown: Index) -> int:
        """Number of circles about the torus's axis on which the vertices lie."""
        q = self._points(grown) - torus.center
        height = q @ torus.axis
        radius = np.linalg.norm(q - height[:, None] * torus.axis, axis=1) - torus.major
        arc = np.sort(torus.minor * np.arctan2(height, radius))
        return 1 + int((np.diff(arc) > 10.0 * self.tolerance).sum())

    def _fits(self, seeds: list[int]) -> list[list[tuple[str, Geometry]]]:
        """Return the surfaces that fit the patches at each facet within tolerance, in the order of `_patches`."""
        patches: dict[str, list[Patch]] = {}
        places: dict[str, list[tuple[int, int]]] = {}
        for i, f in enumerate(seeds):
            for k, (kind, patch) in enumerate(self._patches(f)):
                points = self._points(patch)
                if len(points) > _NEEDED[kind]:
                    patches.setdefault(kind, []).append((points, self.middles[patch], self.vectors[patch]))
                    places.setdefault(kind, []).append((i, k))
        found: list[list[tuple[int, str, Geometry]]] = [[] for _ in seeds]
        for kind, given in patches.items():
            for (i, k), fit in zip(places[kind], fit_patches(kind, given, self.tolerance, iterations=15), strict=True):
                if fit is not None:
                    found[i].append((k, kind, fit.geometry))
        return [[(kind, geometry) for _, kind, geometry in sorted(one, key=lambda each: each[0])] for one in found]

    def _best_at(self, f: int, fits: list[tuple[str, Geometry]], strong: bool) -> tuple[int, Geometry, Index] | None:
        best: tuple[int, Geometry, Index] | None = None
        seed, most = int(self.facets[f][0]), 0
        for kind, fit in fits:
            geometry, grown = self._settle(fit, seed)
            if len(grown) == 0 or not self._enough(geometry, grown, strong):
                continue
            size = len(np.unique(self.facet[grown]))
            if best is None or size > most * (1.0 if kind == best[1].kind else _OUTDO[kind]):
                most = size
                best = (self._score(geometry, grown), geometry, grown)
        return best

    def _settle(self, geometry: Geometry, seed: int) -> tuple[Geometry, Index]:
        """Alternate growth and fit while the segment grows."""
        grown = self._grow(geometry, seed)
        while len(grown):
            try:
                better = refine(geometry, self._points(grown))
            except GeometryError:
                return geometry, grown
            more = self._grow(better, seed)
            if len(more) <= len(grown):
                return (better, more) if len(more) == len(grown) else (geometry, grown)
            geometry, grown = better, more
        return geometry, grown

    def _patches(self, f: int) -> Iterator[tuple[str, Index]]:
        """Yield the kinds to fit at a facet, with the triangles to fit."""
        near = [g for g in self.around[f] if self.label[self.facets[g][0]] < 0]
        for g in near[:4]:
            yield "cylinder", np.concatenate([self.facets[f], self.facets[g]])
        for g, h in combinations(near[:4], 2):
            yield "cone", np.concatenate([self.facets[i] for i in (f, g, h)])
        first = {f, *near}
        second = first | {h for g in near for h in self.around[g] if self.label[self.facets[h][0]] < 0}
        ring, wide = (np.concatenate([self.facets[g] for g in sorted(p)]) for p in (first, second))
        yield "cylinder", wide
        yield "cone", ring
        yield "cone", wide
        yield "sphere", ring
        yield "torus", ring
        yield "torus", wide

    def _planes(self, sure: bool) -> None:
        """Take flat facets that cannot belong to a curved surface (`sure`), or that have no free neighbours."""
        areas = self._facet_areas
        for f in np.argsort(-areas, kind="stable").tolist():
            members = self.facets[f]
            if self.label[members[0]] >= 0:
                continue
            if sure:  # a facet beside others of similar size may belong to a slowly bending surface
                beside = max((areas[g] for g in self.around[f]), default=0.0)
                flat = areas[f] > 3.0 * beside and self._is_wide(members)
            else:  # a lone triangle with smooth neighbours belongs to a curved surface
                free = any(self.label[self.facets[g][0]] < 0 for g in self.around[f])
                flat = not free and (len(members) > 1 or not self.around[f])
            if flat:
                self._take(members, self._plane(members))

    def _is_wide(self, members: Index) -> bool:
        """Whether the vertices lie on more than two parallel lines; a strip of a curved surface has two."""
        points = self._points(members)
        if len(points) < 6:
            return False
        normal = self._plane(members).normal
        corners = self.vertices[self.triangles[members]]
        sides = (np.roll(corners, -1, axis=1) - corners).reshape(-1, 3)
        sides /= np.linalg.norm(sides, axis=1)[:, None]
        heights = points @ np.cross(normal, sides).T
        low, high = heights.min(axis=0), heights.max(axis=0)
        off = np.minimum(heights - low, high - heights).max(axis=0)
        return bool(off.min() > self.tolerance)

    def _plane(self, members: Index) -> Plane:
        fit = fit_kind("plane", self._points(members), self.middles[members], self.vectors[members])
        assert isinstance(fit.geometry, Plane)
        return fit.geometry

    def _rest(self) -> None:
        """Join remaining triangles across smooth edges to freeform surfaces, or a few flat facets to planes."""
        t, n, _ = self._smooth_edges()
        free = (self.label[t] < 0) & (self.label[n] < 0)
        graph = coo_array((np.ones(int(free.sum())), (t[free], n[free])), shape=(len(self.label),) * 2)
        _, group = connected_components(graph, directed=False)
        left = np.flatnonzero(self.label < 0)
        for g in np.unique(group[left]):
            members = left[group[left] == g]
            facets = np.unique(self.facet[members])
            bent = [f for f in facets if len(self.facets[f]) == 1 and self.around[f]]
            if len(facets) >= 4 or bent:
                self._take(members, Freeform())
                continue
            for f in facets:
                flat = members[self.facet[members] == f]
                self._take(flat, self._plane(flat))

    def _smooth_edges(self, apart: Index | None = None) -> tuple[Index, Index, Array]:
        """Return pairs of triangles that meet at a blunt angle (in both orders) and their edge lengths, m.

        Needles count as smooth, unless `apart` is given; then only pairs with different values in it are returned.
        """
        t, k = np.nonzero(self.across >= 0)
        n = self.across[t, k].astype(np.int64)
        blunt = np.einsum("ij,ij->i", self.normals[t], self.normals[n]) > self.smooth
        smooth = blunt | self.needle[t] | self.needle[n] if apart is None else blunt & (apart[t] != apart[n])
        t, k, n = t[smooth], k[smooth], n[smooth]
        ends = self.vertices[self.triangles[t, k]] - self.vertices[self.triangles[t, (k + 1) % 3]]
        return t, n, np.linalg.norm(ends, axis=1)

    def _dissolve(self) -> None:
        """Merge small curved segments that mostly border freeform surfaces into these; join adjacent freeform ones."""
        t, n, length = self._smooth_edges()
        while True:
            a, b = self.label[t], self.label[n]
            count = len(self.segments)
            free = np.array([isinstance(s.geometry, Freeform) for s in self.segments])
            small = np.array([self._is_small(s) for s in self.segments])
            border = np.bincount(a[a != b], length[a != b], minlength=count)
            towards = np.bincount(a[(a != b) & free[b]], length[(a != b) & free[b]], minlength=count)
            given = small & ~free & (towards > 0.5 * border) & (border > 0.0)
            loose = free | given
            joins = loose[a] & loose[b] & (a != b)
            if not joins.any():
                return
            graph = coo_array((np.ones(int(joins.sum())), (a[joins], b[joins])), shape=(count, count))
            _, group = connected_components(graph, directed=False)
            members: dict[int, list[Index]] = {}
            for i, s in enumerate(self.segments):
                key = int(group[i]) if loose[i] else -1 - i
                members.setdefault(key, []).append(s.triangles)
            kept = {-1 - i: s for i, s in enumerate(self.segments) if not loose[i]}
            self.segments = []
            for key, pieces in members.items():
                triangles = np.sort(np.concatenate(pieces))
                self.label[triangles] = len(self.segments)
                self.segments.append(kept.get(key) or Segment(triangles, Freeform(), 0.0))

    def _is_small(self, segment: Segment) -> bool:
        if isinstance(segment.geometry, Plane):
            return len(segment.triangles) == 1
        return len(np.unique(self.facet[segment.triangles])) < _SMALL
