"""Tessellated solids and mesh files."""

import numpy as np
import trimesh

import vpframe as vp
from constraints.recognition.fits import KINDS, FitError, fit_kind
from vpframe.importers.region_growing import neighbours
from vpframe.scene import modelling as m


def overlap(a: np.ndarray, b: np.ndarray, area: np.ndarray) -> float:
    return float(area[a & b].sum() / area[a | b].sum())


def soup(shape: vp.Shape, scale: float = 1.0) -> trimesh.Trimesh:
    """The shape's mesh as an STL has it: no vertex shared."""
    corners = shape.mesh.vertices[shape.mesh.triangles].reshape(-1, 3) * scale
    return trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)


def plate() -> m.Solid:
    """A rounded block with a bore, a countersink, a boss whose foot is filleted, and a dimple."""
    solid = m.box(0.06, 0.04, 0.01).filleted(0.004, lambda p: abs(p[2] - 0.005) < 1e-6)
    solid += m.cylinder(0.006, 0.022).translated(0.044, 0.02)
    solid = solid.filleted(0.002, lambda p: abs(p[2] - 0.01) < 1e-6 and np.hypot(p[0] - 0.044, p[1] - 0.02) < 0.007)
    solid -= m.cylinder(0.004, 0.02).translated(0.015, 0.02)
    solid -= m.cone(0.002, 0.006, 0.004).translated(0.015, 0.02, 0.006 + 1e-9)
    return solid - m.sphere(0.003).translated(0.03, 0.01, 0.01)


def merged(vertices: np.ndarray, triangles: np.ndarray, label: np.ndarray, kinds: list[str]) -> np.ndarray:
    """Labels after neighbours of one analytic kind that one surface fits have been given the same."""
    across = neighbours(triangles)
    t, k = np.nonzero(across >= 0)
    pairs = np.unique(np.column_stack([label[t], label[across[t, k]]]), axis=0)
    name = np.arange(len(kinds))
    for a, b in pairs[pairs[:, 0] < pairs[:, 1]]:
        if kinds[a] != kinds[b] or kinds[a] not in KINDS:
            continue
        both = np.flatnonzero((label == a) | (label == b))
        corners = vertices[triangles[both]]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        try:
            fit = fit_kind(kinds[a], np.unique(corners.reshape(-1, 3), axis=0), corners.mean(axis=1), normals)
        except FitError:
            continue
        if fit.residual < 2e-6:
            name[name == name[b]] = name[a]
    return name[label]
