"""`SurfaceContact`: what collision tells everyone else about two surfaces."""

from __future__ import annotations

import numpy as np

CONTACT_DTYPE = np.dtype(
    [
        ("object_a", np.int32),
        ("surface_a", np.int32),
        ("object_b", np.int32),
        ("surface_b", np.int32),
        ("distance", np.float64),  # m; 0 where triangles intersect
        ("point_a", np.float64, 3),  # witness on surface a, world frame, m
        ("point_b", np.float64, 3),  # witness on surface b, world frame, m
        ("triangle_a", np.int32),
        ("triangle_b", np.int32),
    ]
)
"""One row a surface pair, `object_a < object_b`, rows sorted by the four ids."""
