"""A `RawScene` as one file, encoded by `vpframe.codec`; nothing in it is executed."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from vpframe.codec import WRONG, Codec, CodecError
from vpframe.errors import VpframeError
from vpframe.importers.raw import Array, RawFace, RawJoint, RawPart, RawScene, RawShape


class ArchiveError(VpframeError):
    """The file is not an archive of this version, or is damaged."""


CODEC = Codec()
_CHECKSUM = struct.Struct("<I")  # crc32 of the content


def write(raw: RawScene, path: str | Path) -> None:
    """Write `raw`; `read` restores it bit for bit."""
    shapes = [
        {
            "vertices": shape.vertices,
            "triangles": shape.triangles,
            "face_of_triangle": shape.face_of_triangle,
            "samples": _joined([face.samples for face in shape.faces]),
            "faces": [
                [
                    f.name,
                    f.kind,
                    list(map(float, f.numbers)),
                    f.typed,
                    len(f.samples),
                    _listed(f.color),
                    f.residual,
                    f.size,
                ]
                for f in shape.faces
            ],
            "volume": shape.volume,
            "center": shape.center,
            "inertia": shape.inertia,
            "notes": shape.notes,
            "settled": shape.settled,
            "brep": np.frombuffer(shape.brep, np.uint8),
            "segmented": shape.segmented,
            "bounds": shape.bounds,
        }
        for shape in raw.shapes
    ]
    parts = [[p.name, p.shape, p.rotation, p.translation, _listed(p.color), p.density, p.mass] for p in raw.parts]
    joints = [[j.name, j.links, j.axes, j.free, j.note] for j in raw.joints]
    counts = {"instances": dict(raw.instances), "faces": dict(raw.faces)}
    content = CODEC.encode(
        {
            "shapes": shapes,
            "parts": parts,
            "links": raw.links,
            "joints": joints,
            "notes": raw.notes,
            "whole": raw.whole,
            **counts,
        }
    )
    with open(path, "wb") as file:
        file.write(_CHECKSUM.pack(zlib.crc32(content)))
        file.write(content)


def read(path: str | Path) -> RawScene:
    """Read an archive. Raises ArchiveError if damaged, OSError if missing."""
    data = Path(path).read_bytes()
    try:
        if _CHECKSUM.unpack(data[: _CHECKSUM.size])[0] != zlib.crc32(memoryview(data)[_CHECKSUM.size :]):
            raise ValueError("its checksum is another one")
        content = CODEC.decode(data[_CHECKSUM.size :])
        shapes = [_shape(shape) for shape in content["shapes"]]
        parts = [
            RawPart(name, shape, rotation, translation, _color(color), density, mass)
            for name, shape, rotation, translation, color, density, mass in content["parts"]
        ]
        joints = [RawJoint(*joint) for joint in content["joints"]]
        counts = (Counter(content["instances"]), Counter(content["faces"]))
        return RawScene(shapes, parts, *counts, content["notes"], content["links"], joints, content["whole"])
    except (*WRONG, CodecError, struct.error) as error:
        raise ArchiveError(f"{path}: damaged ({type(error).__name__}: {error})") from None


def _listed(color: Any) -> list[float] | None:
    return None if color is None else list(map(float, color))


def _joined(arrays: list[Array]) -> Array:
    return np.concatenate(arrays) if arrays else np.empty((0, 3))


def _color(values: Any) -> tuple[float, float, float, float] | None:
    return None if values is None else (values[0], values[1], values[2], values[3])


def _shape(content: Any) -> RawShape:
    samples = _cut(content["samples"], [face[4] for face in content["faces"]])
    faces = [
        RawFace(name, kind, tuple(numbers), typed, points, _color(color), residual, size)
        for (name, kind, numbers, typed, _, color, residual, size), points in zip(
            content["faces"], samples, strict=True
        )
    ]
    content["brep"] = content["brep"].tobytes()
    whole = ("volume", "center", "inertia", "notes", "settled", "brep", "segmented", "bounds")
    arrays = (content["vertices"], content["triangles"], content["face_of_triangle"])
    return RawShape(*arrays, faces, *(content[name] for name in whole))


def _cut(points: Array, counts: list[int]) -> list[Array]:
    """Split `points` into pieces of `counts` rows; ValueError if the counts do not add up."""
    if sum(counts) != len(points) or min(counts, default=0) < 0:
        raise ValueError(f"{len(points)} points for {sum(counts)}")
    ends = np.cumsum(counts)
    return [points[end - n : end] for end, n in zip(ends, counts, strict=True)]
