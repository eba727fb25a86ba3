"""Slow and obviously right: meshes for tests, and the distance of triangles by numpy over all features."""

import itertools

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import SurfaceMesh

Array = NDArray[np.float64]


def box(x: float, y: float, z: float, cells: int = 1, name: str = "box") -> SurfaceMesh:
    """A box centred at the origin; surfaces 0 … 5 face -x, +x, -y, +y, -z, +z; `cells`² squares a face."""
    half = np.array([x, y, z]) / 2
    corners, surface = [], []
    s = np.linspace(-1.0, 1.0, cells + 1)
    for axis in range(3):
        for sign in (-1.0, 1.0):
            e, f = ((axis + 1) % 3, (axis + 2) % 3) if sign > 0 else ((axis + 2) % 3, (axis + 1) % 3)
            for i in range(cells):
                for j in range(cells):
                    square = np.full((4, 3), sign)
                    square[:, e] = s[[i, i + 1, i + 1, i]]
                    square[:, f] = s[[j, j, j + 1, j + 1]]
                    corners += [square[[0, 1, 2]], square[[0, 2, 3]]]
                    surface += [2 * axis + (sign > 0)] * 2
    return welded(np.array(corners) * half, np.array(surface), name)


def welded(corners: Array, surface: NDArray[np.int_], name: str) -> SurfaceMesh:
    """A mesh from (m, 3, 3) corners, corners of equal coordinates made one vertex."""
    vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return SurfaceMesh(vertices, index.reshape(-1, 3), surface, name=name)


def turned(profile: list[tuple[float, float]], sectors: int, name: str = "turned") -> SurfaceMesh:
    """The surface of revolution of (z, r) corners about z, one surface a segment; outside on the left of the walk."""
    angle = 2 * np.pi * np.arange(sectors) / sectors
    rings = [np.stack([r * np.cos(angle), r * np.sin(angle), np.full(sectors, z)], axis=1) for z, r in profile]
    corners, surface = [], []
    for k, (lower, upper) in enumerate(itertools.pairwise(rings)):
        for i in range(sectors):
            j = (i + 1) % sectors
            for triangle in ((lower[i], lower[j], upper[j]), (lower[i], upper[j], upper[i])):
                if len(np.unique(triangle, axis=0)) == 3:
                    corners.append(np.array(triangle))
                    surface.append(k)
    return welded(np.round(corners, 12), np.array(surface), name)


