"""From an OpenCascade solid to plain arrays: one face's triangles, type and edges after another.

OpenCascade works in millimetres here (what its readers convert every file to); everything returned is metres.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve, BRepAdaptor_Surface
from OCP.BRepBuilderAPI import BRepBuilderAPI_Copy
from OCP.BRepGProp import BRepGProp
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.collections import (
    IndexedDataMap_TopoDS_Shape_List_TopoDS_Shape_TopTools_ShapeMapHasher as AncestorMap,
)
from OCP.collections import (
    IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher as ShapeMap,
)
from OCP.GeomAbs import GeomAbs_CurveType, GeomAbs_SurfaceType
from OCP.gp import gp_Cone, gp_Cylinder, gp_Pln, gp_Sphere
from OCP.GProp import GProp_GProps
from OCP.ShapeAnalysis import ShapeAnalysis_CanonicalRecognition
from OCP.ShapeFix import ShapeFix_Face
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopExp import TopExp
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS, TopoDS_Face, TopoDS_Shape

from vpframe.importers.raw import Array, Color, RawEdge, RawFace, RawShape

MM = 1e-3
RECOGNITION = 1e-5 / MM  # the kernel's own recognition invents cylinders at looser tolerances

_TYPES = {
    GeomAbs_SurfaceType.GeomAbs_Plane: ("plane", "Plane"),
    GeomAbs_SurfaceType.GeomAbs_Cylinder: ("cylinder", "Cylinder"),
    GeomAbs_SurfaceType.GeomAbs_Cone: ("cone", "Cone"),
    GeomAbs_SurfaceType.GeomAbs_Sphere: ("sphere", "Sphere"),
    GeomAbs_SurfaceType.GeomAbs_Torus: ("torus", "Torus"),
}


MESHED, TYPED = 0.45, 0.6
"""shares of the time of a shape after which it is meshed, and its faces are read; its edges follow"""


def tessellate(
    shape: TopoDS_Shape,
    deflection: float,
    angular: float,
    color: Callable[[TopoDS_Shape], Color | None] = lambda face: None,
    tell: Callable[[float], None] = lambda fraction: None,
) -> RawShape:
    """Mesh `shape` (a solid, shell or face) and read everything a scene wants to know of it.

    `deflection` (m) bounds the distance between a triangle and its surface, `angular` (rad) the angle between
    neighbouring segments of a curve. Faces that mesh to nothing are tried again alone, finer and repaired; those that
    still give nothing are named in `notes`. `color` gives a face's own colour. `tell` hears the fraction done.
    """
    BRepMesh_IncrementalMesh(shape, deflection / MM, False, angular, True)
    faces = ShapeMap()
    TopExp.MapShapes_s(shape, TopAbs_ShapeEnum.TopAbs_FACE, faces)
    raw = RawShape(np.empty((0, 3)), np.empty((0, 3), np.int32), np.empty(0, np.int32), [])
    vertices: list[Array] = []
    triangles: list[Any] = []
    place: dict[int, int] = {}  # the kernel's face number -> ours, where faces without triangles leave no gap
    count = 0
    for number in range(1, faces.Extent() + 1):
        face = TopoDS.Face(faces.FindKey(number))
        tell(MESHED + (TYPED - MESHED) * (number - 1) / faces.Extent())
        points, corners = _triangles(face)
        if len(corners) == 0:
            points, corners = _retry(face, deflection / MM, angular)
            raw.notes.append(
                f"face {number} meshed to nothing and was repaired"
                if len(corners)
                else f"face {number} meshed to nothing, alone and repaired too: it is lost"
            )
            if len(corners) == 0:
                continue
        place[number] = len(raw.faces)
        raw.faces.append(_type(face, f"face_{number}"))
        raw.faces[-1].color = color(face)
        vertices.append(points * MM)
        triangles.append(corners + count)
        count += len(points)
    if raw.faces:
        raw.face_of_triangle = np.repeat(np.arange(len(triangles), dtype=np.int32), [len(t) for t in triangles])
        raw.vertices, inverse = np.unique(np.concatenate(vertices) + 0.0, axis=0, return_inverse=True)
        raw.triangles = inverse.reshape(-1)[np.concatenate(triangles)].astype(np.int32)
    raw.edges = _edges(shape, faces, place, tell)
    _volume(shape, raw)
    return raw


def _triangles(face: TopoDS_Face) -> tuple[Array, Any]:
    """Nodes (n, 3) in the shape's frame, mm, and triangles (m, 3) wound outwards."""
    location = TopLoc_Location()
    mesh = BRep_Tool.Triangulation_s(face, location)
    if mesh is None or mesh.NbTriangles() == 0:
        return np.empty((0, 3)), np.empty((0, 3), np.int64)
    points = np.array([(p.X(), p.Y(), p.Z()) for p in map(mesh.Node, range(1, mesh.NbNodes() + 1))])
    corners = np.array([mesh.Triangle(i).Get() for i in range(1, mesh.NbTriangles() + 1)], dtype=np.int64) - 1
    transformation = location.Transformation()
    if not location.IsIdentity():
        matrix = np.array([[transformation.Value(i, j) for j in range(1, 5)] for i in range(1, 4)])
        points = points @ matrix[:, :3].T + matrix[:, 3]
    if (face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED) != transformation.IsNegative():
        corners = corners[:, [0, 2, 1]]
    return points, corners


