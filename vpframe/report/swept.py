"""`SweptVolume`: where a part has been, as a mesh, and what it came too near to; and STL files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

STL_ROW = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


@dataclass(frozen=True, eq=False)
class SweptVolume:
    """The volume a part swept, in the world."""

    part: str
    vertices: NDArray[np.float64]
    """(n, 3) m"""
    triangles: NDArray[np.int32]
    """(m, 3)"""
    error: float
    """m: how far the mesh may stand off the true volume"""
    clashes: tuple[str, ...] = ()
    """parts that the volume collides with"""


def write_stl(path: Path, vertices: NDArray[np.float64], triangles: NDArray[np.int32], scale: float = 1e3) -> Path:
    """Write a binary STL file; STL has no unit, millimetres are what readers take it for, hence `scale`."""
    corners = vertices[triangles] * scale
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    rows = np.zeros(len(triangles), dtype=STL_ROW)
    rows["normal"] = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    rows["corners"] = corners
    header = b"vpframe swept volume, millimetres".ljust(80)
    path.write_bytes(header + np.uint32(len(triangles)).astype("<u4").tobytes() + rows.tobytes())
    return path
