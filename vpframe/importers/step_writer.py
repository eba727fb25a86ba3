"""Write a scene as a STEP file (AP242) with OpenCascade, in the child process of `vpframe.exporters.step`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from OCP.APIHeaderSection import APIHeaderSection_MakeHeader
from OCP.gp import gp_Trsf
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.Interface import Interface_Static
from OCP.Message import Message, Message_Printer
from OCP.Quantity import Quantity_Color, Quantity_ColorRGBA, Quantity_TypeOfColor
from OCP.STEPCAFControl import STEPCAFControl_Writer
from OCP.STEPControl import STEPControl_StepModelType
from OCP.TCollection import TCollection_ExtendedString, TCollection_HAsciiString
from OCP.TDataStd import TDataStd_Name
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopLoc import TopLoc_Location
from OCP.XCAFDoc import XCAFDoc_ColorType, XCAFDoc_DocumentTool

from vpframe.codec import Codec
from vpframe.importers.brep import MM, brep_shape
from vpframe.importers.raw import Color, UnreadableError
from vpframe.importers.topology import mapped
from vpframe.outputs import GENERATOR

GRAMS = 1e-3
"""g/cm³ for 1 kg/m³: the unit of XCAF's materials"""


def write_step(content: str, path: str) -> None:
    """Write the data in the file `content`, encoded by `vpframe.exporters.step`, to `path`.

    Raises UnreadableError if the kernel fails.
    """
    data = Codec().decode(Path(content).read_bytes())
    Message.DefaultMessenger_s().RemovePrinters(Message_Printer.get_type_descriptor_s())
    document = TDocStd_Document(TCollection_ExtendedString("XmlXCAF"))
    XCAFDoc_DocumentTool.SetLengthUnit_s(document, MM)
    tree = _Tree(document, data["name"], [shape.tobytes() for shape in data["shapes"]])
    for part in data["parts"]:
        tree.add(*part)
    tree.shapes.UpdateAssemblies()
    writer = STEPCAFControl_Writer()
    Interface_Static.SetCVal_s("write.step.schema", "AP242DIS")
    writer.SetNameMode(True)
    writer.SetColorMode(True)
    writer.SetMaterialMode(True)
    if not writer.Transfer(document, STEPControl_StepModelType.STEPControl_AsIs):
        raise UnreadableError("the CAD kernel cannot translate it to STEP")
    header = APIHeaderSection_MakeHeader(writer.ChangeWriter().Model())
    header.SetOriginatingSystem(TCollection_HAsciiString(GENERATOR))
    if writer.Write(path) != IFSelect_ReturnStatus.IFSelect_RetDone:
        raise UnreadableError("the CAD kernel cannot write the STEP file")


class _Tree:
    """Labels of an assembly: subassemblies by path, products by content."""

    def __init__(self, document: TDocStd_Document, name: str, breps: list[bytes]) -> None:
        self.shapes: Any = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
        self._colors: Any = XCAFDoc_DocumentTool.ColorTool_s(document.Main())
        self._materials: Any = XCAFDoc_DocumentTool.MaterialTool_s(document.Main())
        self._breps = breps
        self._read: dict[int, Any] = {}
        self._root = self.shapes.NewShape()
        _name(self._root, name)
        self._assemblies: dict[tuple[str, ...], Any] = {(): self._root}
        self._products: dict[tuple[Any, ...], Any] = {}

    def add(
        self,
        path: list[str],
        shape: int,
        product: str,
        pose: list[float],
        color: Color,
        density: float | None,
        faces: list[tuple[int, Color]],
    ) -> None:
        """Add an instance of a product; `pose`: rows of rotation | translation (mm), world."""
        key = (shape, product, density)
        if key not in self._products:
            self._products[key] = self._product(shape, product, density, faces)
        trsf = gp_Trsf()
        trsf.SetValues(*pose)
        component = self.shapes.AddComponent(
            self._assembly(tuple(path[:-1])), self._products[key], TopLoc_Location(trsf)
        )
        _name(component, path[-1])
        self._colors.SetColor(component, _rgba(color), XCAFDoc_ColorType.XCAFDoc_ColorGen)

    def _assembly(self, path: tuple[str, ...]) -> Any:
        if path not in self._assemblies:
            assembly = self.shapes.NewShape()
            _name(assembly, path[-1])
            component = self.shapes.AddComponent(self._assembly(path[:-1]), assembly, TopLoc_Location())
            _name(component, path[-1])
            self._assemblies[path] = assembly
        return self._assemblies[path]

    def _product(self, number: int, name: str, density: float | None, faces: list[tuple[int, Color]]) -> Any:
        shape = brep_shape(self._breps[number])
        label = self.shapes.AddShape(shape, False)
        _name(label, name)
        if density is not None:
            text = TCollection_HAsciiString
            named = text(f"density {density:.17g} kg/m3")  # readers merge materials of the same name
            given = (named, text(""), density * GRAMS, text("density"), text("POSITIVE_RATIO_MEASURE"))
            self._materials.SetMaterial(label, *given)
        known = mapped(shape, TopAbs_ShapeEnum.TopAbs_FACE)
        for face, color in faces:
            sub = self.shapes.AddSubShape(label, known.FindKey(face))
            self._colors.SetColor(sub, _rgba(color), XCAFDoc_ColorType.XCAFDoc_ColorSurf)
        return label


def _name(label: Any, name: str) -> None:
    TDataStd_Name.Set_s(label, TCollection_ExtendedString(name, True))


def _rgba(color: Color) -> Quantity_ColorRGBA:
    red, green, blue, alpha = color
    return Quantity_ColorRGBA(Quantity_Color(red, green, blue, Quantity_TypeOfColor.Quantity_TOC_sRGB), alpha)
