"""BCF 3.0: what the schema asks of each file, and that a topic says what the clash is."""

import datetime
import io
import re
import zipfile
from dataclasses import replace
from xml.etree import ElementTree as xml

import numpy as np
import pinocchio as pin
import pytest
from PIL import Image

import vpframe as vp
from vpframe.analysis import clash
from vpframe.app import cli
from vpframe.scene import modelling as m

GUID = r"[a-f0-9]{8}-[a-f0-9]{4}-[a-f0-9]{4}-[a-f0-9]{4}-[a-f0-9]{12}"
TEXT, NUMBER, DATE = r"(?s)\S.*", r"-?\d+(\.\d+)?([eE]-?\d+)?", r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ"
BOOL = "true|false"
VECTOR = {"X": (1, 1, NUMBER), "Y": (1, 1, NUMBER), "Z": (1, 1, NUMBER)}
MANY = 10**9
COMPONENTS = {"Component": (0, MANY, "component")}

# (attributes: name -> (required, pattern)), (children in order: name -> (least, most, element type or pattern));
# written after the schemas of buildingSMART's BCF-XML, release 3.0: as much of them as a clash needs
SCHEMA: dict[str, tuple[dict, dict]] = {
    "Version": ({"VersionId": (True, "3\\.0")}, {"DetailedVersion": (0, 1, TEXT)}),
    "ProjectInfo": ({}, {"Project": (1, 1, "project")}),
    "project": ({"ProjectId": (True, TEXT)}, {"Name": (0, 1, TEXT)}),
    "Extensions": (
        {},
        {
            "TopicTypes": (0, 1, {"TopicType": (0, MANY, TEXT)}),
            "TopicStatuses": (0, 1, {"TopicStatus": (0, MANY, TEXT)}),
            "Priorities": (0, 1, {"Priority": (0, MANY, TEXT)}),
            "TopicLabels": (0, 1, {"TopicLabel": (0, MANY, TEXT)}),
            "Users": (0, 1, {"User": (0, MANY, TEXT)}),
            "SnippetTypes": (0, 1, {"SnippetType": (0, MANY, TEXT)}),
            "Stages": (0, 1, {"Stage": (0, MANY, TEXT)}),
        },
    ),
    "Markup": ({}, {"Header": (0, 1, {"Files": (0, 1, {"File": (0, MANY, "file")})}), "Topic": (1, 1, "topic")}),
    "file": (
        {"IfcProject": (False, TEXT), "IfcSpatialStructureElement": (False, TEXT), "IsExternal": (False, BOOL)},
        {"Filename": (0, 1, TEXT), "Date": (0, 1, DATE), "Reference": (0, 1, TEXT)},
    ),
    "topic": (
        {
            "Guid": (True, GUID), "ServerAssignedId": (False, TEXT), "TopicType": (True, TEXT),
            "TopicStatus": (True, TEXT),
        },
        {
            "ReferenceLinks": (0, 1, {"ReferenceLink": (0, MANY, TEXT)}), "Title": (1, 1, TEXT),
            "Priority": (0, 1, TEXT), "Index": (0, 1, r"-?\d+"), "Labels": (0, 1, {"Label": (0, MANY, TEXT)}),
            "CreationDate": (1, 1, DATE), "CreationAuthor": (1, 1, TEXT), "ModifiedDate": (0, 1, DATE),
            "ModifiedAuthor": (0, 1, TEXT), "DueDate": (0, 1, DATE), "AssignedTo": (0, 1, TEXT), "Stage": (0, 1, TEXT),
            "Description": (0, 1, TEXT), "Comments": (0, 1, {"Comment": (0, MANY, "comment")}),
            "Viewpoints": (0, 1, {"ViewPoint": (0, MANY, "viewpoint")}),
        },
    ),
    "comment": (
        {"Guid": (True, GUID)},
        {
            "Date": (1, 1, DATE), "Author": (1, 1, TEXT), "Comment": (0, 1, TEXT), "Viewpoint": (0, 1, "reference"),
            "ModifiedDate": (0, 1, DATE), "ModifiedAuthor": (0, 1, TEXT),
        },
    ),
    "reference": ({"Guid": (True, GUID)}, {}),
    "viewpoint": (
        {"Guid": (True, GUID)}, {"Viewpoint": (0, 1, TEXT), "Snapshot": (0, 1, TEXT), "Index": (0, 1, r"-?\d+")},
    ),
    "VisualizationInfo": (
        {"Guid": (True, GUID)}, {"Components": (0, 1, "components"), "OrthogonalCamera": (0, 1, "orthogonal")},
    ),
    "components": (
        {},
        {
            "Selection": (0, 1, COMPONENTS), "Visibility": (0, 1, "visibility"),
            "Coloring": (0, 1, {"Color": (0, MANY, "color")}),
        },
    ),
    "visibility": ({"DefaultVisibility": (False, BOOL)}, {}),
    "color": ({"Color": (True, "[0-9A-Fa-f]{6}([0-9A-Fa-f]{2})?")}, {"Components": (1, 1, COMPONENTS)}),
    "component": (
        {"IfcGuid": (False, "[0-9A-Za-z_$]{22}")}, {"OriginatingSystem": (0, 1, TEXT), "AuthoringToolId": (0, 1, TEXT)},
    ),
    "orthogonal": (
        {},
        {
            "CameraViewPoint": (1, 1, VECTOR), "CameraDirection": (1, 1, VECTOR), "CameraUpVector": (1, 1, VECTOR),
            "ViewToWorldScale": (1, 1, NUMBER), "AspectRatio": (1, 1, NUMBER),
        },
    ),
}  # fmt: skip


