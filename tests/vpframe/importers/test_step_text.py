"""The text of a STEP file: what it holds, and what the kernel lost of it."""

import re

import pytest

import vpframe as vp
from tests.vpframe.importers.damaged import written
from vpframe.importers.step_text import scan
from vpframe.scene import modelling as m


def test_lost_parts_and_faces_are_named(tmp_path, step):
    lines = step.read_text().replace("\n  ", " ")
    face = next(line for line in lines.splitlines() if "= ADVANCED_FACE" in line)
    scene = vp.load(written(tmp_path / "face.step", lines.replace(face, face.replace("ADVANCED_FACE", "ADVANCED_FCE"))))
    assert any("plate is incomplete: 6 of its 7 faces" in note for note in scene.notes)
    solid = next(line for line in lines.splitlines() if "= MANIFOLD_SOLID_BREP" in line)
    scene = vp.load(
        written(tmp_path / "solid.step", lines.replace(solid, solid.replace(" MANIFOLD_SOLID_BREP(", " ((")))
    )
    assert "plate" not in scene.names
    assert any("plate" in note for note in scene.notes)
    assert any(f"#{solid.split()[0].strip('#=')}" in note and "line" in note for note in scene.notes)


def test_the_text_tells_what_a_step_file_holds(step):
    text = scan(step.read_bytes())
    assert text.damage == []
    assert dict(text.instances) == {"plate": 1, "bolt_1": 2, "cap": 1}
    assert text.faces["plate"] == 7
    assert text.lost(text.instances, text.faces) == []


def uses_of(text: str) -> dict[str, tuple[str, str, str]]:
    """Statement, parent and child of each use of a product, by the name of the use."""
    found = re.findall(r"(#\d+ = NEXT_ASSEMBLY_USAGE_OCCURRENCE\('\d+','(\w+)','',(#\d+),(#\d+),\$\);)", text)
    return {name: (statement, parent, child) for statement, name, parent, child in found}


@pytest.mark.parametrize("user, used", [("plate", "plate"), ("pair", "pair"), ("root", "root"), ("pair", "root")])
def test_an_assembly_used_in_itself_loses_that_use_alone(user, used, tmp_path, step):
    text = step.read_text()
    uses = uses_of(text)
    root = uses["plate"][1]
    parent, child = (root if name == "root" else uses[name][2] for name in (user, used))
    more = f"#99999 = NEXT_ASSEMBLY_USAGE_OCCURRENCE('9','loop','',{parent},{child},$);"
    path = written(tmp_path / "loop.step", text.replace("DATA;", f"DATA;\n{more}", 1).encode())
    scene = vp.load(path)
    assert scene.names == vp.load(step).names
    assert any("is used in itself" in note for note in scene.notes)
    assert not any("lost" in note for note in scene.notes)


def test_a_part_whose_use_was_overwritten_by_a_loop_is_named(tmp_path, step):
    text = step.read_text()
    statement, parent, child = uses_of(text)["cap"]
    path = written(tmp_path / "loop.step", text.replace(statement, statement.replace(parent, child)).encode())
    scene = vp.load(path)
    assert {"plate", "pair/bolt_1", "pair/bolt_2"} <= {name.removeprefix("assembly/") for name in scene.names}
    assert any("cap is used in itself" in note for note in scene.notes)


def test_assemblies_in_other_files_are_no_lost_parts(tmp_path):
    """A node whose shape lies in another file, where it is an assembly, has no faces of its own."""
    tail = {"fin": m.box(0.01, 0.02, 0.001), "boom": m.cylinder(0.002, 0.05)}
    m.write_step(tmp_path / "TAIL.step", tail, name="TAIL")
    top = m.write_step(
        tmp_path / "top.step", {"TAIL": m.box(0.01, 0.01, 0.01), "plate": m.box(0.1, 0.1, 0.01)}, external=True
    )
    (tmp_path / "top_TAIL.stp").write_bytes((tmp_path / "TAIL.step").read_bytes())
    scene = vp.load(top)
    assert set(scene.names) == {"TAIL/fin", "TAIL/boom", "plate"}
    assert not any("left out" in note or "lost" in note for note in scene.notes)


def test_the_text_is_read_in_linear_time_whatever_it_holds():
    quotes = b"DATA;\n" + b"#1=A('" + b"''" * 200_000 + b";\n" + b"#2=B(('x')\n" * 2000 + b"ENDSEC;"
    assert scan(quotes).damage  # by backtracking this would take hours
