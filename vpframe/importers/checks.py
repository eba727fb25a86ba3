"""Recognition of file formats by content, and checks that files are complete."""

from __future__ import annotations

import contextlib
import re
import stat
import struct
from pathlib import Path
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from vpframe.errors import LoadError

FORMATS = {
    ".step": "step", ".stp": "step", ".p21": "step", ".iges": "iges", ".igs": "iges",
    ".stl": "stl", ".obj": "obj", ".ply": "ply", ".glb": "glb",
    ".brep": "brep", ".brp": "brep", ".urdf": "urdf", ".mjcf": "mjcf", ".xml": "mjcf",
}  # fmt: skip
"""format by suffix"""
LARGEST = 1_000_000_000
"""maximum size of a file, bytes"""
FARTHEST = 1e6
"""maximum distance from the origin, m: beyond it rounding errors reach a micrometre"""

_VERTEX = re.compile(rb"^v[ \t]", re.MULTILINE)
_SHORT_VERTEX = re.compile(rb"^v[ \t]+(\S+(?:[ \t]+\S+)?)[ \t\r]*$", re.MULTILINE)


def checked_format(path: Path) -> str:
    """Return the format of a file; LoadError if it is missing, empty, incomplete, or does not match its suffix."""
    where = str(path)
    try:
        exists = path.exists()
    except (OSError, ValueError) as error:  # a name too long, or with a null character
        why = getattr(error, "strerror", None) or str(error)
        raise LoadError(f"{path}: no such file ({why}); check the path", where) from None
    if not exists:
        raise LoadError(f"{path}: no such file; check the path", where)
    if not path.is_file():
        what = "a folder" if path.is_dir() else "a pipe or device"
        raise LoadError(f"{path}: is {what}; give a file", where)
    form = FORMATS.get(path.suffix.lower())
    if form is None:
        known = ", ".join(FORMATS)
        raise LoadError(f"{path}: files of type {path.suffix or '(none)'} are not read; known are {known}", where)
    data = content(path)
    if not data.strip():
        raise LoadError(f"{path}: is empty; export it again", where)
    found = content_of(data)
    if found == "urdf" and path.suffix.lower() == ".xml":
        form = "urdf"
    if found is not None and found != form:
        right = next(suffix for suffix, f in FORMATS.items() if f == found)
        raise LoadError(f"{path}: is a {found.upper()} file by its content; rename it to end in {right}", where)
    fault = _FAULTS[form](data, found)
    if fault is not None:
        raise LoadError(f"{path}: {fault}", where)
    return form


def content(path: Path) -> bytes:
    """Return the content of a file; LoadError if it cannot be read or is larger than `LARGEST`."""
    try:
        size = path.stat().st_size
        if size > LARGEST:
            why = f"has {size / 1e9:.1f} GB, and more than {LARGEST / 1e9:g} GB are not read; split it"
            raise LoadError(f"{path}: {why}, or export it coarser", str(path))
        return path.read_bytes()
    except OSError as error:
        raise LoadError(f"{path}: cannot be read ({error.strerror}); check its permissions", str(path)) from None


def beside(folder: Path, name: str) -> Path | None:
    """Return the regular file that a name in a model means, relative to the model's folder; None if there is none.

    Pipes, devices and files above `LARGEST` are none.
    """
    try:
        file = folder / name
        status = file.stat()
    except (OSError, ValueError):  # missing, a name too long, or with a null character
        return None
    return file if stat.S_ISREG(status.st_mode) and status.st_size <= LARGEST else None


def far_check(path: Path, name: str, vertices: NDArray[np.float64], translation: NDArray[np.float64]) -> None:
    """Raise LoadError for a part with coordinates (m) that are not finite or beyond `FARTHEST`."""
    fault = too_far(name, vertices, translation)
    if fault:
        raise LoadError(f"{path}: {fault}", str(path))


def too_far(name: str, vertices: NDArray[np.float64], translation: NDArray[np.float64]) -> str:
    """Return what is wrong with coordinates (m) that are not finite or beyond `FARTHEST`; "" if nothing is."""
    reach = float(np.abs(vertices).max(initial=0.0)) + float(np.abs(translation).max(initial=0.0))
    if reach <= FARTHEST:
        return ""
    why = f"{name} has coordinates of {reach:.3g} m, and more than {FARTHEST:g} m are not read"
    return f"{why}; check its unit, or export it again"


def content_of(data: bytes) -> str | None:
    """Recognise a format by its content; None if it has no marks (OBJ, damaged files)."""
    head = data[:1024].lstrip(b"\xef\xbb\xbf \t\r\n")
    if head.startswith(b"ISO-10303-21"):
        return "step"
    if head.startswith(b"glTF"):
        return "glb"
    if re.match(rb"(DBRep_DrawableShape|CASCADE Topology|Open CASCADE Topology)", head):
        return "brep"
    if head.startswith((b"<", b"\xff\xfe", b"\xfe\xff")):
        return {"robot": "urdf", "mujoco": "mjcf"}.get(_root(data.lstrip(b" \t\r\n")))
    if head.startswith((b"ply\n", b"ply\r")):
        return "ply"
    if is_binary_stl(data) or (head.startswith(b"solid") and b"facet" in data[:4096]):
        return "stl"
    line = data[:160].split(b"\n")[0].rstrip(b"\r")
    if len(line) >= 73 and line[72:73] == b"S" and line[73:80].strip(b" 0") == b"1":
        return "iges"
    return None


