"""Errors of the vpframe package: one root; each error carries its data, and the command line prints it as one line."""

from __future__ import annotations

from collections.abc import Iterable

ALIKE = 0.65
"""1: share of letters in common, in their order, of two names that are spelt alike"""
CONTAINED = 3
"""letters of a name that is looked for inside others"""


class VpframeError(ValueError):
    """Root of all errors that `vpframe` raises."""


def near_names(name: str, known: Iterable[str], most: int = 3) -> list[str]:
    """Return the known names that `name` may be a slip of, the nearest first; none that only shares stray letters.

    A name is near if it, or the end of its path ("seal_1" of "cover/seal_1"), is spelt alike or contains the other,
    capitals aside.
    """
    import difflib

    def alike(one: str, other: str) -> float:
        short, long = sorted((one, other), key=len)
        if not short:
            return 0.0
        least = ALIKE if len(short) >= CONTAINED and short in long else 0.0
        return max(difflib.SequenceMatcher(None, one, other).ratio(), least)

    meant = str(name).lower()
    scores = {own: max(alike(meant, word) for word in (own.lower(), own.lower().rsplit("/", 1)[-1])) for own in known}
    return sorted((own for own in scores if scores[own] >= ALIKE), key=lambda own: (-scores[own], own))[:most]


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
        near = near_names(str(name), self.known)
        hint = f"did you mean {' or '.join(map(repr, near))}?" if near else f"there are: {', '.join(self.known[:12])}"
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
