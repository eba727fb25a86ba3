"""Parts by a name in the product tree: a part's path, the path of a subassembly, or the tail of either."""

from __future__ import annotations

import re
from collections.abc import Sequence

from vpframe.errors import TaskError, UnknownPartError

LISTED = 6
"""names that a message lists at most"""


def parts_named(names: Sequence[str], name: str) -> tuple[str, ...]:
    """The parts of the subassembly that `name` names, in the order of `names`; of a part's name that part alone.

    names: of all parts, paths in the product tree with "/" between the levels. name: a whole path from the root, or
    the end of one ("nut_3", "…/nut-bolt-assembly_2/nut_3").

    Raises
    ------
    UnknownPartError: nothing in the tree has that name. TaskError: more than one thing has.
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


def listed(names: Sequence[str]) -> str:
    """The names with commas between them; of many the first, and how many more there are."""
    more = len(names) - LISTED
    return ", ".join(names[:LISTED]) + (f" and {more} more" if more > 0 else "")
