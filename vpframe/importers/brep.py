"""Convert OpenCascade solids to arrays: triangles and type of each face, mass properties.

OpenCascade works in millimetres here; results are in metres.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from OCP.BinTools import BinTools, BinTools_FormatVersion
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve, BRepAdaptor_Surface
from OCP.BRepGProp import BRepGProp
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.collections import (
    IndexedDataMap_TopoDS_Shape_List_TopoDS_Shape_TopTools_ShapeMapHasher as AncestorMap,
)
from OCP.collections import (
    IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher as ShapeMap,
)
from OCP.GCPnts import GCPnts_TangentialDeflection
from OCP.GeomAbs import GeomAbs_SurfaceType
from OCP.gp import gp_Cone, gp_Cylinder, gp_Pln, gp_Sphere
from OCP.GProp import GProp_GProps
from OCP.ShapeAnalysis import ShapeAnalysis_CanonicalRecognition
from OCP.Standard import Standard_Failure
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopExp import TopExp
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS, TopoDS_Compound, TopoDS_Edge, TopoDS_Face, TopoDS_Iterator, TopoDS_Shape

from collision.mesh import welded
from vpframe.importers.patches import patch
from vpframe.importers.polyhedron import open_edges, signed_volume, triangle_area_vectors
from vpframe.importers.raw import NO_SAMPLES, Array, Color, RawFace, RawShape, Size
from vpframe.importers.topology import mapped, matrix_of

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
"""mesh of a face: points (n, 3), mm, and triangles (m, 3)"""
NOTHING: Piece = (np.empty((0, 3)), np.empty((0, 3), np.int64))

MESHED, TYPED = 0.6, 0.8
"""fractions of a shape's time at which meshing, and reading of faces, are done"""
ROUND = 2.0 * np.pi - 1e-6
"""angle from which on a face goes all the way round, rad"""
MOST_AGAIN = 200
"""most faces beside gaps that are meshed again"""
SHOWN = 3
"""most faces that a note names"""


def tessellate(
    shape: TopoDS_Shape,
    deflection: float,
    angular: float,
    color: Callable[[TopoDS_Shape], Color | None] = lambda face: None,
    size: Callable[[TopoDS_Shape], Size | None] = lambda face: None,
    tell: Callable[[float], None] = lambda fraction: None,
    mesher: bool = True,
) -> RawShape:
    """Mesh `shape` (a solid, shell or face) and read its faces; `measure` computes its mass properties.

    deflection: maximum distance between a triangle and its surface, m. angular: maximum angle between neighbouring
    segments of a curve, rad. Faces that the kernel leaves without triangles are triangulated between the polygons of
    their edges (`patches`); `notes` names them. color: returns a face's own
    colour. size: returns its toleranced diameter. tell: receives the fraction done. mesher: False triangulates all
    faces between the polygons of their edges, without the kernel's mesher, which does not end on some faces.
    """
    raw = RawShape(np.empty((0, 3)), np.empty((0, 3), np.int32), np.empty(0, np.int32), [])
    faces = mapped(shape, TopAbs_ShapeEnum.TopAbs_FACE)
    every = {number: TopoDS.Face(faces.FindKey(number)) for number in range(1, faces.Extent() + 1)}
    surfaces = {number: BRepAdaptor_Surface(face, False) for number, face in every.items()}
    own = {number for number, face in every.items() if not mesher or _is_round_cone(face, surfaces[number])}
    if len(own) < len(every):
        given = compound_of(face for number, face in every.items() if number not in own) if own else shape
        BRepMesh_IncrementalMesh(given, deflection / MM, False, angular, True)
    tell(MESHED)
    pieces = {number: NOTHING if number in own else _triangles(face) for number, face in every.items()}
    failed = [number for number, (_, corners) in pieces.items() if not len(corners) and number not in own]
    patches = _Patches(shape, faces, pieces, deflection / MM, angular)
    for number in sorted(own.union(failed)):
        pieces[number] = patches.piece(every[number])
    if not mesher:
        raw.notes.append("its faces are triangulated one by one: the CAD kernel's mesher does not end, or crashes")
    is_open = _close(raw, pieces, patches, every)
    lost = [number for number, (_, corners) in pieces.items() if not len(corners)]
    repaired = [number for number in failed if number not in lost]
    for numbers, end in ((repaired, "repaired"), (lost, "lost: nothing closes its border")):
        if numbers:
            places = "; ".join(_words(every[number], number) for number in numbers[:SHOWN])
            more = f"; and {len(numbers) - SHOWN} more" if len(numbers) > SHOWN else ""
            raw.notes.append(f"{places}{more}: meshed to nothing and {'are' if len(numbers) > 1 else 'is'} {end}")
    tell(TYPED)
    for number, (_, corners) in pieces.items():
        if len(corners):
            raw.faces.append(_type(every[number], surfaces[number], f"face_{number}"))
            raw.faces[-1].color, raw.faces[-1].size = color(every[number]), size(every[number])
    numbers = [number for number, (_, corners) in pieces.items() if len(corners)]
    shape, inside = _outwards(shape, faces, numbers, raw)
    raw.brep = brep_bytes(shape)
    if is_open and inside.any() and not inside.all():
        is_open = bool(len(open_edges(raw.triangles[inside])))
    raw.sheet = not inside.any() or (not inside.all() and not is_open)
    if inside.any() and not is_open:
        _bounds(raw, raw.triangles[inside], deflection)
    return raw


