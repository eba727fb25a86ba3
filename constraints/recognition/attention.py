"""Which bodies a `ConstraintManager` looks at in an update: those for which the answer may have changed.

The answer for a pair of bodies depends on their poses, the contact rows between them, the limits and the wanted kinds,
and the decisions about them. Where none of these has changed, the answer has not; of 2,000 parts a hand moves one.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

COLUMNS = ["object_a", "surface_a", "object_b", "surface_b", "distance"]
"""of contact rows: what recognition reads of them"""
Rows = tuple[NDArray[Any], ...]
"""contact rows by these columns"""


class Attention:
    """Remembers, by value, what the last update looked at."""

    def __init__(self) -> None:
        self._known = False
        self._context: Hashable = None
        self._count = 0
        self._poses: list[pin.SE3] = []
        self._versions: NDArray[np.int64] | None = None
        self._rows: Rows = ()
        self._noted: set[int] = set()

    def note(self, bodies: Iterable[int]) -> None:
        """Something was decided or found out about these."""
        self._noted.update(bodies)

    def noted(self) -> frozenset[int]:
        """What was noted since `begin`, which the next update looks at too."""
        return frozenset(self._noted)

    def forget(self) -> None:
        """Have the next update look at everything."""
        self._known = False

    def begin(
        self, context: Hashable, poses: Sequence[pin.SE3], contacts: NDArray[Any],
        versions: NDArray[np.int64] | None = None,
    ) -> set[int]:  # fmt: skip
        """The bodies to look at. An update that does not come to `end` makes the next one look at everything.

        context: all else that the answer depends on. poses: one a body. contacts: rows of `collision.CONTACT_DTYPE`.
        versions: (n,) numbers that are others where a pose may be another; without, poses are compared.
        """
        known, self._known = self._known and context == self._context and len(poses) == self._count, False
        rows = tuple(np.ascontiguousarray(contacts[name]) for name in COLUMNS)
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
        """The update has looked at all that `begin` named."""
        self._known = True


def rows_about(a: NDArray[Any], b: NDArray[Any], bodies: Collection[int]) -> NDArray[np.bool_]:
    """(n,) which pairs of bodies a (n,) and b (n,) have one of `bodies`."""
    if len(bodies) == 1 or not len(a):  # most often
        only = next(iter(bodies), -1)
        one: NDArray[np.bool_] = (a == only) | (b == only)
        return one
    chosen = np.zeros(max(a.max(initial=-1), b.max(initial=-1), max(bodies, default=-1)) + 1, np.bool_)
    chosen[list(bodies)] = True
    found: NDArray[np.bool_] = chosen[a] | chosen[b]
    return found


def _not_about(rows: Rows, bodies: Collection[int]) -> Rows:
    keep = ~rows_about(rows[0], rows[2], bodies)
    if not keep.any():
        return tuple(column[:0] for column in rows)
    return tuple(column[keep] for column in rows)


def _differing(old: Rows, new: Rows) -> set[int]:
    """Bodies of the rows that are in one of the two only, or not as often."""
    if len(old[0]) == len(new[0]) and all((a == b).all() for a, b in zip(old, new, strict=True)):
        return set()
    both = np.empty(len(old[0]) + len(new[0]), [(name, c.dtype) for name, c in zip(COLUMNS, new, strict=True)])
    for name, was, now in zip(COLUMNS, old, new, strict=True):
        both[name] = np.concatenate([was, now])
    rows, which = np.unique(both, return_inverse=True)
    times = np.bincount(which, weights=np.repeat([1.0, -1.0], [len(old[0]), len(new[0])]))
    other = rows[times != 0.0]
    return {*other["object_a"].tolist(), *other["object_b"].tolist()}
