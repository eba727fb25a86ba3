"""Read motion: poses over time from a recording or a table."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpframe.errors import LoadError, VpframeError
from vpframe.scene.motion import Motion
from vpframe.text import uncell

COLUMNS = ("part", "t", "x", "y", "z", "qx", "qy", "qz", "qw")
"""columns of a table of poses: s, m, world"""
SINGLE = 2.0**-22
"""relative error of poses in single precision, with a margin for products of quaternions"""
Row = tuple[str, float, list[float]]
"""part, time (s), position and quaternion"""


def read_motion(path: str | Path) -> Motion:
    """Read the poses of parts over time from a recording (.rrd) or a table of poses (.csv, .parquet; `COLUMNS`).

    Poses in a recording have single precision: 1e-7 of a part's distance from the origin.

    Raises LoadError with one line that names the file and the row.
    """
    file = Path(path)
    readers: dict[str, Callable[[Path, list[float]], Iterator[Row]]] = {
        ".rrd": _recorded, ".csv": _csv, ".parquet": _parquet
    }  # fmt: skip
    if file.suffix.lower() not in readers:
        known = ", ".join(readers)
        raise LoadError(f"{path}: no motion is read from {file.suffix or 'such files'}; known are {known}", str(path))
    ends = [0.0]
    rows = sorted(readers[file.suffix.lower()](file, ends), key=lambda row: row[1])
    if not rows:
        raise LoadError(f"{path}: holds no pose; record a session, or export one with --to poses.csv", str(path))
    times = sorted({time for _, time, _ in rows})
    number = {time: k for k, time in enumerate(times)}
    changes: dict[str, dict[int, NDArray[np.float64]]] = {}
    for part, time, values in rows:
        row = np.array(values, dtype=np.float64)
        length = np.linalg.norm(row[3:])
        if not np.isfinite(row).all() or not math.isfinite(time) or abs(length - 1.0) > 1e-3:
            raise LoadError(f"{path}: {part} at {time:g} s: {values} is no position and unit quaternion", str(path))
        row[3:] /= length
        changes.setdefault(part, {})[number[time]] = row
    precision = SINGLE if file.suffix.lower() == ".rrd" else 0.0
    try:
        return Motion.of_changes(times, {part: own.items() for part, own in changes.items()}, max(ends), precision)
    except VpframeError as error:
        raise LoadError(f"{path}: {error}", str(path)) from None


def _recorded(path: Path, ends: list[float]) -> Iterator[Row]:
    from vpframe.view.replay import tables

    members: dict[str, list[str]] = {}
    crowds: dict[str, tuple[float, Any, Any]] = {}
    for entity, rows in tables(path):
        root, _, rest = entity.partition("/")
        ends.extend(row["time"] for row in rows[-1:] if "time" in row)
        for row in rows if root in ("parts", "still") else ():
            if "Transform3D:translation" in row and "Transform3D:quaternion" in row:
                values = [*row["Transform3D:translation"][0], *row["Transform3D:quaternion"][0]]
                yield _unescaped(rest), row["time"], values
            elif "parts" in row:
                members[entity] = row["parts"]
            elif "InstancePoses3D:translations" in row and entity not in crowds:
                crowds[entity] = (
                    row["time"], row["InstancePoses3D:translations"], row["InstancePoses3D:quaternions"]
                )  # fmt: skip
    for entity, (time, positions, turns) in crowds.items():
        for name, position, turn in zip(members.get(entity, ()), positions, turns, strict=False):
            yield name, time, [*position, *turn]


def _unescaped(step: str) -> str:
    """Inverse of `escape_entity_path_part`."""

    def character(match: re.Match[str]) -> str:
        return chr(int(match[2], 16)) if match[2] else {"n": "\n", "r": "\r", "t": "\t"}.get(match[1], match[1])

    return re.sub(r"\\(u\{([0-9a-fA-F]+)\}|.)", character, step, flags=re.DOTALL)


def _csv(path: Path, ends: list[float]) -> Iterator[Row]:
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file, skipinitialspace=True)
            _check(path, reader.fieldnames or ())
            for row in reader:
                yield _row(path, reader.line_num, {**row, "part": uncell(row["part"] or "")})
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise LoadError(f"{path}: cannot be read as a table of poses: {error}", str(path)) from None


def _parquet(path: Path, ends: list[float]) -> Iterator[Row]:
    from pyarrow import parquet

    try:
        table = parquet.read_table(path)
    except (OSError, ValueError) as error:
        raise LoadError(f"{path}: cannot be read as a table of poses: {error}", str(path)) from None
    _check(path, table.column_names)
    for number, row in enumerate(table.to_pylist()):
        yield _row(path, number, row)


def _check(path: Path, columns: Any) -> None:
    missing = [name for name in COLUMNS if name not in columns]
    if missing:
        raise LoadError(f"{path}: has no column {', '.join(missing)}; poses have {', '.join(COLUMNS)}", str(path))


def _row(path: Path, number: int, row: dict[str, Any]) -> Row:
    try:
        t, *values = (float(row[name]) for name in COLUMNS[1:])
        return str(row["part"]), t, values
    except (TypeError, ValueError):
        raise LoadError(f"{path}: row {number} is {list(row.values())}; numbers are needed", str(path)) from None