def _is_round_cone(face: TopoDS_Face, surface: BRepAdaptor_Surface) -> bool:
    """Whether a face is a cone that goes all the way round: OpenCascade 8 returns no triangles for many, or hangs."""
    if surface.GetType() != GeomAbs_SurfaceType.GeomAbs_Cone:
        return False
    surface = BRepAdaptor_Surface(face)  # between the face's own parameters
    return surface.LastUParameter() - surface.FirstUParameter() >= ROUND


def compound_of(shapes: Iterable[TopoDS_Shape]) -> TopoDS_Compound:
    """Return one shape of several."""
    compound, builder = TopoDS_Compound(), BRep_Builder()
    builder.MakeCompound(compound)
    for shape in shapes:
        builder.Add(compound, shape)
    return compound


def _words(face: TopoDS_Face, number: int) -> str:
    """Words for a face: its number, type and centre."""
    properties = GProp_GProps()
    BRepGProp.SurfaceProperties_s(face, properties)
    kind = _TYPES.get(BRepAdaptor_Surface(face).GetType(), ("freeform surface", ""))[0]
    x, y, z = _xyz(properties.CentreOfMass())
    return f"face {number} ({kind} near ({x:.6g}, {y:.6g}, {z:.6g}) mm)"


class _Patches:
    """Triangulations of single faces of a shape, joined along the polygons of their edges."""

    def __init__(
        self, shape: TopoDS_Shape, faces: ShapeMap, pieces: dict[int, Piece], deflection: float, angular: float
    ) -> None:
        self._deflection, self._angular = deflection, angular
        self._shape, self._faces, self._pieces = shape, faces, pieces
        self._beside: Any = None
        self._known: dict[int, tuple[Array, Array]] = {}

    def piece(self, face: TopoDS_Face) -> Piece:
        """Mesh of a face; without triangles if it has no closed border."""
        try:
            return patch(face, self._border, self._deflection, self._angular)
        except (Standard_Failure, ValueError, RuntimeError):  # a curve without parameters, a damaged surface
            return NOTHING

    def _border(self, edge: TopoDS_Edge) -> tuple[Array, Array]:
        """Parameters (n,) and points (n, 3), mm, of an edge's polygon: that of a meshed neighbour, else a new one."""
        if self._beside is None:
            self._beside = AncestorMap()
            kinds = TopAbs_ShapeEnum.TopAbs_EDGE, TopAbs_ShapeEnum.TopAbs_FACE
            TopExp.MapShapesAndAncestors_s(self._shape, *kinds, self._beside)
        number = self._beside.FindIndex(edge)
        if number not in self._known:
            forward = TopoDS.Edge(edge.Oriented(TopAbs_Orientation.TopAbs_FORWARD))
            polygons = (self._polygon(forward, face) for face in self._beside.FindFromIndex(number))
            found = next((polygon for polygon in polygons if polygon is not None), None)
            self._known[number] = found or _discretized(forward, self._deflection, self._angular)
        return self._known[number]

    def _polygon(self, edge: TopoDS_Edge, face: TopoDS_Shape) -> tuple[Array, Array] | None:
        """Parameters (n,) and points (n, 3), mm, of the kernel's mesh of a face on an edge; None if there is none."""
        location = TopLoc_Location()
        mesh = BRep_Tool.Triangulation_s(TopoDS.Face(face), location)
        polygon = None if mesh is None else BRep_Tool.PolygonOnTriangulation_s(edge, mesh, location)
        points = self._pieces[self._faces.FindIndex(face)][0]
        if polygon is None or not polygon.HasParameters() or not len(points):
            return None
        nodes = range(1, polygon.NbNodes() + 1)
        return np.array([polygon.Parameter(i) for i in nodes]), points[[polygon.Node(i) - 1 for i in nodes]]


