"""Documents of STEP and IGES files: units, products, bodies, references."""

import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from OCP.BRep import BRep_Builder
from OCP.BRepTools import BRepTools
from OCP.IGESControl import IGESControl_Writer
from OCP.Interface import Interface_Static
from OCP.STEPControl import STEPControl_Controller, STEPControl_StepModelType, STEPControl_Writer
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS_Builder, TopoDS_Compound, TopoDS_Shell

import vpframe as vp
import vpframe.analysis.clash
from tests.vpframe.importers.solids import bracket, truth
from vpframe.scene import modelling as m

MM = "#9001=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));\n#9009=DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.);\n"


CONVERTED = "(CONVERSION_BASED_UNIT('INCH',#9002)LENGTH_UNIT()NAMED_UNIT(#9009))"


def in_unit(path: Path, unit: str, more: str = "") -> Path:
    """A block of 100 units, written with a length unit of its own."""
    text = m.write_step(path, {"block": m.box(0.1, 0.1, 0.1)}).read_text()
    *_, last = re.finditer(r"(#\d+) = \( LENGTH_UNIT\(\) NAMED_UNIT\(\*\) SI_UNIT\(.MILLI.,.METRE.\) \);", text)
    path.write_text(text[: last.start()] + f"{last[1]} = {unit};\n{more}" + text[last.end() :])
    return path


@pytest.mark.parametrize(
    ("unit", "more", "size"),
    [
        ("(NAMED_UNIT(*)SI_UNIT($,.METRE.)LENGTH_UNIT())", "", 100.0),
        ("( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT( .MICRO. , .METRE. ) )", "", 1e-4),
        (CONVERTED, MM + "#9002=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#9001);\n", 2.54),
        (CONVERTED, MM + "#9002=LENGTH_MEASURE_WITH_UNIT(2.54E1,#9001);\n", 2.54),
    ],
)
def test_known_length_units_are_read_right(tmp_path, unit, more, size):
    (part,) = vp.load(in_unit(tmp_path / "a.step", unit, more)).parts
    assert part.mesh.vertices.max() == pytest.approx(size, rel=1e-9)


@pytest.mark.parametrize(
    ("unit", "more"),
    [
        ("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.FOO.,.METRE.))", ""),
        ("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METER.))", ""),
        ("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.milli.,.metre.))", ""),
        ("(CONTEXT_DEPENDENT_UNIT('ELL')LENGTH_UNIT()NAMED_UNIT(#9009))", MM),
        (CONVERTED, MM + "#9002=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(0.),#9001);\n"),
        (CONVERTED, MM + "#9002=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(-25.4),#9001);\n"),
        (CONVERTED, MM + "#9002=(LENGTH_MEASURE_WITH_UNIT()MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#9001));\n"),
        (  # the kernel takes a foot of twelve such inches for a millimetre
            CONVERTED,
            MM.replace("#9001=", "#9005=")
            + "#9004=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#9005);\n"
            + CONVERTED.replace("9002", "9004").join(("#9001=", ";\n"))
            + "#9002=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(12.),#9001);\n",
        ),
    ],
)
def test_a_length_unit_that_is_not_known_is_refused(tmp_path, unit, more):
    path = in_unit(tmp_path / "a.step", unit, more)
    with pytest.raises(vp.LoadError, match=r"line \d+: #\d+ is no length unit that is known: .*UNIT") as error:
        vp.load(path)
    assert str(error.value).startswith(str(path)) and "\n" not in str(error.value)
    top = m.write_step(tmp_path / "top.step", {"plate": m.box(0.1, 0.1, 0.1)}, external=True)
    (tmp_path / "top_plate.stp").write_text(path.read_text())
    with pytest.raises(vp.LoadError, match=r"top_plate\.stp: line \d+: #\d+ is no length unit"):
        vp.load(top)


def test_a_shape_without_a_length_unit_is_told(tmp_path):
    unit = "(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))"
    scene = vp.load(in_unit(tmp_path / "a.step", unit))
    assert scene.notes == ("names no length unit for some of its shapes: millimetres are taken",)
    assert scene["block"].mesh.vertices.max() == pytest.approx(0.1)


