"""Selection of the bodies that a `ConstraintManager` examines in an update: those whose result may have changed.

The result for a pair of bodies depends on their poses, the contact rows between them, the limits and the wanted kinds,
and the decisions about them. If none of these has changed, neither has the result; of 2,000 parts a hand moves one.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision.contact import surfaces_of


class Rows(NamedTuple):
    """What recognition reads of contact rows."""

    surfaces: NDArray[np.int32]
    """(n, 4) object, surface, object, surface"""
    distance: NDArray[np.float64]
    """(n,) m"""


class Attention:
    """Input of the last update, kept by value."""

    def __init__(self) -> None:
        self._known = False
        self._context: Hashable = None
        self._count = 0
        self._poses: list[pin.SE3] = []
        self._versions: NDArray[np.int64] | None = None
        self._rows = Rows(np.zeros((0, 4), np.int32), np.zeros(0))
        self._noted: set[int] = set()

    def note(self, bodies: Iterable[int]) -> None:
        """Have the next update examine these bodies, about which something was decided or found."""
        self._noted.update(bodies)

    def noted(self) -> frozenset[int]:
        """Return the bodies noted since `begin`, which the next update examines too."""
        return frozenset(self._noted)

    def forget(self) -> None:
        """Have the next update examine all bodies."""
        self._known = False

    def begin(
        self, context: Hashable, poses: Sequence[pin.SE3], contacts: NDArray[Any],
        versions: NDArray[np.int64] | None = None,
    ) -> set[int]:  # fmt: skip
        """Return the bodies to examine. If an update does not reach `end`, the next one examines all bodies.

        context: everything else that the result depends on. poses: of each body. contacts: rows of
        `collision.CONTACT_DTYPE`. versions: (n,) pose versions, which change with the poses; None: poses are compared.
        """
        known, self._known = self._known and context == self._context and len(poses) == self._count, False
        rows = Rows(surfaces_of(contacts).copy(), contacts["distance"].copy())
        if known and versions is not None and self._versions is not None:
            about = set(np.flatnonzero(versions[: len(poses)] != self._versions).tolist())
        elif known and versions is None and self._versions is None:
            about = {i for i, (was, now) in enumerate(zip(self._poses, poses, strict=True)) if was != now}
        else:
            known, about = False, set(range(len(poses)))
        if known:
            about |= _differing(_not_about(self._rows, about), _not_about(rows, about)) | self._noted
        if versions is None:  # copies: the caller may change what it gave
            self._poses = [pin.SE3(pose) if i in about else self._poses[i] for i, pose in enumerate(poses)]
        self._versions = None if versions is None else versions[: len(poses)].copy()
        self._context, self._rows, self._noted, self._count = context, rows, set(), len(poses)
        return about

    def end(self) -> None:
        """Confirm that the update has examined all bodies that `begin` returned."""
        self._known = True


def rows_about(a: NDArray[Any], b: NDArray[Any], bodies: Collection[int]) -> NDArray[np.bool_]:
    """Return (n,) bool: which pairs of bodies a (n,) and b (n,) contain one of `bodies`."""
    if len(bodies) == 1 or not len(a):  # most often
        only = next(iter(bodies), -1)
        one: NDArray[np.bool_] = (a == only) | (b == only)
        return one
    chosen = np.zeros(max(a.max(initial=-1), b.max(initial=-1), max(bodies, default=-1)) + 1, np.bool_)
    chosen[list(bodies)] = True
    found: NDArray[np.bool_] = chosen[a] | chosen[b]
    return found


def _not_about(rows: Rows, bodies: Collection[int]) -> Rows:
    if not len(rows.surfaces):
        return rows
    keep = ~rows_about(rows.surfaces[:, 0], rows.surfaces[:, 2], bodies)
    return Rows(rows.surfaces[keep], rows.distance[keep])


def _differing(old: Rows, new: Rows) -> set[int]:
    """Bodies of the rows that do not occur equally often in both."""
    sizes = len(old.distance), len(new.distance)
    if sizes[0] == sizes[1] and (old.surfaces == new.surfaces).all() and (old.distance == new.distance).all():
        return set()
    both = np.empty(sum(sizes), [("surfaces", np.int32, 4), ("distance", np.float64)])
    both["surfaces"] = np.concatenate([old.surfaces, new.surfaces])
    both["distance"] = np.concatenate([old.distance, new.distance])
    _, first, which = np.unique(both, return_index=True, return_inverse=True)
    times = np.bincount(which, weights=np.repeat([1.0, -1.0], sizes))
    return set(both["surfaces"][first[times != 0.0]][:, ::2].ravel().tolist())
