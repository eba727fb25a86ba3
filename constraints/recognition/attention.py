"""Which bodies a `ConstraintManager` looks at in an update: those about which anything may be other than before.

What a pair of bodies comes to depends on their poses, the contact rows between them, what is asked of them and what
was decided. Where all of these are as they were, so is the answer; of 2,000 parts a hand moves one.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

COLUMNS = ["object_a", "surface_a", "object_b", "surface_b", "distance"]
"""of contact rows: what recognition reads of them"""


class Attention:
    """Remembers, by value, what the last update looked at."""

    def __init__(self) -> None:
        self._known = False
        self._asked: Hashable = None
        self._poses: list[pin.SE3] = []
        self._rows: NDArray[Any] = np.empty(0)
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

    def begin(self, asked: Hashable, poses: Sequence[pin.SE3], contacts: NDArray[Any]) -> set[int]:
        """The bodies to look at. An update that does not come to `end` makes the next one look at everything.

        asked: all else that the answer depends on. poses: one a body. contacts: rows of `collision.CONTACT_DTYPE`.
        """
        known, self._known = self._known and asked == self._asked and len(poses) == len(self._poses), False
        rows = _columns(contacts)
        if known:
            about = {i for i, (was, now) in enumerate(zip(self._poses, poses, strict=True)) if was != now}
            about |= _differing(_not_about(self._rows, about), _not_about(rows, about)) | self._noted
            for i in about:
                self._poses[i] = pin.SE3(poses[i])
        else:
            about = set(range(len(poses)))
            self._poses = [pin.SE3(pose) for pose in poses]  # copies: the caller may change what it gave
        self._asked, self._rows, self._noted = asked, rows, set()
        return about

    def end(self) -> None:
        """The update has looked at all that `begin` named."""
        self._known = True


def rows_about(contacts: NDArray[Any], bodies: Iterable[int]) -> NDArray[Any]:
    """The contact rows of some bodies."""
    return contacts[_about(contacts, bodies)]


def _about(contacts: NDArray[Any], bodies: Iterable[int]) -> NDArray[np.bool_]:
    ids = np.fromiter(bodies, np.int64)
    found: NDArray[np.bool_] = np.isin(contacts["object_a"], ids) | np.isin(contacts["object_b"], ids)
    return found


def _not_about(rows: NDArray[Any], bodies: Iterable[int]) -> NDArray[Any]:
    return rows[~_about(rows, bodies)]


def _columns(contacts: NDArray[Any]) -> NDArray[Any]:
    """A copy of the columns that count, packed."""
    rows = np.empty(len(contacts), [(name, contacts.dtype[name]) for name in COLUMNS])
    for name in COLUMNS:
        rows[name] = contacts[name]
    return rows


def _differing(old: NDArray[Any], new: NDArray[Any]) -> set[int]:
    """Bodies of the rows that are in one of the two only, or not as often."""
    if np.array_equal(old, new):
        return set()
    rows, which = np.unique(np.concatenate([old, new]), return_inverse=True)
    times = np.bincount(which, weights=np.repeat([1.0, -1.0], [len(old), len(new)]))
    other = rows[times != 0.0]
    return {*other["object_a"].tolist(), *other["object_b"].tolist()}
