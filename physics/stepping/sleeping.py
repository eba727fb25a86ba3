"""Sleep: islands that have been at rest for long enough cost nothing, until something that moves comes near."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from collision import Tolerance
from physics.model.bodies import FREE, KINEMATIC, Bodies, point_speeds

Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


def wake_neighbours(b: Bodies, free: Ints, links: Ints) -> Ints:
    """Wake free bodies linked to an awake or moving kinematic one, transitively; returns ids awake (n,), ascending.

    links: (k, 2) pairs of objects that are near to or joined with one another.
    """
    awake = np.zeros(b.n, bool)
    awake[free] = True
    active = awake.copy()
    active[links[(b.kind[links] == KINEMATIC) & b.velocity[links].any(axis=2)]] = True
    while True:
        reached = np.concatenate([links[active[links[:, 0]], 1], links[active[links[:, 1]], 0]])
        woken = np.unique(reached[(b.kind[reached] == FREE) & ~awake[reached]])
        if len(woken) == 0:
            return np.flatnonzero(awake)
        awake[woken] = active[woken] = True
        b.awake[woken] = True
        b.quiet[woken] = 0.0


def put_to_sleep(b: Bodies, ids: Ints, label: Ints, links: Ints, may: Mask, tolerance: Tolerance, dt: float) -> bool:
    """Put islands to sleep that have rested for `tolerance.sleep_time`; returns whether any fell asleep.

    label: (n,) island of each body of `ids`. may: (n,) mask of bodies that may sleep. Bodies that are near to nothing
    stay awake.
    """
    count = int(label.max(initial=-1)) + 1
    resting = point_speeds(b.velocity[ids], b.radius[ids]) < tolerance.sleep_speed
    b.quiet[ids] = np.where(resting, b.quiet[ids] + dt, 0.0)
    restless = ~may | (b.quiet[ids] < tolerance.sleep_time)
    place = np.full(b.n, -1, np.int64)
    place[ids] = label
    met = np.zeros(count, bool)
    met[place[links[(place[links] >= 0).any(axis=1)]].max(axis=1)] = True
    carried = (b.kind[links] == KINEMATIC) & b.velocity[links].any(axis=2)
    pushed = place[links[carried.any(axis=1)]].max(axis=1)
    awake = ~met
    awake[label[restless]] = True
    awake[pushed[pushed >= 0]] = True
    asleep = ids[~awake[label]]
    b.awake[asleep] = False
    b.velocity[asleep] = 0.0
    return len(asleep) > 0
