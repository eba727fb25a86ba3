"""Solids as OpenCascade has them, and what they are by its measure."""

import numpy as np
from OCP.BRepBuilderAPI import BRepBuilderAPI_NurbsConvert
from OCP.BRepGProp import BRepGProp
from OCP.GProp import GProp_GProps
from OCP.ShapeUpgrade import ShapeUpgrade_ShapeDivideAngle

import vpframe as vp
from vpframe.scene import modelling as m


def untyped(solid: m.Solid) -> m.Solid:
    """The solid as many exporters write it: closed faces in halves, every surface a spline."""
    divide = ShapeUpgrade_ShapeDivideAngle(np.pi, solid.occ)
    divide.Perform()
    return m.Solid(BRepBuilderAPI_NurbsConvert(divide.Result()).Shape())


def bracket() -> m.Solid:
    """A block with a bore, a stepped pin, a countersink, a dimple and a ring groove: every kind of surface."""
    solid = m.box(0.06, 0.04, 0.02) - m.cylinder(0.005, 0.02).translated(0.015, 0.02)
    solid -= m.cone(0.0, 0.004, 0.004).translated(0.045, 0.01, 0.016)
    solid -= m.sphere(0.004).translated(0.045, 0.03, 0.02)
    return solid - m.torus(0.008, 0.001).translated(0.015, 0.02, 0.02)


def truth(shape: vp.Shape) -> list[tuple[str, int, float]]:
    sizes = {"cylinder": "radius", "cone": "half_angle", "sphere": "radius", "torus": "minor", "plane": None}
    return sorted(
        (f.geometry.kind, f.sense, round(getattr(f.geometry, sizes[f.geometry.kind] or "", 0.0), 6))
        for f in shape.features
    )


WORKPIECES = {
    "box": m.box(0.1, 0.1, 0.1),
    "cylinder": m.cylinder(0.05, 0.1),
    "cone": m.cone(0.05, 0.02, 0.03),
    "tip": m.cone(0.05, 0.0, 0.03),
    "ball": m.sphere(0.05),
    "cap": m.sphere(0.05) - m.box(0.2, 0.2, 0.1).translated(-0.1, -0.1, -0.08),
    "ring": m.torus(0.05, 0.01),
    "rounded": m.box(0.1, 0.08, 0.02).filleted(0.004),
    "tilted": (m.box(0.1, 0.1, 0.1) - m.cylinder(0.02, 0.3).translated(0.05, 0.05, -0.1)).rotated([1, 2, 3], 0.7),
    "crossed": m.cylinder(0.03, 0.1) + m.cylinder(0.02, 0.1).rotated([0, 1, 0], 1.2),
    "grooved": m.cylinder(0.03, 0.1) - m.torus(0.03, 0.005).translated(0.0, 0.0, 0.05),
}


def exact_volume(shape) -> float:
    """Signed, mm³."""
    properties = GProp_GProps()
    BRepGProp.VolumeProperties_s(shape, properties)
    return properties.Mass()
