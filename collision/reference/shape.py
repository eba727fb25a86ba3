"""Objects that are not triangle meshes: coal's primitives, convex hulls, height fields and octrees."""

from __future__ import annotations

from typing import Any

import numpy as np

from collision.errors import CollisionError
from collision.mesh import SurfaceMesh

_CORNERS = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1), (1, 1, 1))
_SIDES = (
    (0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4),
    (2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2), (1, 3, 7), (1, 7, 5),
)  # fmt: skip


class ShapeMesh(SurfaceMesh):
    """A solid coal shape as an object of one surface; its triangles are those of its bounding box.

    coal finds its collisions and distances, which are not exact; see `collision.reference.oracle`.

    Raises
    ------
    CollisionError: no shape of coal's, a mesh of coal's, or a shape without bounds.
    """

    __slots__ = ("shape",)

    def __init__(self, shape: Any, name: str | None = None) -> None:
        import coal

        who = name if name is not None else type(shape).__name__
        if not isinstance(shape, coal.CollisionGeometry) or isinstance(shape, coal.BVHModelBase):
            raise CollisionError(
                f"{who}: not a shape of coal ({type(shape).__name__}); give a primitive, a convex hull, a height field "
                "or an octree, and meshes to `add` as SurfaceMesh"
            )
        shape.computeLocalAABB()
        box = np.array([shape.aabb_local.min_, shape.aabb_local.max_])
        if not (np.abs(box) < 1e150).all():
            raise CollisionError(f"{who}: {type(shape).__name__} has no bounds; give a large box instead")
        corners = [[box[k][d] for d, k in enumerate(corner)] for corner in _CORNERS]
        super().__init__(corners, _SIDES, name=who)
        self.shape = shape

    def __copy__(self) -> ShapeMesh:
        return ShapeMesh(self.shape, self.name)

    def __deepcopy__(self, memo: dict[int, Any]) -> ShapeMesh:
        return ShapeMesh(self.shape.clone(), self.name)  # coal clones what it cannot pickle

    def __reduce__(self) -> tuple[Any, ...]:
        try:
            self.shape.__reduce__()
        except RuntimeError:
            raise CollisionError(
                f"{self.name}: coal cannot pickle a {type(self.shape).__name__}; copy it with `copy`, or make it again "
                "from its points where it is needed"
            ) from None
        return ShapeMesh, (self.shape, self.name)


def triangles_needed(mesh: SurfaceMesh) -> None:
    """Raise CollisionError for a `ShapeMesh`: its triangles are not those of its shape."""
    if isinstance(mesh, ShapeMesh):
        raise CollisionError(f'{mesh.name}: a shape has no triangles to test; give method="coal", or use a manager')


def mesh_of_shape(shape: Any, name: str | None = None) -> SurfaceMesh:
    """Return the object for a coal shape: a `ShapeMesh`, or a closed mesh for a height field.

    coal can neither test nor measure a height field against a mesh. As a mesh of one surface, from its heights down to
    its least height, a height field is treated exactly by every query.
    """
    import coal

    if not isinstance(shape, coal.HeightFieldOBBRSS | coal.HeightFieldAABB):
        return ShapeMesh(shape, name)
    x, y, z = np.array(shape.getXGrid()), np.array(shape.getYGrid()), np.array(shape.getHeights())
    rows, columns = z.shape
    top = np.stack([np.broadcast_to(x, z.shape), np.broadcast_to(y[:, None], z.shape), z], axis=2).reshape(-1, 3)
    bottom = top.copy()
    bottom[:, 2] = shape.getMinHeight()
    cell = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).reshape(-1)
    right, below = cell + 1, cell + columns
    upper = np.concatenate([np.stack([cell, below, right], 1), np.stack([right, below, below + 1], 1)])
    rim = np.concatenate(
        [
            np.arange(columns - 1),
            np.arange(rows - 1) * columns + columns - 1,
            (rows - 1) * columns + np.arange(columns - 1, 0, -1),
            np.arange(rows - 1, 0, -1) * columns,
        ]
    )
    ahead = np.roll(rim, -1)
    n = len(top)
    walls = np.concatenate([np.stack([rim, ahead, ahead + n], 1), np.stack([rim, ahead + n, rim + n], 1)])
    triangles = np.concatenate([upper, upper[:, ::-1] + n, walls])
    return SurfaceMesh(
        np.concatenate([top, bottom]), triangles, name=name if name is not None else type(shape).__name__
    )
