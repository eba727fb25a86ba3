"""CAD files through the kernel's own process: what is kept of them."""

from __future__ import annotations

import re
import subprocess
import sys
import textwrap
from collections import Counter

import numpy as np
import pinocchio as pin
import pytest
from OCP.BRepBuilderAPI import BRepBuilderAPI_NurbsConvert
from OCP.IGESControl import IGESControl_Writer
from OCP.Interface import Interface_Static
from OCP.ShapeUpgrade import ShapeUpgrade_ShapeDivideAngle
from OCP.STEPControl import STEPControl_Controller
from OCP.TopoDS import TopoDS_Builder, TopoDS_Compound

import vpframe as vp
from collision.solid import is_closed
from vpframe.importers import brep, build
from vpframe.importers.polyhedron import mass_properties
from vpframe.importers.raw import RawFace
from vpframe.scene import modelling as m


def untyped(solid: m.Solid) -> m.Solid:
    """The solid as many exporters write it: closed faces in halves, every surface a spline."""
    divide = ShapeUpgrade_ShapeDivideAngle(np.pi, solid.occ)
    divide.Perform()
    return m.Solid(BRepBuilderAPI_NurbsConvert(divide.Result()).Shape())


def bracket() -> m.Solid:
    """A block with a bore, a stepped pin, a countersink, a dimple and a ring groove: every kind of surface."""
    solid = m.box(0.06, 0.04, 0.02) - m.cylinder(0.005, 0.02).translated(0.015, 0.02)
    solid -= m.cone(0.0, 0.004, 0.004).translated(0.045, 0.01, 0.016)
    solid -= m.sphere(0.004).translated(0.045, 0.03, 0.02)
    return solid - m.torus(0.008, 0.001).translated(0.015, 0.02, 0.02)


def truth(shape: vp.Shape) -> list[tuple[str, int, float]]:
    sizes = {"cylinder": "radius", "cone": "half_angle", "sphere": "radius", "torus": "minor", "plane": None}
    return sorted(
        (f.geometry.kind, f.sense, round(getattr(f.geometry, sizes[f.geometry.kind] or "", 0.0), 6))
        for f in shape.features
    )


def test_surfaces_that_the_file_leaves_untyped_are_recognised(tmp_path):
    typed = m.shape(bracket())
    shape = vp.load(m.write_step(tmp_path / "a.step", {"a": untyped(bracket())}))["a"].shape
    assert len(shape.surfaces) > len(typed.surfaces)
    assert truth(shape) == truth(typed)
    fitted = [s for s in shape.surfaces if s.geometry.kind != "plane"]
    assert all(0.0 < s.residual <= 1e-5 for s in fitted)
    for feature in shape.features:
        assert feature.residual <= 1e-5
        assert {shape.surfaces[i].geometry.kind for i in feature.surfaces} == {feature.geometry.kind}


def test_where_the_kernel_declines_too_the_fit_finds_them():
    raw = brep.tessellate(untyped(bracket()).occ, 1e-4, 0.35)
    raw.faces = [RawFace(f.name, samples=f.samples) for f in raw.faces]
    assert truth(build.shape(raw)) == truth(m.shape(bracket()))


def test_a_kernels_answer_that_the_points_refute_is_not_taken():
    raw = brep.tessellate(untyped(m.cylinder(0.005, 0.02)).occ, 1e-4, 0.35)
    wrong = (0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0051)
    for face in raw.faces:
        if face.kind == "cylinder":
            face.numbers = wrong
    radii = [s.geometry.radius for s in build.shape(raw).surfaces if s.geometry.kind == "cylinder"]
    assert radii == pytest.approx([0.005, 0.005], abs=1e-9)


