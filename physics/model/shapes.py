"""Contact shape of a mesh: welded vertices, convex edges with their wings, rim circles, analytic surfaces.

A shape is made once a mesh, at its first near contact; all shapes of a world lie one after the other in flat arrays.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import accumulate
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from collision import SurfaceMesh
from collision.numeric.kernel import kernel
from collision.numeric.vectors import along, cross, dot, sub
from constraints.geometry.surfaces import Cylinder, Geometry, Sphere
from physics.model.body import weld

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

FACETED, SPHERE, CYLINDER = 0, 1, 2


class ContactShape(NamedTuple):
    """One mesh in its own frame. `*_start` arrays are offsets: items of i are start[i] … start[i+1]-1."""

    vertices: Array
    """(n, 3) welded, m"""
    neighbour_start: Ints
    neighbours: Ints
    """vertices joined to a vertex by an edge"""
    triangles: Ints
    """(m, 3), those of surface 0 first"""
    normals: Array
    """(m, 3) unit, outward; zero for a degenerate triangle"""
    triangle_start: Ints
    vertex_start: Ints
    surface_vertices: Ints
    edge_start: Ints
    surface_edges: Ints
    edges: Ints
    """(e, 2) vertices of the convex edges"""
    wings: Array
    """(e, 2, 3) unit, in the plane of each of the edge's triangles, from the edge into the triangle"""
    edge_surfaces: Ints
    """(e, 2) the surfaces of its two triangles (a shape's own numbers)"""
    edge_sense: Ints
    """(e,) bit 1: borders a convex analytic surface, bit 2: a concave one"""
    edge_bend: Array
    """(e, 2) sine of the angle at which a curve of facets continues at either end; 0 at a corner"""
    circle_start: Ints
    circles: Array
    """(c, 8) rims of cylinders: centre, axis, radius, number; by surface (a rim is listed for both it parts)"""
    vertex_rim: Ints
    """(n,) row in `circles` of a rim that the vertex lies on, or -1"""
    vertex_bore: Ints
    """(n,) analytic bore (surface) that the vertex lies on, or -1"""
    kinds: Ints
    """(k,) FACETED, SPHERE or CYLINDER, by surface"""
    analytic: Array
    """(k, 11) centre or origin, axis, radius, sense (+1 convex, -1 concave); of a cylinder that goes all the way round
    also its least and greatest height along the axis, and 1"""
    boxes: Array
    """(k, 6) lower and upper corner of each surface"""
    wall: float
    """m: least thickness of the material between faces of opposite normals"""


