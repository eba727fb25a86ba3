"""Edges of a part: the polylines along which two surfaces of its mesh meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from collision import SurfaceMesh

ROUND = 1e-9
"""greatest distance of a polyline's points from a circle that it is on, m"""
FEWEST = 5
"""least number of distinct points of a circle: any three lie on one"""


@dataclass(frozen=True, eq=False)
class Edge:
    """A border between surfaces as a polyline (n, 3) in the part's frame, m; closed if its ends are equal.

    `circle` = (center, axis, radius) if it is one.
    """

    points: NDArray[np.float64]
    surfaces: tuple[int, ...]
    """two, or one where the mesh is open or has an edge of more than two triangles"""
    circle: tuple[NDArray[np.float64], NDArray[np.float64], float] | None = None


def edges_of(mesh: SurfaceMesh) -> tuple[Edge, ...]:
    """Return the edges of a mesh, ordered by their surfaces; they end where three surfaces meet."""
    ends = np.stack([mesh.triangles, np.roll(mesh.triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    owners = np.repeat(mesh.surface_of_triangle, 3)
    pairs, which = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True)
    low, high = np.full(len(pairs), mesh.n_surfaces), np.full(len(pairs), -1)
    np.minimum.at(low, which.reshape(-1), owners)
    np.maximum.at(high, which.reshape(-1), owners)
    counts = np.bincount(which.reshape(-1), minlength=len(pairs))
    border = (low != high) | (counts != 2)
    meeting = np.bincount(pairs[border].reshape(-1), minlength=len(mesh.vertices)) != 2
    found: list[Edge] = []
    keys = np.column_stack([low, high])[border]
    order = np.lexsort((keys[:, 1], keys[:, 0]))
    sides, starts = np.unique(keys[order], axis=0, return_index=True)
    for (a, b), lines in zip(sides.tolist(), np.split(pairs[border][order], starts[1:]), strict=False):
        for chain in _chains(lines.tolist(), meeting):
            points = mesh.vertices[chain]
            found.append(Edge(points, (a,) if a == b else (a, b), _circle(points)))
    return tuple(found)


def _chains(lines: list[list[int]], ends: NDArray[np.bool_]) -> list[list[int]]:
    """Join segments to chains of vertices that stop at `ends`; closed chains repeat their first vertex."""
    beside: dict[int, list[int]] = {}
    for a, b in lines:
        beside.setdefault(a, []).append(b)
        beside.setdefault(b, []).append(a)
    chains = []
    for start in sorted(beside, key=lambda v: (not ends[v] and len(beside[v]) == 2, v)):
        while beside[start]:
            chain = [start]
            while beside[chain[-1]]:
                here = chain[-1]
                following = beside[here].pop()
                beside[following].remove(here)
                chain.append(following)
                if ends[following] or following == start:
                    break
            chains.append(chain)
    return chains


def _circle(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], float] | None:
    """Centre, axis and radius of the circle through points (n, 3); None if they lie on none."""
    distinct = np.unique(points, axis=0)
    if len(distinct) < FEWEST:
        return None
    middle = distinct.mean(axis=0)
    *_, directions = np.linalg.svd(distinct - middle)
    flat = (distinct - middle) @ directions[:2].T
    if np.abs((distinct - middle) @ directions[2]).max() > ROUND:
        return None
    equations = np.column_stack([2.0 * flat, np.ones(len(flat))])
    (x, y, c), _, rank, _ = np.linalg.lstsq(equations, (flat**2).sum(axis=1), rcond=None)
    radius = float(np.sqrt(max(c + x * x + y * y, 0.0)))
    if rank < 3 or np.abs(np.hypot(*(flat - (x, y)).T) - radius).max() > ROUND:
        return None
    return middle + x * directions[0] + y * directions[1], directions[2], radius
