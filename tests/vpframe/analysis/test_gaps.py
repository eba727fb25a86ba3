"""Gaps of curved and freeform faces: judged by their surfaces, bounded by their facets."""

import numpy as np
import pinocchio as pin
import pytest

from constraints.geometry.surfaces import Freeform
from tests.vpframe.fitted import at, kinds, worst
from vpframe.analysis.clash import clash, document, table
from vpframe.scene import modelling as m
from vpframe.scene.scene import Shape, Surface


def curved(case, gap):
    """Two solids with a gap (m; negative: an overlap) between curved faces, as in the models of strangers."""
    turn = pin.exp3(np.array([0.3, -0.4, 0.5]))
    ball = m.sphere(0.01)
    if case == "balls":
        u = turn[:, 0]
        return {"a": ball, "b": (m.sphere(0.008), at(*(u * (0.018 + gap))))}
    if case == "ball on plane":
        return {"a": m.box(0.04, 0.04, 0.01), "b": (ball, at(0.021, 0.019, 0.02 + gap))}
    if case == "taper":
        plug, socket = m.cone(0.008, 0.012, 0.02), m.cone(0.0075, 0.0125, 0.025).translated(z=-0.0025)
        body = m.box(0.04, 0.04, 0.022).translated(-0.02, -0.02, -0.001) - socket
        return {"body": body, "plug": (plug, at(z=gap / np.sin(np.arctan(0.2))))}
    if case == "countersink":
        plate = m.box(0.04, 0.04, 0.012).translated(-0.02, -0.02, -0.012) - m.cylinder(0.0035, 0.03).translated(z=-0.02)
        plate = plate - m.cone(0.0015, 0.007, 0.0055).translated(z=-0.005)
        screw = m.cone(0.003, 0.0065, 0.0035).translated(z=-0.0035) + m.cylinder(0.003, 0.016).translated(z=-0.016)
        return {"plate": plate, "screw": (screw, at(z=gap * 2**0.5))}
    if case == "shaft off its axis":
        hub = m.box(0.07, 0.07, 0.03).translated(-0.035, -0.035, 0.0) - m.cylinder(0.025, 0.03)
        return {"hub": hub, "shaft": (m.cylinder(0.025 - 8e-5, 0.05), at(8e-5 - gap, 0.0, -0.01))}
    if case == "parallel cylinders":
        return {
            "a": m.cylinder(0.01, 0.03),
            "b": (m.cylinder(0.006, 0.03), at(*((0.016 + gap) * turn[:2, 0] / np.linalg.norm(turn[:2, 0])), 0.0)),
        }
    if case == "ring on a plane":
        return {"a": m.box(0.06, 0.06, 0.01), "b": (m.torus(0.015, 0.004), at(0.03, 0.03, 0.014 + gap))}
    if case == "crossed cylinders":
        lying = m.cylinder(0.006, 0.06).translated(0.0, 0.0, -0.03).rotated([1.0, 0.0, 0.0], 1.1)
        return {"a": m.cylinder(0.01, 0.06).translated(0.0, 0.0, -0.03), "b": (lying, at(0.016 + gap))}
    if case == "ball on the rim of a hole":
        plate = m.box(0.04, 0.04, 0.01).translated(-0.02, -0.02, -0.01) - m.cylinder(0.006, 0.02).translated(z=-0.015)
        return {"plate": plate, "ball": (ball, at(z=((0.01 + gap) ** 2 - 0.006**2) ** 0.5))}
    raise AssertionError(case)


CURVED = (
    "balls", "ball on plane", "taper", "countersink", "shaft off its axis", "parallel cylinders", "ring on a plane",
    "crossed cylinders", "ball on the rim of a hole",
)  # fmt: skip


@pytest.mark.parametrize("deflection", [1e-4, 3e-4])
@pytest.mark.parametrize("gap", [-6e-5, -2.5e-5, 2e-5, 6e-5])
@pytest.mark.parametrize("case", CURVED)
def test_curved_faces_are_judged_by_their_surfaces(case, gap, deflection):
    found = worst(curved(case, gap), deflection=deflection)
    assert found.kind == ("clash" if gap < 0.0 else "clearance")
    assert found.distance - found.depth == pytest.approx(gap, abs=2e-8)
    low, high = found.interval
    assert low - 1e-8 <= gap <= high + 1e-8 and high - low < 2e-8
    assert found.distance <= max(gap, 0.0) + 1e-9, "a clearance is never overstated"
    if gap < 0.0:
        assert "mm deep" in table([found]) and ".." not in table([found])


@pytest.mark.parametrize("case", CURVED)
def test_an_overlap_that_facets_do_not_reach_is_found_without_a_clearance(case):
    assert "clash" in kinds(clash(m.scene(curved(case, -3e-5))))
    assert kinds(clash(m.scene(curved(case, 3e-5)))) <= {"contact"}


def freeform(scene):
    """The same parts, their curved faces without an analytic surface."""
    for part in scene.parts:
        faces = tuple(
            s if s.orientation == "flat" else Surface(s.index, s.name, Freeform(), "free", 0.0, s.area)
            for s in part.surfaces
        )
        measured = part.shape.volume, part.shape.center, part.shape.inertia
        part.shape = Shape(part.shape.mesh, faces, (), measured)
    return scene


@pytest.mark.parametrize("gap", [-1.5e-4, -3e-5, 2e-5, 3e-4])
@pytest.mark.parametrize("case", ["balls", "ball on plane", "ring on a plane", "parallel cylinders"])
def test_freeform_faces_have_bounds_and_no_clearance_is_overstated(case, gap):
    found = clash(freeform(m.scene(curved(case, gap))), 1e-3)
    pair = document(found)["pairs"][0]
    low, high = pair["interval"]
    assert low <= gap <= high and 1e-6 < high - low < 6e-4
    assert pair["distance"] <= max(gap, 0.0)
    if pair["kind"] == "clearance":
        assert ".." in table(found) and table(found).splitlines()[1].count("mm apart") == 1
    elif pair["kind"] == "contact":
        assert "touching within their deflection, from" in table(found, contacts=True)
    assert pair["kind"] != "clash" or gap < 0.0
