"""Exact overlaps of planar faces."""

import numpy as np
import pinocchio as pin
import pytest

from tests.vpframe.fitted import AT_HOME, at, kinds
from vpframe.analysis.clash import clash
from vpframe.scene import modelling as m
from vpframe.scene.deflection import deflections

BORED = m.box(0.04, 0.04, 0.01) - m.cylinder(0.01, 0.01).translated(0.02, 0.02, 0.0)


COARSE = {"deflection": 1e-4, "angular": 0.7}


@pytest.mark.parametrize("overlap", [3e-5, 1.2e-5])
@pytest.mark.parametrize(
    ("solid", "pose"),
    [
        (BORED, lambda dz: at(0.001, 0.002, 0.01 - dz)),
        (m.cylinder(0.015, 0.01), lambda dz: at(0.02, 0.02, 0.01 - dz)),
        (
            m.box(0.01, 0.01, 0.01),
            lambda dz: pin.SE3(pin.rpy.rpyToMatrix(np.pi / 4, 0.0, 0.0), np.array([0.002, 0.004, 0.01 - dz])),
        ),
    ],
    ids=["bored plate", "disc", "edge"],
)
def test_planes_are_exact_whatever_bores_are_cut_into_them(solid, pose, overlap):
    """Planes that overlap by less than the facets of a bore in them sag, 48 µm here, clash all the same."""
    deep = clash(m.scene({"a": (BORED, AT_HOME), "b": (solid, pose(overlap))}, **COARSE))
    assert max(deflections(m.shape(BORED, **COARSE))) > 4e-5
    clashes = [p for p in deep if p.kind == "clash"]
    assert clashes and max(p.depth for p in clashes) == pytest.approx(overlap, abs=1e-8)
    assert kinds(clash(m.scene({"a": (BORED, AT_HOME), "b": (solid, pose(0.0))}, **COARSE))) <= {"contact"}
    meant = clash(m.scene({"a": (BORED, AT_HOME), "b": (solid, pose(overlap))}, **COARSE), authorised=[("a", "b")])
    assert kinds(meant) <= {"contact", "authorised"}
