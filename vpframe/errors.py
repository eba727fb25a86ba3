"""Errors of the vpframe package: one root; each error carries its data, and the command line prints it as one line."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

SHARED = 2
"""letters in a row that a proposed word has in common with the one that was written"""
LIKE = 0.5
"""least ratio of common letters of a proposed word"""
ALIKE = 0.7
"""ratio from which on they need not stand in a row: "gaer" for "gear\""""


def near(word: str, known: Iterable[str], most: int = 3) -> list[str]:
    """Return the known words that `word` may be meant for, best first; they share some letters.

    Letters are compared without case, and of a path ("unit/nut_3") also its last name.
    """
    asked, found = word.casefold(), []
    for name in known:
        best = 0.0
        for part in {name.casefold(), name.casefold().rpartition("/")[2]}:
            match = difflib.SequenceMatcher(None, part, asked, autojunk=False)
            ratio = match.ratio()
            if ratio >= ALIKE or match.find_longest_match().size >= SHARED:
                best = max(best, ratio)
        if best >= LIKE:
            found.append((-best, name))
    return [name for _, name in sorted(found)[:most]]


class VpframeError(ValueError):
    """Root of all errors that `vpframe` raises."""


class LoadError(VpframeError):
    """A file cannot be read. `path` is the file."""

    def __init__(self, message: str, path: str) -> None:
        super().__init__(message)
        self.path = path


class UnknownPartError(VpframeError, KeyError):
    """The scene has no part of a name. `name` is that name, `known` are the existing names."""

    def __init__(self, name: str, known: Iterable[str]) -> None:
        self.name = name
        self.known = tuple(known)
        like = near(str(name), self.known)
        hint = f"did you mean {' or '.join(map(repr, like))}?" if like else f"there are: {', '.join(self.known[:12])}"
        super().__init__(f"no part {name!r} in the scene; {hint}")

    def __str__(self) -> str:  # KeyError would print the repr
        return str(self.args[0])


class TaskError(VpframeError):
    """A request of a task script cannot be carried out; the message says where and why."""


class OutputError(VpframeError):
    """A file or folder cannot, or must not, be written. `path` is the file or folder."""

    def __init__(self, message: str, path: str) -> None:
        super().__init__(message)
        self.path = path


class CheckpointError(VpframeError):
    """A checkpoint cannot be resumed. `path` is the file, `step` the first step that does not fit (or None)."""

    def __init__(self, message: str, path: str, step: int | None = None) -> None:
        super().__init__(message)
        self.path = path
        self.step = step
