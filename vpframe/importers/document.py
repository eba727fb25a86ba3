"""Read a STEP or IGES file into OpenCascade's document and collect instances that share shapes."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from OCP.BinTools import BinTools
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeSolid, BRepBuilderAPI_Sewing, BRepBuilderAPI_Transform
from OCP.BRepLib import BRepLib
from OCP.BRepTools import BRepTools
from OCP.collections import IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher as ShapeMap
from OCP.collections import Sequence_TDF_Label
from OCP.gp import gp_Trsf
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.IGESCAFControl import IGESCAFControl_Reader
from OCP.Message import Message, Message_Printer
from OCP.Quantity import Quantity_ColorRGBA, Quantity_TypeOfColor
from OCP.STEPCAFControl import STEPCAFControl_Reader
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDF import TDF_Label
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp, TopExp_Explorer
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS, TopoDS_Compound, TopoDS_Shape
from OCP.XCAFDoc import (
    XCAFDoc_ColorTool,
    XCAFDoc_ColorType,
    XCAFDoc_DocumentTool,
    XCAFDoc_MaterialTool,
    XCAFDoc_ShapeTool,
)

from vpframe.importers import wrong_side
from vpframe.importers.brep import MM, compound_of, tessellate
from vpframe.importers.crew import Make, left_out
from vpframe.importers.names import numbered
from vpframe.importers.pmi import Sizes, sizes_of
from vpframe.importers.raw import Array, Color, Options, RawPart, RawScene, RawShape, UnreadableError
from vpframe.importers.topology import explored, matrix_of

Hire = Callable[[Make, Sequence[float], Sequence[str]], dict[int, str]]
"""makes shapes; arguments: how, expected effort and words for each; returns why shapes are left out, by number"""
ColorOf = Callable[[TopoDS_Shape], Color | None]

_UNNAMED = re.compile(r"=>\[.*\]|NAUO\d+|\*[A-Z]+\d*|\d+|")
"""names that kernels and exporters write for unnamed objects: "*DIT29" is a dictionary key"""
_SEWING = 1e-5  # gaps between loose faces that are closed, m (IGES has faces only)
_GENERIC = ("SOLID", "COMPOUND", "SHELL", "COMPSOLID")
_KINDS = (XCAFDoc_ColorType.XCAFDoc_ColorSurf, XCAFDoc_ColorType.XCAFDoc_ColorGen)


@dataclass
class Node:
    """A label of the document placed under its parent."""

    name: str
    product: str
    pose: TopLoc_Location
    shape: TopoDS_Shape
    density: float
    """in the unit of the kernel; 0 if there is none"""
    color: Color | None
    children: list[Node]
    is_body: bool = False
    """whether the kernel made it of one body of its parent's shape, so that it is no product"""

    @property
    def has_bodies(self) -> bool:
        """Whether it is one product of several bodies, not an assembly."""
        return bool(self.children) and all(child.is_body for child in self.children)


def read_document(path: str, form: str, options: Options, crew: Hire) -> RawScene:
    """Read a CAD file; `crew` makes its shapes, which are not in the returned scene."""
    _begin(options, "reading the file")
    document = _transfer(path, form)
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    labels = Sequence_TDF_Label()
    shapes.GetFreeShapes(labels)
    roots = [_node(label, TopLoc_Location()) for label in labels]
    raw = RawScene()
    found = _Solids(
        raw,
        (_color_tool(document), _face_colors(document)),
        sizes_of(document, Path(path).read_bytes(), raw.notes) if form == "step" else Sizes(),
        _is_whole(roots, options.bodies),
    )
    leaves = list(_leaves(roots, found.whole))
    if form == "iges" and not any(_holds(leaf.node.shape, TopAbs_ShapeEnum.TopAbs_SOLID) for leaf in leaves):
        leaves = _joined(leaves, Path(path).stem)
    found.add_all(leaves, "export the parts as solids, not as wireframe or open surfaces")
    return found.mesh(options, crew)


