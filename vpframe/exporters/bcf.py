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
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from vpframe import files
from vpframe.analysis.clash import is_open
from vpframe.analysis.fits import BAD_KINDS
from vpframe.analysis.pairs import ClashRow, PartPair, by_parts
from vpframe.events import Frame, Poses
from vpframe.outputs import BCF, GENERATOR, claimed
from vpframe.report.pictures import PAIR_SIZE, pair_camera, pair_picture
from vpframe.scene.boxes import placed_corners
from vpframe.scene.scene import Scene
from vpframe.text import rendered
from vpframe.view.camera import Camera, look_at
from vpframe.view.snapshot import Look, png, render

NAMESPACE = uuid.UUID("8b3f3a52-6f0e-5c0b-9d57-3c1c6a1f6f10")
"""namespace of the GUIDs of topics and viewpoints"""


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
    source = Path(scene.source).name if scene.source else ""
    with claimed(path, BCF) as output:
        content = io.BytesIO()
        with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.comment = GENERATOR.encode()
            _add(archive, "bcf.version")
            _add(archive, "project.bcfp", guid=_guid("project", source or "scene"), name=source or "scene")
            _add(archive, "extensions.xml", kinds=BAD_KINDS, author=author)
            for number, pair in enumerate(clashes):
                parts = pair.worst.parts
                progress(number / len(clashes), " – ".join(parts))
                guid, view = (_guid(what, *parts) for what in ("topic", "view"))
                camera, picture = _picture(scene, pair.worst)
                size = f"{pair.worst.depth * 1e3:.3f} mm deep" if pair.worst.depth > 0.0 else pair.worst.kind
                _add(
                    archive, f"{guid}/markup.bcf", source=source, guid=guid, view=view, number=number, when=when,
                    author=author, kind=pair.worst.kind, is_open=is_open(pair), description=_description(pair),
                    title=f"{' – '.join(parts)}: {size}", remark=pair.remark, remark_guid=_guid("remark", guid),
                )  # fmt: skip
                _add(archive, f"{guid}/viewpoint.bcfv", view=view, parts=parts, generator=GENERATOR, **_view(camera))
                _write(archive, f"{guid}/snapshot.png", picture)
        files.replace(output.path, content.getvalue())
    others = [pair.kind for pair in pairs if pair.kind not in BAD_KINDS]
    return [f"{others.count(kind)} pairs of kind {kind}: no clashes" for kind in dict.fromkeys(others)]


def _guid(*words: str) -> str:
    return str(uuid.uuid5(NAMESPACE, "\0".join(words)))


def _add(archive: zipfile.ZipFile, name: str, /, **contents: Any) -> None:
    """Add a document, from the template of its name."""
    _write(archive, name, rendered(f"exporters/bcf_files/{Path(name).name}", **contents).encode())


def _write(archive: zipfile.ZipFile, name: str, data: bytes) -> None:
    info = zipfile.ZipInfo(name)  # without date: equal clashes give equal bytes
    info.compress_type = zipfile.ZIP_DEFLATED
    info.external_attr = 0o644 << 16
    archive.writestr(info, data)


def _description(pair: PartPair[ClashRow]) -> str:
    row = pair.worst
    x, y, z = (1e3 * value for value in row.point)
    faces = " – ".join(row.face_words) or "as a whole"
    words = [f"{row.kind}: {faces}", f"{len(pair.rows)} pairs of surfaces", f"at ({x:.3f}, {y:.3f}, {z:.3f}) mm"]
    return "; ".join(filter(None, [*words, row.why]))


def _view(camera: Camera) -> dict[str, Any]:
    """Return the vectors of an orthogonal camera, and its extent."""
    forward = (camera.target - camera.eye) / np.linalg.norm(camera.target - camera.eye)
    up = camera.up - (camera.up @ forward) * forward
    width, height = PAIR_SIZE
    vectors = {"CameraViewPoint": camera.eye, "CameraDirection": forward, "CameraUpVector": up / np.linalg.norm(up)}
    return {
        "vectors": {name: vector.tolist() for name, vector in vectors.items()},
        "scale": float(2.0 * camera.radius * height / min(width, height)),
        "aspect": width / height,
    }


def _picture(scene: Scene, row: ClashRow) -> tuple[Camera, bytes]:
    poses = Poses.of({part.name: part.pose for part in scene.parts})
    surfaces = list(zip(row.parts, row.surfaces, strict=False))
    if surfaces:
        frame = Frame(0, 0.0, poses, np.empty((0, 4), np.int32), (), {}, {}, None, {})
        return pair_camera(scene, frame, surfaces), png(pair_picture(scene, frame, surfaces))
    camera = look_at(np.concatenate([placed_corners(scene[name], scene[name].pose) for name in row.parts]))
    opacity = {name: 0.5 if name in row.parts else 0.1 for name in scene.names}
    return camera, png(render(scene, poses, (), PAIR_SIZE, camera, (), look=Look(opacity)))
