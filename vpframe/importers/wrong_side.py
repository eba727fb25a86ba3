"""Mend solids whose file takes the wrong side of a sphere's border: the rest of the ball instead of the small cap.

A face with the wrong sense leaves its shell inside out: the kernel then turns the whole shell, and the solid becomes
what the ball leaves around it.
"""

from __future__ import annotations

import numpy as np
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.BRepGProp import BRepGProp
from OCP.GeomAbs import GeomAbs_SurfaceType
from OCP.GProp import GProp_GProps
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS, TopoDS_Face, TopoDS_Shape, TopoDS_Shell, TopoDS_Solid

from vpframe.importers.topology import explored


def mended(solid: TopoDS_Shape) -> TopoDS_Shape | None:
    """Return the solid with the other side of a sphere's border; None if nothing shows that a side is wrong.

    That is so where the kernel turned the shell, a spherical face without seam of its own covers more than half of its
    sphere, and the other side gives a positive, smaller volume.
    """
    first = next(explored(solid, TopAbs_ShapeEnum.TopAbs_SHELL), None)
    if first is None or first.Orientation() != TopAbs_Orientation.TopAbs_REVERSED:
        return None
    faces = [TopoDS.Face(shape) for shape in explored(first, TopAbs_ShapeEnum.TopAbs_FACE)]
    for i, face in enumerate(faces):
        other = _other_side(face)
        if other is None:
            continue
        shell, whole, builder = TopoDS_Shell(), TopoDS_Solid(), BRep_Builder()
        builder.MakeShell(shell)
        for k, beside in enumerate(faces):
            builder.Add(shell, other if k == i else beside.Reversed())
        shell.Closed(True)
        builder.MakeSolid(whole)
        builder.Add(whole, shell)
        if 0.0 < _volume(whole) < _volume(solid):
            return whole
    return None


def _other_side(face: TopoDS_Face) -> TopoDS_Face | None:
    """Return a face with the borders of a spherical face and the other side of them, if that is the smaller one."""
    surface = BRepAdaptor_Surface(face)
    if surface.GetType() != GeomAbs_SurfaceType.GeomAbs_Sphere:
        return None
    properties = GProp_GProps()
    BRepGProp.SurfaceProperties_s(face, properties)
    wires = [wire for wire in explored(face, TopAbs_ShapeEnum.TopAbs_WIRE) if not _is_seam(wire, face)]
    if len(wires) != 1 or properties.Mass() <= 2.0 * np.pi * surface.Sphere().Radius() ** 2:
        return None
    location = TopLoc_Location()
    other, builder = TopoDS_Face(), BRep_Builder()
    builder.MakeFace(other, BRep_Tool.Surface_s(face, location), location, BRep_Tool.Tolerance_s(face))
    forward = TopoDS.Face(face.Oriented(TopAbs_Orientation.TopAbs_FORWARD))
    wire = next(wire for wire in explored(forward, TopAbs_ShapeEnum.TopAbs_WIRE) if wire.IsSame(wires[0]))
    builder.Add(other, wire.Reversed())
    return TopoDS.Face(other.Oriented(face.Orientation()))


def _is_seam(wire: TopoDS_Shape, face: TopoDS_Face) -> bool:
    """Whether a wire is the border of the whole sphere, in parameters."""
    return any(
        BRep_Tool.Degenerated_s(TopoDS.Edge(edge)) or BRep_Tool.IsClosed_s(TopoDS.Edge(edge), face)
        for edge in explored(wire, TopAbs_ShapeEnum.TopAbs_EDGE)
    )


def _volume(solid: TopoDS_Shape) -> float:
    properties = GProp_GProps()
    BRepGProp.VolumeProperties_s(solid, properties)
    return float(properties.Mass())
