"""Convert OpenCascade solids to arrays: triangles, type and edges of each face.

OpenCascade works in millimetres here; results are in metres.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
from OCP.BinTools import BinTools, BinTools_FormatVersion
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve, BRepAdaptor_Surface
from OCP.BRepBuilderAPI import BRepBuilderAPI_Copy
from OCP.BRepGProp import BRepGProp
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.BRepTools import BRepTools
from OCP.collections import (
    IndexedDataMap_TopoDS_Shape_List_TopoDS_Shape_TopTools_ShapeMapHasher as AncestorMap,
)
from OCP.collections import (
    IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher as ShapeMap,
)
from OCP.GeomAbs import GeomAbs_CurveType, GeomAbs_SurfaceType
from OCP.GeomAPI import GeomAPI_ProjectPointOnSurf
from OCP.gp import gp_Cone, gp_Cylinder, gp_Pln, gp_Pnt, gp_Sphere
from OCP.GProp import GProp_GProps
from OCP.ShapeAnalysis import ShapeAnalysis_CanonicalRecognition
from OCP.ShapeFix import ShapeFix_Face
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopExp import TopExp
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS, TopoDS_Face, TopoDS_Shape

from collision.mesh import welded
from vpframe.importers.polyhedron import LONGEST, boundary_loops, fill, mass_properties, open_edges
from vpframe.importers.raw import Array, Color, RawEdge, RawFace, RawShape, Size

MM = 1e-3
RECOGNITION = 1e-5 / MM  # at looser tolerances the kernel recognises false cylinders

_TYPES = {
    GeomAbs_SurfaceType.GeomAbs_Plane: ("plane", "Plane"),
    GeomAbs_SurfaceType.GeomAbs_Cylinder: ("cylinder", "Cylinder"),
    GeomAbs_SurfaceType.GeomAbs_Cone: ("cone", "Cone"),
    GeomAbs_SurfaceType.GeomAbs_Sphere: ("sphere", "Sphere"),
    GeomAbs_SurfaceType.GeomAbs_Torus: ("torus", "Torus"),
}


Piece = tuple[Array, Any]
"""mesh of a face: points (n, 3), m, and triangles (m, 3)"""

MESHED, TYPED = 0.45, 0.6
"""fractions of a shape's time at which meshing, and reading of faces, are done"""


def tessellate(
    shape: TopoDS_Shape,
    deflection: float,
    angular: float,
    color: Callable[[TopoDS_Shape], Color | None] = lambda face: None,
    size: Callable[[TopoDS_Shape], Size | None] = lambda face: None,
    tell: Callable[[float], None] = lambda fraction: None,
) -> RawShape:
    """Mesh `shape` (a solid, shell or face) and read its faces, edges and mass properties.

    deflection: maximum distance between a triangle and its surface, m. angular: maximum angle between neighbouring
    segments of a curve, rad. Faces without triangles are filled from their neighbours' borders, meshed first, or
    repaired; `notes` names them. color: returns a face's own colour. size: returns its toleranced diameter. tell:
    receives the fraction done.
    """
    raw = RawShape(np.empty((0, 3)), np.empty((0, 3), np.int32), np.empty(0, np.int32), [])
    raw.brep = brep_bytes(shape)
    BRepMesh_IncrementalMesh(shape, deflection / MM, False, angular, True)
    faces = ShapeMap()
    TopExp.MapShapes_s(shape, TopAbs_ShapeEnum.TopAbs_FACE, faces)
    pieces = _pieces(faces, lambda fraction: tell(MESHED + (TYPED - MESHED) * fraction))
    _weld(raw, pieces)
    empty = [number for number, (_, corners) in pieces.items() if len(corners) == 0]
    for repair in (_fill_holes, _mesh_first, _fill_holes, _mesh_alone):
        missing = [number for number in empty if len(pieces[number][1]) == 0]
        if missing:
            pieces.update(repair(shape, faces, missing, raw, deflection / MM, angular))
            _weld(raw, pieces)
    for number in empty:
        lost = len(pieces[number][1]) == 0
        raw.notes.append(
            f"face {number} meshed to nothing and {'is lost: it cannot be repaired' if lost else 'was repaired'}"
        )
    place = {number: i for i, number in enumerate(n for n, (_, corners) in pieces.items() if len(corners))}
    for number in place:
        face = TopoDS.Face(faces.FindKey(number))
        raw.faces.append(_type(face, f"face_{number}"))
        raw.faces[-1].color, raw.faces[-1].size = color(face), size(face)
    raw.edges = _edges(shape, faces, place, tell)
    _volume(shape, raw)
    return raw


