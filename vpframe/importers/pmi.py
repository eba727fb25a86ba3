"""Toleranced sizes of an AP242 file (semantic PMI): diameters of bores and shafts with deviations or class."""

from __future__ import annotations

import re
from collections import Counter
from typing import Any

from OCP.collections import Sequence_TDF_Label
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopoDS import TopoDS_Shape
from OCP.XCAFDimTolObjects import (
    XCAFDimTolObjects_DimensionFormVariance,
    XCAFDimTolObjects_DimensionGrade,
    XCAFDimTolObjects_DimensionType,
)
from OCP.XCAFDoc import XCAFDoc_Dimension, XCAFDoc_DimTolTool, XCAFDoc_DocumentTool, XCAFDoc_ShapeTool

from vpframe.importers.brep import MM
from vpframe.importers.raw import Size
from vpframe.importers.topology import explored

_TWICE = {
    XCAFDimTolObjects_DimensionType.XCAFDimTolObjects_DimensionType_Size_Diameter: 1.0,
    XCAFDimTolObjects_DimensionType.XCAFDimTolObjects_DimensionType_Size_Radius: 2.0,
}
"""supported kinds of size, with the factor to the diameter"""


_MEASURE = re.compile(
    rb"#(\d+)\s*=\s*[^;]*?MEASURE_WITH_UNIT\s*\(\s*(?:[A-Z_]*MEASURE\s*\(\s*)?([-+]?\d+\.?\d*(?:E[-+]?\d+)?)\s*\)?\s*,"
)
_TOLERANCE = re.compile(rb"TOLERANCE_VALUE\s*\(\s*#(\d+)\s*,\s*#(\d+)\s*\)")


class Sizes:
    """Toleranced diameters by face."""

    def __init__(self) -> None:
        self._known: list[tuple[TopoDS_Shape, Size]] = []

    def add(self, face: TopoDS_Shape, size: Size) -> None:
        """Add the size of a face."""
        self._known.append((face, size))

    def of(self, face: TopoDS_Shape) -> Size | None:
        """Return the size of a face at any location; None if it has none."""
        return next((size for known, size in self._known if known.IsPartner(face)), None)


def sizes_of(document: TDocStd_Document, data: bytes, notes: list[str]) -> Sizes:
    """Return the sizes of a document's faces; other dimensions and tolerances are counted in `notes`.

    data: content of the file. The kernel loses the signs of deviations on one side of the nominal size (+0.020/+0.005);
    in files that have such, only classes are read.
    """
    sizes = Sizes()
    tool: Any = XCAFDoc_DocumentTool.DimTolTool_s(document.Main())
    labels = Sequence_TDF_Label()
    tool.GetDimensionLabels(labels)
    trusted = not labels.Length() or not _one_sided(data)
    unread: Counter[str] = Counter()
    for label in labels:
        if not label.IsAttribute(XCAFDoc_Dimension.GetID_s()):
            continue
        stated = XCAFDoc_Dimension.Set_s(label).GetObject()  # existing attribute
        faces = _faces(label)
        if stated.GetType() not in _TWICE or not faces:
            unread[stated.GetType().name.rpartition("DimensionType_")[2]] += 1
            continue
        size = _size(stated, _TWICE[stated.GetType()], trusted)
        if size is None:
            unread["sizes with deviations on one side"] += 1
            continue
        for face in faces:
            sizes.add(face, size)
    tool.GetGeomToleranceLabels(labels)
    if labels.Length():
        unread["tolerances of form and place"] += labels.Length()
    if unread:
        counted = ", ".join(f"{kind} ({n})" for kind, n in sorted(unread.items()))
        notes.append(f"PMI that is not read: {counted}; only diameters and radii of faces are")
    return sizes


def _faces(label: Any) -> list[TopoDS_Shape]:
    first, second = Sequence_TDF_Label(), Sequence_TDF_Label()
    XCAFDoc_DimTolTool.GetRefShapeLabel_s(label, first, second)
    shapes = map(XCAFDoc_ShapeTool.GetShape_s, first)
    return [face for shape in shapes for face in explored(shape, TopAbs_ShapeEnum.TopAbs_FACE)]


def _one_sided(data: bytes) -> bool:
    """Whether a tolerance of the file has both deviations on the same side of the nominal size."""
    values = {int(number): float(value) for number, value in _MEASURE.findall(data)}
    pairs = (tuple(map(int, pair)) for pair in _TOLERANCE.findall(data))
    return any(a in values and b in values and values[a] * values[b] > 0.0 for a, b in pairs)


def _size(stated: Any, twice: float, trusted: bool) -> Size | None:
    """Return nominal size, deviations and class of a dimension (a range gives deviations); None if they are unknown."""
    scale = twice * MM
    if stated.IsDimWithRange():
        lower, upper = stated.GetLowerBound() * scale, stated.GetUpperBound() * scale
        if not (trusted and 0.0 < lower <= upper):
            return None
        return 0.5 * (lower + upper), 0.5 * (lower - upper), 0.5 * (upper - lower), ""
    nominal = stated.GetValue() * scale
    if stated.IsDimWithClassOfTolerance():
        variance = XCAFDimTolObjects_DimensionFormVariance(0)  # objects of their own, which the kernel fills
        grade = XCAFDimTolObjects_DimensionGrade(0)
        hole = False
        stated.GetClassOfTolerance(hole, variance, grade)
        letter = XCAFDimTolObjects_DimensionFormVariance(int(variance)).name.rpartition("_")[2]
        number = XCAFDimTolObjects_DimensionGrade(int(grade)).name.rpartition("_IT")[2]
        return nominal, None, None, f"{letter}{number}"
    if stated.IsDimWithPlusMinusTolerance():
        if not trusted:
            return None
        return nominal, -abs(stated.GetLowerTolValue()) * scale, stated.GetUpperTolValue() * scale, ""
    return nominal, None, None, ""