def _begin(options: Options, text: str) -> None:
    """Silence the kernel and report the first stage."""
    Message.DefaultMessenger_s().RemovePrinters(Message_Printer.get_type_descriptor_s())
    if options.progress is not None:
        options.progress(0.15, text)


@dataclass
class Given:
    """A node of a tree of shapes that has no file format."""

    name: str
    file: str
    """file of its B-rep (BRepTools' text or BinTools' binary format); "" for a subassembly"""
    matrix: list[float]
    """rows of its placement under the parent: rotation | translation (mm); [] for none"""
    color: Color | None
    children: list[Given]


def read_given(roots: list[Given], options: Options, crew: Hire) -> RawScene:
    """Read a tree of B-reps as `read_document` reads a file; nodes with the same file share its shape."""
    _begin(options, "reading the shapes")
    raw, shapes = RawScene(), {}

    def node(given: Given) -> Node:
        if given.file and given.file not in shapes:
            shapes[given.file] = _brep_file(given.file)
        shape = shapes[given.file] if given.file else TopoDS_Compound()
        color = None if given.color is None else (*given.color,)
        pose = _location(given.matrix)
        return Node(given.name, given.name, pose, shape, 0.0, color, [node(child) for child in given.children])

    nodes = [node(root) for root in roots]
    found = _Solids(raw, (lambda body: None, lambda face: None), Sizes(), _is_whole(nodes, options.bodies))
    found.add_all(_leaves(nodes, found.whole), "give parts as solids, not as wires or open surfaces")
    return found.mesh(options, crew)


def _brep_file(path: str) -> TopoDS_Shape:
    shape = TopoDS_Shape()
    with open(path, "rb") as file:
        binary = file.read(64).lstrip().startswith(b"Open CASCADE Topology")
    try:
        read = BinTools.Read_s(shape, path) if binary else BRepTools.Read_s(shape, path, BRep_Builder())
    except MemoryError:
        raise
    except Exception:  # OpenCascade's exceptions share no base but Exception
        read = False
    if not read:
        raise UnreadableError("cannot be parsed as a B-rep of OpenCascade; it is damaged: write it again")
    if shape.IsNull():
        raise UnreadableError("holds no shape; write it again")
    return shape


def _location(matrix: list[float]) -> TopLoc_Location:
    if not matrix:
        return TopLoc_Location()
    trsf = gp_Trsf()
    trsf.SetValues(*matrix)
    return TopLoc_Location(trsf)


def _transfer(path: str, form: str) -> TDocStd_Document:
    document = TDocStd_Document(TCollection_ExtendedString("XmlXCAF"))
    reader = STEPCAFControl_Reader() if form == "step" else IGESCAFControl_Reader()
    reader.SetNameMode(True)
    reader.SetColorMode(True)
    if form == "step":
        reader.SetMatMode(True)
        reader.SetPropsMode(True)
        reader.SetGDTMode(True)
    if reader.ReadFile(path) != IFSelect_ReturnStatus.IFSelect_RetDone:
        raise UnreadableError("cannot be parsed; it is damaged or no such file: export it again")
    if not reader.Transfer(document):
        raise UnreadableError("holds no geometry that can be translated; export it again, as solids")
    return document


def _name(label: Any) -> str:
    if not label.IsAttribute(TDataStd_Name.GetID_s()):
        return ""
    name = TDataStd_Name()
    label.FindAttribute(TDataStd_Name.GetID_s(), name)
    return name.Get().ToExtString().strip()


def _color(label: Any) -> Color | None:
    color = Quantity_ColorRGBA()
    for kind in _KINDS:
        if XCAFDoc_ColorTool.GetColor_s(label, kind, color):
            return _rgba(color)
    return None


def _rgba(color: Quantity_ColorRGBA) -> Color:
    red, green, blue = color.GetRGB().Values(Quantity_TypeOfColor.Quantity_TOC_sRGB)  # stored as linear values
    return red, green, blue, float(color.Alpha())


