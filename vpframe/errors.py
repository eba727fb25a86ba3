"""Errors of the vpframe package: one root, each error carries its data; the command line prints them as one line."""

from __future__ import annotations

from collections.abc import Iterable


class VpframeError(ValueError):
    """Root of all errors that `vpframe` raises."""


class LoadError(VpframeError):
    """A file that cannot be read. `path` is the file."""

    def __init__(self, message: str, path: str) -> None:
        super().__init__(message)
        self.path = path


class UnknownPartError(VpframeError, KeyError):
    """A part name the scene does not have. `name` was given, `known` are the names there are."""

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
    """A task script that asks for what cannot be done (as asked); the message says where and why."""


class OutputError(VpframeError):
    """A file or folder that cannot, or must not, be written. `path` is which."""

    def __init__(self, message: str, path: str) -> None:
        super().__init__(message)
        self.path = path


class CheckpointError(VpframeError):
    """A checkpoint that cannot be resumed from. `path` is the file, `step` where it no longer fits (or None)."""

    def __init__(self, message: str, path: str, step: int | None = None) -> None:
        super().__init__(message)
        self.path = path
        self.step = step
