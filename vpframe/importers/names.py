"""Names that tell siblings apart."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable


def numbered(names: Iterable[str]) -> list[str]:
    """The names made unique: those that occur more than once get a number, in order ("ball_1", "ball_2", …).

    A slash, which stands between the names of a path, becomes a bar.
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