def brep_bytes(shape: TopoDS_Shape) -> bytes:
    """Return the shape in OpenCascade's binary format (BinTools), without triangles."""
    stream = io.BytesIO()
    BinTools.Write_s(shape, stream, False, False, BinTools_FormatVersion.BinTools_FormatVersion_CURRENT)
    return stream.getvalue()


def brep_shape(data: bytes) -> TopoDS_Shape:
    """Inverse of `brep_bytes`; a null shape for bytes that are no B-rep. May crash on damaged bytes."""
    shape = TopoDS_Shape()
    BinTools.Read_s(shape, io.BytesIO(data))
    return shape


def _pieces(faces: ShapeMap, tell: Callable[[float], None] = lambda fraction: None) -> dict[int, Piece]:
    """Return the mesh of each face, by the kernel's face number."""
    pieces = {}
    for number in range(1, faces.Extent() + 1):
        tell((number - 1) / faces.Extent())
        points, corners = _triangles(TopoDS.Face(faces.FindKey(number)))
        pieces[number] = points * MM, corners
    return pieces


def _weld(raw: RawShape, pieces: dict[int, Piece]) -> None:
    """Join the triangles of all faces; merge equal vertices and drop triangles with two equal corners."""
    found = [(points, corners) for points, corners in pieces.values() if len(corners)]
    if not found:
        return
    starts = np.cumsum([0, *(len(points) for points, _ in found)])
    raw.vertices, point = welded(np.concatenate([p for p, _ in found]) + 0.0)
    corners = np.concatenate([corners + start for (_, corners), start in zip(found, starts, strict=False)])
    raw.triangles = point[corners].astype(np.int32)
    raw.face_of_triangle = np.repeat(np.arange(len(found), dtype=np.int32), [len(corners) for _, corners in found])
    real = (raw.triangles != np.roll(raw.triangles, 1, axis=1)).all(axis=1)  # a pole is one point for two corners
    raw.triangles, raw.face_of_triangle = raw.triangles[real], raw.face_of_triangle[real]


def _fill_holes(
    shape: TopoDS_Shape, faces: ShapeMap, missing: list[int], raw: RawShape, deflection: float, angular: float
) -> dict[int, Piece]:
    """Fill the holes of missing faces with triangles between their neighbours' vertices.

    A filling is used only if it is within `deflection` of the face's surface and has the face's area.
    """
    loops = [loop for loop in boundary_loops(raw.triangles) if len(loop) <= LONGEST]
    filled: dict[int, Piece] = {}
    for number in missing:
        face = TopoDS.Face(faces.FindKey(number))
        properties = GProp_GProps()
        BRepGProp.SurfaceProperties_s(face, properties)
        center = np.array(_xyz(properties.CentreOfMass())) * MM
        loops.sort(key=lambda loop: float(np.linalg.norm(raw.vertices[loop].mean(axis=0) - center)))
        for loop in loops:
            points = raw.vertices[loop]
            corners = fill(points)
            a, b, c = (points[corners[:, k]] for k in range(3))
            area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
            border = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1).sum()
            if abs(area - properties.Mass() * MM**2) > border * deflection * MM:
                continue
            probes = np.concatenate([points, (a + b) / 2, (b + c) / 2, (c + a) / 2, (a + b + c) / 3])
            if _deviation(face, probes / MM) <= deflection:
                filled[number] = points, corners
                loops.remove(loop)
                break
    return filled


def _deviation(face: TopoDS_Face, points: Array) -> float:
    """Greatest distance of points (n, 3) from the face's surface, mm."""
    surface = BRep_Tool.Surface_s(face)
    feet = (GeomAPI_ProjectPointOnSurf(gp_Pnt(*p), surface) for p in points.tolist())
    return max(foot.LowerDistance() if foot.NbPoints() else np.inf for foot in feet)


def _mesh_first(
    shape: TopoDS_Shape, faces: ShapeMap, missing: list[int], raw: RawShape, deflection: float, angular: float
) -> dict[int, Piece]:
    """Mesh all faces again after the missing ones, which are meshed finer; their neighbours then use their borders."""
    BRepTools.Clean_s(shape)
    for number in missing:
        for finer in (0.5, 0.1):
            face = TopoDS.Face(faces.FindKey(number))
            BRepMesh_IncrementalMesh(face, deflection * finer, False, angular * finer, False)
            if len(_triangles(face)[1]):
                break
    BRepMesh_IncrementalMesh(shape, deflection, False, angular, True)
    return _pieces(faces)


