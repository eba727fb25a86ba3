"""Errors of the constraints package: one root, each error carries its data."""

from __future__ import annotations


class ConstraintsError(ValueError):
    """Root of all errors that `constraints` raises."""


class GeometryError(ConstraintsError):
    """Analytic geometry that does not exist (a zero axis, a negative radius, NaN). `field` names the culprit."""

    def __init__(self, message: str, field: str | None = None) -> None:
        super().__init__(message)
        self.field = field
