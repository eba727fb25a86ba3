"""Meshes the tests use, made of a few numbers."""

import numpy as np
import pinocchio as pin

from collision import SurfaceMesh


def at(x: float, y: float = 0.0, z: float = 0.0) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([x, y, z]))


QUADS = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))


def box(size: tuple[float, float, float] = (1.0, 1.0, 1.0), cells: int = 1, name: str = "box") -> SurfaceMesh:
    """A box about the origin, 6 surfaces (-z, +z, -y, +y, -x, +x) of `cells`² quads each."""
    corner = np.array([[x, y, z] for z in (-0.5, 0.5) for y in (-0.5, 0.5) for x in (-0.5, 0.5)]) * size
    vertices: list[np.ndarray] = []
    triangles: list[np.ndarray] = []
    for quad in QUADS:
        a, b, c, d = corner[list(quad)]
        u, v = np.meshgrid(np.linspace(0, 1, cells + 1), np.linspace(0, 1, cells + 1), indexing="ij")
        u, v = u.ravel()[:, None], v.ravel()[:, None]
        i = np.arange((cells + 1) ** 2).reshape(cells + 1, -1) + len(vertices) * (cells + 1) ** 2
        q = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], -1).reshape(-1, 4)
        vertices.append((1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d)
        triangles.append(np.concatenate([q[:, [0, 1, 2]], q[:, [0, 2, 3]]]))
    surface = np.repeat(np.arange(6), 2 * cells**2)
    return SurfaceMesh(np.concatenate(vertices), np.concatenate(triangles), surface, name)


def soup(triangles: int, surfaces: int, seed: int, size: float = 0.3) -> SurfaceMesh:
    """Random triangles in the unit cube, each surface in a region of its own more or less."""
    rng = np.random.default_rng(seed)
    surface = np.sort(np.concatenate([np.arange(surfaces), rng.integers(0, surfaces, triangles - surfaces)]))
    centre = rng.random((surfaces, 3))[surface] + 0.1 * rng.normal(size=(triangles, 3))
    corners = centre[:, None] + size * rng.normal(size=(triangles, 3, 3))
    return SurfaceMesh(corners.reshape(-1, 3), np.arange(3 * triangles).reshape(-1, 3), surface, f"soup {seed}")


def wave(cells: int, surfaces: int, seed: int) -> SurfaceMesh:
    """A wavy sheet over the unit square, cut into `surfaces`² patches."""
    rng = np.random.default_rng(seed)
    x = np.linspace(0, 1, cells + 1)
    x, y = (a.ravel() for a in np.meshgrid(x, x, indexing="ij"))
    phase = rng.random(2) * 6
    z = 0.08 * np.sin(7 * x + phase[0]) * np.cos(5 * y + phase[1])
    i = np.arange((cells + 1) ** 2).reshape(cells + 1, -1)
    q = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], -1).reshape(-1, 4)
    triangles = np.concatenate([q[:, [0, 1, 2]], q[:, [0, 2, 3]]])
    vertices = np.stack([x, y, z], 1)
    cell = np.minimum((vertices[triangles].mean(1)[:, :2] * surfaces).astype(int), surfaces - 1)
    return SurfaceMesh(vertices, triangles, cell[:, 0] * surfaces + cell[:, 1], f"wave {seed}")
