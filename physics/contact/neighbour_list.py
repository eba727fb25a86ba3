"""`NeighbourList`: surface pairs that may meet soon, made with slack and kept until something may leave it (Verlet)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collision import CollisionManager, SurfaceMesh
from constraints.geometry.surfaces import Geometry
from physics.contact.contact_set import DEEPEST, ContactSet
from physics.contact.surface_pairs import near_surfaces
from physics.model.bodies import Bodies
from physics.model.shapes import ContactShape, make_shape, pack

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SLACK = 2e-3
"""m: least slack of the list; more where bodies are fast, so that the list lasts some steps"""
CROWD = 64
"""bodies: among more, a long list costs more than making it anew"""


class NeighbourList:
    """Pairs of near surfaces of moving objects and all other solid objects, and the contact shapes of their objects.

    geometries: by object id, surfaces that are known analytically (mesh frame).
    """

    def __init__(
        self,
        collision: CollisionManager,
        bodies: Bodies,
        contact_set: ContactSet,
        geometries: Mapping[int, Mapping[int, Geometry]],
    ) -> None:
        self.pairs: Ints = np.zeros((0, 4), np.int64)
        """(k, 4) object, surface, object, surface; sorted by the objects"""
        self.solid: dict[int, bool] = {}
        """by object id; objects not in it are solid"""
        self.stale = True
        """whether the list must be made anew before the next step"""
        self.placed = True
        """whether objects were placed since the list was made, and may overlap"""
        self._collision = collision
        self._bodies = bodies
        self._contact_set = contact_set
        self._geometries = geometries
        self.reach = np.zeros(0)
        """(n,) m, by object id: how far a body may move before the list must be made anew"""
        self.center = np.zeros((0, 3))
        self.rotation = np.zeros((0, 3, 3))
        """with `center`: how the bodies stood when the list was made"""
        self._shapes: list[ContactShape] = []
        self._shape_key: dict[tuple, int] = {}
        self._named: list[tuple[SurfaceMesh, Mapping[int, Geometry]]] = []  # by their id() in `_shape_key`: kept alive
        self._surface_count = np.zeros(0, np.int64)
        self._whole = np.zeros((0, 6))

    def objects(self) -> Ints:
        """(k, 2) near objects, each pair once."""
        near = self.pairs[:, [0, 2]]
        return near[np.append(True, (near[1:] != near[:-1]).any(axis=1))] if len(near) else near

    def of(self, ids: Ints) -> Ints:
        """(k, 4) near surface pairs that involve one of the bodies `ids`."""
        mine = np.zeros(self._bodies.n, bool)
        mine[ids] = True
        return self.pairs[mine[self.pairs[:, 0]] | mine[self.pairs[:, 2]]]

    def hold_for(self, movers: Ints, step: Array) -> bool:
        """Whether the list stays complete while the bodies `movers` (n,) move by up to `step` (n,) m."""
        if self.stale:
            return False
        b = self._bodies
        turned = np.abs(b.rotation[movers] - self.rotation[movers]).sum(axis=(1, 2)) * b.radius[movers]
        moved = np.sqrt(((b.center[movers] - self.center[movers]) ** 2).sum(axis=1)) + turned
        return bool((moved + step <= self.reach[movers]).all())

    def renew(self, movers: Ints, step: Array) -> None:
        """Rebuild the list for the bodies `movers` (n,), ascending, which are about to move by `step` (n,) m."""
        b = self._bodies
        n = b.n
        self.center = b.center[:n].copy()
        self.rotation = b.rotation[:n].copy()
        self.reach = np.zeros(n)
        self.reach[movers] = SLACK + (4.0 if len(movers) <= CROWD else 1.5) * step
        if self.placed:
            self.reach[movers] += DEEPEST * np.where(np.isfinite(b.thickness[movers]), b.thickness[movers], 0.0)
        solid = [i for i in movers.tolist() if self.solid.get(i, True)]
        reach = self.reach[solid].max(initial=0.0)
        objects = self._collision.object_pairs(solid, 2.0 * reach).astype(np.int64)
        keep = np.array([self.solid.get(i, True) and self.solid.get(j, True) for i, j in objects.tolist()], bool)
        far = np.sqrt(((b.center[objects[:, 0]] - b.center[objects[:, 1]]) ** 2).sum(axis=1))
        keep &= far <= (b.radius[objects] + self.reach[objects]).sum(axis=1)
        objects = objects[keep]
        self.use(objects)
        self.pairs = self._surface_pairs(objects)
        self.stale = self.placed = False

    def state(self) -> dict[str, Any]:
        """The data that `restore` takes."""
        return {
            "pairs": self.pairs, "reach": self.reach, "listed": (self.center, self.rotation), "stale": self.stale,
            "placed": self.placed,
        }  # fmt: skip

    def restore(self, data: Mapping[str, Any]) -> None:
        """Restore what `state` returned for the same objects."""
        self.pairs, self.reach = data["pairs"], data["reach"]
        self.center, self.rotation = data["listed"]
        self.stale, self.placed = data["stale"], data["placed"]
        self.use(self.pairs[:, [0, 2]])

    def _surface_pairs(self, objects: Ints) -> Ints:
        b = self._bodies
        shapes = self._contact_set.shapes
        if shapes is None or len(objects) == 0:
            return np.zeros((0, 4), np.int64)
        out = np.empty((256 + 2 * len(self.pairs), 4), np.int64)
        while True:
            found = near_surfaces(
                objects, b.rotation, b.origin, self._contact_set.shape_of, shapes.boxes, shapes.first_surface,
                self._surface_count, self._whole, self.reach, out,
            )  # fmt: skip
            if found <= len(out):
                break
            out = np.empty((found, 4), np.int64)
        pairs = out[:found]
        keep = np.ones(found, bool)
        for i, j in objects if self._collision.ignores else ():
            ignored = self._collision.ignored_surfaces(int(i), int(j))
            if ignored:
                mine = np.flatnonzero((pairs[:, 0] == i) & (pairs[:, 2] == j))
                keep[mine] = [(int(pairs[k, 1]), int(pairs[k, 3])) not in ignored for k in mine]
        return np.ascontiguousarray(pairs[keep])

    def use(self, objects: Ints) -> None:
        """Build the contact shapes of these objects where missing; sets their wall thickness."""
        for i in np.unique(objects).tolist():
            if self._contact_set.shape_of[i] < 0:
                self._pack(i)

    def _pack(self, i: int) -> None:
        mesh = self._collision.mesh(i)
        geometries = self._geometries.get(i, {})
        key = (id(mesh), tuple(sorted((s, id(g)) for s, g in geometries.items())))
        if key not in self._shape_key:
            self._shapes.append(make_shape(mesh, geometries, self._contact_set.tolerance.linear))
            self._named.append((mesh, geometries))
            self._contact_set.use(pack(self._shapes))
            self._surface_count = np.array([len(s.kinds) for s in self._shapes], np.int64)
            self._whole = np.array([[*s.boxes[:, :3].min(axis=0), *s.boxes[:, 3:].max(axis=0)] for s in self._shapes])
            self._shape_key[key] = len(self._shapes) - 1  # last: what is interrupted before is made again
        shape = self._shape_key[key]
        self._contact_set.shape_of[i] = shape
        self._bodies.thickness[i] = min(self._bodies.thickness[i], self._shapes[shape].wall)
