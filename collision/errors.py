"""Errors of the collision package: one root, each error carries its data."""

from __future__ import annotations


class CollisionError(ValueError):
    """Root of all errors of `collision`; the message names the value given, the values allowed and the remedy."""


class MeshError(CollisionError):
    """A mesh that cannot be used. `mesh` is its name, `index` the first offending row (or None)."""

    def __init__(self, message: str, mesh: str | None = None, index: int | None = None) -> None:
        super().__init__(message)
        self.mesh = mesh
        self.index = index


class PoseError(CollisionError):
    """A pose that is not a finite rigid motion. `object_id` is the object it was meant for (or None)."""

    def __init__(self, message: str, object_id: int | None = None) -> None:
        super().__init__(message)
        self.object_id = object_id


class UnknownObjectError(CollisionError):
    """An object id that the manager does not hold."""

    def __init__(self, message: str, object_id: int) -> None:
        super().__init__(message)
        self.object_id = object_id
