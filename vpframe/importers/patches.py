"""Triangulate one B-rep face in its parameters (u, v), between given polygons of its edges.

This replaces the kernel's mesher where that returns nothing or does not end. Lengths are millimetres.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from typing import Any

import manifold3d
import numpy as np
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve2d, BRepAdaptor_Surface
from OCP.BRepTools import BRepTools_WireExplorer
from OCP.GeomAbs import GeomAbs_SurfaceType
from OCP.gp import gp_Pnt, gp_Vec
from OCP.ShapeAnalysis import ShapeAnalysis_Surface
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS, TopoDS_Edge, TopoDS_Face

from vpframe.importers.topology import explored

Array = NDArray[np.float64]
Border = Callable[[TopoDS_Edge], tuple[Array, Array]]
"""returns the curve parameters (n,) and the points (n, 3), mm, of an edge's polygon, in the sense of its curve"""

MOST_SPLITS = 4000
"""points added inside one face: a limit of work that does not depend on the machine"""
TURN = 1.5
"""largest angle between the normals at the ends of an inner edge, in units of the angular deflection"""
SAME = 1e-9
"""difference of parameters that are equal, rad"""
LEAST = 1e-2
"""deviation below which a turn of the normal is ignored, in units of the deflection"""


def patch(face: TopoDS_Face, border: Border, deflection: float, angular: float) -> tuple[Array, NDArray[np.int64]]:
    """Points (n, 3), mm, and triangles (m, 3), wound outwards, of a face whose edges have the polygons of `border`.

    The polygons are kept point for point, so that neighbours with the same polygons stay joined. Cones and cylinders
    between two borders become a strip. Other polygons are triangulated (manifold3d), inner edges are flipped until the
    triangulation is Delaunay in the metric of the surface (Lawson, Software for C1 surface interpolation, 1977), and
    split where they deviate by more than `deflection` (mm) or turn by more than `angular` (rad). Empty if the face has
    no closed border.
    """
    forward = TopoDS.Face(face.Oriented(TopAbs_Orientation.TopAbs_FORWARD))
    surface = BRepAdaptor_Surface(forward)
    loops = _loops(forward, surface, border, deflection, angular)
    if not loops:
        return np.empty((0, 3)), np.empty((0, 3), np.int64)
    areas = [_area(uv) for uv, _ in loops]
    outer = int(np.argmax(np.abs(areas)))
    loops = [
        (uv[::-1], points[::-1]) if (area < 0.0) == (i == outer) else (uv, points)
        for i, ((uv, points), area) in enumerate(zip(loops, areas, strict=True))
    ]
    strip = _strip(surface, loops, deflection)
    if strip is None:
        scale = _scale(surface, np.concatenate([uv for uv, _ in loops]))
        corners = manifold3d.triangulate([uv * scale for uv, _ in loops])
        mesh = _Refined(surface, scale, loops, np.asarray(corners, np.int64))
        mesh.refine(deflection, angular)
    points, triangles = mesh.arrays() if strip is None else (loops[0][1], strip)
    reversed_ = face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED
    return points, triangles[:, [0, 2, 1]] if reversed_ else triangles


def _strip(
    surface: BRepAdaptor_Surface, loops: list[tuple[Array, Array]], deflection: float
) -> NDArray[np.int64] | None:
    """Triangles (m, 3) along the rulings of a cone or cylinder between two borders that run in the sense of u.

    None for other faces, and where a triangle would be turned over or deviate by more than `deflection`.
    """
    kind = surface.GetType()
    if len(loops) > 1 or kind not in (GeomAbs_SurfaceType.GeomAbs_Cone, GeomAbs_SurfaceType.GeomAbs_Cylinder):
        return None
    (uv, points), n = loops[0], len(loops[0][0])
    u, v = uv.T
    first, last = int(np.lexsort((v, u))[0]), int(np.lexsort((v, -u))[0])
    around, end = (first + np.arange(n)) % n, (last - first) % n
    lower, upper = around[: end + 1], np.r_[first, around[end:][::-1]]
    if min(np.diff(u[lower]).min(initial=0.0), np.diff(u[upper]).min()) < -SAME:
        return None
    order = np.argsort(u[np.r_[lower[1:], upper[1:]]], kind="stable")
    below = order < end  # the border on which each step goes on
    i, j = np.cumsum(below), np.cumsum(~below)
    corners = np.column_stack([lower[i - below], np.where(below, lower[i], upper[j]), upper[j - ~below]])
    corners = corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]
    (au, av), (bu, bv), (cu, cv) = (uv[corners[:, k]].T for k in range(3))
    if len(corners) != n - 2 or ((bu - au) * (cv - av) <= (bv - av) * (cu - au)).any():
        return None
    axis = (surface.Cone() if kind == GeomAbs_SurfaceType.GeomAbs_Cone else surface.Cylinder()).Axis()
    away = points - axis.Location().Coord()
    radii = np.linalg.norm(np.cross(away, axis.Direction().Coord()), axis=1)
    a, c = radii[corners[:, 0]], radii[corners[:, 2]]
    off = 0.5 * (a + c - np.sqrt(np.maximum(a * a + c * c + 2.0 * a * c * np.cos(au - cu), 0.0)))
    return corners if off.max() <= deflection else None


