"""Unique names of siblings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable


def numbered(names: Iterable[str]) -> list[str]:
    """Make names unique: repeated names are numbered in order ("ball_1", "ball_2", …).

    A slash, the separator of paths, is replaced by a bar.
    """
    given = [name.replace("/", "|") for name in names]
    counts = Counter(given)
    taken = {name for name in given if counts[name] == 1}
    unique = []
    for name in given:
        chosen, number = name, 1
        while counts[name] > 1 and (chosen := f"{name}_{number}") in taken:
            number += 1
        taken.add(chosen)
        unique.append(chosen)
    return unique
