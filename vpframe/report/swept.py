"""`SweptVolume`: the volume that a part swept, as a mesh, and its collisions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class SweptVolume:
    """The volume that a part swept, world frame."""

    part: str
    vertices: NDArray[np.float64]
    """(n, 3) m"""
    triangles: NDArray[np.int32]
    """(m, 3)"""
    error: float
    """maximum distance of the mesh from the true volume, m"""
    clashes: tuple[str, ...] = ()
    """parts that the volume collides with"""
