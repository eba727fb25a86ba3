"""Fit classes against the tables of ISO 286-2, and recognition by class."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from collision import CollisionManager, Tolerance
from constraints import recognise
from constraints.recognition.iso286 import FINE_STEPS, STEPS, FitClassError, fit_class, greatest_interference
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
        ("H7/k6", 0.020, -15, 19),
        ("H8/k8", 0.020, -33, 33),  # k lies at the nominal size in grades above 7
        ("H7/m6", 0.050, -25, 16),
        ("H7/n6", 0.010, -19, 5),
        ("H7/p6", 0.025, -35, -1),
        ("H7/r6", 0.065, -60, -11),
        ("H7/r6", 0.080, -62, -13),
        ("H7/s6", 0.025, -48, -14),
        ("H7/s6", 0.100, -93, -36),
        ("H7/s6", 0.110, -101, -44),
        ("H7/u6", 0.020, -54, -20),
        ("H7/u6", 0.025, -61, -27),
        ("H8/u8", 0.200, -308, -164),
        ("H7/u6", 0.500, -580, -477),
    ],
)
def test_tables_of_the_standard(name, diameter, least, most):
    found = fit_class(name, diameter)
    assert found.least == pytest.approx(1e-6 * least, abs=1e-12)
    assert found.most == pytest.approx(1e-6 * most, abs=1e-12)


@pytest.mark.parametrize("name", ["H7", "h7/g6", "H4/g6", "H7/x6", "H7/ks6", "", "H7/g6 "])
def test_unknown_classes_are_named(name):
    with pytest.raises(FitClassError, match="not known") as error:
        fit_class(name, 0.02)
    assert error.value.given == name


@pytest.mark.parametrize(
    ("shaft", "diameter", "most"),
    [("s7", 0.010, 38), ("s6", 0.010, 32), ("u8", 0.010, 50), ("s7", 0.002, 24), ("s7", 0.0102, 46), ("h6", 0.010, 0),
     ("s7", 0.200, 168), ("s7", 0.0005, 24), ("s7", 1.0, 315), ("g6", 0.01, 0)],
)  # fmt: skip
def test_the_greatest_interference_of_a_shaft_in_a_hole_h(shaft, diameter, most):
    assert greatest_interference(shaft, diameter) == pytest.approx(1e-6 * most, abs=1e-12)


def test_fine_and_coarse_steps_agree():
    """Each step of sizes of r, s and u lies in one of the others; deviations grow with the letter and the size."""
    assert set(STEPS) <= set(FINE_STEPS) and sorted(FINE_STEPS) == list(FINE_STEPS)
    by_size = [[greatest_interference(f"{letter}7", 1e-3 * size) for letter in "hkmnprsu"] for size in FINE_STEPS]
    assert all(row == sorted(row) for row in by_size) and all(list(c) == sorted(c) for c in zip(*by_size, strict=True))


@pytest.mark.parametrize("shaft", ["x6", "s", "S7", "", "s4"])
def test_unknown_shaft_classes_are_named(shaft):
    with pytest.raises(FitClassError, match="shaft class") as error:
        greatest_interference(shaft, 0.01)
    assert error.value.given == shaft


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