def faults(element: xml.Element, kind: str | dict) -> list[str]:
    """What of an element is not as the schema has it."""
    if isinstance(kind, str) and kind not in SCHEMA:
        found = [] if re.fullmatch(kind, element.text or "") else [f"{element.tag}: text {element.text!r}"]
        return found + [f"{element.tag}: has children or attributes"] * bool(len(element) or element.attrib)
    attributes, children = ({}, kind) if isinstance(kind, dict) else SCHEMA[kind]
    out = [
        f"{element.tag}: no attribute {n}" for n, (must, _) in attributes.items() if must and n not in element.attrib
    ]
    for name, value in element.attrib.items():
        if name not in attributes or not re.fullmatch(attributes[name][1], value):
            out.append(f"{element.tag}: attribute {name}={value!r}")
    order = list(children)
    tags = [child.tag for child in element]
    if any(tag not in order for tag in tags):
        return [*out, f"{element.tag}: holds {set(tags) - set(order)}"]
    if [order.index(tag) for tag in tags] != sorted(order.index(tag) for tag in tags):
        out.append(f"{element.tag}: children in another order")
    out += [
        f"{element.tag}: {tags.count(n)} of {n}" for n, (a, b, _) in children.items() if not a <= tags.count(n) <= b
    ]
    for child in element:
        out += faults(child, children[child.tag][2])
    return out


def clashing() -> vp.Scene:
    """Two blocks that share volume, a ball within a third, and a block that only touches; a name for XML to escape."""

    def at(x: float) -> pin.SE3:
        return pin.SE3(np.eye(3), np.array([x, 0.0, 0.0]))

    return m.scene(
        {
            'frame/"A" <left> & Ø8\x1b': m.box(0.1, 0.1, 0.1),
            "frame/B": (m.box(0.1, 0.1, 0.1), at(0.09)),
            "touching": (m.box(0.1, 0.1, 0.1), at(0.19)),
            "can": (m.box(0.1, 0.1, 0.1), at(1.0)),
            "ball": (m.sphere(0.01).translated(0.05, 0.05, 0.05), at(1.0)),
        }
    )


