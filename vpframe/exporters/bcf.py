"""Clashes as BCF 3.0 (BIM Collaboration Format, buildingSMART): one topic for each pair of parts, with a picture.

The GUID of a topic is derived from the two parts' names, so that tools update it in later runs. Parts have no IFC
GUID: components carry their names as `AuthoringToolId`.
"""

from __future__ import annotations

import datetime
import io
import os
import uuid
import zipfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from xml.etree import ElementTree as xml

import numpy as np
from numpy.typing import NDArray

from vpframe import files
from vpframe.analysis.clash import is_open
from vpframe.analysis.fits import BAD_KINDS
from vpframe.analysis.pairs import ClashRow, PartPair, by_parts
from vpframe.events import Frame, Poses
from vpframe.outputs import BCF, GENERATOR, claimed
from vpframe.report.pictures import PAIR_SIZE, pair_camera, pair_picture
from vpframe.scene.boxes import placed_corners
from vpframe.scene.scene import Scene
from vpframe.text import plain
from vpframe.view.camera import Camera, look_at
from vpframe.view.snapshot import Look, png, render

NAMESPACE = uuid.UUID("8b3f3a52-6f0e-5c0b-9d57-3c1c6a1f6f10")
"""namespace of the GUIDs of topics and viewpoints"""
TYPE, OPEN, CLOSED = "Clash", "Open", "Closed"
RED = "E62924"


