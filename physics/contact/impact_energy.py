"""Energy of impacts: restitution that gains none.

Newton's law prescribes the speed at which contacts part. With friction the impulses that this takes may do more work
than was there (Kane & Levinson, Dynamics, 1985; Chatterjee & Ruina, J. Appl. Mech. 65, 1998). Without restitution they
never do (Glocker, Z. Angew. Math. Mech. 2013: an impact law is consistent as long as the work below is not positive).

Relative velocities s at the contacts change from s⁻ to s⁺ under impulses λ; what is gained is exactly

    D = ½ Σ λ · (s⁺ + s⁻),

also where a moving obstacle strikes: its own work is left out; joints do none. Between the answer without restitution
(σ = 0) and Newton's (σ = 1) all of λ and s⁺ are linear in σ and D is a parabola, open above, not positive at 0. The
answer is the greatest σ ≤ 1 that gains nothing: contacts part, joints hold and friction stays in its cone there, as
they do at both ends.

Poisson's law seldom needs that. Let λ be the impulses of its compression, which ends with speeds sᶜ and λ · sᶜ ≤ 0, and
λ' those of its restitution. Impulses e λ in its place would end with -½ (1 - e²) λ·Wλ more energy than there was, at
most (W: inverse mass at the contacts); and λ' ends with less than they, by the law: (λ' - e λ) · s⁺ ≤ 0, since normal
parts above e λ_n are where s⁺_n = 0, and friction opposes s⁺_t with all of μ λ'_n ≥ μ e λ_n. So it makes none for any e
and μ, as long as e is the same at all contacts of a blow; if it is not, only friction can gain.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physics.solver.islands import components

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

ROUNDING = 1e-12
"""1: gains below this fraction of the impulses' greatest possible work are rounding"""


def relative(bodies: Ints, jacobian: Array, bias: Array, v: Array) -> Array:
    """(c, 3) m/s at which contacts part and slide, rows as `contact_problem.contact_rows` gives them, v (n, 6)."""
    padded = np.concatenate([v, np.zeros((1, 6))])  # -1: what does not move
    return np.einsum("cij,cj->ci", jacobian, padded[bodies].reshape(-1, 12)) + bias


def groups(n: int, bodies: Ints, joints: Ints) -> tuple[Ints, Ints, int]:
    """Component labels of n bodies and contacts (c, 2), connected by contacts and joints (g, 2), and their number."""
    label, count = components(n, np.concatenate([bodies, joints]))
    return label, label[bodies.max(axis=1)], count


def gained(impulse: Array, before: Array, after: Array, group: Ints, count: int) -> NDArray[np.bool_]:
    """(count,) whether impulses (c, 3) have made energy, where they take relative speeds from `before` to `after`."""
    work = impulse * (after + before)
    most = np.abs(impulse) * (np.abs(after) + np.abs(before))
    total = np.bincount(group, work.sum(axis=1), count)
    return total > ROUNDING * np.bincount(group, most.sum(axis=1), count)


def share(
    impulse: Array, least: Array, before: Array, after: Array, least_after: Array, group: Ints, count: int
) -> Array:
    """(count,) σ of each group: the greatest in 0 … 1 that gains no energy.

    impulse, after: (c, 3) N·s and m/s of Newton's law; least, least_after: those without restitution.
    """
    rise, run = impulse - least, after - least_after
    a, b, c = (
        np.bincount(group, terms.sum(axis=1), count)
        for terms in (rise * run, rise * (least_after + before) + least * run, least * (least_after + before))
    )
    root = np.sqrt(np.maximum(b * b - 4.0 * a * np.minimum(c, 0.0), 0.0))
    # of the two forms of the larger root the one that does not cancel
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma = np.where(b > 0.0, -2.0 * np.minimum(c, 0.0) / (b + root), (root - b) / (2.0 * a))
    return np.clip(np.nan_to_num(sigma, nan=1.0, posinf=1.0), 0.0, 1.0)