def _loops(
    face: TopoDS_Face, surface: BRepAdaptor_Surface, border: Border, deflection: float, angular: float
) -> list[tuple[Array, Array]]:
    """Return parameters (n, 2) and points (n, 3) around each wire.

    Parameters that do not lead to their points (curves shifted by a period) are replaced by those of the nearest point.
    """
    loops = []
    for wire in explored(face, TopAbs_ShapeEnum.TopAbs_WIRE):
        explorer = BRepTools_WireExplorer(TopoDS.Wire(wire), face)
        pieces = []
        while explorer.More():
            uv, points = _along(explorer.Current(), face, border, angular)
            reached = np.array([surface.Value(u, v).Coord() for u, v in uv.tolist()])
            if (np.linalg.norm(reached - points, axis=1) > deflection).any():
                nearest = ShapeAnalysis_Surface(BRep_Tool.Surface_s(face))
                found = [nearest.ValueOfUV(gp_Pnt(*point), deflection) for point in points.tolist()]
                uv = np.array([(p.X(), p.Y()) for p in found])
            pieces.append((uv, points))
            explorer.Next()
        if pieces:
            loops.append((np.concatenate([uv[:-1] for uv, _ in pieces]), np.concatenate([p[:-1] for _, p in pieces])))
    return [(uv, points) for uv, points in loops if len(uv) >= 3]


def _along(edge: TopoDS_Edge, face: TopoDS_Face, border: Border, angular: float) -> tuple[Array, Array]:
    """Parameters (n, 2) and points (n, 3) of an edge, in its sense along the wire."""
    curve = BRepAdaptor_Curve2d(edge, face)
    if BRep_Tool.Degenerated_s(edge):  # at a pole: many parameters, one point
        first, last = curve.FirstParameter(), curve.LastParameter()
        at = np.linspace(first, last, 2 + int(2.0 * np.pi / angular))
        pole = BRep_Tool.Pnt_s(TopExp.FirstVertex_s(edge))
        points = np.repeat([pole.Coord()], len(at), axis=0)
    else:
        at, points = border(edge)
    uv = np.array([curve.Value(t).Coord() for t in at.tolist()])
    return (uv[::-1], points[::-1]) if edge.Orientation() == TopAbs_Orientation.TopAbs_REVERSED else (uv, points)


