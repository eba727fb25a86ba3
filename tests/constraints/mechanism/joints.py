"""Joints and linkages of two and more bodies, and their poses in a Pinocchio model."""

import numpy as np
import pinocchio as pin

from constraints import Against, Concentric, Coplanar, Screw, Spherical
from constraints.geometry.surfaces import Cylinder, Plane, Sphere
from constraints.mechanism.urdf import load_urdf, to_urdf
from tests.constraints.shapes import at

Z = np.array([0.0, 0.0, 1.0])


def concentric(a, b, at_a, at_b=(0, 0, 0)):
    return Concentric((a, b), (Cylinder(at_a, Z, 0.01), Cylinder(at_b, Z, 0.01)))


def against(a, b, z_a=0.0, z_b=0.0):
    return Against((a, b), (Plane([0, 0, z_a], Z), Plane([0, 0, z_b], -Z)))


def hinge(a, b, at_a, at_b=(0, 0, 0)):
    return [concentric(a, b, at_a, at_b), against(a, b)]


CASES = {
    "revolute": hinge(0, 1, [0.1, 0, 0]),
    "cylindrical": [concentric(0, 1, [0.1, 0, 0])],
    "planar": [against(0, 1)],
    "spherical": [Spherical((0, 1), (Sphere([0.1, 0, 0], 0.02), Sphere([0, 0, 0], 0.02)))],
    "screw": [Screw((0, 1), (Cylinder([0.1, 0, 0], Z, 0.01), Cylinder([0, 0, 0], Z, 0.01)), pitch=2e-3)],
    "screw left-hand": [Screw((0, 1), (Cylinder([0.1, 0, 0], Z, 0.01), Cylinder([0, 0, 0], Z, 0.01)), pitch=-1.5e-3)],
    "screw left-hand, axes opposed": [
        Screw((0, 1), (Cylinder([0.1, 0, 0], -Z, 0.01), Cylinder([0, 0, 0], Z, 0.01)), pitch=-1.5e-3).engaged(
            at(), at(x=0.1)
        )
    ],
    "prismatic": [
        against(0, 1),
        Coplanar((0, 1), (Plane([0.1, 0, 0], [1.0, 0, 0]), Plane([0, 0, 0], [1.0, 0, 0]))),
    ],
    "free": [],
}


def frames(model, q):
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return {f.name: data.oMf[i] for i, f in enumerate(model.frames)}


def both(made, path, **options):
    path.write_text(to_urdf(made, **options), encoding="utf-8")
    return made.model(), load_urdf(path)