def _retry(face: TopoDS_Face, deflection: float, angular: float) -> tuple[Array, Any]:
    """What a face meshes to when it is copied from its neighbours, meshed finer, and at last repaired."""
    for repair in (False, True):
        copy = TopoDS.Face(BRepBuilderAPI_Copy(face, True, False).Shape())
        if repair:
            fix = ShapeFix_Face(copy)
            fix.Perform()
            copy = fix.Face()
        for finer in (0.5, 0.1):
            BRepMesh_IncrementalMesh(copy, deflection * finer, False, angular * finer, False)
            points, corners = _triangles(copy)
            if len(corners):
                return points, corners
    return np.empty((0, 3)), np.empty((0, 3), np.int64)


def _type(face: TopoDS_Face, name: str) -> RawFace:
    """The face's analytic type: the file's own, else the kernel's recognition, else points to fit one to."""
    surface = BRepAdaptor_Surface(face)
    if surface.GetType() in _TYPES:
        kind, getter = _TYPES[surface.GetType()]
        return RawFace(name, kind, _numbers(kind, getattr(surface, getter)()), typed=True)
    samples = _samples(face, surface)
    recognition = ShapeAnalysis_CanonicalRecognition(face)
    for kind, value in (
        ("plane", gp_Pln()),
        ("cylinder", gp_Cylinder()),
        ("cone", gp_Cone()),
        ("sphere", gp_Sphere()),
    ):
        recognition.ClearStatus()
        if getattr(recognition, f"Is{kind.capitalize()}")(RECOGNITION, value):
            return RawFace(name, kind, _numbers(kind, value), samples=samples)
    return RawFace(name, samples=samples)


def _numbers(kind: str, value: Any) -> tuple[float, ...]:
    """The numbers of an OpenCascade elementary surface, metres, in the order that `RawFace.numbers` states."""

    def point(p: Any) -> tuple[float, ...]:
        return (p.X() * MM, p.Y() * MM, p.Z() * MM)

    def direction(d: Any) -> tuple[float, ...]:
        return (d.X(), d.Y(), d.Z())

    if kind == "plane":
        return (*point(value.Location()), *direction(value.Axis().Direction()))
    if kind == "cylinder":
        return (*point(value.Location()), *direction(value.Axis().Direction()), value.Radius() * MM)
    if kind == "cone":
        sign = -1.0 if value.SemiAngle() < 0 else 1.0
        axis = (sign * x for x in direction(value.Axis().Direction()))
        return (*point(value.Apex()), *axis, abs(value.SemiAngle()))
    if kind == "sphere":
        return (*point(value.Location()), value.Radius() * MM)
    return (
        *point(value.Location()),
        *direction(value.Axis().Direction()),
        value.MajorRadius() * MM,
        value.MinorRadius() * MM,
    )


