"""Limits of processor time and resident memory: of reading processes, and of each shape that they make.

No imports but the standard library's, because the reading process uses it.
"""

from __future__ import annotations

from dataclasses import dataclass

MEGABYTE = 1e6
CAD_SECONDS = 60.0
"""for each megabyte of a CAD file, and at least; more for each shape and face"""
CAD_MEMORY, CAD_MEMORY_OF_SIZE = 1_750_000_000, 200
"""bytes, and for each byte of the files: below 2 GB. The idle kernel takes 0.25 GB; measured models took below 80 bytes
for each byte (um2_head: 0.05 GB for 2.6 MB)."""
MESH_SECONDS, MESH_SECONDS_OF_SIZE = 30.0, 6e-6
"""and for each byte of mesh files: trimesh takes below 1e-6"""
MESH_MEMORY, MESH_MEMORY_OF_SIZE = 1_500_000_000, 20
SHAPE_SECONDS, SHAPE_SECONDS_OF_FACE = 10.0, 0.1
SHAPE_MEMORY = 0.8
"""part of the limit of a reading process that one forked for shapes may write to"""
CROWDED = 0.4
"""part of the memory above which a crash counts as lack of memory, since growing arrays are copied to twice their
size"""


@dataclass(frozen=True)
class ReadingLimits:
    """Limits of a process."""

    seconds: float
    """of processor time, of all threads and child processes; time in which all of them sleep counts too"""
    memory: float
    """resident bytes"""
    growth: tuple[tuple[str, float, float], ...] = ()
    """(unit, seconds, bytes) added for each unit ("shapes", "faces", …) that the process reports to have found"""

    def grown(self, found: dict[str, int]) -> ReadingLimits:
        """Return the limits for a file in which `found` (number of each unit) was found."""
        each = [(found.get(unit, 0), seconds, memory) for unit, seconds, memory in self.growth]
        seconds = self.seconds + sum(number * more for number, more, _ in each)
        return ReadingLimits(seconds, self.memory + sum(number * more for number, _, more in each))

    @property
    def ceiling(self) -> int:
        """Bytes of writable memory that the process may map, resident or not; holds between two samples."""
        return int(1.12 * self.memory)


def of_cad(size: int, timeout: float | None = None) -> ReadingLimits:
    """ReadingLimits for CAD files of `size` bytes in all; `timeout`: s instead of the default, which grows."""
    growth = () if timeout is not None else (("shapes", 1.0, 0.0), ("faces", 0.05, 0.0))
    seconds = CAD_SECONDS * max(1.0, size / MEGABYTE) if timeout is None else timeout
    return ReadingLimits(seconds, CAD_MEMORY + CAD_MEMORY_OF_SIZE * size, (*growth, ("forked", 0.0, 1.0)))


def of_meshes(size: int, timeout: float | None = None) -> ReadingLimits:
    """ReadingLimits for mesh files of `size` bytes in all; `timeout`: s instead of the default."""
    seconds = MESH_SECONDS + MESH_SECONDS_OF_SIZE * size if timeout is None else timeout
    return ReadingLimits(seconds, MESH_MEMORY + MESH_MEMORY_OF_SIZE * size, (("triangles", 1e-4, 1000.0),))


def of_shape(faces: float, memory: float) -> ReadingLimits:
    """ReadingLimits for one shape of so many faces in a process forked from one with a limit of `memory`, bytes."""
    return ReadingLimits(SHAPE_SECONDS + SHAPE_SECONDS_OF_FACE * faces, SHAPE_MEMORY * memory)
