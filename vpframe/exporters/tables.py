"""Tables for pandas, polars and spreadsheets: CSV and Parquet."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from vpframe import files
from vpframe.analysis.pairs import ClashRow
from vpframe.errors import VpframeError
from vpframe.events import Event
from vpframe.outputs import PARQUET, Output, table_of
from vpframe.scene.motion import Motion
from vpframe.scene.scene import Scene
from vpframe.text import csv_text

SUFFIXES = (".csv", ".parquet")
EVENT_COLUMNS = ("step", "time", "kind", "parts", "surfaces", "text", "data")


def write_table(
    path: str | os.PathLike[str],
    rows: Iterable[Event | Mapping[str, Any]],
    columns: Sequence[str] | None = None,
    force: bool = False,
) -> Path:
    """Write events, or rows of named values, as CSV or Parquet by the suffix; return the path.

    One column for each name; numbers and text are kept, nested values (lists, dictionaries) become JSON. CSV is UTF-8
    with a header and all digits of numbers.

    columns: names in order; default: in order of appearance. force: also replace a file that is no such table.

    Raises
    ------
    OutputError: it cannot be written, or exists and is not ours. VpframeError: unknown suffix.
    """
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise VpframeError(f"{path}: tables are written as {' or '.join(SUFFIXES)}")
    flat = [_flat(row) for row in rows]
    names = list(columns or dict.fromkeys(name for row in flat for name in row))
    if not names:
        names = list(EVENT_COLUMNS)
    kind = table_of(names) if target.suffix.lower() == ".csv" else PARQUET
    with path if isinstance(path, Output) else Output(path, kind, force) as output:
        if target.suffix.lower() == ".csv":
            files.replace(output.path, csv_text([names, *([row.get(name) for name in names] for row in flat)]))
        else:
            files.replace(output.path, _parquet(names, flat))
    return target


def pose_rows(scene: Scene, motion: Motion | None = None) -> list[dict[str, Any]]:
    """Return a row for each part and key: part, t (s), x y z (m), qx qy qz qw, and properties; see `read_motion`."""
    out = []
    for part in scene.parts:
        times, rows = (np.zeros(1), pin.SE3ToXYZQUAT(part.pose)[None, :])
        if motion is not None and part.name in motion.keys:
            times, rows = motion.keys[part.name]
        red, green, blue, alpha = part.color
        rest = {
            "density": part.density, "volume": part.shape.volume, "fixed": part.fixed,
            "red": red, "green": green, "blue": blue, "alpha": alpha,
        }  # fmt: skip
        for time, row in zip(times.tolist(), rows.tolist(), strict=True):
            pose = dict(zip(("x", "y", "z", "qx", "qy", "qz", "qw"), row, strict=True))
            out.append({"part": part.name, "t": time, **pose, **rest})
    return out


def clash_rows(found: Iterable[ClashRow]) -> list[dict[str, Any]]:
    """Return a row for each pair of surfaces found by `vpframe.analysis.clash.clash`; lengths in m."""
    out = []
    for row in found:
        surfaces, faces = (list(values) or [None, None] for values in (row.surfaces, row.face_words))
        x, y, z = row.point
        a, b = row.parts
        out.append(
            {
                "kind": row.kind, "part_a": a, "part_b": b, "surface_a": surfaces[0], "surface_b": surfaces[1],
                "face_a": faces[0], "face_b": faces[1], "distance": row.distance, "depth": row.depth,
                "x": x, "y": y, "z": z, "reason": row.why, "status": row.status or None,
                "remark": row.remark if row.status else None,
            }
        )  # fmt: skip
    return out


def _flat(row: Event | Mapping[str, Any]) -> dict[str, Any]:
    given = {name: getattr(row, name) for name in EVENT_COLUMNS} if isinstance(row, Event) else row
    return {name: _cell(value) for name, value in given.items()}


def _cell(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        value = {str(key): inner for key, inner in value.items()}
    return json.dumps(value, ensure_ascii=False, default=lambda inner: _cell(inner) if _known(inner) else str(inner))


def _known(value: Any) -> bool:
    return isinstance(value, np.generic | np.ndarray)


def _parquet(names: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> bytes:
    import pyarrow as pa
    from pyarrow import parquet

    columns = {name: [row.get(name) for row in rows] for name in names}
    try:
        table = pa.table(columns).replace_schema_metadata({b"generator": b"vpframe"})
    except (pa.ArrowInvalid, pa.ArrowTypeError) as error:
        raise VpframeError(f"a column holds values of several types, which Parquet cannot carry: {error}") from None
    sink = io.BytesIO()
    parquet.write_table(table, sink)
    return sink.getvalue()
