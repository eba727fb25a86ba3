"""`Feature`: one analytic surface of a part, made of the faces that continue one another on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from constraints.geometry import Geometry


@dataclass(frozen=True, eq=False)
class Feature:
    """Faces that lie on one analytic surface and continue one another (two half bores are one feature)."""

    geometry: Geometry
    """in the part's frame; a plane's normal points out of the material"""
    surfaces: tuple[int, ...]
    """indices of the faces, ascending"""
    sense: int
    """+1 convex (material inside: a shaft, a ball), -1 concave (a bore, a socket), +1 for planes"""
    samples: NDArray[np.float64]
    """(n, 3) vertices of the faces, part frame, m: they lie on the true surface and bound its extent"""
    triangles: NDArray[np.int32]
    """(t, 3) the faces' triangles as indices into `samples`: what overlap is measured on"""
    residual: float
    """m: greatest distance of `samples` to `geometry`"""
    area: float
    """m²"""
