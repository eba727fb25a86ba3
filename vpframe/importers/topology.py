"""The parts of OpenCascade shapes, and the matrices of their transformations."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from OCP.collections import IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher as ShapeMap
from OCP.gp import gp_Trsf
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp, TopExp_Explorer
from OCP.TopoDS import TopoDS_Shape

from vpframe.importers.raw import Array


def explored(
    shape: TopoDS_Shape, kind: TopAbs_ShapeEnum, outside: TopAbs_ShapeEnum = TopAbs_ShapeEnum.TopAbs_SHAPE
) -> Iterator[TopoDS_Shape]:
    """Yield each occurrence of a kind in a shape, except for those in shapes of the kind `outside`."""
    explorer = TopExp_Explorer(shape, kind, outside)
    while explorer.More():
        yield explorer.Current()
        explorer.Next()


def mapped(shape: TopoDS_Shape, kind: TopAbs_ShapeEnum) -> ShapeMap:
    """Return the different shapes of a kind in a shape, numbered from 1."""
    found = ShapeMap()
    TopExp.MapShapes_s(shape, kind, found)
    return found


def matrix_of(trsf: gp_Trsf) -> Array:
    """(3, 4) linear part | translation, mm."""
    return np.array([[trsf.Value(i, j) for j in range(1, 5)] for i in range(1, 4)])
