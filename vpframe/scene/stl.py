"""Binary STL files. The format has no unit of length."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vpframe import files

ROW = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def write_stl(
    path: Path, vertices: NDArray[np.float64], triangles: NDArray[np.int32], scale: float = 1.0, header: str = "vpframe"
) -> Path:
    """Write triangles (m, 3) of vertices (n, 3), m, as binary STL in units of 1/`scale` m; return the path."""
    corners = vertices[triangles] * scale
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    rows = np.zeros(len(triangles), dtype=ROW)
    rows["normal"] = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    rows["corners"] = corners
    files.replace(path, header.encode().ljust(80) + np.uint32(len(rows)).astype("<u4").tobytes() + rows.tobytes())
    return path
