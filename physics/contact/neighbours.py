"""`Neighbours`: the list of surface pairs that may meet soon, made with slack and kept until something may leave it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collision import CollisionManager, SurfaceMesh
from constraints.geometry.surfaces import Geometry
from physics.contact.candidates import near_objects, near_surfaces
from physics.contact.contact_set import DEEPEST, Touching
from physics.model.bodies import Bodies
from physics.model.shapes import Shape, make_shape, pack

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SLACK = 2e-3
"""m: least slack of the list; more where things are fast, so that it lasts some steps"""
CROWD = 64
"""bodies: among more, a long list costs more than making it anew"""


class Neighbours:
    """Near surface pairs of the objects that move, with everything solid, and the shapes they are judged by.

    geometries: by object id, the surfaces known analytically (mesh frame).
    """

    def __init__(
        self,
        collision: CollisionManager,
        bodies: Bodies,
        touching: Touching,
        geometries: Mapping[int, Mapping[int, Geometry]],
    ) -> None:
        self.pairs: Ints = np.zeros((0, 4), np.int64)
        """(k, 4) object, surface, object, surface; sorted by the objects"""
        self.solid: dict[int, bool] = {}
        """by object id; what is not in it is solid"""
        self.stale = True
        """whether the list must be made anew before the next step"""
        self.placed = True
        """whether objects were placed since the list was made, perhaps into one another"""
        self._collision = collision
        self._bodies = bodies
        self._touching = touching
        self._geometries = geometries
        self._reach = np.zeros(0)
        self._center = np.zeros((0, 3))
        self._rotation = np.zeros((0, 3, 3))
        self._shapes: list[Shape] = []
        self._shape_key: dict[tuple, int] = {}
        self._named: list[tuple[SurfaceMesh, Mapping[int, Geometry]]] = []  # by their id() in `_shape_key`: kept alive
        self._surface_count = np.zeros(0, np.int64)
        self._whole = np.zeros((0, 6))

    def objects(self) -> Ints:
        """(k, 2) near objects, each pair once."""
        near = self.pairs[:, [0, 2]]
        return near[np.append(True, (near[1:] != near[:-1]).any(axis=1))] if len(near) else near

    def of(self, ids: Ints) -> Ints:
        """Near surface pairs with one of the bodies."""
        mine = np.zeros(self._bodies.n, bool)
        mine[ids] = True
        return self.pairs[mine[self.pairs[:, 0]] | mine[self.pairs[:, 2]]]

    def hold_for(self, movers: Ints, step: Array) -> bool:
        """Whether the list is still good when the bodies `movers` (n,) move by up to `step` (n,) m."""
        if self.stale:
            return False
        b = self._bodies
        turned = np.abs(b.rotation[movers] - self._rotation[movers]).sum(axis=(1, 2)) * b.radius[movers]
        moved = np.sqrt(((b.center[movers] - self._center[movers]) ** 2).sum(axis=1)) + turned
        return bool((moved + step <= self._reach[movers]).all())

    def renew(self, movers: Ints, step: Array) -> None:
        """Make the list anew for the bodies `movers` (n,), ascending, which are about to move by `step` (n,) m."""
        b = self._bodies
        n = b.n
        self._center = b.center[:n].copy()
        self._rotation = b.rotation[:n].copy()
        self._reach = np.zeros(n)
        self._reach[movers] = SLACK + (4.0 if len(movers) <= CROWD else 1.5) * step
        if self.placed:
            self._reach[movers] += DEEPEST * np.where(np.isfinite(b.thickness[movers]), b.thickness[movers], 0.0)
        others = np.array([i for i in range(n) if b.kind[i] != 0 and self.solid.get(i, True)], dtype=np.int64)
        solid = np.array([i for i in movers if self.solid.get(int(i), True)], dtype=np.int64)
        objects = np.empty((max(64, 8 * len(solid)), 2), np.int64)
        while (found := near_objects(solid, others, b.center, b.radius, self._reach, objects)) > len(objects):
            objects = np.empty((found, 2), np.int64)
        objects = objects[:found]
        objects = objects[np.lexsort((objects[:, 1], objects[:, 0]))]
        if self._collision.ignores:
            heeded = [not self._collision.ignored(int(i), int(j)) for i, j in objects]
            objects = objects[np.array(heeded, bool)]
        self.use(objects)
        self.pairs = self._surface_pairs(objects)
        self.stale = self.placed = False

    def state(self) -> dict[str, Any]:
        """What `restore` needs."""
        return {
            "pairs": self.pairs, "reach": self._reach, "listed": (self._center, self._rotation), "stale": self.stale,
            "placed": self.placed,
        }  # fmt: skip

    def restore(self, data: Mapping[str, Any]) -> None:
        """Go back to a `state` of the same objects."""
        self.pairs, self._reach = data["pairs"], data["reach"]
        self._center, self._rotation = data["listed"]
        self.stale, self.placed = data["stale"], data["placed"]
        self.use(self.pairs[:, [0, 2]])

    def _surface_pairs(self, objects: Ints) -> Ints:
        b = self._bodies
        shapes = self._touching.shapes
        if shapes is None or len(objects) == 0:
            return np.zeros((0, 4), np.int64)
        out = np.empty((256 + 2 * len(self.pairs), 4), np.int64)
        while True:
            found = near_surfaces(
                objects, b.rotation, b.origin, self._touching.shape_of, shapes.boxes, shapes.first_surface,
                self._surface_count, self._whole, self._reach, out,
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
        """Make sure the shapes of these objects are packed, so that their walls' thickness is known."""
        for i in np.unique(objects).tolist():
            if self._touching.shape_of[i] < 0:
                self._pack(i)

    def _pack(self, i: int) -> None:
        mesh = self._collision.mesh(i)
        geometries = self._geometries.get(i, {})
        key = (id(mesh), tuple(sorted((s, id(g)) for s, g in geometries.items())))
        if key not in self._shape_key:
            self._shape_key[key] = len(self._shapes)
            self._shapes.append(make_shape(mesh, geometries, self._touching.tolerance.linear))
            self._named.append((mesh, geometries))
            self._touching.use(pack(self._shapes))
            self._surface_count = np.array([len(s.kinds) for s in self._shapes], np.int64)
            self._whole = np.array([[*s.boxes[:, :3].min(axis=0), *s.boxes[:, 3:].max(axis=0)] for s in self._shapes])
        shape = self._shape_key[key]
        self._touching.shape_of[i] = shape
        self._bodies.thickness[i] = min(self._bodies.thickness[i], self._shapes[shape].wall)