def test_an_assembly_in_inches_is_in_metres(tmp_path):
    parts = {"block": (m.box(0.0254, 0.0508, 0.0762), pin.SE3(np.eye(3), np.array([0.254, 0.0, 0.0])))}
    STEPControl_Controller.Init_s()  # or there is no such parameter yet
    Interface_Static.SetCVal_s("write.step.unit", "INCH")
    try:
        path = m.write_step(tmp_path / "inch.step", parts)
    finally:
        Interface_Static.SetCVal_s("write.step.unit", "MM")
    assert "INCH" in path.read_text()
    block = vp.load(path)["block"]
    assert np.ptp(block.mesh.vertices, axis=0) == pytest.approx([0.0254, 0.0508, 0.0762], abs=1e-9)
    assert block.pose.translation == pytest.approx([0.254, 0.0, 0.0], abs=1e-9)


def balls(count: int = 3, apart: float = 0.1) -> m.Solid:
    """One shape of several solids."""
    compound, builder = TopoDS_Compound(), TopoDS_Builder()
    builder.MakeCompound(compound)
    for i in range(count):
        builder.Add(compound, m.sphere(0.01).translated(apart * i).occ)
    return m.Solid(compound)


def test_siblings_of_one_name_get_numbers_and_a_compound_of_solids_becomes_parts(tmp_path):
    path = m.write_step(tmp_path / "a.step", {"balls": balls(), "box": m.box(0.1, 0.1, 0.1)})
    scene = vp.load(path, bodies="split")
    assert scene.names == ("balls/1", "balls/2", "balls/3", "box")
    assert [
        round(scene[f"balls/{i}"].pose.translation[0] + scene[f"balls/{i}"].shape.center[0], 6) for i in (1, 2, 3)
    ] == [0.0, 0.1, 0.2]
    text = (tmp_path / "a.step").read_text().replace("'box'", "'balls'")
    (tmp_path / "b.step").write_text(text)
    assert vp.load(tmp_path / "b.step", bodies="split").names == ("balls_1/1", "balls_1/2", "balls_1/3", "balls_2")


def test_in_an_assembly_a_product_of_several_bodies_is_one_part(tmp_path):
    path = m.write_step(tmp_path / "a.step", {"balls": balls(), "box": m.box(0.1, 0.1, 0.1)})
    for scene in (vp.load(path), vp.load(path, bodies="whole")):
        assert scene.names == ("balls", "box")
        assert scene["balls"].shape.volume == pytest.approx(3 * 4 / 3 * np.pi * 0.01**3, rel=1e-9)
        assert scene["balls"].shape.closed
        assert any("balls" in note and "3 bodies" in note for note in scene.all_notes())
    with pytest.raises(vp.LoadError, match="bodies"):
        vp.load(path, bodies="merged")


def test_without_assemblies_each_solid_is_a_part(tmp_path):
    writer = STEPControl_Writer()
    writer.Transfer(balls(2).occ, STEPControl_StepModelType.STEPControl_AsIs)
    writer.Write(str(tmp_path / "a.step"))
    BRepTools.Write_s(balls(2).occ, str(tmp_path / "a.brep"))
    for name in ("a.step", "a.brep"):
        assert len(vp.load(tmp_path / name)) == 2
    assert len(vp.load(tmp_path / "a.brep", bodies="whole")) == 1


def test_bodies_that_overlap_in_one_product_do_not_clash(tmp_path):
    """A screw as libraries draw it: a compound of overlapping solids."""
    parts = {
        "screw": balls(5, apart=0.012),
        "plate": (m.box(0.1, 0.1, 0.01), pin.SE3(np.eye(3), np.array([0, 0, 1.0]))),
    }
    path = m.write_step(tmp_path / "a.step", parts)
    found = vpframe.analysis.clash.clash(vp.load(path))
    assert [row for row in found if row.kind == "clash"] == []
    found = vpframe.analysis.clash.clash(vp.load(path, bodies="split"))
    assert len({row.parts for row in found if row.kind == "clash"}) == 4


