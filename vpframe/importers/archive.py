"""A `RawScene` as one file: arrays and JSON, nothing that runs when it is read."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from vpframe.errors import VpframeError
from vpframe.importers.raw import Array, RawEdge, RawFace, RawPart, RawScene, RawShape


class ArchiveError(VpframeError):
    """The file is no archive of this version, or it is damaged."""


def write(raw: RawScene, path: str | Path) -> None:
    """Write all of `raw`; `read` gives it back bit by bit."""
    arrays: dict[str, Any] = {}
    shapes = []
    for i, shape in enumerate(raw.shapes):
        arrays |= {
            f"{i}/vertices": shape.vertices,
            f"{i}/triangles": shape.triangles,
            f"{i}/face_of_triangle": shape.face_of_triangle,
            f"{i}/samples": _joined([face.samples for face in shape.faces]),
            f"{i}/edges": _joined([edge.points for edge in shape.edges]),
        }
        shapes.append(
            {
                "faces": [
                    [f.name, f.kind, f.numbers, f.typed, len(f.samples), f.color, f.residual] for f in shape.faces
                ],
                "edges": [[len(e.points), e.faces, _circle(e)] for e in shape.edges],
                "volume": shape.volume,
                "center": shape.center.tolist(),
                "inertia": shape.inertia.tolist(),
                "notes": shape.notes,
                "settled": shape.settled,
            }
        )
    parts = [[p.name, p.shape, p.rotation.tolist(), p.translation.tolist(), p.color, p.density] for p in raw.parts]
    text = {
        "shapes": shapes,
        "parts": parts,
        "instances": raw.instances,
        "faces": raw.faces,
        "notes": raw.notes,
    }
    arrays["text"] = np.frombuffer(json.dumps(text).encode(), np.uint8)
    with open(path, "wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def read(path: str | Path) -> RawScene:
    """What `write` wrote, but for `whole`. Raises ArchiveError, or OSError where there is no such file."""
    try:
        with np.load(path, allow_pickle=False) as arrays:
            text = json.loads(arrays["text"].tobytes())
            shapes = [_shape(arrays, i, shape) for i, shape in enumerate(text["shapes"])]
        parts = [
            RawPart(name, shape, np.array(rotation), np.array(translation), _color(color), density)
            for name, shape, rotation, translation, color, density in text["parts"]
        ]
        return RawScene(shapes, parts, Counter(text["instances"]), Counter(text["faces"]), text["notes"])
    except (ArchiveError, OSError):
        raise
    except Exception as error:  # zip files, headers and JSON each have their own
        raise ArchiveError(f"{path}: damaged ({type(error).__name__}: {error})") from None


def _joined(arrays: list[Array]) -> Array:
    return np.concatenate(arrays) if arrays else np.empty((0, 3))


def _circle(edge: RawEdge) -> list[Any] | None:
    return None if edge.circle is None else [edge.circle[0].tolist(), edge.circle[1].tolist(), edge.circle[2]]


def _color(values: Any) -> tuple[float, float, float, float] | None:
    return None if values is None else (values[0], values[1], values[2], values[3])


def _shape(arrays: Any, number: int, text: Any) -> RawShape:
    samples = _cut(arrays[f"{number}/samples"], [face[4] for face in text["faces"]])
    lines = _cut(arrays[f"{number}/edges"], [edge[0] for edge in text["edges"]])
    faces = [
        RawFace(name, kind, tuple(numbers), typed, points, _color(color), residual)
        for (name, kind, numbers, typed, _, color, residual), points in zip(text["faces"], samples, strict=True)
    ]
    edges = [
        RawEdge(points, tuple(beside), None if c is None else (np.array(c[0]), np.array(c[1]), c[2]))
        for (_, beside, c), points in zip(text["edges"], lines, strict=True)
    ]
    return RawShape(
        arrays[f"{number}/vertices"],
        arrays[f"{number}/triangles"],
        arrays[f"{number}/face_of_triangle"],
        faces,
        edges,
        text["volume"],
        np.array(text["center"]),
        np.array(text["inertia"]),
        text["notes"],
        text["settled"],
    )


def _cut(points: Array, counts: list[int]) -> list[Array]:
    """`points` in pieces of so many rows; raises ValueError where they do not add up."""
    if sum(counts) != len(points) or min(counts, default=0) < 0:
        raise ValueError(f"{len(points)} points for {sum(counts)}")
    ends = np.cumsum(counts)
    return [points[end - n : end] for end, n in zip(ends, counts, strict=True)]
