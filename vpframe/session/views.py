"""`Views`: the constraints in force as observers see them, drawn where their bodies are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from constraints.manager import InForce
from constraints.solve.groups import Groups
from constraints.solve.together import Together
from vpframe.session.events import ConstraintView


class Selection(NamedTuple):
    """The constraints to be drawn anew when certain bodies have moved."""

    places: list[int]
    first: list[int]
    """of each the first body"""
    local: NDArray[np.float64]
    """(k, 2, 3) where to draw each and its direction, in the frame of that body"""
    measured: list[int]
    """those of which the residual may be another"""
    together: Together
    """the same"""


class Views:
    """Keeps the views of constraints whose bodies stand still; of those that move as one only the place changes."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Draw all anew."""
        self._in_force = InForce({})
        self._views: list[ConstraintView | None] = []
        self._local = np.zeros((0, 2, 3))
        self._selection: tuple[Any, Selection | None] = None, None

    def active(
        self, in_force: InForce, names: Sequence[str], poses: Sequence[pin.SE3], moved: NDArray[np.bool_],
        groups: Groups,
    ) -> list[ConstraintView]:  # fmt: skip
        """The constraints in force, in the order of acceptance, at `poses`; moved (n,): bodies since the last call."""
        if in_force is not self._in_force:
            self._begin(in_force, names)
        selection = self._selected(moved, groups)
        views = self._views
        if selection.places:
            residual = selection.together.residual(poses)
            distance = dict(zip(selection.measured, selection.together.distance(residual).tolist(), strict=True))
            at = np.array([poses[i].homogeneous for i in selection.first])
            drawn = selection.local @ at[:, :3, :3].transpose(0, 2, 1)
            drawn[:, 0] += at[:, :3, 3]
            drawn.setflags(write=False)
            for k, (origin, direction) in zip(selection.places, drawn, strict=True):
                old = views[k]
                assert old is not None
                view = views[k] = object.__new__(ConstraintView)  # `replace`, a tenth as long: a frame has hundreds
                moves = {"origin": origin, "direction": direction, "residual": distance.get(k, old.residual)}
                view.__dict__.update(old.__dict__, **moves)
        return [view for view in views if view is not None]

    def _selected(self, moved: NDArray[np.bool_], groups: Groups) -> Selection:
        key = moved.tobytes(), groups
        known, selection = self._selection
        if selection is None or known != key:
            bodies = self._in_force.together.bodies
            new = np.array([np.isnan(view.residual) for view in self._views if view is not None], bool)
            places = np.flatnonzero(moved[bodies].any(axis=1) | new)
            carrier = groups.carriers(len(moved))[bodies[places]]
            measured = places[(carrier[:, 0] != carrier[:, 1]) | new[places]]
            selection = Selection(
                places.tolist(), bodies[places, 0].tolist(), self._local[places], measured.tolist(),
                self._in_force.together.subset(measured),
            )  # fmt: skip
            self._selection = (None if new.any() else key), selection
        return selection

    def _begin(self, in_force: InForce, names: Sequence[str]) -> None:
        known = {id(e.candidate): v for e, v in zip(self._in_force.accepted.values(), self._views, strict=True)}
        self._in_force, self._selection = in_force, (None, None)
        self._views = []
        for number, entry in in_force.accepted.items():
            c = entry.candidate
            a, b = c.bodies
            self._views.append(known.get(id(c)) or ConstraintView(
                number, c.kind, (names[a], names[b]), c.surfaces, np.nan, "active", c.match.origin, c.match.direction,
                c.match.size, c.why,
            ))  # fmt: skip
        home = pin.SE3.Identity()
        local = [
            (c.match.local, c.constraint.drawing(home).direction)
            for c in (e.candidate for e in in_force.accepted.values())
        ]
        self._local = np.array(local).reshape(-1, 2, 3)
