"""Segmentation of a triangle mesh into the surfaces from which it was tessellated.

The vertices of a tessellated CAD face lie on its true surface, which is more reliable than angles between triangles: at
a tangential transition from a plane to a fillet there is no edge, but the next vertices lie off the plane. Triangles
are joined to flat facets; analytic surfaces are fitted to facets and their neighbours and grown over all triangles
whose vertices lie on them; the surface that explains most vertices beyond its degrees of freedom is taken first.
Remaining triangles form freeform surfaces bounded by sharp edges. Growth from seeds follows Schnabel, Wahl & Klein
(Computer Graphics Forum 26 (2007) 214), with fits in place of random samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from collision import Tolerance
from constraints.geometry.surfaces import LARGEST, Freeform, Geometry, Plane, Torus
from constraints.recognition.patches import (
    NUMBERS,
    Patches,
    Samples,
    fit_packed,
    fit_patches,
    geometry_of,
    numbers_of,
    workspace,
)
from vpframe.importers.region_growing import Mesh, flat_facets, neighbours, patches_at, scratch, settle

Array = NDArray[np.float64]
Index = NDArray[np.int64]

Fits = tuple[tuple[str, Array, int], ...]
"""kind, numbers, and number of triangles of the patch to which a surface was fitted"""

_NEEDED = {"plane": 3, "cylinder": 5, "sphere": 4, "cone": 6, "torus": 7}
_STRONG = 6
"""vertices beyond its degrees of freedom that a curved surface must explain to precede planes"""
_SMALL = 12
"""number of facets below which a curved segment within a freeform surface counts as accidental"""
_FEWEST, _MOST = 4, 1024
"""number of facets whose patches are fitted together: doubled while no surface found covers the next facets"""
_PATCH, _SAMPLES = 40, 64
"""most facets of a patch, and most vertices of a facet that are fitted"""
_ITERATIONS = 15
_OUTDO = {"cylinder": 1.0, "cone": 1.5, "sphere": 1.5, "torus": 2.5}
"""factor by which a more complex surface must explain more facets than a simpler one: a sphere fits both circles of any
frustum, a torus any two frustums in a row"""


def _outdoes(kind: str, size: int, other: str, most: int) -> bool:
    """Whether a surface of `size` facets is preferred to another of `most`: the simpler, unless it explains less."""
    order = list(_OUTDO)
    if order.index(kind) < order.index(other):
        return size * _OUTDO[other] >= most
    return size > most * (1.0 if kind == other else _OUTDO[kind])


class Grown(NamedTuple):
    """Triangles on a surface that are connected to a seed."""

    kind: str
    numbers: Array
    """(8,) as in `constraints.recognition.patches`"""
    triangles: Index
    score: int
    """number of vertices beyond the degrees of freedom"""
    facets: int

    @property
    def geometry(self) -> Geometry:
        found = geometry_of(NUMBERS[self.kind], self.numbers)
        assert found is not None
        return found


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
        self.flat, self.smooth = np.cos(limits.flat), np.cos(limits.bend)
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
        self._mesh = Mesh(
            vertices,
            triangles,
            self.normals,
            self.needle,
            self.across,
            self.label,
            tolerance,
            float(np.cos(limits.facet)),
        )
        self._scratch, self._work = scratch(len(triangles), len(vertices)), workspace(len(vertices), 1)
        self.facet = self._flat_facets()
        self._order = np.argsort(self.facet, kind="stable")
        self._starts = np.concatenate([[0], np.cumsum(np.bincount(self.facet))])
        self.seeds = self._order[self._starts[:-1]]
        """(facets,) first triangle of each"""
        self._facet_areas = np.bincount(self.facet, self.areas)
        key = np.unique(np.repeat(self.facet, 3) * len(vertices) + triangles.reshape(-1))
        self._corners = key // len(vertices), key % len(vertices)
        """facet and vertex of each pair, by facet"""
        self._flat_planes = self._fitted_planes()
        self.around, self.rounds = self._smooth_neighbours()
        self._samples = self._sampled()
        self._known: dict[int, Fits] = {}
        """surfaces that fit the patches at each facet, of the first pass"""

    def run(self) -> list[Segment]:
        self._planes(sure=True)
        self._curved(strong=True)
        self._planes(sure=False)
        self._curved(strong=False)
        self._rest()
        self._dissolve()
        return sorted(self.segments, key=lambda s: int(s.triangles.min()))

    def _settle(self, kind: str, numbers: Array, seed: int, patch: int) -> Grown:
        """Alternate growth and fit while the segment grows beyond the number of triangles to which it was fitted."""
        numbers = numbers.copy()
        count, vertices, facets = settle(
            NUMBERS[kind], numbers, patch, seed, self._mesh, self.facet, self._scratch, self._work
        )
        return Grown(kind, numbers, self._scratch.out[:count].copy(), vertices - _NEEDED[kind], facets)

    def _points(self, triangles: Index) -> Array:
        return self.vertices[np.unique(self.triangles[triangles])]

    def _take(self, triangles: Index, geometry: Geometry) -> None:
        self.label[triangles] = len(self.segments)
        residual = 0.0
        if not isinstance(geometry, Freeform):
            residual = float(np.abs(geometry.distance(self._points(triangles))).max())
        self.segments.append(Segment(triangles, geometry, residual))

    def _flat_facets(self) -> Index:
        """Return the facet of each triangle: groups of connected coplanar triangles."""
        facet = np.full(len(self.triangles), -1, np.int64)
        planes = np.column_stack([self.middles, self.normals, np.zeros((len(facet), 2))])
        order = np.argsort(-self.areas, kind="stable")
        flat_facets(order, planes, self._mesh, self.flat, facet, np.full((2, len(facet)), -1, np.int64))
        return facet

    def _members(self, f: int) -> Index:
        """Return the triangles of a facet, ascending."""
        return self._order[self._starts[f] : self._starts[f + 1]]

    def _smooth_neighbours(self) -> tuple[Index, Index]:
        """Return the facets that meet each facet at a blunt angle, longest common border first, and their ends."""
        t, n, lengths = self._smooth_edges(self.facet)
        count = len(self.seeds)
        key, which = np.unique(self.facet[t] * count + self.facet[n], return_inverse=True)
        border = np.bincount(which.reshape(-1), lengths, len(key))
        a, b = key // count, key % count
        order = np.lexsort((b, -border, a))
        return b[order], np.concatenate([[0], np.cumsum(np.bincount(a, minlength=count))])

    def _beside(self, facets: Index) -> Index:
        """Return the facets around some facets, and some of these themselves."""
        lengths = self.rounds[facets + 1] - self.rounds[facets]
        ends = np.cumsum(lengths)
        return self.around[np.arange(lengths.sum()) + np.repeat(self.rounds[facets] - ends + lengths, lengths)]

    def _sampled(self) -> tuple[Index, Index, Array, Array]:
        """Return up to `_SAMPLES` vertices of each facet with their ends, its middle and its area vector."""
        count = len(self.seeds)
        owner, corners = self._corners
        numbers = np.bincount(owner, minlength=count)
        rank = np.arange(len(owner)) - np.repeat(np.cumsum(numbers) - numbers, numbers)
        share = np.minimum(numbers, _SAMPLES)[owner]
        kept = (rank + 1) * share // numbers[owner] > rank * share // numbers[owner]
        first = np.concatenate([[0], np.cumsum(np.bincount(owner[kept], minlength=count))])
        weights = [np.bincount(self.facet, self.areas * self.middles[:, d], count) for d in range(3)]
        vectors = [np.bincount(self.facet, self.vectors[:, d], count) for d in range(3)]
        return corners[kept], first, np.column_stack(weights) / self._facet_areas[:, None], np.column_stack(vectors)

    def _curved(self, strong: bool) -> None:
        """Take curved surfaces, best score first, from seeds at every free facet."""
        candidates: list[tuple[int, int, Grown, int]] = []
        covered = np.zeros(len(self.triangles), bool)
        free = self.label[self.seeds] < 0
        self._forget(np.unique(self.facet[self.label >= 0]))
        order = [f for f in np.argsort(-self._facet_areas, kind="stable").tolist() if free[f]]
        together, next_ = _FEWEST, 0
        while next_ < len(order):
            seeds: list[int] = []
            while next_ < len(order) and len(seeds) < together:
                if not covered[self.seeds[order[next_]]]:
                    seeds.append(order[next_])
                next_ += 1
            spared = 0
            for f, fits in zip(seeds, self._fits(seeds), strict=True):
                if covered[self.seeds[f]]:
                    spared += 1
                    continue
                best = self._best_at(f, fits, strong)
                if best is not None:
                    candidates.append((-best.score, len(candidates), best, int(self.seeds[f])))
                    covered[best.triangles] = True
            together = min(2 * together, _MOST) if not spared else max(together // 2, _FEWEST)
        heapify(candidates)
        last = len(candidates)
        while candidates:
            less, _, found, seed = heappop(candidates)
            if self.label[seed] >= 0:
                continue
            now = self._settle(found.kind, found.numbers, seed, len(self.label))
            if not self._enough(now, strong):
                continue
            if now.score < -less and candidates and now.score < -candidates[0][0]:
                heappush(candidates, (-now.score, last, found, seed))
                last += 1
            else:
                self._take(np.sort(now.triangles), now.geometry)

    def _enough(self, grown: Grown, strong: bool) -> bool:
        if strong and (grown.facets < 4 or grown.score < _STRONG * (2 - (grown.kind == "cylinder"))):
            return False
        if isinstance(grown.geometry, Torus) and self._circles(grown.geometry, grown.triangles) < 4:
            return False  # a torus fits any three coaxial circles
        if strong:
            return True
        needed = _STRONG if grown.kind in ("sphere", "torus") else 1
        if grown.facets < 3 or grown.score < needed:
            return False
        facets = np.unique(self.facet[grown.triangles])
        beside = np.setdiff1d(self._beside(facets), facets)
        if (self.label[self.seeds[beside]] < 0).sum() >= len(facets):
            return False  # a patch of a freeform surface
        areas = np.bincount(self.facet[grown.triangles], self.areas[grown.triangles])
        areas = areas[areas > 0]
        return bool(areas.max() <= 3.0 * np.median(areas))

    def _circles(self, torus: Torus, grown: Index) -> int:
        """Number of circles about the torus's axis on which the vertices lie."""
        q = self._points(grown) - torus.center
        height = q @ torus.axis
        radius = np.linalg.norm(q - height[:, None] * torus.axis, axis=1) - torus.major
        arc = np.sort(torus.minor * np.arctan2(height, radius))
        return 1 + int((np.diff(arc) > 10.0 * self.tolerance).sum())

    def _fits(self, seeds: list[int]) -> list[Fits]:
        """Return the surfaces that fit the patches at each facet within tolerance.

        Patches: the facet with one or two neighbours, with all, and with the neighbours of these.
        """
        free = self.label[self.seeds] < 0
        new = np.array([f for f in seeds if f not in self._known], np.int64)
        needed = np.array([_NEEDED[kind] for kind in NUMBERS])
        corners, first, middles, vectors = self._samples
        owner, kinds, (of, ends, at, stops) = patches_at(
            new, self.around, self.rounds, free, corners, first, _PATCH, needed, self._scratch
        )
        packed = Patches(kinds, of, ends, at, stops)
        found = fit_packed(Samples(self.vertices, middles, vectors), packed, self.tolerance, _ITERATIONS)
        names = list(NUMBERS)
        self._known |= dict.fromkeys(new.tolist(), ())
        sizes = np.diff(self._starts)
        for i in np.flatnonzero((np.abs(found) <= LARGEST).all(axis=1)).tolist():
            size = int(sizes[at[stops[i] : stops[i + 1]]].sum())
            self._known[int(new[owner[i]])] += ((names[kinds[i]], found[i], size),)
        return [self._known[f] for f in seeds]

    def _forget(self, taken: Index) -> None:
        """Forget fits whose patches may hold one of the `taken` facets: those at up to two facets' distance."""
        near = np.unique(np.concatenate([taken, self._beside(taken)]))
        for f in (*near.tolist(), *np.unique(self._beside(near)).tolist()):
            self._known.pop(f, None)

    def _best_at(self, f: int, fits: Fits, strong: bool) -> Grown | None:
        best: Grown | None = None
        seed = int(self.seeds[f])
        for kind, numbers, patch in fits:
            grown = self._settle(kind, numbers, seed, patch)
            if not len(grown.triangles) or not self._enough(grown, strong):
                continue
            if best is None or _outdoes(kind, grown.facets, best.kind, best.facets):
                best = grown
        if best is not None and best.kind == "sphere":
            cone = self._cone_of(best.triangles, seed)
            if cone is not None and _outdoes("cone", cone.facets, "sphere", best.facets):
                return cone
        return best

    def _cone_of(self, zone: Index, seed: int) -> Grown | None:
        """The cone through the triangles of a zone of a sphere: few facets of a frustum with unequal rings fit none."""
        zone = np.sort(zone)
        patch = self._points(zone), self.vertices[self.triangles[zone]].mean(axis=1), self.vectors[zone]
        (fit,) = fit_patches("cone", [patch], self.tolerance)
        if fit is None:
            return None
        grown = self._settle("cone", numbers_of(fit.geometry), seed, 0)
        return grown if len(grown.triangles) else None

    def _planes(self, sure: bool) -> None:
        """Take flat facets that cannot belong to a curved surface (`sure`), or that have no free neighbours."""
        areas, near = self._facet_areas, np.diff(self.rounds)
        free, owner = self.label[self.seeds] < 0, np.repeat(np.arange(len(areas)), near)
        if sure:  # a facet beside others of similar size may belong to a slowly bending surface
            beside = np.zeros(len(areas))
            np.maximum.at(beside, owner, areas[self.around])
            flat = free & (areas > 3.0 * beside)
        else:  # a lone triangle with smooth neighbours belongs to a curved surface
            bent = np.bincount(owner[free[self.around]], minlength=len(areas)) > 0
            flat = free & ~bent & ((np.diff(self._starts) > 1) | (near == 0))
        for f in np.argsort(-areas, kind="stable").tolist():
            if flat[f] and (not sure or self._is_wide(self._members(f))):
                self._take_flat(f)

    def _is_wide(self, members: Index) -> bool:
        """Whether the vertices lie on more than two parallel lines; a strip of a curved surface has two.

        Of any three points two lie on the same of two lines, so three directions are tried; far points are chosen.
        """
        points = self._points(members)
        if len(points) < 6:
            return False
        normal = self._flat_planes[1][self.facet[members[0]]]
        a = points[np.linalg.norm(points - points.mean(axis=0), axis=1).argmax()]
        b = points[np.linalg.norm(points - a, axis=1).argmax()]
        c = points[np.abs((points - a) @ np.cross(normal, b - a)).argmax()]
        across = np.cross(normal, [b - a, c - b, a - c])
        lengths = np.linalg.norm(across, axis=1)
        heights = points @ (across[lengths > 0.0] / lengths[lengths > 0.0, None]).T
        low, high = heights.min(axis=0), heights.max(axis=0)
        off = np.minimum(heights - low, high - heights).max(axis=0)
        return bool(off.min() > self.tolerance)

    def _fitted_planes(self) -> tuple[Array, Array, Array]:
        """Return the plane of least squared distances through the vertices of each facet, and its residual, m.

        Points (n, 3) and normals (n, 3), which point out of the triangles; residuals (n,).
        """
        owner, corners = self._corners
        first = np.flatnonzero(np.r_[True, owner[1:] != owner[:-1]])
        points = self.vertices[corners]
        middles = np.add.reduceat(points, first) / np.bincount(owner)[:, None]
        away = points - middles[owner]
        normals = np.linalg.eigh(np.add.reduceat(away[:, :, None] * away[:, None, :], first))[1][:, :, 0]
        outward = np.column_stack([np.bincount(self.facet, self.vectors[:, d]) for d in range(3)])
        normals[np.einsum("ij,ij->i", normals, outward) < 0.0] *= -1.0
        off = np.abs(np.einsum("ij,ij->i", away, normals[owner]))
        return middles, normals, np.maximum.reduceat(off, first)

    def _take_flat(self, f: int) -> None:
        """Take the triangles of a facet as a plane."""
        members = self._members(f)
        middles, normals, residuals = self._flat_planes
        self.label[members] = len(self.segments)
        self.segments.append(Segment(members, Plane(middles[f], normals[f]), float(residuals[f])))

    def _rest(self) -> None:
        """Join remaining triangles across smooth edges to freeform surfaces, or a few flat facets to planes."""
        t, n, _ = self._smooth_edges()
        free = (self.label[t] < 0) & (self.label[n] < 0)
        graph = coo_array((np.ones(int(free.sum())), (t[free], n[free])), shape=(len(self.label),) * 2)
        _, group = connected_components(graph, directed=False)
        left = np.flatnonzero(self.label < 0)
        left = left[np.argsort(group[left], kind="stable")]
        for members in np.split(left, np.flatnonzero(np.diff(group[left])) + 1) if len(left) else ():
            facets = np.unique(self.facet[members])
            bent = (np.diff(self._starts)[facets] == 1) & (np.diff(self.rounds)[facets] > 0)
            if len(facets) >= 4 or bent.any():
                self._take(members, Freeform())
                continue
            for f in facets.tolist():
                self._take_flat(f)

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