def _discretized(edge: TopoDS_Edge, deflection: float, angular: float) -> tuple[Array, Array]:
    """Parameters (n,) and points (n, 3), mm, of an edge that no meshed face has; its ends are its vertices."""
    found = GCPnts_TangentialDeflection(BRepAdaptor_Curve(edge), angular, deflection)
    numbers = range(1, found.NbPoints() + 1)
    points = np.array([_xyz(found.Value(i)) for i in numbers])
    for end, vertex in ((0, TopExp.FirstVertex_s(edge)), (-1, TopExp.LastVertex_s(edge))):
        if not vertex.IsNull():
            points[end] = _xyz(BRep_Tool.Pnt_s(vertex))
    return np.array([found.Parameter(i) for i in numbers]), points


def _close(raw: RawShape, pieces: dict[int, Piece], patches: _Patches, faces: dict[int, TopoDS_Face]) -> bool:
    """Set the mesh of `raw` from `pieces`; where it is open, the faces beside gaps are meshed again. Whether it is."""
    border = _weld(raw, pieces)
    if not len(border):
        return False
    present = [number for number, (_, corners) in pieces.items() if len(corners)]
    touched = np.isin(raw.triangles, border).sum(axis=1) >= 2
    beside = [present[i] for i in np.unique(raw.face_of_triangle[touched]).tolist()]
    again = {number: patches.piece(faces[number]) for number in beside[:MOST_AGAIN]}
    again = {number: piece for number, piece in again.items() if len(piece[1])}
    left = len(_weld(raw, {**pieces, **again}))
    if left < len(border):
        raw.notes.append(f"{len(again)} faces beside gaps of the CAD kernel's mesh were meshed again")
        pieces.update(again)
        return left > 0
    _weld(raw, pieces)
    return True


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


def _weld(raw: RawShape, pieces: dict[int, Piece]) -> NDArray[np.int64]:
    """Join the triangles of all faces; merge equal vertices and drop triangles with two equal corners.

    Returns the open edges (k, 2).
    """
    found = [(points, corners) for points, corners in pieces.values() if len(corners)]
    if not found:
        return np.empty((0, 2), np.int64)
    starts = np.cumsum([0, *(len(points) for points, _ in found)])
    points, point = welded(np.concatenate([p for p, _ in found]) + 0.0)
    raw.vertices = points * MM
    corners = np.concatenate([corners + start for (_, corners), start in zip(found, starts, strict=False)])
    raw.triangles = point[corners].astype(np.int32)
    raw.face_of_triangle = np.repeat(np.arange(len(found), dtype=np.int32), [len(corners) for _, corners in found])
    real = (raw.triangles != np.roll(raw.triangles, 1, axis=1)).all(axis=1)  # a pole is one point for two corners
    raw.triangles, raw.face_of_triangle = raw.triangles[real], raw.face_of_triangle[real]
    return open_edges(raw.triangles)


def _triangles(face: TopoDS_Face) -> tuple[Array, Any]:
    """Nodes (n, 3) in the shape's frame, mm, and triangles (m, 3) with outward winding."""
    location = TopLoc_Location()
    mesh = BRep_Tool.Triangulation_s(face, location)
    if mesh is None or mesh.NbTriangles() == 0:
        return np.empty((0, 3)), np.empty((0, 3), np.int64)
    points = np.array([mesh.Node(i).Coord() for i in range(1, mesh.NbNodes() + 1)])
    corners = np.array([mesh.Triangle(i).Get() for i in range(1, mesh.NbTriangles() + 1)], dtype=np.int64) - 1
    transformation = location.Transformation()
    if not location.IsIdentity():
        matrix = matrix_of(transformation)
        points = points @ matrix[:, :3].T + matrix[:, 3]
    if (face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED) != transformation.IsNegative():
        corners = corners[:, [0, 2, 1]]
    return points, corners


