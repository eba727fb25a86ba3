"""Caps and balls whose faces have the wrong sense."""

import re

import numpy as np
import pinocchio as pin
import pytest
from OCP.BRep import BRep_Builder
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS_Builder, TopoDS_Compound, TopoDS_Shell, TopoDS_Solid

import vpframe as vp
from tests.vpframe.importers.solids import WORKPIECES, exact_volume
from vpframe.importers import brep
from vpframe.importers.polyhedron import signed_volume
from vpframe.scene import modelling as m


@pytest.mark.parametrize(
    "solid", [m.box(0.01, 0.02, 0.03), WORKPIECES["cap"], WORKPIECES["cylinder"], WORKPIECES["tip"]]
)
def test_a_solid_points_out_of_itself_in_the_scene_and_in_the_file_written(solid, tmp_path):
    """Inside out as a whole, by its shell, or by its faces."""
    shells = TopExp_Explorer(solid.occ, TopAbs_ShapeEnum.TopAbs_SHELL)
    builder, by_shell, by_faces, shell = TopoDS_Builder(), TopoDS_Solid(), TopoDS_Solid(), TopoDS_Shell()
    BRep_Builder().MakeSolid(by_shell)
    builder.Add(by_shell, shells.Current().Reversed())
    BRep_Builder().MakeShell(shell)
    faces = TopExp_Explorer(shells.Current(), TopAbs_ShapeEnum.TopAbs_FACE)
    while faces.More():
        builder.Add(shell, faces.Current().Reversed())
        faces.Next()
    shell.Closed(True)
    BRep_Builder().MakeSolid(by_faces)
    builder.Add(by_faces, shell)
    right = m.shape(solid)
    compound = TopoDS_Compound()
    builder.MakeCompound(compound)
    builder.Add(compound, by_shell)
    builder.Add(compound, m.box(0.01, 0.01, 0.01).translated(1.0).occ)
    for wrong, more in ((solid.occ.Reversed(), 0.0), (by_shell, 0.0), (by_faces, 0.0), (compound, 1e-6)):
        shape = m.shape(m.Solid(wrong))
        assert shape.volume == pytest.approx(right.volume + more, rel=1e-9)
        assert signed_volume(shape.mesh.vertices, shape.mesh.triangles) > 0.0
        assert exact_volume(brep.brep_shape(shape.brep)) == pytest.approx(1e9 * shape.volume, rel=1e-9)
        if not more:
            vp.Scene([vp.Part("solid", shape, pin.SE3.Identity())]).export(tmp_path / "out.step")
            outwards = planes_face_outwards(tmp_path / "out.step")
            assert outwards and all(outwards)


@pytest.mark.parametrize("axis", [(0, 0, 1), (1, 0, 0), (1, 1, 1)])
@pytest.mark.parametrize("size", [(0.02, 0.03, 0.08), (0.015, 0.01, 0.05), (0.005, 0.03, 0.09)])
def test_a_cap_whose_sense_is_wrong_is_not_the_rest_of_the_ball(axis, size, tmp_path):
    turn = np.cross([0.0, 0.0, 1.0], axis)
    angle = float(np.arccos(axis[2] / np.linalg.norm(axis)))
    ball = m.sphere(0.06).rotated(turn, angle) if angle else m.sphere(0.06)
    block = m.box(*size).translated(0.003, 0.004, -0.01) & ball.translated(0.0, 0.0, -0.035)
    path = m.write_step(tmp_path / "right.step", {"block": block, "box": m.box(0.01, 0.01, 0.01)})
    text = path.read_text()
    (number,) = re.findall(r"(#\d+) = SPHERICAL_SURFACE", text)
    (face,) = re.findall(rf"ADVANCED_FACE\('[^']*',\([^)]*\),{number},\.[TF]\.\)", text)
    other = face.replace(".T.)", ".F.)") if face.endswith(".T.)") else face.replace(".F.)", ".T.)")
    (tmp_path / "wrong.step").write_text(text.replace(face, other))
    right, wrong = vp.load(path), vp.load(tmp_path / "wrong.step")
    assert not right.notes
    assert wrong["block"].shape.volume == pytest.approx(right["block"].shape.volume, rel=1e-6)
    assert wrong["block"].shape.closed
    vertices = wrong["block"].mesh.vertices
    assert signed_volume(vertices, wrong["block"].mesh.triangles) == pytest.approx(
        right["block"].shape.volume, rel=0.05
    )
    assert any("sense of a spherical face" in note for note in wrong.notes)


def planes_face_outwards(path) -> list[bool]:
    """For each plane face in the text of a STEP file of one convex solid: whether its stated normal points outwards.

    The kernel's reader turns solids that are inside out; others do not.
    """
    text = re.sub(r"\s+", "", path.read_text().partition("DATA;")[2])
    entities = {int(n): body for n, body in re.findall(r"#(\d+)=(.*?);(?=#|ENDSEC)", text)}

    def triple(n: int) -> np.ndarray:
        return np.array([float(x) for x in re.findall(r"\(([-+.\dE,]+)\)", entities[n])[-1].split(",")])

    def named(kind: str) -> list[str]:
        return [body for body in entities.values() if body.startswith(f"{kind}(")]

    def references(body: str) -> list[int]:
        return [int(n) for n in re.findall(r"#(\d+)", body)]

    inner = np.mean([triple(references(body)[0]) for body in named("VERTEX_POINT")], axis=0)
    found = []
    for face in named("ADVANCED_FACE"):
        surface = entities[references(face)[-1]]
        if surface.startswith("PLANE("):
            origin, normal, *_ = map(triple, references(entities[references(surface)[0]]))
            found.append(bool(normal @ (origin - inner) > 0.0) == face.endswith(".T.)"))
    assert not named("ORIENTED_CLOSED_SHELL")
    return found
