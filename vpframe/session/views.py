"""`Views`: the constraints in force as observers receive them, placed at the current poses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, overload

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from constraints.manager import InForce
from constraints.solve.together import Together
from vpframe.events import ConstraintView


class Selection(NamedTuple):
    """The constraints whose views must be recomputed when certain bodies have moved."""

    places: list[int]
    first: list[int]
    """index of each constraint's first body"""
    local: NDArray[np.float64]
    """(k, 2, 3) origin (m) and direction of each symbol, in the frame of its first body"""
    together: Together
    """the same constraints, for batched residuals"""


class DrawnView(NamedTuple):
    """The views computed last, and their inputs."""

    in_force: InForce
    views: list[ConstraintView]
    local: NDArray[np.float64]
    """(k, 2, 3) origin (m) and direction of each symbol, in the frame of its first body"""
    poses: tuple[pin.SE3, ...]


class ViewsOfStep(Sequence[ConstraintView]):
    """The constraints after one step, computed at first use because most steps' views are never read.

    make: returns the views; its inputs must not change any more. of: records of the constraints in force, offered and
    refused; two steps with the same records have the same constraints in the same states.
    """

    def __init__(self, make: Callable[[], tuple[ConstraintView, ...]], of: tuple[object, ...]) -> None:
        self._make: Callable[[], tuple[ConstraintView, ...]] | None = make
        self._views: tuple[ConstraintView, ...] = ()
        self.of = of

    def _made(self) -> tuple[ConstraintView, ...]:
        make = self._make
        if make is not None:
            self._views = make()
            self._make = None
        return self._views

    def __reduce__(self) -> tuple[Any, ...]:
        return tuple, (self._made(),)  # a copied or pickled object contains the views only

    def __eq__(self, other: object) -> bool:
        return isinstance(other, tuple | ViewsOfStep) and self._made() == tuple(other)

    def __len__(self) -> int:
        return len(self._made())

    def __iter__(self) -> Iterator[ConstraintView]:
        return iter(self._made())

    @overload
    def __getitem__(self, index: int) -> ConstraintView: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[ConstraintView, ...]: ...
    def __getitem__(self, index: int | slice) -> ConstraintView | tuple[ConstraintView, ...]:
        return self._made()[index]


class Views:
    """Computes the views of constraints in force; those whose bodies have not moved are reused."""

    def __init__(self) -> None:
        self._drawn = DrawnView(InForce({}), [], np.zeros((0, 2, 3)), ())
        self._selection: tuple[Any, Selection | None] = None, None

    def active(self, in_force: InForce, names: Sequence[str], poses: tuple[pin.SE3, ...]) -> list[ConstraintView]:
        """Return the views of the constraints in force, in order of acceptance, at `poses`."""
        drawn = self._drawn if self._drawn.in_force is in_force else self._begun(in_force, names)
        before = drawn.poses or (None,) * len(poses)
        moved = np.array([now is not then for now, then in zip(poses, before, strict=True)])
        selection = self._selected(drawn, moved)
        views = list(drawn.views)
        if selection.places:
            distance = selection.together.distance(selection.together.residual(poses)).tolist()
            at = np.array([poses[i].homogeneous for i in selection.first])
            where = selection.local @ at[:, :3, :3].transpose(0, 2, 1)
            where[:, 0] += at[:, :3, 3]
            where.setflags(write=False)
            for k, residual, (origin, direction) in zip(selection.places, distance, where, strict=True):
                view = object.__new__(ConstraintView)  # ten times faster than `replace`; there can be hundreds
                view.__dict__.update(views[k].__dict__, origin=origin, direction=direction, residual=residual)
                views[k] = view
        self._drawn = DrawnView(in_force, views, drawn.local, poses)
        return views

    def _selected(self, drawn: DrawnView, moved: NDArray[np.bool_]) -> Selection:
        key = drawn.in_force, moved.tobytes()
        known, selection = self._selection
        if selection is None or known != key:
            together = drawn.in_force.together
            new = np.array([np.isnan(view.residual) for view in drawn.views], bool)
            places = np.flatnonzero(moved[together.bodies].any(axis=1) | new)
            first, local = together.bodies[places, 0].tolist(), drawn.local[places]
            selection = Selection(places.tolist(), first, local, together.subset(places))
            self._selection = (None if new.any() else key), selection
        return selection

    def _begun(self, in_force: InForce, names: Sequence[str]) -> DrawnView:
        """Reuse the views of constraints that stay in force; new views have residual NaN until they are computed."""
        last = self._drawn
        known = {id(e.candidate): v for e, v in zip(last.in_force.accepted.values(), last.views, strict=True)}
        views, local, home = [], [], pin.SE3.Identity()
        for number, entry in in_force.accepted.items():
            c = entry.candidate
            a, b = c.bodies
            local.append((c.match.local, c.constraint.drawing(home).direction))
            views.append(known.get(id(c)) or ConstraintView(
                number, c.kind, (names[a], names[b]), c.surfaces, np.nan, "active", c.match.origin, c.match.direction,
                c.match.size, c.why, c.match.press,
            ))  # fmt: skip
        return DrawnView(in_force, views, np.array(local).reshape(-1, 2, 3), last.poses)