def test_every_file_is_as_the_schema_has_it(tmp_path):
    scene = clashing()
    found = clash.clash(scene)
    accepted = {"status": "accepted", "remark": "a rattle\nis meant"}
    found = [replace(row, **accepted) if row.parts == ("can", "ball") else row for row in found]
    left = vp.write_bcf(tmp_path / "out.bcf", scene, found, author="someone@example.org")
    assert left == ["1 pairs of kind contact: no clashes"]
    with zipfile.ZipFile(tmp_path / "out.bcf") as archive:
        names = archive.namelist()
        files = {name: archive.read(name) for name in names}
    roots = {"markup.bcf": "Markup", "viewpoint.bcfv": "VisualizationInfo"}
    roots |= {"bcf.version": "Version", "extensions.xml": "Extensions", "project.bcfp": "ProjectInfo"}
    topics = {name.split("/")[0] for name in names if "/" in name}
    assert len(topics) == 2 and len(names) == 3 + 3 * 2
    statuses = {}
    for name, data in files.items():
        if name.endswith(".png"):
            assert Image.open(io.BytesIO(data)).size == (360, 270)
            assert len(np.unique(np.asarray(Image.open(io.BytesIO(data))).reshape(-1, 3), axis=0)) > 20
            continue
        root = xml.fromstring(data)
        assert root.tag == roots[name.split("/")[-1]]
        assert faults(root, root.tag) == []
        if root.tag == "Markup":
            topic = root.find("Topic")
            assert topic.get("Guid") == name.split("/")[0]
            view = topic.find("Viewpoints/ViewPoint")
            assert {f"{topic.get('Guid')}/{view.find(k).text}" for k in ("Viewpoint", "Snapshot")} <= set(names)
            other = xml.fromstring(files[f"{topic.get('Guid')}/viewpoint.bcfv"])
            assert other.get("Guid") == view.get("Guid")
            parts = [c.find("AuthoringToolId").text for c in other.iterfind("Components/Selection/Component")]
            statuses[tuple(parts)] = topic.get("TopicStatus"), topic.find("Title").text
    assert statuses[('frame/"A" <left> & Ø8\\x1b', "frame/B")] == (
        "Open", 'frame/"A" <left> & Ø8\\x1b – frame/B: 10.000 mm deep',
    )  # fmt: skip
    assert statuses["can", "ball"][0] == "Closed"


def test_the_schema_of_this_test_finds_faults():
    topic = xml.fromstring(
        '<Topic Guid="x" TopicType="Clash"><CreationDate>today</CreationDate><Title>a</Title></Topic>'
    )
    found = " ".join(faults(topic, "topic"))
    for words in ("no attribute TopicStatus", "Guid='x'", "another order", "0 of CreationAuthor", "text 'today'"):
        assert words in found


def test_a_view_looks_at_the_place_of_the_clash(tmp_path):
    scene = clashing()
    found = clash.clash(scene)
    vp.write_bcf(tmp_path / "out.bcf", scene, found)
    worst = next(p for p in found if p.kind == "clash")
    with zipfile.ZipFile(tmp_path / "out.bcf") as archive:
        views = [xml.fromstring(archive.read(n)) for n in archive.namelist() if n.endswith(".bcfv")]
    view = next(v for v in views if "frame/B" in [c.text for c in v.iter("AuthoringToolId")]).find("OrthogonalCamera")

    def vector(name):
        return np.array([float(view.find(f"{name}/{axis}").text) for axis in "XYZ"])

    forward, up = vector("CameraDirection"), vector("CameraUpVector")
    assert np.linalg.norm(forward) == pytest.approx(1.0) and abs(forward @ up) < 1e-12
    away = np.array(worst.point) - vector("CameraViewPoint")
    across = away - (away @ forward) * forward
    assert away @ forward > 0.0 and np.linalg.norm(across) < float(view.find("ViewToWorldScale").text)


def test_the_same_clashes_give_the_same_bytes_and_the_command_line_writes_them(tmp_path, capsys):
    scene = clashing()
    found = clash.clash(scene)
    date = datetime.datetime(2026, 1, 2, tzinfo=datetime.UTC)
    first, second = (tmp_path / name for name in ("a.bcf", "b.bcf"))
    vp.write_bcf(first, scene, found, date=date)
    vp.write_bcf(second, scene, found, date=date)
    assert first.read_bytes() == second.read_bytes()
    parts = {"a": m.box(0.1, 0.1, 0.1), "b": (m.box(0.1, 0.1, 0.1), pin.SE3(np.eye(3), np.array([0.05, 0, 0])))}
    model = m.write_step(tmp_path / "model.step", parts)
    out, table = tmp_path / "out.bcf", tmp_path / "out.csv"
    assert cli.main(["clash", str(model), "--bcf", str(out), "--table", str(table)]) == 1
    assert f"wrote {out}" in capsys.readouterr().out
    assert zipfile.is_zipfile(out) and table.read_text().startswith("kind,part_a,part_b,surface_a,")
    out.write_bytes(b"mine")
    assert cli.main(["clash", str(model), "--bcf", str(out)]) == 2
    assert out.read_bytes() == b"mine"