def _color_tool(document: TDocStd_Document) -> ColorOf:
    """Return a function that gives the colour of a shape in a document."""
    colors: Any = XCAFDoc_DocumentTool.ColorTool_s(document.Main())

    def color_of(shape: TopoDS_Shape) -> Color | None:
        color = Quantity_ColorRGBA()
        return next((_rgba(color) for kind in _KINDS if colors.GetColor(shape, kind, color)), None)

    return color_of


def _face_colors(document: TDocStd_Document) -> ColorOf:
    """Return a function that gives the colour of a face: `_color_tool` would search all shapes for each."""
    faces, colors = ShapeMap(), list[Color | None]()
    shapes, within = Sequence_TDF_Label(), Sequence_TDF_Label()
    XCAFDoc_DocumentTool.ShapeTool_s(document.Main()).GetShapes(shapes)
    for shape in shapes:
        XCAFDoc_ShapeTool.GetSubShapes_s(shape, within)
        for label in within:
            if faces.Add(XCAFDoc_ShapeTool.GetShape_s(label)) > len(colors):
                colors.append(_color(label))
    return lambda face: colors[number - 1] if (number := faces.FindIndex(face)) else None


def _node(label: Any, pose: TopLoc_Location, within: str = "part") -> Node:
    referred = label
    if XCAFDoc_ShapeTool.IsReference_s(label):
        referred = TDF_Label()
        XCAFDoc_ShapeTool.GetReferredShape_s(label, referred)
        pose = XCAFDoc_ShapeTool.GetLocation_s(label)
    product, name = _name(referred), _name(label)
    is_body = product in _GENERIC and (not name or name.startswith("=>"))
    if not product or product in _GENERIC:  # a solid of a product with several representations
        product = within
    if _UNNAMED.fullmatch(name):
        name = _name(referred) or within
    children = []
    if XCAFDoc_ShapeTool.IsAssembly_s(referred):
        components = Sequence_TDF_Label()
        XCAFDoc_ShapeTool.GetComponents_s(referred, components)
        children = [_node(component, TopLoc_Location(), product) for component in components]
        children = [child for child in children if child.children or _holds(child.shape, TopAbs_ShapeEnum.TopAbs_FACE)]
    shape = XCAFDoc_ShapeTool.GetShape_s(referred)
    density = XCAFDoc_MaterialTool.GetDensityForShape_s(referred)
    color = _color(label) or _color(referred)
    return Node(name, product, pose, shape, density, color, children, is_body and not children)


def _holds(shape: TopoDS_Shape, kind: TopAbs_ShapeEnum) -> bool:
    return TopExp_Explorer(shape, kind).More()


@dataclass
class Leaf:
    """An instance of a shape in the tree."""

    path: str
    """names from the root, separated by slashes; a single root is left out"""
    node: Node
    pose: TopLoc_Location
    color: Color | None
    owner: tuple[int, ...]
    """indices, from the root, of the product instance it belongs to"""


def _is_whole(roots: Sequence[Node], bodies: str | None) -> bool:
    """Whether a product is one part, whatever number of bodies it has: `bodies`, else if the file has assemblies."""
    if bodies:
        return bodies == "whole"
    return any(root.children and not root.has_bodies for root in roots)


def _leaves(roots: list[Node], whole: bool) -> Iterator[Leaf]:
    """Yield the instances of products; without `whole`, those of bodies that the kernel has as nodes."""

    def walk(node: Node, leaf: Leaf) -> Iterator[Leaf]:
        leaf.color = leaf.color or node.color
        if not node.children or (whole and node.has_bodies):
            yield leaf
            return
        for i, (name, child) in enumerate(zip(numbered(c.name for c in node.children), node.children, strict=True)):
            alone = len(node.children) == 1 and child.name in _GENERIC and not child.children and leaf.path
            path = leaf.path if alone else f"{leaf.path}/{name}" if leaf.path else name
            owner = leaf.owner if child.product == node.product and not child.children else (*leaf.owner, i)
            yield from walk(child, Leaf(path, child, leaf.pose.Multiplied(child.pose), leaf.color, owner))

    for i, (name, root) in enumerate(zip(numbered(r.name for r in roots), roots, strict=True)):
        path = "" if len(roots) == 1 and root.children and not (whole and root.has_bodies) else name
        yield from walk(root, Leaf(path, root, root.pose, None, (i,)))


