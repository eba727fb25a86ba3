"""A `RawScene` as one file, encoded by `vpframe.codec`; nothing in it is executed."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from pathlib import Path

from vpframe.codec import Codec, CodecError, Packing
from vpframe.errors import VpframeError
from vpframe.importers.raw import RawFace, RawJoint, RawPart, RawScene, RawShape


class ArchiveError(VpframeError):
    """The file is not an archive of this version, or is damaged."""


CODEC = Codec((RawScene, RawShape, RawFace, RawPart, RawJoint), {Counter: Packing(dict, Counter)})
_CHECKSUM = struct.Struct("<I")  # crc32 of the content


def write(raw: RawScene, path: str | Path) -> None:
    """Write `raw`; `read` restores it bit for bit."""
    content = CODEC.encode(raw)
    with open(path, "wb") as file:
        file.write(_CHECKSUM.pack(zlib.crc32(content)))
        file.write(content)


def read(path: str | Path) -> RawScene:
    """Read an archive. Raises ArchiveError if damaged, OSError if missing."""
    data = Path(path).read_bytes()
    checksum, content = data[: _CHECKSUM.size], data[_CHECKSUM.size :]
    if checksum != _CHECKSUM.pack(zlib.crc32(content)):
        raise ArchiveError(f"{path}: damaged: its checksum is another one")
    try:
        raw = CODEC.decode(content)
    except CodecError as error:
        raise ArchiveError(f"{path}: {error}") from None
    if not isinstance(raw, RawScene):
        raise ArchiveError(f"{path}: damaged: it is a {type(raw).__name__}")
    return raw
