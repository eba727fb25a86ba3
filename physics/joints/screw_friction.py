"""Friction of threads in joint coordinates: which stick and which slide, with what torque, and when that changes.

The torque x of friction about each thread enters the accelerations linearly, and through them the loads that bound it:

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
from physics.joints.thread import Thread

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

NEWTON = 30
"""iterations for torques of friction; a few suffice where they exist"""
TRIALS = 60
"""steps with which the time of an event is looked for"""


@dataclass(frozen=True, eq=False)
class Dry:
    """The threads of a mechanism that rub."""

    of_thread: Ints
    """(d,) which threads"""
    cosine: Array
    sine: Array
    """(d,) of the lead angle λ"""
    radius: Array
    on_flanks: Array
    """(d,) μ'"""
    across: Array
    """(d,) μ"""

    @classmethod
    def of(cls, threads: Sequence[Thread], law: Law) -> Dry:
        """Those of some threads whose pair has friction."""
        if not threads:
            return _NONE
        mu = law(np.array([t.bodies for t in threads], np.int64))[0]
        rubs = np.flatnonzero(mu > 0.0)
        own = [threads[k] for k in rubs.tolist()]
        angle = np.array([t.angle for t in own])
        both = np.array([t.friction(m) for t, m in zip(own, mu[rubs].tolist(), strict=True)]).reshape(-1, 2)
        return cls(rubs, np.cos(angle), np.sin(angle), np.array([t.radius for t in own]), both[:, 0], both[:, 1])


_NONE = Dry(np.zeros(0, np.int64), *(np.zeros(0) for _ in range(5)))


class Rates(NamedTuple):
    """A mechanism's accelerations, and its threads' rates and loads, as linear functions of the torques of friction."""

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
        """Where no thread rubs."""
        n = len(acceleration)
        return cls(acceleration, np.zeros((n, 0)), np.zeros(0), np.zeros((0, 0)), np.zeros((0, 4)), np.zeros((0, 4, 0)))

    def pressing(self, dry: Dry, x: Array) -> tuple[Array, Array, Array, Array]:
        """N (d,) across the flanks and R (d,) across the axis, N, and their derivatives (d, d) by x."""
        now = self.load + self.load_by_torque @ x
        c, s = dry.cosine, dry.sine / dry.radius
        n = c * now[:, 0] - s * now[:, 1]
        n_by = c[:, None] * self.load_by_torque[:, 0] - s[:, None] * self.load_by_torque[:, 1]
        r = np.sqrt(now[:, 2] ** 2 + now[:, 3] ** 2)
        way = now[:, 2:] / np.where(r > 0.0, r, 1.0)[:, None]
        r_by = way[:, :1] * self.load_by_torque[:, 2] + way[:, 1:] * self.load_by_torque[:, 3]
        return n, r, n_by, r_by

    def bound(self, dry: Dry, x: Array) -> Array:
        """(d,) N·m: the most that friction can hold."""
        n, r, _, _ = self.pressing(dry, x)
        return dry.radius / dry.cosine * (dry.on_flanks * np.abs(n) + dry.across * r)


def friction_torques(dry: Dry, slip: Array, rates: Rates) -> Array | None:
    """(d,) torques, by Newton's method, of threads that slide in the sense `slip` (±1) or stick (0).

    None where sliding makes more load than friction gives way to (a jam, Painlevé): no torque, or several, would do.
    """
    x = np.zeros(len(slip))
    sticks = slip == 0.0
    arm = dry.radius / dry.cosine
    last = np.inf
    for _ in range(NEWTON):
        n, r, n_by, r_by = rates.pressing(dry, x)
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


def chosen(dry: Dry, moving: Array, rates: Rates) -> Array | None:
    """(d,) how each thread goes on: one that moves (±1) as it does, one at rest (0) sticks if it can, else slides."""
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
    """The time in (0, h] after which `value` is first seen to be negative, to rounding; `end` < 0 is its value at h.

    False position after Illinois, from a time at which it is not negative; None where `value` is.
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
