"""Build B-rep parts with OpenCascade, for demo, examples and tests.

A `Solid` is a value; every operation returns a new one. Lengths are metres, angles radians.

>>> plate = box(0.1, 0.1, 0.01) - cylinder(0.004, 0.01).translated(0.05, 0.05, 0.0)
>>> write_step("plate.step", {"plate": plate, "pin": (cylinder(0.004, 0.03), pin.SE3.Identity())})
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from OCP.APIHeaderSection import APIHeaderSection_MakeHeader
from OCP.BRepAdaptor import BRepAdaptor_Curve
from OCP.BRepAlgoAPI import BRepAlgoAPI_Common, BRepAlgoAPI_Cut, BRepAlgoAPI_Fuse
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakePolygon, BRepBuilderAPI_Transform
from OCP.BRepFilletAPI import BRepFilletAPI_MakeChamfer, BRepFilletAPI_MakeFillet
from OCP.BRepPrimAPI import (
    BRepPrimAPI_MakeBox,
    BRepPrimAPI_MakeCone,
    BRepPrimAPI_MakeCylinder,
    BRepPrimAPI_MakePrism,
    BRepPrimAPI_MakeRevol,
    BRepPrimAPI_MakeSphere,
    BRepPrimAPI_MakeTorus,
)
from OCP.collections import IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher as ShapeMap
from OCP.gp import gp_Ax1, gp_Dir, gp_Pnt, gp_Trsf, gp_Vec
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.Message import Message, Message_Printer
from OCP.Quantity import Quantity_Color, Quantity_ColorRGBA, Quantity_TypeOfColor
from OCP.ShapeUpgrade import ShapeUpgrade_UnifySameDomain
from OCP.STEPCAFControl import STEPCAFControl_Writer
from OCP.STEPControl import STEPControl_StepModelType
from OCP.TCollection import TCollection_ExtendedString, TCollection_HAsciiString
from OCP.TDataStd import TDataStd_Name
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS, TopoDS_Shape
from OCP.XCAFDoc import XCAFDoc_ColorType, XCAFDoc_DocumentTool

from vpframe import services
from vpframe.errors import VpframeError
from vpframe.outputs import GENERATOR
from vpframe.scene.units import METRES

if TYPE_CHECKING:
    from vpframe.scene.scene import Scene, Shape

MM = METRES["mm"]

Near = Callable[[np.ndarray], bool]
"""Selects edges by their middle point (3,), m."""


class ModellingError(VpframeError):
    """Geometry that cannot be built; the message names the operation."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A B-rep solid. `a + b` is the union, `a - b` the cut, `a & b` the intersection."""

    occ: TopoDS_Shape
    """OpenCascade shape, mm"""

    def __add__(self, other: Solid) -> Solid:
        return _boolean(BRepAlgoAPI_Fuse, self, other, "union")

    def __sub__(self, other: Solid) -> Solid:
        return _boolean(BRepAlgoAPI_Cut, self, other, "cut")

    def __and__(self, other: Solid) -> Solid:
        return _boolean(BRepAlgoAPI_Common, self, other, "intersection")

    def moved(self, pose: pin.SE3) -> Solid:
        """Return the solid moved by a rigid motion."""
        return Solid(BRepBuilderAPI_Transform(self.occ, _trsf(pose), True).Shape())

    def translated(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Solid:
        """Return the solid moved by (x, y, z), m."""
        return self.moved(pin.SE3(np.eye(3), np.array([x, y, z], dtype=np.float64)))

    def rotated(self, axis: ArrayLike, angle: float, origin: ArrayLike = (0.0, 0.0, 0.0)) -> Solid:
        """Return the solid rotated by `angle` rad about `axis` through `origin`."""
        direction = np.asarray(axis, dtype=np.float64)
        rotation = pin.exp3(direction / np.linalg.norm(direction) * angle)
        about = np.asarray(origin, dtype=np.float64)
        return self.moved(pin.SE3(rotation, about - rotation @ about))

    def filleted(self, radius: float, edges: Near | None = None) -> Solid:
        """Return the solid with fillets of `radius` m on its edges (on those whose middle `edges` accepts)."""
        return self._blend(BRepFilletAPI_MakeFillet(self.occ), radius, edges, "fillet")

    def chamfered(self, width: float, edges: Near | None = None) -> Solid:
        """Return the solid with chamfers of `width` m on its edges (on those whose middle `edges` accepts)."""
        return self._blend(BRepFilletAPI_MakeChamfer(self.occ), width, edges, "chamfer")

    def _blend(self, maker: Any, size: float, edges: Near | None, what: str) -> Solid:
        found = ShapeMap()
        TopExp.MapShapes_s(self.occ, TopAbs_ShapeEnum.TopAbs_EDGE, found)
        chosen = 0
        for i in range(1, found.Extent() + 1):
            edge = TopoDS.Edge(found.FindKey(i))
            curve = BRepAdaptor_Curve(edge)
            middle = curve.Value(0.5 * (curve.FirstParameter() + curve.LastParameter()))
            if edges is None or edges(np.array([middle.X(), middle.Y(), middle.Z()]) * MM):
                maker.Add(size / MM, edge)
                chosen += 1
        if chosen == 0:
            raise ModellingError(f"{what}: no edge chosen out of {found.Extent()}; widen the choice")
        try:
            return _checked(maker, f"{what} of {size} m")
        except ModellingError:
            raise
        except Exception as error:  # OpenCascade's exceptions share no base but Exception
            raise ModellingError(f"{what} of {size} m cannot be built on this solid; try a smaller one") from error


def _checked(maker: Any, what: str) -> Solid:
    maker.Build()
    if not maker.IsDone():
        raise ModellingError(f"{what} cannot be built on this solid; try another size or place")
    return Solid(maker.Shape())


def _boolean(operation: Any, a: Solid, b: Solid, what: str) -> Solid:
    maker = operation(a.occ, b.occ)
    result = _checked(maker, what).occ
    unify = ShapeUpgrade_UnifySameDomain(result, True, True, False)  # merges faces that the operation split
    unify.Build()
    solids = ShapeMap()
    TopExp.MapShapes_s(unify.Shape(), TopAbs_ShapeEnum.TopAbs_SOLID, solids)
    if solids.Extent() == 0:
        raise ModellingError(f"{what}: nothing is left; check that the solids overlap as meant")
    return Solid(solids.FindKey(1) if solids.Extent() == 1 else unify.Shape())


def _trsf(pose: pin.SE3) -> gp_Trsf:
    r, t = pose.rotation, pose.translation / MM
    trsf = gp_Trsf()
    trsf.SetValues(*(float(x) for row in np.column_stack([r, t]) for x in row))
    return trsf


def _lengths(what: str, **values: float) -> None:
    for name, value in values.items():
        if not (np.isfinite(value) and value > 0.0):
            raise ModellingError(f"{what}: {name} is {value!r}; give a positive length in metres")


def box(x: float, y: float, z: float) -> Solid:
    """Return a block from the origin to (x, y, z), m."""
    _lengths("box", x=x, y=y, z=z)
    return Solid(BRepPrimAPI_MakeBox(x / MM, y / MM, z / MM).Solid())


def cylinder(radius: float, height: float) -> Solid:
    """Return a cylinder about z, from z = 0 to `height`, m."""
    _lengths("cylinder", radius=radius, height=height)
    return Solid(BRepPrimAPI_MakeCylinder(radius / MM, height / MM).Solid())


def cone(radius_bottom: float, radius_top: float, height: float) -> Solid:
    """Return a cone (or frustum) about z, from z = 0 to `height`, m; one of the radii may be zero."""
    _lengths("cone", height=height)
    for name, radius in (("radius_bottom", radius_bottom), ("radius_top", radius_top)):
        if not (np.isfinite(radius) and radius >= 0.0):
            raise ModellingError(f"cone: {name} is {radius!r}; give a length in metres, or zero for a point")
    if radius_bottom == radius_top:
        raise ModellingError(f"cone: both radii are {radius_top!r}; that is a cylinder: use cylinder()")
    return Solid(BRepPrimAPI_MakeCone(radius_bottom / MM, radius_top / MM, height / MM).Solid())


def sphere(radius: float) -> Solid:
    """Return a ball about the origin, m."""
    _lengths("sphere", radius=radius)
    return Solid(BRepPrimAPI_MakeSphere(radius / MM).Solid())


def torus(major: float, minor: float) -> Solid:
    """Return a torus about z, m."""
    _lengths("torus", major=major, minor=minor)
    return Solid(BRepPrimAPI_MakeTorus(major / MM, minor / MM).Solid())


def _face(points: Iterable[Sequence[float]]) -> Any:
    corners = np.array(list(points), dtype=np.float64)
    if len(corners) < 3 or not np.isfinite(corners).all():
        raise ModellingError(f"polygon: {len(corners)} points; give at least three, of finite coordinates")
    if np.linalg.matrix_rank(corners - corners[0]) < 2:
        raise ModellingError("polygon: bounds no area; its points must not all lie on one line")
    polygon = BRepBuilderAPI_MakePolygon()
    for x, y, z in corners / MM:
        polygon.Add(gp_Pnt(x, y, z))
    polygon.Close()
    face = BRepBuilderAPI_MakeFace(polygon.Wire(), True)
    if not face.IsDone():
        raise ModellingError("polygon: no face can be spanned by its points; they must lie in one plane")
    return face.Face()


def revolve(profile: Sequence[tuple[float, float]], angle: float = 2.0 * np.pi) -> Solid:
    """Return the closed polygon `profile` of (radius, z) points, m, revolved about z."""
    maker = BRepPrimAPI_MakeRevol(
        _face((r, 0.0, z) for r, z in profile), gp_Ax1(gp_Pnt(0, 0, 0), gp_Dir(0, 0, 1)), angle
    )
    return _checked(maker, "revolve")


def extrude(polygon: Sequence[tuple[float, float]], height: float) -> Solid:
    """Return the closed polygon of (x, y) points, m, extruded from z = 0 to `height`."""
    _lengths("extrude", height=height)
    maker = BRepPrimAPI_MakePrism(_face((x, y, 0.0) for x, y in polygon), gp_Vec(0, 0, height / MM))
    return _checked(maker, "extrude")


def hexagon(across_flats: float, height: float) -> Solid:
    """Return a hexagonal prism about z from z = 0 to `height`, m, such as a bolt head or nut."""
    _lengths("hexagon", across_flats=across_flats)
    radius = across_flats / np.sqrt(3.0)
    angles = np.arange(6) * np.pi / 3.0
    return extrude([(radius * np.cos(a), radius * np.sin(a)) for a in angles], height)


def shape(solid: Solid, deflection: float = 1e-4, angular: float = 0.35, name: str = "shape") -> Shape:
    """Tessellate a solid to a `Shape`; `deflection` (m) and `angular` (rad) as in `vpframe.load`."""
    made: Shape = services.call("tessellate", solid.occ, deflection, angular, name)
    return made


Placed = Solid | tuple[Any, ...]
"""`solid`, `(solid, pose)`, `(solid, pose, (r, g, b, a))` (sRGB, 0 … 1) or `(solid, pose, colour, density)`"""


def _placed(value: Placed) -> tuple[Any, pin.SE3, tuple[float, ...] | None, float | None]:
    given = value if isinstance(value, tuple) else (value,)
    pose = given[1] if len(given) > 1 and given[1] is not None else pin.SE3.Identity()
    return given[0], pose, given[2] if len(given) > 2 else None, given[3] if len(given) > 3 else None


def _rgba(color: Sequence[float]) -> tuple[float, float, float, float]:
    r, g, b, *alpha = (float(c) for c in color)
    return r, g, b, alpha[0] if alpha else 1.0


def scene(parts: Mapping[str, Placed], deflection: float = 1e-4, angular: float = 0.35) -> Scene:
    """Return a scene of placed solids; a `Solid` that is placed twice becomes one shape."""
    from vpframe.scene.scene import Part, Scene

    shapes: dict[int, Shape] = {}
    made = []
    for name, value in parts.items():
        solid, pose, color, density = _placed(value)
        if id(solid) not in shapes:
            shapes[id(solid)] = shape(solid, deflection, angular, name)
        part = Part(name, shapes[id(solid)], pin.SE3(pose), density=density)
        if color is not None:
            part.color = _rgba(color)
        made.append(part)
    return Scene(made)


def write_step(
    path: str | Path, parts: Mapping[str, Any], name: str = "assembly", external: bool = False, date: str | None = None
) -> Path:
    """Write placed solids as a STEP assembly with names, colours and densities; return the path.

    `parts` maps a name to `Placed`; a mapping in place of the solid is a subassembly. A `Solid` or mapping that is
    placed twice is written once and instanced. With `external` each part is written to a file of its own, named after
    it, to which the assembly refers. `date` (ISO 8601) is that of the header, by default now.
    """
    document = TDocStd_Document(TCollection_ExtendedString("XmlXCAF"))
    XCAFDoc_DocumentTool.SetLengthUnit_s(document, MM)
    tools = (
        XCAFDoc_DocumentTool.ShapeTool_s(document.Main()),
        XCAFDoc_DocumentTool.ColorTool_s(document.Main()),
        XCAFDoc_DocumentTool.MaterialTool_s(document.Main()),
    )
    _write_assembly(tools, parts, name, {})
    tools[0].UpdateAssemblies()
    Message.DefaultMessenger_s().RemovePrinters(Message_Printer.get_type_descriptor_s())  # for standard output
    writer = STEPCAFControl_Writer()
    writer.SetNameMode(True)
    writer.SetColorMode(True)
    writer.SetMaterialMode(True)
    prefix = Path(path).stem + "_" if external else None
    writer.Transfer(document, STEPControl_StepModelType.STEPControl_AsIs, prefix)
    header = APIHeaderSection_MakeHeader(writer.ChangeWriter().Model())
    header.SetOriginatingSystem(TCollection_HAsciiString(GENERATOR))
    if date is not None:
        header.SetTimeStamp(TCollection_HAsciiString(date))
    if writer.Write(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
        raise ModellingError(f"{path}: the STEP file cannot be written; check that its folder exists and is writable")
    return Path(path)


def _write_assembly(tools: tuple[Any, ...], parts: Mapping[str, Any], name: str, written: dict[int, Any]) -> Any:
    shapes, colors, materials = tools
    assembly = shapes.NewShape()
    TDataStd_Name.Set_s(assembly, TCollection_ExtendedString(name, True))
    for part, value in parts.items():
        content, pose, color, density = _placed(value)
        if id(content) not in written:
            if isinstance(content, Mapping):
                label = _write_assembly(tools, content, part, written)
            else:
                label = shapes.AddShape(content.occ, False)
                TDataStd_Name.Set_s(label, TCollection_ExtendedString(part, True))
                if density is not None:
                    text = TCollection_HAsciiString
                    material = (text("material"), text(""), density, text("density"), text("POSITIVE_RATIO_MEASURE"))
                    materials.SetMaterial(label, *material)
            written[id(content)] = label
        component = shapes.AddComponent(assembly, written[id(content)], TopLoc_Location(_trsf(pose)))
        TDataStd_Name.Set_s(component, TCollection_ExtendedString(part, True))
        if color is not None:
            red, green, blue, alpha = _rgba(color)
            kept = Quantity_Color(red, green, blue, Quantity_TypeOfColor.Quantity_TOC_sRGB)
            rgba = Quantity_ColorRGBA(kept, alpha)
            colors.SetColor(component, rgba, XCAFDoc_ColorType.XCAFDoc_ColorGen)
    return assembly


__all__ = [
    "ModellingError",
    "Near",
    "Placed",
    "Solid",
    "box",
    "cone",
    "cylinder",
    "extrude",
    "hexagon",
    "revolve",
    "scene",
    "shape",
    "sphere",
    "torus",
    "write_step",
]
