"""Kernels of segmentation."""

import numpy as np
import trimesh

from vpframe.importers.region_growing import neighbours


def test_neighbours_against_brute_force():
    mesh = trimesh.creation.icosphere(subdivisions=1)
    triangles = np.vstack([mesh.faces[:-3], [mesh.faces[0]]]).astype(np.int32)  # a hole, and an edge where three meet
    found = neighbours(triangles)
    for t, k in np.ndindex(found.shape):
        edge = {triangles[t, k], triangles[t, (k + 1) % 3]}
        others = [u for u in range(len(triangles)) if u != t and edge <= set(triangles[u])]
        assert found[t, k] == (others[0] if len(others) == 1 else -1)
