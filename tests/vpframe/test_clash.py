"""What `vpframe clash` says of scenes whose truth is known."""

import numpy as np
import pinocchio as pin
import pytest

from vpframe import modelling as m
from vpframe.clash import authorised_pairs, clash, merged, table
from vpframe.deflection import deflections
from vpframe.errors import VpframeError
from vpframe.scene import Scene

AT_HOME = pin.SE3.Identity()


def at(x=0.0, y=0.0, z=0.0):
    return pin.SE3(np.eye(3), np.array([x, y, z], dtype=float))


def kinds(document):
    return {pair["kind"] for pair in document["pairs"]}


def shaft_in_bore(radius, deflection=1e-4):
    block = m.box(0.04, 0.04, 0.03).translated(-0.02, -0.02, 0.0) - m.cylinder(0.010, 0.03)
    shaft = m.cylinder(radius, 0.06).translated(0.0, 0.0, -0.015)
    # turned by an odd angle, so that facets of the shaft meet facets of the bore across
    turn = pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.123])), np.zeros(3))
    return m.scene({"block": (block, AT_HOME), "shaft": (shaft, turn)}, deflection=deflection)


@pytest.mark.parametrize("deflection", [2e-5, 1e-4, 4e-4])
@pytest.mark.parametrize(
    ("radius", "kind"), [(0.01002, "clash"), (0.010, "contact"), (0.00998, "clearance"), (0.0099, None)]
)
def test_a_fit_is_judged_on_its_radii_whatever_the_tessellation(radius, kind, deflection):
    found = clash(shaft_in_bore(radius, deflection), clearance=5e-5)
    assert kinds(found) == ({kind} if kind else set())
    if kind == "clash":
        assert [p["depth"] for p in found["pairs"]] == pytest.approx([2e-5] * len(found["pairs"]), abs=1e-9)
    if kind == "clearance":
        assert [p["distance"] for p in found["pairs"]] == pytest.approx([2e-5] * len(found["pairs"]), abs=1e-9)


def test_a_press_fit_may_be_authorised_by_name():
    scene = shaft_in_bore(0.01002)
    assert kinds(clash(scene, authorised=authorised_pairs(["shaft:block"]))) == {"authorised"}


def test_flush_is_contact_overlap_is_clash_inside_is_containment():
    cube = m.box(0.02, 0.02, 0.02)
    flush = m.scene({"a": (cube, AT_HOME), "b": (cube, at(x=0.02))})
    assert kinds(clash(flush)) == {"contact"}
    deep = clash(m.scene({"a": (cube, AT_HOME), "b": (cube, at(x=0.019, y=0.001, z=0.001))}))
    assert kinds(deep) >= {"clash"}
    assert max(p["depth"] for p in deep["pairs"]) == pytest.approx(1e-3, abs=1e-6)
    inside = clash(m.scene({"a": (cube, AT_HOME), "b": (m.box(0.01, 0.01, 0.01), at(0.005, 0.005, 0.005))}))
    assert [(p["kind"], p["surfaces"]) for p in inside["pairs"]] == [("containment", [])]
    assert clash(m.scene({"a": (cube, AT_HOME), "b": (cube, at(x=0.03))}))["pairs"] == []


def test_identical_parts_in_one_place_clash():
    cube = m.box(0.02, 0.02, 0.02)
    assert "clash" in kinds(clash(m.scene({"a": (cube, AT_HOME), "b": (cube, AT_HOME)})))


def test_the_table_names_parts_and_counts_kinds():
    text = table(clash(shaft_in_bore(0.01002)))
    assert text.startswith("3 clash") and "block – shaft" in text and "0.020 mm deep" in text
    assert table({"pairs": []}) == "no two parts touch"


def test_scenes_of_several_files_keep_their_parts_apart():
    one = m.scene({"cube": (m.box(0.01, 0.01, 0.01), AT_HOME)})
    one.source = "folder/a.step"
    both = merged([one, one])
    assert both.names == ("a/cube", "a_2/cube")
    assert merged([one]) is one
    assert clash(Scene()) == {"pairs": []}


def test_authorised_pairs_are_two_names():
    with pytest.raises(VpframeError, match="A:B"):
        authorised_pairs(["shaft"])


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


def test_the_table_puts_the_deepest_first_and_tells_no_length_of_zero():
    def row(kind, depth=0.0, distance=0.0, b="b"):
        return {"kind": kind, "parts": ["a", b], "surfaces": [0, 1], "distance": distance, "depth": depth}

    pairs = [row("contact", 1e-15), row("contact", 2e-5, b="c"), row("clash", 1e-4), row("clash", 3e-3, b="d")]
    lines = table({"pairs": [*pairs, row("clearance", distance=2e-4)]}).splitlines()
    assert lines[0] == "2 clash, 2 contact, 1 clearance"
    assert [line.split()[3].rstrip(":") for line in lines[1:4]] == ["d", "b", "c"]
    assert lines[3].endswith("touching, their facets 0.020 mm into each other, no more than they stray")
    assert lines[4].endswith("touching") and lines[5].endswith("0.200 mm apart")
    assert "0.000" not in "\n".join(lines)