def _samples(face: TopoDS_Face, surface: BRepAdaptor_Surface) -> Array:
    """Points of the true surface at the middle of each triangle (in parameters), m: what vertices alone may hide."""
    mesh = BRep_Tool.Triangulation_s(face, TopLoc_Location())
    if mesh is None or not mesh.HasUVNodes():
        return np.empty((0, 3))
    uv = np.array([(p.X(), p.Y()) for p in map(mesh.UVNode, range(1, mesh.NbNodes() + 1))])
    corners = np.array([mesh.Triangle(i).Get() for i in range(1, mesh.NbTriangles() + 1)]) - 1
    if len(corners) > 400:
        corners = corners[:: len(corners) // 200]
    middles = uv[corners].mean(axis=1)
    return np.array([(p.X(), p.Y(), p.Z()) for p in (surface.Value(u, v) for u, v in middles)]) * MM


def _edges(shape: TopoDS_Shape, faces: ShapeMap, place: dict[int, int], tell: Callable[[float], None]) -> list[RawEdge]:
    """Each edge once: its polyline, the faces it bounds, and its circle if it is one."""
    ancestors = AncestorMap()
    TopExp.MapShapesAndAncestors_s(shape, TopAbs_ShapeEnum.TopAbs_EDGE, TopAbs_ShapeEnum.TopAbs_FACE, ancestors)
    edges = []
    for i in range(1, ancestors.Extent() + 1):
        tell(TYPED + (1.0 - TYPED) * (i - 1) / ancestors.Extent())
        edge = TopoDS.Edge(ancestors.FindKey(i))
        if BRep_Tool.Degenerated_s(edge):
            continue
        numbers = dict.fromkeys(faces.FindIndex(face) for face in ancestors.FindFromIndex(i))
        points = next((p for p in (_polyline(edge, TopoDS.Face(faces.FindKey(n))) for n in numbers) if len(p)), None)
        if points is None:
            continue
        curve = BRepAdaptor_Curve(edge)
        circle = None
        if curve.GetType() == GeomAbs_CurveType.GeomAbs_Circle:
            value = curve.Circle()
            center, axis = value.Location(), value.Axis().Direction()
            circle = (
                np.array([center.X(), center.Y(), center.Z()]) * MM,
                np.array([axis.X(), axis.Y(), axis.Z()]),
                value.Radius() * MM,
            )
        edges.append(RawEdge(points * MM, tuple(sorted(place[n] for n in numbers if n in place)), circle))
    return edges


def _polyline(edge: Any, face: TopoDS_Face) -> Array:
    """Nodes (n, 3), mm, that the face's mesh has on the edge; empty when it has none."""
    location = TopLoc_Location()
    mesh = BRep_Tool.Triangulation_s(face, location)
    polygon = None if mesh is None else BRep_Tool.PolygonOnTriangulation_s(edge, mesh, location)
    if polygon is None:
        return np.empty((0, 3))
    transformation = location.Transformation()
    nodes = (mesh.Node(polygon.Node(i)).Transformed(transformation) for i in range(1, polygon.NbNodes() + 1))
    return np.array([(p.X(), p.Y(), p.Z()) for p in nodes])


def _volume(shape: TopoDS_Shape, raw: RawShape) -> None:
    """Volume, centre and inertia of the exact solid; nothing for a sheet."""
    solids = ShapeMap()
    TopExp.MapShapes_s(shape, TopAbs_ShapeEnum.TopAbs_SOLID, solids)
    if solids.Extent() == 0:
        return
    properties = GProp_GProps()
    BRepGProp.VolumeProperties_s(shape, properties)
    center, inertia = properties.CentreOfMass(), properties.MatrixOfInertia()
    volume = properties.Mass()
    if volume == 0:
        return
    if volume < 0:  # a solid inside out
        raw.triangles = np.ascontiguousarray(raw.triangles[:, [0, 2, 1]])
    raw.volume = abs(volume) * MM**3
    raw.center = np.array([center.X(), center.Y(), center.Z()]) * MM
    sign = 1.0 if volume > 0 else -1.0
    raw.inertia = sign * MM**5 * np.array([[inertia.Value(i, j) for j in (1, 2, 3)] for i in (1, 2, 3)])
