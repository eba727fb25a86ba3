"""Meshes and rooms that the physics tests and the benchmark share."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from collision import CollisionManager, SurfaceMesh

_QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def box_mesh(x: float, y: float, z: float, name: str = "box") -> SurfaceMesh:
    """A box about the origin, a surface a side."""
    corners = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (-0.5, 0.5)]) * [x, y, z]
    triangles = [t for a, b, c, d in _QUADS for t in ((a, b, c), (a, c, d))]
    return SurfaceMesh(corners, triangles, np.repeat(np.arange(6), 2), name)


def ball_mesh(radius: float, n: int = 16) -> SurfaceMesh:
    """A ball about the origin as one surface, vertices on the sphere."""
    rows = [[0.0, 0.0, radius]]
    for i in range(1, n):
        a = np.pi * i / n
        for k in range(2 * n):
            b = np.pi * k / n
            rows.append([radius * np.sin(a) * np.cos(b), radius * np.sin(a) * np.sin(b), radius * np.cos(a)])
    rows.append([0.0, 0.0, -radius])
    m, last = 2 * n, len(rows) - 1
    triangles = []
    for k in range(m):
        nxt = (k + 1) % m
        triangles.append((0, 1 + k, 1 + nxt))
        for i in range(n - 2):
            a, b = 1 + i * m + k, 1 + i * m + nxt
            triangles += [(a, a + m, b), (b, a + m, b + m)]
        base = 1 + (n - 2) * m
        triangles.append((base + k, last, base + nxt))
    return SurfaceMesh(np.array(rows), triangles, None, "ball")


def cylinder_mesh(radius: float, length: float, n: int = 64) -> SurfaceMesh:
    """A solid cylinder along z about the origin: surface 0 the side, 1 the top, 2 the bottom."""
    a = 2 * np.pi * np.arange(n) / n
    ring = np.stack([radius * np.cos(a), radius * np.sin(a)], axis=1)
    top = np.column_stack([ring, np.full(n, length / 2)])
    bottom = np.column_stack([ring, np.full(n, -length / 2)])
    vertices = np.vstack([top, bottom, [[0, 0, length / 2], [0, 0, -length / 2]]])
    triangles, surfaces = [], []
    for k in range(n):
        nxt = (k + 1) % n
        triangles += [(k, n + k, nxt), (nxt, n + k, n + nxt), (2 * n, k, nxt), (2 * n + 1, n + nxt, n + k)]
        surfaces += [0, 0, 1, 2]
    return SurfaceMesh(vertices, triangles, surfaces, "cylinder")


def plate_with_hole(size: float, thickness: float, radius: float, n: int = 64) -> SurfaceMesh:
    """A square plate about the origin with a bore along z: surface 0 the bore, 1 the top, 2 the bottom, 3-6 sides."""
    a = 2 * np.pi * np.arange(n) / n
    inner = np.stack([np.cos(a), np.sin(a)], axis=1)
    outer = 0.5 * size * inner / np.abs(inner).max(axis=1)[:, None]
    inner = radius * inner
    h = thickness / 2
    vertices = np.vstack(
        [
            np.column_stack([inner, np.full(n, h)]),
            np.column_stack([inner, np.full(n, -h)]),
            np.column_stack([outer, np.full(n, h)]),
            np.column_stack([outer, np.full(n, -h)]),
        ]
    )
    triangles, surfaces = [], []
    for k in range(n):
        m = (k + 1) % n
        it, ib, ot, ob = k, n + k, 2 * n + k, 3 * n + k
        jt, jb, pt, pb = m, n + m, 2 * n + m, 3 * n + m
        triangles += [(it, jt, ib), (jt, jb, ib), (it, ot, jt), (jt, ot, pt), (ib, jb, ob), (jb, pb, ob)]
        triangles += [(ot, ob, pt), (pt, ob, pb)]
        middle = 0.5 * (outer[k] + outer[m])
        side = 3 + int(np.argmax([middle[0], middle[1], -middle[0], -middle[1]]))
        surfaces += [0, 0, 1, 1, 2, 2, side, side]
    return SurfaceMesh(vertices, triangles, surfaces, "plate")


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0, turn: tuple[float, float, float] = (0, 0, 0)) -> pin.SE3:
    """A pose by position and rotation vector."""
    return pin.SE3(pin.exp3(np.array(turn, dtype=float)), np.array([x, y, z], dtype=float))


def room(size: float = 4.0, thickness: float = 0.2) -> tuple[CollisionManager, int]:
    """A collision manager with a floor whose top is z = 0."""
    manager = CollisionManager()
    floor = manager.add(box_mesh(size, size, thickness, "floor"), at(z=-thickness / 2), movable=False)
    return manager, floor


def tube_mesh(inner: float, outer: float, height: float, n: int = 48, phase: float = 0.0) -> SurfaceMesh:
    """A tube along z about the origin: surface 0 the bore, 1 the outside, 2 the top, 3 the bottom."""
    a = 2 * np.pi * np.arange(n) / n + phase
    ring = np.stack([np.cos(a), np.sin(a)], axis=1)
    corners = [(r, z * height / 2) for r in (inner, outer) for z in (1, -1)]
    vertices = np.vstack([np.column_stack([r * ring, np.full(n, z)]) for r, z in corners])
    triangles, surfaces = [], []
    for k in range(n):
        m = (k + 1) % n
        it, ib, ot, ob = k, n + k, 2 * n + k, 3 * n + k
        jt, jb, pt, pb = m, n + m, 2 * n + m, 3 * n + m
        triangles += [(it, jt, ib), (jt, jb, ib), (ot, ob, pt), (pt, ob, pb)]
        triangles += [(it, ot, jt), (jt, ot, pt), (ib, jb, ob), (jb, pb, ob)]
        surfaces += [0, 0, 1, 1, 2, 2, 3, 3]
    return SurfaceMesh(vertices, triangles, surfaces, "tube")