def write_bcf(
    path: str | os.PathLike[str],
    scene: Scene,
    found: Iterable[ClashRow],
    author: str = GENERATOR,
    date: datetime.datetime | None = None,
    progress: Callable[[float, str], None] = lambda fraction, text: None,
) -> list[str]:
    """Write the clashes found by `vpframe.analysis.clash.clash` as a BCF 3.0 file.

    Parameters
    ----------
    found: rows of `clash`, or of `with_status`. An accepted clash becomes a closed
        topic with its remark as comment.
    author, date: of the topics; default date: now, UTC.

    Returns
    -------
    One line for each kind of pair that is no clash and was left out, with its number.

    Raises
    ------
    OutputError: the file cannot be written, or exists and was not written by vpframe.
    """
    pairs = by_parts(found)
    clashes = [pair for pair in pairs if pair.kind in BAD_KINDS]
    when = (date or datetime.datetime.now(datetime.UTC)).astimezone(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    with claimed(path, BCF) as output:
        content = io.BytesIO()
        with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.comment = GENERATOR.encode()
            _add(archive, "bcf.version", _text(xml.Element("Version", VersionId="3.0")))
            _add(archive, "project.bcfp", _text(_project(scene)))
            _add(archive, "extensions.xml", _text(_extensions(author)))
            for number, pair in enumerate(clashes):
                parts = pair.worst.parts
                progress(number / len(clashes), " – ".join(parts))
                guid, view = (_guid(what, *parts) for what in ("topic", "view"))
                camera, picture = _picture(scene, pair.worst)
                topic = _topic(scene, pair, guid, view, number, author, when)
                _add(archive, f"{guid}/markup.bcf", _text(topic))
                _add(archive, f"{guid}/viewpoint.bcfv", _text(_viewpoint(parts, view, camera)))
                _add(archive, f"{guid}/snapshot.png", picture)
        files.replace(output.path, content.getvalue())
    others = [pair.kind for pair in pairs if pair.kind not in BAD_KINDS]
    return [f"{others.count(kind)} pairs of kind {kind}: no clashes" for kind in dict.fromkeys(others)]


def _guid(*words: str) -> str:
    return str(uuid.uuid5(NAMESPACE, "\0".join(words)))


def _add(archive: zipfile.ZipFile, name: str, data: bytes) -> None:
    info = zipfile.ZipInfo(name)  # without date: equal clashes give equal bytes
    info.compress_type = zipfile.ZIP_DEFLATED
    info.external_attr = 0o644 << 16
    archive.writestr(info, data)


def _text(root: xml.Element) -> bytes:
    xml.indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + xml.tostring(root, encoding="utf-8") + b"\n"


def _element(parent: xml.Element, name: str, text: str | None = None, **attributes: str) -> xml.Element:
    made = xml.SubElement(parent, name, attributes)
    made.text = text if text is None else plain(text)
    return made


def _project(scene: Scene) -> xml.Element:
    root = xml.Element("ProjectInfo")
    name = Path(scene.source).name if scene.source else "scene"
    project = _element(root, "Project", ProjectId=_guid("project", name))
    _element(project, "Name", name)
    return root


def _extensions(author: str) -> xml.Element:
    """Return the vocabulary of the topics: all lists of the schema in its order."""
    root = xml.Element("Extensions")
    lists = {
        "TopicTypes": [TYPE],
        "TopicStatuses": [OPEN, CLOSED],
        "Priorities": [],
        "TopicLabels": list(BAD_KINDS),
        "Users": [author],
        "SnippetTypes": [],
        "Stages": [],
    }
    for name, words in lists.items():
        made = _element(root, name)
        for word in words:
            _element(made, {"TopicStatuses": "TopicStatus", "Priorities": "Priority"}.get(name, name[:-1]), word)
    return root


def _topic(
    scene: Scene, pair: PartPair[ClashRow], guid: str, view: str, number: int, author: str, when: str
) -> xml.Element:
    root = xml.Element("Markup")
    if scene.source:
        file = _element(_element(_element(root, "Header"), "Files"), "File", IsExternal="true")
        _element(file, "Filename", Path(scene.source).name)
    status = OPEN if is_open(pair) else CLOSED
    topic = _element(root, "Topic", Guid=guid, TopicType=TYPE, TopicStatus=status)
    row = pair.worst
    size = f"{row.depth * 1e3:.3f} mm deep" if row.depth > 0.0 else row.kind
    _element(topic, "Title", f"{' – '.join(row.parts)}: {size}")
    _element(topic, "Index", str(number))
    _element(_element(topic, "Labels"), "Label", row.kind)
    _element(topic, "CreationDate", when)
    _element(topic, "CreationAuthor", author)
    _element(topic, "Description", _description(pair))
    if pair.remark:
        comment = _element(_element(topic, "Comments"), "Comment", Guid=_guid("remark", guid))
        _element(comment, "Date", when)
        _element(comment, "Author", author)
        _element(comment, "Comment", pair.remark)
        _element(comment, "Viewpoint", Guid=view)
    shown = _element(_element(topic, "Viewpoints"), "ViewPoint", Guid=view)
    _element(shown, "Viewpoint", "viewpoint.bcfv")
    _element(shown, "Snapshot", "snapshot.png")
    _element(shown, "Index", "0")
    return root


def _description(pair: PartPair[ClashRow]) -> str:
    row = pair.worst
    x, y, z = (1e3 * value for value in row.point)
    faces = " – ".join(row.face_words) or "as a whole"
    words = [f"{row.kind}: {faces}", f"{len(pair.rows)} pairs of surfaces", f"at ({x:.3f}, {y:.3f}, {z:.3f}) mm"]
    return "; ".join(filter(None, [*words, row.why]))


def _viewpoint(parts: Sequence[str], guid: str, camera: Camera) -> xml.Element:
    root = xml.Element("VisualizationInfo", Guid=guid)
    components = _element(root, "Components")
    _components(_element(components, "Selection"), parts)
    _element(components, "Visibility", DefaultVisibility="true")
    color = _element(_element(components, "Coloring"), "Color", Color=RED)
    _components(_element(color, "Components"), parts[1:])
    view = _element(root, "OrthogonalCamera")
    forward = (camera.target - camera.eye) / np.linalg.norm(camera.target - camera.eye)
    up = camera.up - (camera.up @ forward) * forward
    width, height = PAIR_SIZE
    _vector(view, "CameraViewPoint", camera.eye)
    _vector(view, "CameraDirection", forward)
    _vector(view, "CameraUpVector", up / np.linalg.norm(up))
    _element(view, "ViewToWorldScale", repr(float(2.0 * camera.radius * height / min(width, height))))
    _element(view, "AspectRatio", repr(width / height))
    return root


def _components(parent: xml.Element, parts: Sequence[str]) -> None:
    for part in parts:
        made = _element(parent, "Component")
        _element(made, "OriginatingSystem", GENERATOR)
        _element(made, "AuthoringToolId", part)


def _vector(parent: xml.Element, name: str, values: NDArray[np.float64]) -> None:
    made = _element(parent, name)
    for axis, value in zip("XYZ", values.tolist(), strict=True):
        _element(made, axis, repr(value))


def _picture(scene: Scene, row: ClashRow) -> tuple[Camera, bytes]:
    poses = Poses.of({part.name: part.pose for part in scene.parts})
    surfaces = list(zip(row.parts, row.surfaces, strict=False))
    if surfaces:
        frame = Frame(0, 0.0, poses, np.empty((0, 4), np.int32), (), {}, {}, None, {})
        return pair_camera(scene, frame, surfaces), png(pair_picture(scene, frame, surfaces))
    camera = look_at(np.concatenate([placed_corners(scene[name], scene[name].pose) for name in row.parts]))
    opacity = {name: 0.5 if name in row.parts else 0.1 for name in scene.names}
    return camera, png(render(scene, poses, (), PAIR_SIZE, camera, (), look=Look(opacity)))
