"""Screw friction in joint coordinates: which threads stick or slide, their friction torques, and event times.

Accelerations are linear in the friction torque x of each thread, and so are the loads that bound it:

    a = a₀ + D x,    |x_j| ≤ c_j (μ'_j |N_j(x)| + μ_j R_j(x)),    c = r / cos λ,

see `thread`. One that sticks has a_j = 0; one that slides has the bound, against the sense of its motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from physics.joints.rows import Law
from physics.joints.thread import ThreadFriction

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

NEWTON = 30
"""bound of Newton iterations for friction torques; a few suffice where they exist"""
TRIALS = 60
"""bound of iterations for an event time"""


@dataclass(frozen=True, eq=False)
class ScrewFriction:
    """The threads with friction of an articulated body."""

    of_thread: Ints
    """(d,) their numbers among all threads"""
    cosine: Array
    sine: Array
    """(d,) of the lead angle λ"""
    radius: Array
    on_flanks: Array
    """(d,) μ'"""
    across: Array
    """(d,) μ"""

    @classmethod
    def of(cls, threads: Sequence[ThreadFriction], law: Law) -> ScrewFriction:
        """The threads whose pair of bodies has friction."""
        if not threads:
            return _NONE
        mu = law(np.array([t.bodies for t in threads], np.int64))[0]
        rubs = np.flatnonzero(mu > 0.0)
        own = [threads[k] for k in rubs.tolist()]
        angle = np.array([t.angle for t in own])
        both = np.array([t.friction(m) for t, m in zip(own, mu[rubs].tolist(), strict=True)]).reshape(-1, 2)
        return cls(rubs, np.cos(angle), np.sin(angle), np.array([t.radius for t in own]), both[:, 0], both[:, 1])


_NONE = ScrewFriction(np.zeros(0, np.int64), *(np.zeros(0) for _ in range(5)))

NO_THREADS = np.zeros(0), np.zeros((0, 0)), np.zeros((0, 4)), np.zeros((0, 4, 0))
"""rates and loads of no threads: the last fields of `Rates`"""


class Rates(NamedTuple):
    """Accelerations of an articulated body, rates and loads of its threads, linear in the friction torques."""

    acceleration: Array
    """(nv,) without friction"""
    by_torque: Array
    """(nv, d)"""
    own: Array
    """(d,) rad/s², of the threads"""
    own_by_torque: Array
    """(d, d)"""
    load: Array
    """(d, 4) N and N·m: along the axis, about it, twice across it"""
    load_by_torque: Array
    """(d, 4, d)"""

    @classmethod
    def without_friction(cls, acceleration: Array) -> Rates:
        """Rates of an articulated body without screw friction."""
        return cls(acceleration, np.zeros((len(acceleration), 0)), *NO_THREADS)

    def normal_loads(self, dry: ScrewFriction, x: Array) -> tuple[Array, Array, Array, Array]:
        """Forces N (d,) across the flanks and R (d,) across the axis, N, and their derivatives (d, d) by x."""
        now = self.load + self.load_by_torque @ x
        c, s = dry.cosine, dry.sine / dry.radius
        n = c * now[:, 0] - s * now[:, 1]
        n_by = c[:, None] * self.load_by_torque[:, 0] - s[:, None] * self.load_by_torque[:, 1]
        r = np.sqrt(now[:, 2] ** 2 + now[:, 3] ** 2)
        way = now[:, 2:] / np.where(r > 0.0, r, 1.0)[:, None]
        r_by = way[:, :1] * self.load_by_torque[:, 2] + way[:, 1:] * self.load_by_torque[:, 3]
        return n, r, n_by, r_by

    def bound(self, dry: ScrewFriction, x: Array) -> Array:
        """(d,) N·m: bound of the friction torques."""
        n, r, _, _ = self.normal_loads(dry, x)
        return dry.radius / dry.cosine * (dry.on_flanks * np.abs(n) + dry.across * r)


def friction_torques(dry: ScrewFriction, slip: Array, rates: Rates) -> Array | None:
    """(d,) N·m: friction torques of threads that slide with sign `slip` (±1) or stick (0), by Newton's method.

    None where no torque or several solve the law (Painlevé: sliding adds more load than friction yields to).
    """
    x = np.zeros(len(slip))
    sticks = slip == 0.0
    arm = dry.radius / dry.cosine
    last = np.inf
    for _ in range(NEWTON):
        n, r, n_by, r_by = rates.normal_loads(dry, x)
        most = arm * (dry.on_flanks * np.abs(n) + dry.across * r)
        steep = arm[:, None] * (dry.on_flanks[:, None] * np.abs(n_by) + dry.across[:, None] * np.abs(r_by))
        if (steep[~sticks].sum(axis=1) >= 1.0).any():
            return None
        by = arm[:, None] * (dry.on_flanks[:, None] * np.sign(n)[:, None] * n_by + dry.across[:, None] * r_by)
        left = np.where(sticks, rates.own + rates.own_by_torque @ x, x + slip * most)
        matrix = np.where(sticks[:, None], rates.own_by_torque, np.eye(len(x)) + slip[:, None] * by)
        try:
            step = np.linalg.solve(matrix, left)
        except np.linalg.LinAlgError:
            return None
        x = x - step
        size = float(np.abs(step).max())
        if size <= 1e-15 * np.abs(x).max() or (size >= last and size <= 1e-12 * np.abs(x).max()):
            return x
        last = size
    return None


def chosen(dry: ScrewFriction, moving: Array, rates: Rates) -> Array | None:
    """(d,) slip of each thread from now on: a moving one (±1) keeps its sign, one at rest (0) sticks if it can."""
    slip = moving.copy()
    for _ in range(4 * len(slip) + 4):
        x = friction_torques(dry, slip, rates)
        if x is None:
            return None
        over = np.where(slip == 0.0, np.abs(x) - rates.bound(dry, x), -np.inf)
        rate = rates.own + rates.own_by_torque @ x
        back = (moving == 0.0) & (slip != 0.0) & (slip * rate < 0.0)
        if over.max() > 0.0:
            k = int(np.argmax(over))
            slip[k] = -np.sign(x[k])
        elif back.any():
            slip[int(np.argmax(back))] = 0.0
        else:
            return slip
    return None


def when(value: Callable[[float], float | None], end: float, h: float) -> float | None:
    """Time in (0, h] at which `value` becomes negative, to rounding; `end` < 0 is its value at h.

    Illinois variant of false position. None if `value` returns None.
    """
    low, high, at_high = 0.0, h, end
    at_low: float | None = None
    for _ in range(TRIALS):
        if high - low <= 1e-14 * h:
            break
        middle = 0.5 * (low + high)
        if at_low is not None and at_low > 0.0:
            cut = low + (high - low) * at_low / (at_low - at_high)
            middle = cut if low < cut < high else middle
        now = value(middle)
        if now is None:
            return None
        if now < 0.0:
            high, at_high = middle, now
            at_low = None if at_low is None else 0.5 * at_low
        else:
            low, at_low = middle, now
            at_high = 0.5 * at_high
    return high
