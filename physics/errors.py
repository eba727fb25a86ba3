"""Errors of the physics package: one root, each error carries its data."""

from __future__ import annotations


class PhysicsError(ValueError):
    """Root of all errors that `physics` raises; its message names what was given, what is allowed, what to do."""


class BodyError(PhysicsError):
    """Mass properties that no solid has. `name` is the body's name, `field` the culprit."""

    def __init__(self, message: str, name: str | None = None, field: str | None = None) -> None:
        super().__init__(message)
        self.name = name
        self.field = field


class BehaviourError(PhysicsError):
    """A behaviour with a parameter out of range, or one that returned what is no wrench, reaction or pose.

    `object_id` is the object it acted on (None while it is being made), `behaviour` its class name.
    """

    def __init__(self, message: str, object_id: int | None = None, behaviour: str | None = None) -> None:
        super().__init__(message)
        self.object_id = object_id
        self.behaviour = behaviour


class WorldError(PhysicsError):
    """A call that the world cannot answer: an unknown object, a bad time step. `object_id` is the object, or None."""

    def __init__(self, message: str, object_id: int | None = None) -> None:
        super().__init__(message)
        self.object_id = object_id