def make_shape(mesh: SurfaceMesh, geometries: Mapping[int, Geometry] | None = None, flush: float = 0.0) -> ContactShape:
    """The shape of `mesh`; `geometries` says which surfaces are known analytically (mesh frame).

    flush: m; faces nearer than this are flush (touching shells of one part), with no wall between them.

    Spheres and cylinders are then judged on their analytic geometry wherever they meet; all else on its triangles.
    """
    geometries = {} if geometries is None else geometries
    vertices, welded = weld(mesh)
    triangles = welded[mesh.order]
    surface_of = mesh.surface_of_triangle[mesh.order].astype(np.int64)
    k = mesh.n_surfaces
    product = np.cross(
        vertices[triangles[:, 1]] - vertices[triangles[:, 0]], vertices[triangles[:, 2]] - vertices[triangles[:, 0]]
    )
    double_area = np.linalg.norm(product, axis=1)
    normals = np.divide(product, double_area[:, None], out=np.zeros_like(product), where=double_area[:, None] > 0.0)
    kinds, analytic = _analytic(vertices, triangles, normals, double_area, surface_of, k, geometries)
    pairs = np.unique(np.stack([np.repeat(surface_of, 3), triangles.reshape(-1)], axis=1), axis=0)
    boxes = np.empty((k, 6))
    vertex_start = np.searchsorted(pairs[:, 0], np.arange(k + 1))
    for s in range(k):
        points = vertices[pairs[vertex_start[s] : vertex_start[s + 1], 1]]
        boxes[s, :3], boxes[s, 3:] = points.min(axis=0), points.max(axis=0)
    edges, wings, of_edge, sense, rims = _edges(vertices, triangles, normals, surface_of, kinds, analytic)
    order = np.lexsort((np.tile(np.arange(len(edges)), 2), of_edge.T.reshape(-1)))
    listed = np.stack([of_edge.T.reshape(-1)[order], np.tile(np.arange(len(edges)), 2)[order]], axis=1)
    listed = np.unique(listed, axis=0) if len(listed) else listed.reshape(0, 2)
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    both = np.unique(np.concatenate([sides, sides[:, ::-1]]), axis=0)
    both = both[both[:, 0] != both[:, 1]]
    rims = rims[np.argsort(rims[:, 7], kind="stable")]
    return ContactShape(
        vertices=np.ascontiguousarray(vertices),
        neighbour_start=np.searchsorted(both[:, 0], np.arange(len(vertices) + 1)).astype(np.int64),
        neighbours=np.ascontiguousarray(both[:, 1]),
        triangles=np.ascontiguousarray(triangles),
        normals=normals,
        triangle_start=mesh.surface_start.astype(np.int64),
        vertex_start=vertex_start.astype(np.int64),
        surface_vertices=np.ascontiguousarray(pairs[:, 1]),
        edge_start=np.searchsorted(listed[:, 0], np.arange(k + 1)).astype(np.int64),
        surface_edges=np.ascontiguousarray(listed[:, 1]),
        edges=edges,
        wings=wings,
        edge_surfaces=np.ascontiguousarray(of_edge),
        edge_sense=sense,
        edge_bend=_bends(vertices, edges, of_edge),
        circle_start=np.searchsorted(rims[:, 7], np.arange(k + 1)).astype(np.int64),
        circles=np.ascontiguousarray(rims[:, [0, 1, 2, 3, 4, 5, 6, 8]]),
        vertex_rim=_vertex_rim(vertices, rims),
        vertex_bore=_vertex_bore(len(vertices), kinds, analytic, pairs),
        kinds=kinds,
        analytic=analytic,
        boxes=boxes,
        wall=_wall(vertices, triangles, normals, double_area, flush),
    )


SAMPLES = 256
"""triangles, the largest first, behind which `_wall` looks for the other side"""


@kernel
def _behind(points, directions, vertices, triangles, normals, beyond):
    """Least distance along a ray, above `beyond` (m), to a triangle that looks the same way (within 25°)."""
    least = np.inf
    for i in range(len(points)):
        p, d = points[i], directions[i]
        for t in range(len(triangles)):
            n = normals[t]
            cosine = dot(n, d)
            if cosine < 0.9:
                continue
            a, b, c = vertices[triangles[t, 0]], vertices[triangles[t, 1]], vertices[triangles[t, 2]]
            depth = dot(n, sub(a, p)) / cosine
            if depth <= beyond or depth >= least:
                continue
            q = along(p, depth, d)
            inside = True
            for u, v in ((a, b), (b, c), (c, a)):
                inside = inside and dot(n, cross(sub(v, u), sub(q, u))) >= 0.0
            if inside:
                least = depth
    return least


def _wall(vertices: Array, triangles: Ints, normals: Array, double_area: Array, flush: float) -> float:
    largest = np.sort(np.argsort(-double_area, kind="stable")[:SAMPLES])
    largest = largest[double_area[largest] > 0.0]
    middles = vertices[triangles[largest]].mean(axis=1)
    return float(_behind(middles, -normals[largest], vertices, triangles, normals, flush))


def _vertex_bore(n: int, kinds: Ints, analytic: Array, on: Ints) -> Ints:
    """(n,) the bore (surface) that each vertex lies on, or -1; on: (k, 2) surfaces and their vertices."""
    bore = np.full(n, -1, np.int64)
    mine = on[(kinds[on[:, 0]] == CYLINDER) & (analytic[on[:, 0], 7] < 0.0)]
    bore[mine[:, 1]] = mine[:, 0]
    return bore


def _vertex_rim(vertices: Array, rims: Array) -> Ints:
    on = np.full(len(vertices), -1, np.int64)
    for row, rim in enumerate(rims):
        q = vertices - rim[:3]
        height = q @ rim[3:6]
        radius = np.linalg.norm(q - height[:, None] * rim[3:6], axis=1)
        on[np.hypot(height, radius - rim[6]) < 1e-6 * rim[6]] = row
    return on


