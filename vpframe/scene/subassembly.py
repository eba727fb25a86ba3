"""Parts of a name in the product tree: a path of a part or subassembly, or the end of one."""

from __future__ import annotations

import re
from collections.abc import Sequence

from vpframe.errors import TaskError, UnknownPartError

LISTED = 6
"""maximum number of names listed in a message"""


def parts_named(names: Sequence[str], name: str) -> tuple[str, ...]:
    """Return the parts of the subassembly `name`, in the order of `names`, or the part of that name.

    names: of all parts, paths in the product tree with "/" between levels. name: a path from the root, or the end of
        one ("nut_3", "…/nut-bolt-assembly_2/nut_3").

    Raises
    ------
    UnknownPartError: no such name. TaskError: the name is ambiguous.
    """
    if name in names:
        return (name,)
    paths = dict.fromkeys("/".join(n.split("/")[: k + 1]) for n in names for k in range(n.count("/") + 1))
    tail = re.sub(r"^(…|\.\.\.)/", "", str(name)).strip("/")
    found = [tail] if tail in paths else [path for path in paths if path.endswith("/" + tail)] if tail else []
    if not found:
        raise UnknownPartError(name, paths)
    if len(found) > 1:
        raise TaskError(f"{name!r} names {len(found)} things: {listed(found)}; give more of the path")
    return tuple(n for n in names if n == found[0] or n.startswith(found[0] + "/"))


def name_of(names: Sequence[str], parts: Sequence[str]) -> str:
    """Return the path of the subassembly that consists of `parts`, else the name of the first of them.

    names: of all parts, as for `parts_named`.
    """
    levels = parts[0].split("/")
    for k in range(1, len(levels) if len(parts) > 1 else 0):
        path = "/".join(levels[:k])
        if {n for n in names if n.startswith(path + "/")} == set(parts):
            return path
    return parts[0]


def listed(names: Sequence[str], most: int = LISTED) -> str:
    """Join names with commas, at most `most`, with the number of the others."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")
