"""Fit classes against the tables of ISO 286-2, and recognition by class."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from collision import CollisionManager, Tolerance
from constraints import recognise
from constraints.recognition.iso286 import FitClassError, fit_class
from tests.constraints.shapes import housing, shaft


@pytest.mark.parametrize(
    ("name", "diameter", "least", "most"),
    [
        ("H7/g6", 0.020, 7, 41),
        ("H7/h6", 0.020, 0, 34),
        ("H8/f7", 0.020, 20, 74),
        ("H7/g6", 0.040, 9, 50),
        ("H8/e8", 0.100, 72, 180),
        ("H7/g6", 0.010, 5, 29),
        ("H7/g6", 0.0101, 6, 35),
        ("H11/h11", 0.100, 0, 440),
        ("H7/f7", 0.300, 56, 160),
        ("H8/h7", 0.008, 0, 37),
        ("D10/h9", 0.010, 40, 134),
    ],
)
def test_tables_of_the_standard(name, diameter, least, most):
    found = fit_class(name, diameter)
    assert found.least == pytest.approx(1e-6 * least, abs=1e-12)
    assert found.most == pytest.approx(1e-6 * most, abs=1e-12)


@pytest.mark.parametrize("name", ["H7", "h7/g6", "H4/g6", "H7/k6", "", "H7/g6 "])
def test_unknown_classes_are_named(name):
    with pytest.raises(FitClassError, match="not known") as error:
        fit_class(name, 0.02)
    assert error.value.given == name


def test_sizes_out_of_range_are_named():
    with pytest.raises(FitClassError, match="1 … 500 mm"):
        fit_class("H7/g6", 0.6)


@pytest.mark.parametrize(
    ("clearance", "fits"), [(0.0, True), (5e-6, True), (2e-5, True), (3.5e-5, False), (-2e-5, False), (1e-4, False)]
)
def test_recognition_by_class(clearance, fits):
    """Ø20 H7/g6: 3.5 … 20.5 µm radially, or drawn at nominal size."""
    t = replace(Tolerance(linear=1e-6), reach=0.0, reach_angular=0.0, fit_class="H7/g6")
    bodies = [housing(0.01 + clearance), shaft(0.01, 0.05, phase=0.1)]
    world = CollisionManager(t)
    for body in bodies:
        world.add(body.mesh, pin.SE3.Identity())
    found = recognise([b.features for b in bodies], [pin.SE3.Identity()] * 2, world.contacts(t.clearance), t)
    assert [c.kind for c in found] == (["concentric"] if fits else [])
    assert all("H7/g6" in c.why for c in found)
    assert np.all([c.match.fit == pytest.approx(clearance, abs=1e-12) for c in found])