def test_sheets_beside_a_solid_belong_to_its_product(tmp_path):
    compound, builder = TopoDS_Compound(), TopoDS_Builder()
    builder.MakeCompound(compound)
    builder.Add(compound, m.sphere(0.01).occ)
    faces = TopExp_Explorer(m.box(0.02, 0.02, 0.02).translated(0.05).occ, TopAbs_ShapeEnum.TopAbs_FACE)
    builder.Add(compound, faces.Current())
    parts = {"ball": m.Solid(compound), "box": m.box(0.1, 0.1, 0.1)}
    scene = vp.load(m.write_step(tmp_path / "a.step", parts))
    assert scene.names == ("ball", "box")
    assert len(scene["ball"].surfaces) == 2
    assert scene["ball"].shape.volume == pytest.approx(4 / 3 * np.pi * 0.01**3, rel=1e-9)
    (note,) = scene["ball"].shape.notes
    assert note.startswith("open: at 4 edges") and "belong to no solid" in note and "missing" not in note


def test_iges_faces_are_sewn_to_a_solid(tmp_path):
    writer = IGESControl_Writer("MM", 0)
    writer.AddShape(bracket().occ)
    writer.ComputeModel()
    assert writer.Write(str(tmp_path / "a.igs"))
    (part,) = vp.load(tmp_path / "a.igs").parts
    typed = m.shape(bracket())
    assert part.shape.closed
    assert part.shape.volume == pytest.approx(typed.volume, rel=1e-6)
    assert truth(part.shape) == truth(typed)


def test_external_references_lie_beside_the_file(tmp_path, monkeypatch):
    parts = {"plate": m.box(0.1, 0.1, 0.01), "pin": m.cylinder(0.004, 0.03)}
    monkeypatch.chdir(tmp_path)
    (tmp_path / "models").mkdir()
    path = m.write_step(tmp_path / "models" / "top.step", parts, external=True)
    assert vp.load(path).names == ("plate", "pin")
    (tmp_path / "models" / "top_pin.stp").unlink()
    scene = vp.load("models/top.step")
    assert scene.names == ("plate",)
    assert any("top_pin.stp" in note for note in scene.notes)
    (tmp_path / "models" / "top_plate.stp").unlink()
    with pytest.raises(vp.LoadError, match=r"top_plate\.stp"):
        vp.load(path)


def test_a_file_missing_below_another_one_is_named(tmp_path):
    parts = {"sub": {"pin": m.cylinder(0.004, 0.03), "nut": m.cylinder(0.006, 0.01)}, "plate": m.box(0.1, 0.1, 0.01)}
    path = m.write_step(tmp_path / "top.step", parts, external=True)
    assert set(vp.load(path).names) == {"sub/pin", "sub/nut", "plate"}
    (nut,) = tmp_path.glob("*nut.stp")
    nut.unlink()
    scene = vp.load(path)
    assert set(scene.names) == {"sub/pin", "plate"}
    assert any(nut.name in note and "does not lie beside it" in note for note in scene.notes)


def test_an_instance_without_a_name_has_its_products(tmp_path):
    path = m.write_step(tmp_path / "a.step", {"bolt_1": m.cylinder(0.004, 0.03), "plate": m.box(0.1, 0.1, 0.01)})
    text = path.read_text()
    (usage,) = re.findall(r"NEXT_ASSEMBLY_USAGE_OCCURRENCE\('\d+','bolt_1'", text)
    path.write_text(text.replace(usage, usage.replace("'bolt_1'", "'*DIT29'")))
    assert vp.load(path).names == ("bolt_1", "plate")


def test_notes_of_one_kind_are_one_line_and_the_summary_counts(tmp_path):
    """Open shells of different sizes."""
    parts = {"plate": m.box(0.1, 0.1, 0.01)}
    for i in range(4):
        box, shell = m.box(0.01, 0.01, 0.01 + 0.001 * i), TopoDS_Shell()
        BRep_Builder().MakeShell(shell)
        faces = TopExp_Explorer(box.occ, TopAbs_ShapeEnum.TopAbs_FACE)
        for _ in range(5):
            TopoDS_Builder().Add(shell, faces.Current())
            faces.Next()
        parts[f"open_{i}"] = m.Solid(shell)
    scene = vp.load(m.write_step(tmp_path / "a.step", parts))
    (note,) = scene.all_notes()
    assert note.startswith("4 parts of 4 shapes (open_0, open_1, open_2, …): open: at 4 edges")
    head, _, tail = scene.summary().partition(", 4 open (")
    assert head == "5 parts of 5 shapes, 26 faces, 52 triangles; 0 shapes repaired"
    assert re.fullmatch(r"(open_\d near \([^)]*\) mm, ){3}…\)", tail) and tail.startswith("open_0")