def _root(data: bytes) -> str:
    """Return the name of an XML file's first element; empty if there is none."""
    parser, names = expat.ParserCreate(), []

    def begin(name: str, _: object) -> None:
        names.append(name)
        raise StopIteration  # nothing behind it is read

    parser.StartElementHandler = begin
    with contextlib.suppress(expat.ExpatError, StopIteration, LookupError, ValueError):
        parser.Parse(data, True)
    return names[0] if names else ""


def is_binary_stl(data: bytes) -> bool:
    """Whether the length matches that of a binary STL file with the stated number of triangles."""
    return len(data) >= 84 and len(data) == 84 + 50 * struct.unpack("<I", data[80:84])[0]


def _step_fault(data: bytes, content: str | None) -> str | None:
    if content is None:
        return "is not a STEP file (it does not begin with ISO-10303-21); export it again"
    if b"END-ISO-10303-21" not in data[-4096:]:
        lines = data.count(b"\n") + 1
        return f"is cut short: line {lines} is the last, and END-ISO-10303-21 is missing; copy or export it again"
    return None


def _iges_fault(data: bytes, content: str | None) -> str | None:
    if content is None:
        return "is not an IGES file (no start section in columns 73 to 80); export it again"
    lines = data.rstrip().splitlines()
    if lines[-1][72:73] != b"T":
        return f"is cut short: line {len(lines)} is the last, and the terminate section is missing; export it again"
    return None


def iges_damage(data: bytes) -> str:
    """Return the damage found in an IGES file's lines (missing, doubled, out of place), or "".

    Every line ends with the letter of its section and its number there, in columns 73 to 80; the last line says how
    many lines each section has (IGES 5.3, sections 2.2.1 and 2.2.4.6).
    """
    last = dict.fromkeys((b"S", b"G", b"D", b"P"), 0)
    lines = data.rstrip().splitlines()
    wrong = []
    for number, line in enumerate(lines, start=1):
        section, own = line[72:73], line[73:80].strip()
        if section == b"C":
            return ""  # the compressed form has no such lines
        if section in last:
            if not own.isdigit() or int(own) != last[section] + 1:
                wrong.append(number)
            last[section] = int(own) if own.isdigit() else last[section] + 1
        elif section != b"T":
            wrong.append(number)
    if not wrong and lines:
        stated = re.match(rb"S *(\d+)G *(\d+)D *(\d+)P *(\d+)", lines[-1])
        if stated is None or [*map(int, stated.groups())] != [*last.values()]:
            wrong.append(len(lines))
    return f"damaged: {len(wrong)} lines are not in sequence, the first is line {wrong[0]}" if wrong else ""


def _stl_fault(data: bytes, content: str | None) -> str | None:
    if content is None and len(data) >= 84 and not data.lstrip().startswith(b"solid"):
        announced, present = struct.unpack("<I", data[80:84])[0], (len(data) - 84) // 50
        return (
            f"is cut short or damaged: it announces {announced} triangles and has room for {present}; export it again"
        )
    if content is None:
        return "is not an STL file (neither `solid … facet` nor the binary form); export it again"
    if not is_binary_stl(data) and b"endsolid" not in data[-1024:]:
        lines = data.count(b"\n") + 1
        return f"is cut short: line {lines} is the last, and `endsolid` is missing; export it again"
    return None


def _glb_fault(data: bytes, content: str | None) -> str | None:
    if content is None:
        return "is not a GLB file (it does not begin with glTF); export it again"
    length = struct.unpack("<I", data[8:12])[0] if len(data) >= 12 else 12
    if len(data) < length:
        return f"is cut short: it announces {length} bytes and has {len(data)}; copy or export it again"
    return None


def _ply_fault(data: bytes, content: str | None) -> str | None:
    return None if content else "is not a PLY file (it does not begin with ply); export it again"


def _brep_fault(data: bytes, content: str | None) -> str | None:
    return None if content else "is not a B-rep of OpenCascade (no `CASCADE Topology` at its head); write it again"


def _xml_fault(data: bytes, content: str | None) -> str | None:
    return None if content else "is neither URDF nor MJCF (its root is no <robot> and no <mujoco>)"


def _obj_fault(data: bytes, content: str | None) -> str | None:
    if b"\0" in data[:4096] or _VERTEX.search(data) is None:
        return "is not an OBJ file (no line begins with v); export it again"
    short = _SHORT_VERTEX.search(data)
    if short is not None:
        line = data.count(b"\n", 0, short.start()) + 1
        return f"line {line} gives a vertex {len(short[1].split())} of its three numbers; export it again"
    return None


_FAULTS = {
    "step": _step_fault,
    "iges": _iges_fault,
    "stl": _stl_fault,
    "obj": _obj_fault,
    "ply": _ply_fault,
    "glb": _glb_fault,
    "brep": _brep_fault,
    "urdf": _xml_fault,
    "mjcf": _xml_fault,
}