def _type(face: TopoDS_Face, surface: BRepAdaptor_Surface, name: str) -> RawFace:
    """Return the analytic type of a face: from the file, else from the kernel's recognition, else sample points."""
    stated = surface.GetType()
    if stated in _TYPES:
        kind, getter = _TYPES[stated]
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
        return NO_SAMPLES
    uv = np.array([mesh.UVNode(i).Coord() for i in range(1, mesh.NbNodes() + 1)])
    corners = np.array([mesh.Triangle(i).Get() for i in range(1, mesh.NbTriangles() + 1)]) - 1
    if len(corners) > 400:
        corners = corners[:: len(corners) // 200]
    middles = uv[corners].mean(axis=1)
    return np.array([surface.Value(u, v).Coord() for u, v in middles]) * MM


def _outwards(
    shape: TopoDS_Shape, faces: ShapeMap, numbers: list[int], raw: RawShape
) -> tuple[TopoDS_Shape, NDArray[np.bool_]]:
    """Return the shape with each solid's faces pointing out of it, and which triangles are those of solids.

    The triangles of `raw` are turned likewise. numbers: those in `faces` of the faces that have triangles, in the order
    of `raw.faces`.
    """
    solids = list(mapped(shape, TopAbs_ShapeEnum.TopAbs_SOLID))
    inverted = []
    inside = np.zeros(len(raw.triangles), bool)
    for i, solid in enumerate(solids):
        own = mapped(solid, TopAbs_ShapeEnum.TopAbs_FACE)
        mine = np.array([own.Contains(faces.FindKey(number)) for number in numbers], bool)[raw.face_of_triangle]
        inside |= mine
        if signed_volume(raw.vertices, raw.triangles[mine]) < 0.0:
            inverted.append(i)
            raw.triangles[mine] = raw.triangles[mine][:, [0, 2, 1]]
    if not inverted:
        return shape, inside
    return _turned(shape, [solids[i] for i in inverted]), inside


def _turned(shape: TopoDS_Shape, inverted: list[TopoDS_Shape]) -> TopoDS_Shape:
    """Return a shape with some of its solids reversed."""
    if shape.ShapeType() == TopAbs_ShapeEnum.TopAbs_SOLID:
        return shape.Reversed() if any(shape.IsSame(solid) for solid in inverted) else shape
    if shape.ShapeType() != TopAbs_ShapeEnum.TopAbs_COMPOUND:
        return shape
    children, iterator = [], TopoDS_Iterator(shape)
    while iterator.More():
        children.append(_turned(iterator.Value(), inverted))
        iterator.Next()
    return compound_of(children)


def _bounds(raw: RawShape, triangles: NDArray[np.int32], deflection: float) -> None:
    """Set `bounds` of the volume of closed solids, which have `triangles`."""
    meshed = signed_volume(raw.vertices, triangles)
    area = float(np.linalg.norm(triangle_area_vectors(raw.vertices, triangles), axis=1).sum())
    slack = 0.05 * meshed + area * deflection
    raw.bounds = meshed - slack, meshed + slack


def measured(shape: TopoDS_Shape, deflection: float, angular: float) -> RawShape:
    """Mesh and measure a shape in this process."""
    raw = tessellate(shape, deflection, angular)
    measure(raw)
    return raw


def measure(raw: RawShape) -> None:
    """Set volume, centre and inertia to those of the exact solids; a note, and None, where these are not plausible."""
    if raw.bounds is None:
        return
    solids = list(mapped(brep_shape(raw.brep), TopAbs_ShapeEnum.TopAbs_SOLID))
    properties = GProp_GProps()
    BRepGProp.VolumeProperties_s(compound_of(solids) if len(solids) != 1 else solids[0], properties)
    volume, (low, high) = properties.Mass() * MM**3, raw.bounds
    if not low <= volume <= high:  # it may be nan
        wrong, right = (f"{each * 1e9:.6g} mm³" for each in (volume, 0.5 * (low + high)))
        raw.notes.append(f"its exact volume, {wrong}, is not that of its triangles, {right}, which is taken")
    elif volume > 0.0:
        inertia = properties.MatrixOfInertia()
        raw.volume = volume
        raw.center = np.array(properties.CentreOfMass().Coord()) * MM
        raw.inertia = MM**5 * np.array([[inertia.Value(i, j) for j in (1, 2, 3)] for i in (1, 2, 3)])
