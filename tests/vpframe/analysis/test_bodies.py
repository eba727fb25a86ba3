"""Bodies of one part that overlap are a note, not clashes."""

import json

import numpy as np
import pinocchio as pin
import pytest

import vpframe as vp
from vpframe.analysis.bodies import overlap_notes, shells
from vpframe.app.cli import main
from vpframe.scene import modelling as m


def product(solids):
    """A part of several solids."""
    from OCP.TopoDS import TopoDS_Builder, TopoDS_Compound

    compound, builder = TopoDS_Compound(), TopoDS_Builder()
    builder.MakeCompound(compound)
    for solid in solids:
        builder.Add(compound, solid.occ)
    return m.Solid(compound)


def plate():
    return m.box(0.1, 0.1, 0.01), pin.SE3(np.eye(3), np.array([0.0, 0.0, 1.0]))


BOX = m.box(0.01, 0.01, 0.01)
CASES = {
    "in a row": ([BOX.translated(0.008 * k) for k in range(4)], "3 pairs of its 4 bodies by at most 2 mm"),
    "screw": (
        [m.cylinder(0.003, 0.02), m.hexagon(0.01, 0.005).translated(z=0.018)],
        "1 pair of its 2 bodies by at most",
    ),
    "apart": ([BOX, BOX.translated(0.02)], ""),
    "face to face": ([BOX, BOX.translated(0.01)], ""),
    "hollow": ([m.box(0.03, 0.03, 0.03) - BOX.translated(0.01, 0.01, 0.01)], ""),
}


@pytest.mark.parametrize("name", CASES)
def test_overlaps_of_bodies_of_one_product_are_a_note(name, tmp_path, capsys) -> None:
    solids, words = CASES[name]
    path = m.write_step(tmp_path / "a.step", {"product": product(solids), "plate": plate()})
    scene = vp.load(path)
    assert scene.names == ("product", "plate")
    notes = overlap_notes(scene)
    assert len(notes) == bool(words) and all(words in note and "apart): product (" in note for note in notes)
    assert main(["clash", str(path), "--json"]) == 0, "no clash"
    document = json.loads(capsys.readouterr().out)
    assert (
        any(words in note for note in document["notes"])
        if words
        else not any("overlap" in n for n in document["notes"])
    )


def test_overlaps_in_several_products_are_one_line(tmp_path) -> None:
    parts = {name: product(CASES[name][0]) for name in ("in a row", "screw", "apart")}
    path = m.write_step(tmp_path / "a.step", {**parts, "plate": plate()})
    (note,) = overlap_notes(vp.load(path))
    assert "in a row (3 pairs" in note and "screw (1 pair" in note and ", apart" not in note


def test_shells_are_the_pieces_that_share_no_vertex() -> None:
    mesh = m.shape(m.box(0.03, 0.03, 0.03) - BOX.translated(0.01, 0.01, 0.01)).mesh
    assert sorted(len(shell.triangles) for shell in shells(mesh)) == [12, 12]