def _joined(leaves: list[Leaf], name: str) -> list[Leaf]:
    """Merge all leaves into one, because the loose faces of a file without solids belong together."""
    compound = compound_of(leaf.node.shape.Moved(leaf.pose) for leaf in leaves)
    node = Node(name, name, TopLoc_Location(), compound, 0.0, None, [])
    return [Leaf(name, node, TopLoc_Location(), leaves[0].color if leaves else None, (0,))]


class _Solids:
    """Collects solids; instances of one solid become parts of one shape."""

    def __init__(self, raw: RawScene, colors: tuple[ColorOf, ColorOf], sizes: Sizes, whole: bool) -> None:
        self.raw = raw
        self.color, self.face_color = colors
        self.sizes = sizes
        self.whole = whole
        self.shapes: list[TopoDS_Shape] = []
        self._has_solid = False
        self._product = ""
        self._owners: set[tuple[int, ...]] = set()
        self._known: list[tuple[TopoDS_Shape, list[TopoDS_Shape]]] = []
        self._joined: dict[int, TopoDS_Shape] = {}
        self._joined_products: dict[str, int] = {}

    def add_all(self, leaves: Iterable[Leaf], mend: str) -> None:
        """Add parts for all leaves. Raises UnreadableError, with how to `mend` it, if none holds a closed solid."""
        for leaf in leaves:
            self._add(leaf)
        if self._joined_products:
            named = ", ".join(f"{name} ({count} bodies)" for name, count in self._joined_products.items())
            self.raw.notes.append(f"one rigid part for each product of several bodies: {named}")
        if not self._has_solid:
            raise UnreadableError(f"holds no closed solid; {mend}")

    def _add(self, leaf: Leaf) -> None:
        """Add parts for every body of a leaf, or one for all: its solids, and its sheets outside solids."""
        self._product = leaf.node.product
        solids = self._explored(leaf.node.shape)
        density = _density(next(filter(None, (node.density for node in (leaf.node, *leaf.node.children))), 0.0))
        self._has_solid |= any(solid.ShapeType() == TopAbs_ShapeEnum.TopAbs_SOLID for solid in solids)
        colors = [child.color for child in leaf.node.children if child.color]
        bodies = [self._whole(solids)] if self.whole and len(solids) > 1 else solids
        if len(bodies) < len(solids):
            self._joined_products.setdefault(leaf.node.product, len(solids))
        for i, body in enumerate(bodies, 1):
            place = leaf.pose.Multiplied(body.Location())
            number = self._number(body, place)
            rotation, translation, _ = _rigid(place)
            color = leaf.color or self.color(body) or next(filter(None, map(self.color, solids)), None)
            name = leaf.path if len(bodies) == 1 else f"{leaf.path}/{i}"
            self.raw.parts.append(
                RawPart(name, number, rotation, translation, color or next(iter(colors), None), density)
            )
        product = leaf.node.product
        if leaf.owner not in self._owners:
            self._owners.add(leaf.owner)
            self.raw.instances[product] += 1
        faces = ShapeMap()
        for solid in solids:
            TopExp.MapShapes_s(solid, TopAbs_ShapeEnum.TopAbs_FACE, faces)
        self.raw.faces[product] += faces.Extent()

    def _whole(self, bodies: list[TopoDS_Shape]) -> TopoDS_Shape:
        """Compound of the bodies of a product, the same for each of its instances."""
        return self._joined.setdefault(id(bodies), compound_of(bodies))

    def _explored(self, shape: TopoDS_Shape) -> list[TopoDS_Shape]:
        """`_explore` with a cache for instances, since sewing creates new shapes each time."""
        for known, solids in self._known:
            if known.IsEqual(shape):
                return solids
        self._known.append((shape, [self._mended(body) for body in _explore(shape)]))
        return self._known[-1][1]

    def _mended(self, body: TopoDS_Shape) -> TopoDS_Shape:
        mended = wrong_side.mended(body)
        if mended is not None:
            self.raw.notes.append(
                f"{self._product}: the sense of a spherical face is wrong in the file; the other side of its border, "
                "which leaves the smaller volume, is taken"
            )
        return mended or body

    def _number(self, solid: TopoDS_Shape, place: TopLoc_Location) -> int:
        own = solid.Located(TopLoc_Location())
        if not _rigid(place)[2]:  # mirrored or scaled: transformed into a shape of its own
            return self._new(BRepBuilderAPI_Transform(own, place.Transformation(), True).Shape())
        for number, known in enumerate(self.shapes):
            if known.IsPartner(own) and known.Orientation() == own.Orientation():
                return number
        return self._new(own)

    def _new(self, shape: TopoDS_Shape) -> int:
        self.shapes.append(shape)
        return len(self.shapes) - 1

    def mesh(self, options: Options, crew: Hire) -> RawScene:
        """Mesh every shape once; parts whose shape has no triangles are named and left out."""
        first: dict[int, str] = {}
        for part in self.raw.parts:
            first.setdefault(part.shape, part.name)
        faces = [sum(1 for _ in explored(shape, TopAbs_ShapeEnum.TopAbs_FACE)) for shape in self.shapes]

        def make(number: int, mesher: bool, tell: Callable[[float], None]) -> RawShape:
            shape = self.shapes[number]
            return tessellate(shape, options.deflection, options.angular, self.face_color, self.sizes.of, tell, mesher)

        lost = crew(make, faces, [f"meshing {first[number]}" for number in range(len(faces))])
        left_out(self.raw, lost)
        if not self.raw.parts:
            raise UnreadableError("no part of it can be meshed; check it in a CAD program and export it again")
        return self.raw


