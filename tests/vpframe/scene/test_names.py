"""One name for a face everywhere."""

import math

import pinocchio as pin
import pytest

from constraints.geometry.surfaces import Cone, Cylinder, Freeform, Plane, Sphere, Torus
from tests.vpframe.watching import box
from vpframe.scene import modelling
from vpframe.scene.names import face_name, face_words, geometry_words
from vpframe.scene.scene import Part

HOME, Z = [0, 0, 0], [0, 0, 1]
HERE = pin.SE3.Identity()


@pytest.mark.parametrize(
    ("geometry", "orientation", "words"),
    [
        (Plane(HOME, Z), "flat", "plane"),
        (Cylinder(HOME, Z, 0.01), "concave", "bore Ø20"),
        (Cylinder(HOME, Z, 0.01002), "convex", "shaft Ø20.04"),
        (Cylinder(HOME, Z, 0.01), "", "cylinder Ø20"),
        (Cylinder(HOME, Z, 0.0099999999), "concave", "bore Ø20"),  # as fitted to a tessellation
        (Cylinder(HOME, Z, 1.2345e-5), "convex", "shaft Ø0.0247"),
        (Cone(HOME, Z, math.radians(45.0)), "concave", "cone 90°"),
        (Sphere(HOME, 0.0015), "convex", "sphere Ø3"),
        (Torus(HOME, Z, 0.02, 0.002), "convex", "torus Ø40 × Ø4"),
        (Freeform(), "free", "free form"),
    ],
)
def test_a_face_is_called_what_it_is(geometry, orientation, words):
    assert geometry_words(geometry, orientation) == words


def test_a_bore_of_a_real_shape_has_its_number_and_its_diameter():
    block = modelling.box(0.04, 0.04, 0.03).translated(-0.02, -0.02, 0.0) - modelling.cylinder(0.010, 0.03)
    part = Part("machine/housing", modelling.shape(block), HERE)
    (bore,) = [s.index for s in part.surfaces if isinstance(s.geometry, Cylinder)]
    assert face_name(part, bore) == f"machine/housing · face {bore} · bore Ø20"
    flat = [s.index for s in part.surfaces if isinstance(s.geometry, Plane)]
    assert face_words(part, *flat) == f"faces {', '.join(map(str, flat))} · plane"
    assert face_words(part, flat[0], bore).endswith(" · plane, bore Ø20")
    assert face_words(part, *range(7)).startswith("faces 0, 1, 2, 3, 4, 5 … (7) · ")


def test_a_face_that_is_not_there_has_its_number():
    assert face_words(Part("a", box(), HERE), 99) == "face 99"
