"""`SweptVolume`: where a part has been, as a mesh, and what it came too near to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


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
