"""Deflection of triangles from their true surfaces."""

import numpy as np
import pinocchio as pin
import pytest

from tests.vpframe.fitted import AT_HOME, kinds
from vpframe.analysis.clash import clash
from vpframe.scene import modelling as m
from vpframe.scene.deflection import deflections


@pytest.mark.parametrize("angular", [0.1, 0.35, 0.7])
def test_deflection_is_that_of_the_chords(angular):
    radius = 0.01
    shape = m.shape(m.cylinder(radius, 0.03), deflection=1.0, angular=angular)
    mesh = shape.mesh
    sides = next(s for s in shape.surfaces if s.orientation == "convex")
    ring = np.unique(
        np.round(mesh.vertices[mesh.triangles[mesh.triangles_of(sides.index)]].reshape(-1, 3)[:, :2], 12), axis=0
    )
    sagitta = radius * (1.0 - np.cos(np.pi / len(ring)))
    # the flat ends end at the same chords
    assert deflections(shape) == pytest.approx([sagitta] * 3, rel=0.02)


BORED = m.box(0.04, 0.04, 0.01) - m.cylinder(0.01, 0.01).translated(0.02, 0.02, 0.0)


COARSE = {"deflection": 1e-4, "angular": 0.7}


@pytest.mark.parametrize(
    ("solid", "pose"),
    [
        # a square key whose corners lie on the bore's circle: the bore's chords cut them off
        (
            m.box(0.01 * 2**0.5, 0.01 * 2**0.5, 0.03).translated(-0.01 / 2**0.5, -0.01 / 2**0.5, 0.0),
            pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, 0.3), np.array([0.02, 0.02, -0.01])),
        ),
        # a pin that ends 30 µm below the plate's face: chords of bore and pin overlap in a sliver
        (
            m.cylinder(0.01, 0.00997),
            pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, 0.1), np.array([0.02, 0.02, 0.0])),
        ),
    ],
    ids=["key", "pin"],
)
def test_a_curved_border_still_strays_within_its_plane(solid, pose):
    assert kinds(clash(m.scene({"a": (BORED, AT_HOME), "b": (solid, pose)}, **COARSE))) == {"contact"}
