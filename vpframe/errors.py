"""Errors of the vpframe package: one root; each error carries its data, and the command line prints it as one line."""

from __future__ import annotations

from collections.abc import Iterable


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
        import difflib

        self.name = name
        self.known = tuple(known)
        near = difflib.get_close_matches(str(name), self.known, n=3, cutoff=0.4)
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