def test_freeform_stays_freeform():
    lens = m.box(0.04, 0.04, 0.01).filleted(0.003, lambda p: p[2] > 0.009 and p[0] < 0.03)
    pole = np.array(
        [
            [x, y, 0.002 * np.sin(90 * x) * np.cos(70 * y)]
            for x in np.linspace(0, 0.04, 8)
            for y in np.linspace(0, 0.04, 8)
        ]
    )
    raw = brep.tessellate(lens.occ, 1e-4, 0.35)
    assert "freeform" not in {s.geometry.kind for s in build.shape(raw).surfaces}
    grid = np.arange(49).reshape(7, 7) + np.arange(7)[:, None]
    a = grid.ravel()
    raw.vertices, raw.triangles = (
        pole,
        np.vstack([np.column_stack([a, a + 8, a + 9]), np.column_stack([a, a + 9, a + 1])]).astype(np.int32),
    )
    raw.face_of_triangle, raw.faces, raw.edges = np.zeros(98, np.int32), [RawFace("wave")], []
    (wave,) = build.shape(raw).surfaces
    assert (wave.geometry.kind, wave.orientation, wave.residual) == ("freeform", "free", 0.0)


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


def test_siblings_of_one_name_get_numbers_and_a_compound_of_solids_becomes_parts(tmp_path):
    compound = TopoDS_Compound()
    builder = TopoDS_Builder()
    builder.MakeCompound(compound)
    ball = m.sphere(0.01)
    for i in range(3):
        builder.Add(compound, ball.translated(0.1 * i).occ)
    scene = vp.load(m.write_step(tmp_path / "a.step", {"balls": m.Solid(compound), "box": m.box(0.1, 0.1, 0.1)}))
    assert scene.names == ("balls/1", "balls/2", "balls/3", "box")
    assert [
        round(scene[f"balls/{i}"].pose.translation[0] + scene[f"balls/{i}"].shape.center[0], 6) for i in (1, 2, 3)
    ] == [0.0, 0.1, 0.2]
    text = (tmp_path / "a.step").read_text().replace("'box'", "'balls'")
    (tmp_path / "b.step").write_text(text)
    assert vp.load(tmp_path / "b.step").names == ("balls_1/1", "balls_1/2", "balls_1/3", "balls_2")


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


def test_volume_and_inertia_are_the_solids_own_and_deflection_bounds_the_mesh(tmp_path):
    path = m.write_step(tmp_path / "a.step", {"ball": m.sphere(0.05)})
    counts = []
    for deflection, angular in ((1e-3, 1.0), (1e-4, 1.0), (1e-3, 0.1)):
        ball = vp.load(path, deflection=deflection, angular=angular)["ball"]
        counts.append(ball.mesh.n_triangles)
        middles = ball.mesh.vertices[ball.mesh.triangles].mean(axis=1)
        assert np.abs(ball.surfaces[0].geometry.distance(middles)).max() <= deflection * 1.5
        assert ball.shape.volume == pytest.approx(4 / 3 * np.pi * 0.05**3, rel=1e-9)
        assert ball.shape.inertia == pytest.approx(0.4 * ball.shape.volume * 0.05**2 * np.eye(3), rel=1e-9)
    assert counts[0] < counts[1] and counts[0] < counts[2]


def test_mesh_properties_are_those_of_the_polyhedron():
    block = m.shape(m.box(0.1, 0.2, 0.3).rotated([1.0, 2.0, 3.0], 0.7).translated(1.0, 2.0, 3.0))
    volume, center, inertia = build.mass_properties(block.mesh.vertices, block.mesh.triangles)
    assert volume == pytest.approx(block.volume, rel=1e-9)
    assert center == pytest.approx(block.center, abs=1e-9)
    assert inertia == pytest.approx(block.inertia, rel=1e-6, abs=1e-12)


def test_a_face_that_meshes_to_nothing_is_tried_again_then_named(monkeypatch):
    real = brep._triangles
    tries: list[int] = []

    def first_fails(face):
        tries.append(1)
        return real(face) if len(tries) > 1 else (np.empty((0, 3)), np.empty((0, 3), np.int64))

    monkeypatch.setattr(brep, "_triangles", first_fails)
    repaired = m.shape(m.box(0.1, 0.1, 0.1))
    assert len(repaired.surfaces) == 6
    assert any("face 1" in note and "repaired" in note for note in repaired.notes)

    def round_fails(face):
        points, corners = real(face)
        return (points, corners[:0]) if len(points) and np.ptp(points, axis=0).min() > 1.0 else (points, corners)

    monkeypatch.setattr(brep, "_triangles", round_fails)
    holed = m.shape(m.cylinder(0.05, 0.1))
    assert len(holed.surfaces) == 2
    assert not holed.closed
    assert any("lost" in note for note in holed.notes)
    assert any(note.startswith("open: at ") for note in holed.notes)