def _mesh_alone(
    shape: TopoDS_Shape, faces: ShapeMap, missing: list[int], raw: RawShape, deflection: float, angular: float
) -> dict[int, Piece]:
    """Mesh copies of missing faces finer, and at last repaired; this leaves gaps to their neighbours."""
    pieces = {}
    for number in missing:
        for repair, finer in product((False, True), (0.5, 0.1)):
            copy = TopoDS.Face(BRepBuilderAPI_Copy(faces.FindKey(number), True, False).Shape())
            if repair:
                fix = ShapeFix_Face(copy)
                fix.Perform()
                copy = fix.Face()
            BRepMesh_IncrementalMesh(copy, deflection * finer, False, angular * finer, False)
            points, corners = _triangles(copy)
            if len(corners):
                pieces[number] = points * MM, corners
                break
    return pieces


def _triangles(face: TopoDS_Face) -> tuple[Array, Any]:
    """Nodes (n, 3) in the shape's frame, mm, and triangles (m, 3) with outward winding."""
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


def _type(face: TopoDS_Face, name: str) -> RawFace:
    """Return the analytic type of a face: from the file, else from the kernel's recognition, else sample points."""
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
    """Return the numbers of an elementary surface, in metres and the order of `RawFace.numbers`."""

    def point(p: Any) -> tuple[float, ...]:
        x, y, z = _xyz(p)
        return (x * MM, y * MM, z * MM)

    if kind == "plane":
        return (*point(value.Location()), *_xyz(value.Axis().Direction()))
    if kind == "cylinder":
        return (*point(value.Location()), *_xyz(value.Axis().Direction()), value.Radius() * MM)
    if kind == "cone":
        sign = -1.0 if value.SemiAngle() < 0 else 1.0
        axis = (sign * x for x in _xyz(value.Axis().Direction()))
        return (*point(value.Apex()), *axis, abs(value.SemiAngle()))
    if kind == "sphere":
        return (*point(value.Location()), value.Radius() * MM)
    return (
        *point(value.Location()),
        *_xyz(value.Axis().Direction()),
        value.MajorRadius() * MM,
        value.MinorRadius() * MM,
    )


def _xyz(value: Any) -> tuple[float, float, float]:
    return value.X(), value.Y(), value.Z()


def _samples(face: TopoDS_Face, surface: BRepAdaptor_Surface) -> Array:
    """Points of the true surface at the middle of each triangle (in parameters), m, for the fit of its type."""
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
    """Return each edge once: its polyline, the faces it bounds, and its circle if it is one."""
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
    """Nodes (n, 3) of the face's mesh on the edge, mm; empty if there are none."""
    location = TopLoc_Location()
    mesh = BRep_Tool.Triangulation_s(face, location)
    polygon = None if mesh is None else BRep_Tool.PolygonOnTriangulation_s(edge, mesh, location)
    if polygon is None:
        return np.empty((0, 3))
    nodes = [mesh.Node(polygon.Node(i)) for i in range(1, polygon.NbNodes() + 1)]
    if not location.IsIdentity():
        nodes = [node.Transformed(location.Transformation()) for node in nodes]
    return np.array([_xyz(node) for node in nodes])


def _volume(shape: TopoDS_Shape, raw: RawShape) -> None:
    """Compute volume, centre and inertia of the exact solid; not for sheets, open solids and damaged ones.

    An inverted solid is reversed.
    """
    solids = ShapeMap()
    TopExp.MapShapes_s(shape, TopAbs_ShapeEnum.TopAbs_SOLID, solids)
    if solids.Extent() == 0:
        return
    if closed := not len(open_edges(raw.triangles)):
        properties = GProp_GProps()
        BRepGProp.VolumeProperties_s(shape, properties)
        inertia, volume = properties.MatrixOfInertia(), properties.Mass()
        box = float(np.ptp(raw.vertices, axis=0).prod())
    if not closed or not (box == 0.0 or abs(volume) * MM**3 <= 2.0 * box):  # it may be nan
        if closed:
            raw.notes.append("its volume is not that of its faces: it is damaged; its mass is that of its triangles")
        if mass_properties(raw.vertices, raw.triangles)[0] < 0.0:
            raw.triangles = np.ascontiguousarray(raw.triangles[:, [0, 2, 1]])
        return
    if volume == 0:
        return
    if volume < 0:
        raw.triangles = np.ascontiguousarray(raw.triangles[:, [0, 2, 1]])
    raw.volume = abs(volume) * MM**3
    raw.center = np.array(_xyz(properties.CentreOfMass())) * MM
    sign = 1.0 if volume > 0 else -1.0
    raw.inertia = sign * MM**5 * np.array([[inertia.Value(i, j) for j in (1, 2, 3)] for i in (1, 2, 3)])
