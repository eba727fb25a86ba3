"""Islands: free bodies that may push one another within a step, found by union over pairs that are near or joined."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray


def islands(free: Iterable[int], pairs: Iterable[tuple[int, int]]) -> list[NDArray[np.int64]]:
    """Groups of the ids `free` joined by `pairs`, each ascending, by least id.

    A pair with an id that is not in `free` joins nothing: pushes do not pass through what does not move.
    """
    root = {int(i): int(i) for i in free}

    def find(i: int) -> int:
        while root[i] != i:
            root[i] = root[root[i]]
            i = root[i]
        return i

    for i, j in pairs:
        if i in root and j in root:
            a, b = find(i), find(j)
            if a != b:
                root[max(a, b)] = min(a, b)
    groups: dict[int, list[int]] = {}
    for i in sorted(root):
        groups.setdefault(find(i), []).append(i)
    return [np.array(group, dtype=np.int64) for _, group in sorted(groups.items())]