def test_a_flat_face_that_meshes_to_nothing_is_filled_between_its_neighbours(monkeypatch):
    """Whatever its outline is, the mesh is closed and has the solid's volume, to what round borders stray."""
    real = brep._triangles
    solid = m.hexagon(0.1, 0.02) + m.cylinder(0.02, 0.05).translated(0.04, 0.0)
    solid += m.cylinder(0.01, 0.06).translated(-0.03, 0.01)
    whole = m.shape(solid)
    for height in (0.0, 0.05, 0.06):

        def flat_fails(face, height=height):
            points, corners = real(face)
            at = len(points) and np.allclose(points[:, 2], height * 1e3)
            return (points, corners[:0]) if at else (points, corners)

        monkeypatch.setattr(brep, "_triangles", flat_fails)
        filled = m.shape(solid)
        assert any("repaired" in note for note in filled.notes)
        assert filled.closed and is_closed(filled.mesh)
        assert len(filled.surfaces) == len(whole.surfaces)
        assert mass_properties(filled.mesh.vertices, filled.mesh.triangles)[0] == pytest.approx(
            mass_properties(whole.mesh.vertices, whole.mesh.triangles)[0], rel=1e-12
        )


def test_a_face_with_a_hole_that_meshes_to_nothing_is_not_filled_as_two(monkeypatch):
    """Its two borders are loops of their own; spanned each by itself they would close the bore."""
    real = brep._triangles
    plate = m.box(0.1, 0.1, 0.01) - m.cylinder(0.02, 0.01).translated(0.05, 0.05)

    def top_fails(face):
        points, corners = real(face)
        return (points, corners[:0]) if len(points) and points[:, 2].min() > 9.0 else (points, corners)

    monkeypatch.setattr(brep, "_triangles", top_fails)
    shape = m.shape(plate)
    assert not shape.closed and not is_closed(shape.mesh)
    (lost, opened) = shape.notes
    assert "lost" in lost and opened.startswith("open: at ")


def test_a_face_that_only_meshes_finer_gives_its_border_to_its_neighbours(monkeypatch):
    real, meshed = brep._triangles, brep.BRepMesh_IncrementalMesh
    sizes: list[float] = []

    def mesh(shape, deflection, *more):
        sizes.append(deflection)
        return meshed(shape, deflection, *more)

    def round_fails(face):
        """As if the bore could not be meshed at the deflection that is asked for."""
        points, corners = real(face)
        bore = len(points) and np.ptp(points, axis=0).tolist() == pytest.approx([40.0, 40.0, 10.0], abs=0.5)
        return (points, corners[:0]) if bore and min(sizes) > 0.09 else (points, corners)

    monkeypatch.setattr(brep, "_triangles", round_fails)
    monkeypatch.setattr(brep, "BRepMesh_IncrementalMesh", mesh)
    shape = m.shape(m.box(0.1, 0.1, 0.01) - m.cylinder(0.02, 0.01).translated(0.05, 0.05))
    assert sizes == [pytest.approx(0.1), pytest.approx(0.05), pytest.approx(0.1)]
    assert shape.closed and is_closed(shape.mesh)
    assert len(shape.surfaces) == 7
    assert any("repaired" in note for note in shape.notes)