def _explore(shape: TopoDS_Shape) -> list[TopoDS_Shape]:
    """Return the solids of a shape, and its loose faces sewn to shells, or to solids if these are closed."""
    found = list(explored(shape, TopAbs_ShapeEnum.TopAbs_SOLID))
    loose = list(explored(shape, TopAbs_ShapeEnum.TopAbs_FACE, TopAbs_ShapeEnum.TopAbs_SOLID))
    if not loose:
        return found
    sewing = BRepBuilderAPI_Sewing(_SEWING / MM)
    for face in loose:
        sewing.Add(face)
    sewing.Perform()
    sewn = sewing.SewedShape()
    for shell in explored(sewn, TopAbs_ShapeEnum.TopAbs_SHELL):
        if not BRep_Tool.IsClosed_s(shell):
            found.append(shell)
            continue
        solid = BRepBuilderAPI_MakeSolid(TopoDS.Shell(shell)).Solid()
        BRepLib.OrientClosedSolid_s(solid)
        found.append(solid)
    return [*found, *explored(sewn, TopAbs_ShapeEnum.TopAbs_FACE, TopAbs_ShapeEnum.TopAbs_SHELL)]


def _rigid(location: TopLoc_Location) -> tuple[Array, Array, bool]:
    """Return rotation, translation (m) and whether the location is rigid; identity and zero if not."""
    matrix = matrix_of(location.Transformation())
    rotation, translation = matrix[:, :3], matrix[:, 3] * MM
    if not np.allclose(rotation.T @ rotation, np.eye(3), atol=1e-6) or np.linalg.det(rotation) < 0:
        return np.eye(3), np.zeros(3), False
    u, _, vt = np.linalg.svd(rotation)  # the nearest rotation, because files have six digits
    return u @ vt, translation, True


def _density(value: float) -> float | None:
    """Convert the kernel's density to kg/m³ by the first plausible unit of g/mm³, g/cm³ and kg/m³."""
    return next((value * factor for factor in (1e6, 1e3, 1.0) if 20.0 <= value * factor <= 23000.0), None)
