"""Surfaces that constraints in force exclude from collision: the two mated ones, and the faces adjacent to them.

The faces next to a mated one meet the other part only along the rim, where facets would overlap. All other surfaces of
both parts stay solid.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from collision import SurfaceMesh, Tolerance
from collision.mesh import welded
from constraints.geometry.sleeve import sleeve
from constraints.kinds.stated import mates_surfaces
from constraints.manager import ConstraintManager
from constraints.recognition.candidate import Candidate

Pairing = tuple[int, tuple[int, ...], int, tuple[int, ...]]
"""body a, surfaces of a, body b, surfaces of b: each of the first with each of the second"""
Faces = tuple[int, ...]


class Ignoring(Protocol):
    """Methods of `collision.CollisionManager` that are called."""

    def mesh(self, i: int) -> SurfaceMesh: ...
    def ignore_surfaces(self, i: int, surfaces_i: Iterable[int], j: int, surfaces_j: Iterable[int]) -> None: ...
    def enable_surfaces(self, i: int, surfaces_i: Iterable[int], j: int, surfaces_j: Iterable[int]) -> None: ...


class MatedSurfaces:
    """Keeps the surfaces that collision ignores up to date with the constraints in force."""

    def __init__(self, collision: Ignoring, constraints: ConstraintManager, tolerance: Tolerance) -> None:
        self.collision = collision
        self.constraints = constraints
        self.tolerance = tolerance
        self._synced: object = None
        self._of: dict[int, Candidate] = {}
        self._mated: dict[int, tuple[Pairing, ...]] = {}
        self._beside: dict[int, Pairing] = {}
        self._always: dict[tuple[int, int], list[Pairing]] = {}

    def leave_out(self, row: Pairing) -> None:
        """Leave surfaces out whatever constraints come and go: of an overlap that is meant."""
        self._always.setdefault((min(row[0], row[2]), max(row[0], row[2])), []).append(row)
        self.collision.ignore_surfaces(*row)

    def sync(self) -> None:
        """Update the surfaces that collision ignores."""
        in_force = self.constraints.in_force
        if self._synced is in_force:
            return
        now = {id: entry.candidate for id, entry in self.constraints.accepted.items()}
        gone = [id for id, candidate in self._of.items() if now.get(id) is not candidate]
        fresh = [id for id, candidate in now.items() if self._of.get(id) is not candidate]
        mated, beside = dict(self._mated), dict(self._beside)
        enabled = {self._of[id].bodies for id in gone}
        for id in gone:
            del beside[id]
            for row in mated.pop(id):
                self.collision.enable_surfaces(*row)
        sleeves: dict[Hashable, tuple[Faces, Faces] | None] = {}
        for id in fresh:
            candidate = now[id]
            if not mates_surfaces(candidate, self.constraints.recogniser.features):
                mated[id], beside[id] = (), (0, (), 0, ())
                continue
            a, b = candidate.bodies
            sa, sb = candidate.surfaces
            beside_a = adjacent_surfaces(self.collision.mesh(a), sa)
            beside_b = adjacent_surfaces(self.collision.mesh(b), sb)
            beside[id] = (a, beside_a, b, beside_b)
            mated[id] = ((a, sa, b, sb + beside_b), (a, beside_a, b, sb), *self._sleeve(candidate, sleeves))
        # a constraint still in force may share surfaces with a pair just enabled: ignore its surfaces again
        for id in [*fresh, *(i for i, c in now.items() if enabled and c.bodies in enabled)]:
            for row in mated[id]:
                self.collision.ignore_surfaces(*row)
        for row in (row for a, b in enabled for row in self._always.get((min(a, b), max(a, b)), ())):
            self.collision.ignore_surfaces(*row)
        self._of, self._mated, self._beside, self._synced = now, mated, beside, in_force

    def _sleeve(self, candidate: Candidate, known: dict[Hashable, tuple[Faces, Faces] | None]) -> tuple[Pairing, ...]:
        """The faces that cannot meet while a shaft shares its bore's axis, or planes are face to face.

        known: results by meshes and features, so that of four hundred equal bolts one is computed.
        """
        a, fa, b, fb, kind = candidate.key
        meshes = self.collision.mesh(a), self.collision.mesh(b)
        features = self.constraints.recogniser.features
        alike = (*map(id, (*meshes, features[a][fa], features[b][fb], *candidate.geometries)), kind)
        if alike not in known:
            known[alike] = sleeve(candidate, features, meshes, self.tolerance.fit)
        faces = known[alike]
        return () if faces is None else ((a, faces[0], b, faces[1]),)

    def beside(self, a: int, sa: int, b: int, sb: int) -> bool:
        """Whether surface sa of body a and sb of b both lie next to the surfaces of one mate."""
        return any((i, j) == (a, b) and sa in si and sb in sj for i, si, j, sj in self._beside.values())


def adjacent_surfaces(mesh: SurfaceMesh, surfaces: Iterable[int]) -> tuple[int, ...]:
    """Return the other surfaces that share a vertex position with one of `surfaces`, ascending."""
    table = mesh._cache.get("surface_adjacency")
    if table is None:
        table = mesh._cache["surface_adjacency"] = _adjacency(mesh)
    mine = set(surfaces)
    return tuple(sorted({int(t) for s in mine for t in table[s]} - mine))


def _adjacency(mesh: SurfaceMesh) -> list[NDArray[Any]]:
    corners = mesh.vertices[mesh.triangles].reshape(-1, 3)
    scale = float(np.abs(corners).max()) or 1.0
    _, point = welded(corners, 1e-9 * scale)
    pairs = np.unique(np.stack([point, np.repeat(mesh.surface_of_triangle, 3)], axis=1), axis=0)
    groups = np.split(pairs[:, 1], np.flatnonzero(np.diff(pairs[:, 0])) + 1)
    table: list[set[int]] = [set() for _ in range(mesh.n_surfaces)]
    for group in groups:
        for s in group:
            table[s].update(group.tolist())
    return [np.array(sorted(t - {s}), dtype=np.int64) for s, t in enumerate(table)]