def test_triangles_of_zero_area_are_dropped_and_counted():
    raw = brep.tessellate(m.box(0.1, 0.1, 0.1).occ, 1e-4, 0.35)
    raw.triangles = np.vstack([raw.triangles, [[0, 1, 1], [2, 2, 2]]]).astype(np.int32)
    raw.face_of_triangle = np.append(raw.face_of_triangle, [0, 6]).astype(np.int32)
    raw.faces.append(RawFace("face_7"))
    shape = build.shape(raw)
    assert shape.mesh.n_triangles == 12
    assert shape.closed
    assert any("2 triangles of zero area" in note for note in shape.notes)
    assert any("face_7" in note for note in shape.notes)


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


def test_a_script_needs_no_main_guard_and_the_kernel_does_not_write_to_its_output(tmp_path):
    path = m.write_step(tmp_path / "a.step", {"box": m.box(0.1, 0.1, 0.1)})
    script = tmp_path / "task.py"
    script.write_text(
        textwrap.dedent(f"""
        import sys
        sys.path.insert(0, {str(vp.__path__[0])!r} + "/..")
        import vpframe as vp
        told = []
        scene = vp.load({str(path)!r}, progress=lambda fraction, text: told.append((fraction, text)))
        assert told == sorted(told, key=lambda t: t[0]) and told[-1][0] == 1.0, told
        assert any("box" in text for _, text in told), told
        print(scene.names)
        """)
    )
    result = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, cwd=tmp_path)
    assert (result.stdout, result.stderr, result.returncode) == ("('box',)\n", "", 0)


def test_the_same_file_gives_the_same_bits(tmp_path):
    path = m.write_step(tmp_path / "a.step", {"a": untyped(bracket())})
    a, b = vp.load(path)["a"], vp.load(path)["a"]
    assert a.mesh.vertices.tobytes() == b.mesh.vertices.tobytes()
    assert a.mesh.triangles.tobytes() == b.mesh.triangles.tobytes()
    for s, t in zip(a.surfaces, b.surfaces, strict=True):
        assert repr(s) == repr(t)


def test_the_reading_process_imports_no_solver():
    """Numba and Pinocchio take longer to import than most files take to read."""
    code = "import sys, vpframe.importers.document, vpframe.exporters.step_writer as _\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert "OCP" in done.stdout.split()
    assert not {"numba", "pinocchio", "coal", "scipy", "physics", "constraints"} & set(done.stdout.split())


class TestRealModels:
    @pytest.mark.parametrize(("name", "length"), [("as1-oc-214", 0.18), ("as1_pe_203", 0.18 * 25.4)])
    def test_as1(self, real_models, name, length):
        """The same assembly in millimetres, with no cylinder typed, and in inches, with parts that have no faces."""
        scene = vp.load(real_models / "step" / f"{name}.stp")
        assert len(scene) == 18
        assert len({id(p.shape) for p in scene.parts}) == 5
        assert sum(len(p.surfaces) for p in scene.parts) == 160
        assert scene.notes == ()
        bores = Counter()
        for part in {id(p.shape): p for p in scene.parts}.values():
            kinds = Counter((f.geometry.kind, f.sense) for f in part.features)
            assert set(kinds) <= {("plane", 1), ("cylinder", 1), ("cylinder", -1)}
            assert all(len(f.surfaces) == 2 for f in part.features if f.geometry.kind == "cylinder")
            bores[kinds["cylinder", -1], kinds["cylinder", 1]] += 1
        assert bores == {(6, 0): 1, (4, 0): 1, (1, 0): 1, (0, 2): 1, (0, 1): 1}  # plate, bracket, nut, bolt, rod
        plate = next(p for p in scene.parts if len(p.surfaces) == 18)
        assert np.ptp(plate.mesh.vertices, axis=0).max() == pytest.approx(length, rel=1e-6)

    @pytest.mark.parametrize(
        "name", ["bearing_20x37x9.stp", "bdw_taper_bearing.step", "caxif_dm1-oc-214.stp", "screw.step"]
    )
    def test_others_load_whole(self, real_models, name):
        scene = vp.load(real_models / "step" / name)
        assert scene.notes == ()
        assert all(p.shape.closed for p in scene.parts)
        assert all(f.residual <= 1e-5 for p in scene.parts for f in p.features)
