"""`Trails`: the poses of moved parts at every step, and where a way bends within one, in bounded memory."""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Iterator, Sequence
from typing import Any, BinaryIO

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vpframe.errors import OutputError

ROWS = 4096
"""number of rows kept in memory; older rows are in a temporary file"""
_ROW = np.dtype([("step", np.int64), ("part", np.int64), ("rotation", np.float64, 9), ("translation", np.float64, 3)])


class Trails:
    """Poses of parts by step, 112 bytes each, most of them in a temporary file.

    The file is created when needed, has no name, and is deleted with this object or its process.
    """

    def __init__(self) -> None:
        self._rows = np.zeros(0, _ROW)
        self._count = 0
        self._full = 0  # blocks of ROWS rows in the file
        self._file: BinaryIO | None = None
        self._lost = ""

    def add(self, step: int, parts: Sequence[int], poses: NDArray[np.float64]) -> None:
        """Append the poses (k, 12), rotation by rows and translation in m, of parts in a step, in order."""
        done = 0
        while done < len(parts):
            if self._count == len(self._rows):
                self._make_room()
            rows = self._rows[self._count : self._count + len(parts) - done]
            own = slice(done, done + len(rows))
            rows["step"], rows["part"] = step, parts[own]
            rows["rotation"], rows["translation"] = poses[own, :9], poses[own, 9:]
            self._count, done = self._count + len(rows), own.stop

    def rewind(self, step: int) -> None:
        """Remove the rows of all later steps."""
        while self._full and self._file is not None and (not self._count or self._rows["step"][0] > step):
            self._full, self._count = self._full - 1, ROWS
            self._file.seek(self._full * ROWS * _ROW.itemsize)
            self._rows = np.frombuffer(self._file.read(ROWS * _ROW.itemsize), _ROW).copy()
        self._count = int(np.searchsorted(self._rows["step"][: self._count], step, side="right"))

    def of(self, part: int) -> tuple[tuple[int, pin.SE3], ...]:
        """Return (step, pose) of every step in which a part moved and of the bends within it, bit for bit.

        Raises
        ------
        OutputError: the temporary file could not be written.
        """
        if self._lost:
            raise OutputError(f"the trails of parts are lost: {self._lost}", tempfile.gettempdir())
        mine = [rows[rows["part"] == part] for rows in self._blocks()]
        return tuple(
            (int(row["step"]), pin.SE3(row["rotation"].reshape(3, 3), row["translation"]))
            for rows in mine
            for row in rows
        )

    def _blocks(self) -> Iterator[NDArray[Any]]:
        if self._file is not None:
            self._file.seek(0)
            for _ in range(self._full):
                yield np.frombuffer(self._file.read(ROWS * _ROW.itemsize), _ROW)
        yield self._rows[: self._count]

    def _make_room(self) -> None:
        """Double the capacity; at `ROWS` rows, write them to the file and start again with an empty block."""
        if self._count < ROWS:
            grown = np.zeros(min(max(64, 2 * self._count), ROWS), _ROW)
            grown[: self._count] = self._rows
            self._rows = grown
            return
        try:
            if self._file is None:
                self._file = tempfile.TemporaryFile(prefix="vpframe-", buffering=0)  # noqa: SIM115 - for the whole run
                weakref.finalize(self, self._file.close)
            self._file.seek(self._full * ROWS * _ROW.itemsize)
            if self._file.write(self._rows.tobytes()) != self._rows.nbytes:
                raise OSError(0, "no room")
            self._full += 1
        except OSError as error:  # reported by `of` only
            self._lost = f"the folder for temporary files, {tempfile.gettempdir()}, cannot be written: {error.strerror}"
        self._count = 0


def bends(points: NDArray[np.float64], within: float) -> list[int]:
    """Return the inner points of a polyline that keep it within a distance of itself, ascending.

    points: (n, k, d) k points that move together; the farthest one counts. Ramer 1972, Douglas and Peucker 1973.
    """
    chord = points[-1] - points[0]
    inner = points[1:-1] - points[0]
    along = (inner * chord).sum(axis=2) / np.maximum((chord * chord).sum(axis=1), np.finfo(float).tiny)
    beside = inner - np.clip(along, 0.0, 1.0)[..., None] * chord
    far = (beside * beside).sum(axis=2).max(axis=1, initial=0.0)
    if not len(far) or far.max() <= within * within:
        return []
    k = 1 + int(far.argmax())
    return [*bends(points[: k + 1], within), k, *(k + i for i in bends(points[k:], within))]