def _analytic(vertices, triangles, normals, double_area, surface_of, k, geometries):
    kinds = np.zeros(k, np.int64)
    analytic = np.zeros((k, 11))
    for s, geometry in geometries.items():
        mine = surface_of == s
        middle = vertices[triangles[mine]].mean(axis=1)
        if isinstance(geometry, Sphere):
            kinds[s] = SPHERE
            analytic[s, :3], analytic[s, 6] = geometry.center, geometry.radius
        elif isinstance(geometry, Cylinder):
            kinds[s] = CYLINDER
            analytic[s, :3], analytic[s, 3:6], analytic[s, 6] = geometry.origin, geometry.axis, geometry.radius
        else:
            continue
        outward = np.einsum("ij,ij,i->", geometry.normals(middle), normals[mine], double_area[mine])
        analytic[s, 7] = 1.0 if outward > 0.0 else -1.0
        if kinds[s] == CYLINDER:
            heights = (vertices[triangles[mine]].reshape(-1, 3) - analytic[s, :3]) @ analytic[s, 3:6]
            low, high = heights.min(), heights.max()
            whole = 2.0 * np.pi * analytic[s, 6] * (high - low)
            if 0.5 * double_area[mine].sum() > 0.98 * whole:
                analytic[s, 8:] = low, high, 1.0
    return kinds, analytic


def _edges(vertices, triangles, normals, surface_of, kinds, analytic):
    """Convex edges (e, 2), wings (e, 2, 3), their surfaces (e, 2), senses (e,), and rims (c, 8: circle, surface)."""
    solid = np.flatnonzero(normals.any(axis=1))
    t = triangles[solid]
    a = np.concatenate([t[:, 0], t[:, 1], t[:, 2]])
    b = np.concatenate([t[:, 1], t[:, 2], t[:, 0]])
    opposite = np.concatenate([t[:, 2], t[:, 0], t[:, 1]])
    owner = np.tile(solid, 3)
    n = len(vertices)
    code = np.minimum(a, b) * n + np.maximum(a, b)
    order = np.argsort(code, kind="stable")
    sorted_code = code[order]
    first = np.flatnonzero(np.diff(sorted_code, prepend=-1))
    length = np.diff(np.append(first, len(sorted_code)))
    first = first[length == 2]  # an edge of an open or non-manifold mesh has no inside to be convex about
    one, two = order[first], order[first + 1]
    edges = np.stack([a[one], b[one]], axis=1)
    along = vertices[edges[:, 1]] - vertices[edges[:, 0]]
    size = np.linalg.norm(along, axis=1)
    along = np.divide(along, size[:, None], out=np.zeros_like(along), where=size[:, None] > 0)
    wings = np.empty((len(edges), 2, 3))
    for side, which in enumerate((one, two)):
        w = vertices[opposite[which]] - vertices[edges[:, 0]]
        w = w - np.einsum("ij,ij->i", w, along)[:, None] * along
        wings[:, side] = w / np.maximum(np.linalg.norm(w, axis=1), 1e-300)[:, None]
    bend = np.einsum("ij,ij->i", wings[:, 0], normals[owner[two]])
    surfaces = np.stack([surface_of[owner[one]], surface_of[owner[two]]], axis=1)
    sides = np.stack([normals[owner[one]], normals[owner[two]]], axis=1)
    rims = _rims(vertices, edges, surfaces, sides, kinds, analytic)
    convex = (bend < -1e-6) & (size > 0)
    senses = np.zeros(len(edges), np.int64)
    for side in (0, 1):
        s = surfaces[:, side]
        senses |= np.where(analytic[s, 7] > 0, 1, 0) | np.where(analytic[s, 7] < 0, 2, 0)
    return (
        np.ascontiguousarray(edges[convex]),
        np.ascontiguousarray(wings[convex]),
        surfaces[convex],
        senses[convex],
        rims,
    )


SMOOTH = 0.5
"""1: sine of the angle between edges below which they are one curve of facets, and no corner"""


def _bends(vertices: Array, edges: Ints, surfaces: Ints) -> Array:
    """`ContactShape.edge_bend`: where just two edges between the same two surfaces meet, and hardly turn."""
    out = np.zeros((len(edges), 2))
    if len(edges) == 0:
        return out
    along = vertices[edges[:, 1]] - vertices[edges[:, 0]]
    along /= np.linalg.norm(along, axis=1)[:, None]
    ways = np.stack([along, -along], axis=1).reshape(-1, 3)  # from each end into the edge
    between = np.repeat(np.sort(surfaces, axis=1), 2, axis=0)
    ends = np.column_stack([edges.reshape(-1), between])
    _, group, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(group.reshape(-1), kind="stable")
    first = np.flatnonzero(count == 2)
    one = order[(np.cumsum(count) - count)[first]]
    two = order[(np.cumsum(count) - count)[first] + 1]
    sine = np.linalg.norm(np.cross(ways[one], ways[two]), axis=1)
    sine[((ways[one] * ways[two]).sum(axis=1) > 0.0) | (sine > SMOOTH)] = 0.0
    out.reshape(-1)[one] = out.reshape(-1)[two] = sine
    return out