def _scale(surface: BRepAdaptor_Surface, uv: Array) -> Array:
    """(2,) mean lengths of the surface's derivatives along u and v, mm per unit of the parameter."""
    point, along_u, along_v = gp_Pnt(), gp_Vec(), gp_Vec()
    sums = np.zeros(2)
    for u, v in uv[:: 1 + len(uv) // 32].tolist():
        surface.D1(u, v, point, along_u, along_v)
        sums += along_u.Magnitude(), along_v.Magnitude()
    return np.where(sums > 0.0, sums, 1.0) / len(uv[:: 1 + len(uv) // 32])


def _area(polygon: Array) -> float:
    x, y = (polygon - polygon[0]).T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def _distance(p: Any, a: Any, b: Any) -> float:
    """Distance of a point from a segment: parameters need not run evenly along it."""
    ax, ay, az = a
    dx, dy, dz = b[0] - ax, b[1] - ay, b[2] - az
    px, py, pz = p[0] - ax, p[1] - ay, p[2] - az
    square = dx * dx + dy * dy + dz * dz
    t = min(max((dx * px + dy * py + dz * pz) / square, 0.0), 1.0) if square else 0.0
    return math.hypot(px - t * dx, py - t * dy, pz - t * dz)


class _Refined:
    """A triangulation whose inner edges are flipped and split; its border is fixed."""

    def __init__(
        self, surface: BRepAdaptor_Surface, scale: Array, loops: list[tuple[Array, Array]], corners: NDArray[np.int64]
    ) -> None:
        self._surface = surface
        self._scale = (float(scale[0]), float(scale[1]))
        self._uv: list[tuple[float, float]] = [(u, v) for uv, _ in loops for u, v in uv.tolist()]
        self._points: list[Any] = [p for _, points in loops for p in points.tolist()]
        self._flat: list[tuple[float, float]] = [(u * self._scale[0], v * self._scale[1]) for u, v in self._uv]
        self._normals: dict[int, Any] = {}
        self._apex: dict[tuple[int, int], int] = {}
        """the third corner of the triangle on the left of each directed edge"""
        for a, b, c in corners.tolist():
            self._add(a, b, c)

    def arrays(self) -> tuple[Array, NDArray[np.int64]]:
        """Points (n, 3) and triangles (m, 3)."""
        triangles = [(a, b, c) for (a, b), c in self._apex.items() if a < b and a < c]
        return np.array(self._points), np.array(triangles, np.int64).reshape(-1, 3)

    def refine(self, deflection: float, angular: float) -> None:
        """Flip all inner edges to Delaunay; split the one that deviates or turns most, until none does too much."""
        waiting: list[tuple[float, int, int]] = []

        def weigh(edges: list[tuple[int, int]]) -> None:
            for a, b in edges:
                excess = self._excess(a, b, deflection, angular) if (b, a) in self._apex else 0.0
                if excess > 1.0:
                    heapq.heappush(waiting, (-excess, a, b))

        weigh(self._flip([(a, b) for a, b in self._apex if a < b]))
        splits = 0
        while waiting and splits < MOST_SPLITS:
            _, a, b = heapq.heappop(waiting)
            if (a, b) in self._apex and (b, a) in self._apex:
                weigh(self._flip(self._split(a, b)))
                splits += 1

    def _add(self, a: int, b: int, c: int) -> None:
        self._apex[a, b], self._apex[b, c], self._apex[c, a] = c, a, b

    def _drop(self, a: int, b: int, c: int) -> None:
        del self._apex[a, b], self._apex[b, c], self._apex[c, a]

    def _flip(self, edges: list[tuple[int, int]]) -> list[tuple[int, int]]:
        """Flip edges until all are locally Delaunay; returns those that were looked at and remain."""
        seen: dict[tuple[int, int], None] = {}
        budget = 20 * len(edges) + 100
        while edges and budget:
            budget -= 1
            a, b = edges.pop()
            c, d = self._apex.get((a, b)), self._apex.get((b, a))
            if c is None or d is None:
                continue
            seen[min(a, b), max(a, b)] = None
            if c == d or (c, d) in self._apex or (d, c) in self._apex or not self._is_better(a, b, c, d):
                continue
            self._drop(a, b, c)
            self._drop(b, a, d)
            self._add(a, d, c)
            self._add(d, b, c)
            edges += [(a, d), (d, b), (b, c), (c, a)]
            seen[min(c, d), max(c, d)] = None
        return list(seen)

    def _is_better(self, a: int, b: int, c: int, d: int) -> bool:
        """Whether edge c-d is to replace edge a-b: the angles at c and d sum to more than a half turn."""
        flat = self._flat
        (ax, ay), (bx, by), (cx, cy), (dx, dy) = flat[a], flat[b], flat[c], flat[d]
        left, right = (dx - ax) * (cy - ay) - (dy - ay) * (cx - ax), (bx - dx) * (cy - dy) - (by - dy) * (cx - dx)
        if left <= 0.0 or right <= 0.0:
            return False
        sin_c, cos_c = (ax - cx) * (by - cy) - (ay - cy) * (bx - cx), (ax - cx) * (bx - cx) + (ay - cy) * (by - cy)
        sin_d, cos_d = (bx - dx) * (ay - dy) - (by - dy) * (ax - dx), (bx - dx) * (ax - dx) + (by - dy) * (ay - dy)
        size = (abs(sin_c) + abs(cos_c)) * (abs(sin_d) + abs(cos_d))
        return sin_c * cos_d + cos_c * sin_d < -1e-12 * size

    def _middle(self, a: int, b: int) -> tuple[float, float, tuple[float, float, float]]:
        """Parameters and surface point at the middle of an edge."""
        (ua, va), (ub, vb) = self._uv[a], self._uv[b]
        u, v = 0.5 * (ua + ub), 0.5 * (va + vb)
        p = self._surface.Value(u, v)
        return u, v, p.Coord()

    def _excess(self, a: int, b: int, deflection: float, angular: float) -> float:
        """Deviation of an edge, or turn of the normal along it, in units of what is allowed."""
        away = _distance(self._middle(a, b)[2], self._points[a], self._points[b])
        if away <= LEAST * deflection:
            return 0.0
        return max(away / deflection, self._turn(a, b) / (TURN * angular))

    def _turn(self, a: int, b: int) -> float:
        """Angle between the surface's normals at two points, rad; 0 where there is none."""
        n, m = self._normal(a), self._normal(b)
        if n is None or m is None:
            return 0.0
        return float(n.Angle(m))

    def _normal(self, i: int) -> Any:
        if i not in self._normals:
            point, along_u, along_v = gp_Pnt(), gp_Vec(), gp_Vec()
            self._surface.D1(*self._uv[i], point, along_u, along_v)
            normal = along_u.Crossed(along_v)
            size = along_u.Magnitude() * along_v.Magnitude()
            self._normals[i] = normal if normal.Magnitude() > 1e-9 * size > 0.0 else None
        return self._normals[i]

    def _split(self, a: int, b: int) -> list[tuple[int, int]]:
        """Put a point on an inner edge; returns the edges to be looked at."""
        c, d = self._apex[a, b], self._apex[b, a]
        m = len(self._uv)
        u, v, point = self._middle(a, b)
        self._uv.append((u, v))
        self._flat.append((u * self._scale[0], v * self._scale[1]))
        self._points.append(point)
        self._drop(a, b, c)
        self._drop(b, a, d)
        for x, y, z in ((a, m, c), (m, b, c), (b, m, d), (m, a, d)):
            self._add(x, y, z)
        return [(a, m), (m, b), (m, c), (m, d), (b, c), (c, a), (a, d), (d, b)]