def sphere(radius: float, sectors: int = 24) -> SurfaceMesh:
    """A sphere as one surface, its poles on the z axis; all vertices on the true sphere."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, sectors // 2 + 1)
    mesh = turned(
        [(radius * np.sin(a), abs(radius * np.cos(a)) if abs(np.cos(a)) > 1e-9 else 0.0) for a in angle], sectors
    )
    return SurfaceMesh(mesh.vertices, mesh.triangles, np.zeros(mesh.n_triangles, int), name="sphere")


def with_slivers(rng: np.random.Generator, off: float) -> tuple[SurfaceMesh, np.ndarray]:
    """A box of 1, 0.8 and 0.6 and its rotation; its sides meet by slivers, as faces that are meshed one by one do.

    The points of the slivers lie within `off` of the edge that they are along; some are turned over.
    """
    rotation = pin.exp3(rng.normal(size=3))
    mesh = box(1.0, 0.8, 0.6)
    vertices, triangles, surface = list(mesh.vertices), [], []
    for (a, b, c), s in zip(mesh.triangles.tolist(), mesh.surface_of_triangle.tolist(), strict=True):
        chain = [a, b]
        if s in (0, 3, 5):
            for u in np.sort(rng.uniform(0.02, 0.98, 5)):
                away = rng.uniform(-off, off, 3)
                chain.insert(-1, len(vertices))
                vertices.append(mesh.vertices[a] + u * (mesh.vertices[b] - mesh.vertices[a]) + away)
        fan = [(a, chain[k + 1], chain[k]) for k in range(1, len(chain) - 1)]  # back to the straight edge
        own = [*((p, q, c) for p, q in itertools.pairwise(chain)), *fan]
        triangles += own
        surface += [s] * len(own)
    return SurfaceMesh(np.array(vertices) @ rotation.T, triangles, surface, name="slivers"), rotation


def random_soup(rng: np.random.Generator, triangles: int, surfaces: int) -> SurfaceMesh:
    """Unconnected random triangles dealt out to surfaces."""
    corners = rng.normal(size=(triangles, 1, 3)) + 0.3 * rng.normal(size=(triangles, 3, 3))
    surface = np.arange(triangles) % surfaces
    return SurfaceMesh(corners.reshape(-1, 3), np.arange(3 * triangles).reshape(-1, 3), surface, name="soup")


def _point_segment(p: Array, a: Array, b: Array) -> Array:
    u = b - a
    length = (u * u).sum(axis=-1)
    s = np.clip(((p - a) * u).sum(axis=-1) / np.where(length > 0, length, 1.0), 0.0, 1.0)
    return np.linalg.norm(p - a - s[..., None] * u, axis=-1)


def _point_triangle(p: Array, t: Array) -> Array:
    a, b, c = t[..., 0, :], t[..., 1, :], t[..., 2, :]
    out = np.minimum(np.minimum(_point_segment(p, a, b), _point_segment(p, b, c)), _point_segment(p, c, a))
    n = np.cross(b - a, c - a)
    nn = (n * n).sum(-1)
    safe = np.where(nn > 0, nn, 1.0)
    h = (n * (p - a)).sum(-1)
    foot = p - (h / safe)[..., None] * n
    inside = nn > 0
    for e, f in ((a, b), (b, c), (c, a)):
        inside &= (np.cross(f - e, foot - e) * n).sum(-1) >= 0
    return np.where(inside, np.minimum(out, np.linalg.norm(p - foot, axis=-1)), out)


def _segment_segment(p: Array, q: Array, a: Array, b: Array) -> Array:
    out = np.minimum(
        np.minimum(_point_segment(p, a, b), _point_segment(q, a, b)),
        np.minimum(_point_segment(a, p, q), _point_segment(b, p, q)),
    )
    u, v, w = q - p, b - a, a - p
    n = np.cross(u, v)
    nn = (n * n).sum(-1)
    safe = np.where(nn > 0, nn, 1.0)
    s, t = (np.cross(w, v) * n).sum(-1) / safe, (np.cross(w, u) * n).sum(-1) / safe
    inside = (nn > 0) & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    apart = np.linalg.norm(p + s[..., None] * u - a - t[..., None] * v, axis=-1)
    return np.where(inside, np.minimum(out, apart), out)


def _crosses(p: Array, q: Array, t: Array) -> NDArray[np.bool_]:
    a, b, c = t[..., 0, :], t[..., 1, :], t[..., 2, :]
    n = np.cross(b - a, c - a)
    hp, hq = (n * (p - a)).sum(-1), (n * (q - a)).sum(-1)
    span = hp - hq
    f = p + (hp / np.where(span != 0, span, 1.0))[..., None] * (q - p)
    inside = np.ones(hp.shape, bool)
    for e, g in ((a, b), (b, c), (c, a)):
        inside &= (np.cross(g - e, f - e) * n).sum(-1) >= 0
    return (span != 0) & (hp * hq <= 0) & inside & ((n * n).sum(-1) > 0)


def point_distances(points: Array, triangles: Array) -> Array:
    """(n, m) distances of points (n, 3) and triangles (m, 3, 3)."""
    shape = (len(points), len(triangles), 3)
    return _point_triangle(np.broadcast_to(points[:, None], shape), np.broadcast_to(triangles[None], (*shape, 3)))


def triangle_distances(a: Array, b: Array, crossing: bool = True) -> Array:
    """(n, m) distances of triangles a (n, 3, 3) and b (m, 3, 3); `crossing`: 0 where an edge pierces the other.

    In extended precision, so that needles do not spoil the reference.
    """
    ta, tb = a.astype(np.longdouble)[:, None], b.astype(np.longdouble)[None]
    shape = np.broadcast_shapes(ta.shape, tb.shape)
    ta, tb = np.broadcast_to(ta, shape), np.broadcast_to(tb, shape)
    out = np.full(shape[:2], np.inf, np.longdouble)
    for i in range(3):
        out = np.minimum(out, _point_triangle(ta[:, :, i], tb))
        out = np.minimum(out, _point_triangle(tb[:, :, i], ta))
        for j in range(3):
            segments = ta[:, :, i], ta[:, :, (i + 1) % 3], tb[:, :, j], tb[:, :, (j + 1) % 3]
            out = np.minimum(out, _segment_segment(*segments))
    if crossing:
        for i in range(3):
            out[_crosses(ta[:, :, i], ta[:, :, (i + 1) % 3], tb)] = 0.0
            out[_crosses(tb[:, :, i], tb[:, :, (i + 1) % 3], ta)] = 0.0
    return out.astype(np.float64)


def signed_distances(a: Array, b: Array) -> Array:
    """(n, m) distances of triangles a (n, 3, 3) and b (m, 3, 3); where they meet, minus the shortest way to part them.

    That is the least overlap over the normals of both and the products of their edges.
    """
    distance = triangle_distances(a, b)
    shape = (*distance.shape, 3, 3)
    ta, tb = np.broadcast_to(a[:, None], shape), np.broadcast_to(b[None], shape)
    edges_a, edges_b = np.roll(ta, -1, axis=2) - ta, np.roll(tb, -1, axis=2) - tb
    axes = [np.cross(edges[:, :, 0], edges[:, :, 1]) for edges in (edges_a, edges_b)]
    axes += [np.cross(edges_a[:, :, i], edges_b[:, :, j]) for i in range(3) for j in range(3)]
    parted = np.full(distance.shape, -np.inf)
    for axis in axes:
        length = np.linalg.norm(axis, axis=-1)
        n = axis / np.where(length > 0.0, length, 1.0)[..., None]
        along_a, along_b = np.einsum("nmd,nmkd->nmk", n, ta), np.einsum("nmd,nmkd->nmk", n, tb)
        gap = np.maximum(along_b.min(-1) - along_a.max(-1), along_a.min(-1) - along_b.max(-1))
        parted = np.where(length > 0.0, np.maximum(parted, gap), parted)
    return np.where(distance > 0.0, distance, np.where(np.isfinite(parted), np.minimum(parted, 0.0), 0.0))


def without_lid() -> SurfaceMesh:
    mesh = box(1.0, 1.0, 1.0)
    keep = mesh.surface_of_triangle != 5
    return SurfaceMesh(mesh.vertices, mesh.triangles[keep], mesh.surface_of_triangle[keep], name="open box")


def hollow(outer: float, inner: float) -> SurfaceMesh:
    a, b = box(outer, outer, outer), box(inner, inner, inner)
    triangles = np.concatenate([a.triangles, b.triangles[:, ::-1] + len(a.vertices)])
    surface = np.concatenate([a.surface_of_triangle, b.surface_of_triangle + 6])
    return SurfaceMesh(np.concatenate([a.vertices, b.vertices]), triangles, surface, name="hollow box")