def _rims(vertices, edges, surfaces, normals, kinds, analytic):
    """Circles where a convex cylinder ends in a plane face square to its axis; listed for both surfaces (c, 9).

    normals: (e, 2, 3) of the triangles on both sides of each edge.
    """
    rims: list[list[float]] = []
    for s in np.flatnonzero((kinds == CYLINDER) & (analytic[:, 7] > 0)):
        origin, axis, radius = analytic[s, :3], analytic[s, 3:6], analytic[s, 6]
        mine = np.flatnonzero((surfaces[:, 0] == s) ^ (surfaces[:, 1] == s))
        other = np.where(surfaces[mine, 0] == s, surfaces[mine, 1], surfaces[mine, 0])
        far = np.where((surfaces[mine, 0] == s)[:, None], normals[mine, 1], normals[mine, 0])
        for o in np.unique(other):
            rows = mine[other == o]
            square = np.abs(np.abs(far[other == o] @ axis) - 1.0) < 1e-9
            heights = (vertices[edges[rows].reshape(-1)] - origin) @ axis
            whole = np.isclose(
                np.linalg.norm(vertices[edges[rows, 1]] - vertices[edges[rows, 0]], axis=1).sum(),
                2 * np.pi * radius,
                rtol=0.1,
            )
            if square.all() and whole and np.ptp(heights) < 1e-6 * radius:
                center = origin + heights.mean() * axis
                number = len(rims) // 2
                for of in (int(s), int(o)):
                    rims.append([*center, *axis, radius, of, number])
    return np.array(rims).reshape(-1, 9)


class Shapes(NamedTuple):
    """All shapes of a world, one after the other; `first_*` (shapes, …) say where each begins."""

    vertices: Array
    neighbour_start: Ints
    neighbours: Ints
    triangles: Ints
    normals: Array
    triangle_start: Ints
    vertex_start: Ints
    surface_vertices: Ints
    edge_start: Ints
    surface_edges: Ints
    edges: Ints
    wings: Array
    edge_surfaces: Ints
    edge_sense: Ints
    edge_bend: Array
    circle_start: Ints
    circles: Array
    vertex_rim: Ints
    vertex_bore: Ints
    kinds: Ints
    analytic: Array
    boxes: Array
    first_surface: Ints
    """(shapes,) global number of a shape's surface 0; offsets have one row more a shape, so there surface s of shape
    i is row `first_surface[i] + s + i` (and vertex v of shape i is row v + i of `neighbour_start`)"""


COUNTED = {
    "neighbour_start": "neighbours",
    "neighbours": "vertices",
    "triangles": "vertices",
    "triangle_start": "triangles",
    "vertex_start": "surface_vertices",
    "surface_vertices": "vertices",
    "edge_start": "surface_edges",
    "surface_edges": "edges",
    "edges": "vertices",
    "circle_start": "circles",
    "vertex_rim": "circles",
}
"""arrays that hold indices, and the array into which: in `Shapes` they grow by its rows of the shapes before"""


def _offsets(shapes: list[ContactShape], name: str) -> list[int]:
    """Where each shape's rows of an array begin once the shapes lie one after the other."""
    return [0, *accumulate(len(getattr(shape, name)) for shape in shapes[:-1])]


def pack(shapes: list[ContactShape]) -> Shapes:
    """Lay shapes one after the other; indices become global, and -1, for none, stays."""
    packed = {}
    for name in Shapes._fields[:-1]:
        parts = [getattr(shape, name) for shape in shapes]
        if name in COUNTED:
            parts = [
                np.where(part >= 0, part + base, part)
                for part, base in zip(parts, _offsets(shapes, COUNTED[name]), strict=True)
            ]
        packed[name] = np.ascontiguousarray(np.concatenate(parts))
    return Shapes(**packed, first_surface=np.array(_offsets(shapes, "kinds"), np.int64))
