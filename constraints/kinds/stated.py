"""Constraints that the caller states, where recognition offers those that contact suggests.

A stated constraint is a `Candidate` as any other once it is in force: listed, drawn, kept in a checkpoint. It does not
end when surfaces no longer overlap, since no overlap made it, nor give way to what is recognised later, and no pull
ends it unless a limit is given at which it breaks.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from collision import Tolerance
from constraints.freedom.mobility import mobility
from constraints.freedom.redundancy import Conflict, Names
from constraints.geometry.features import Feature
from constraints.kinds import Constraint
from constraints.recognition.candidate import KINDS, Candidate, Match
from constraints.recognition.pairings import FITS
from constraints.solve.solver import solve

FAR = 1e3
"""of the size of what hangs together: a solution that throws a body farther is none (parallels "meet" far out)"""
UNKNOWN = -1
"""place of a feature that its body does not list, of which the next lower ones are used too"""


def stated(
    constraint: Constraint, poses: Sequence[pin.SE3], features: Sequence[Sequence[Feature]], number: int, why: str
) -> Candidate:
    """The candidate of a constraint that the caller states.

    features: of every body. number: one that no other statement has: it tells apart those about the same bodies.
    why: one line, for the user.
    """
    a, b = constraint.bodies
    symbol = constraint.drawing(poses[a])
    residual = constraint.residual(poses[a], poses[b])
    linear = float(np.abs(residual[~constraint.angular]).max(initial=0.0))
    angle = float(np.abs(residual[constraint.angular]).max(initial=0.0))
    match = Match(
        kind=constraint.kind, residual=linear, angle=angle, fit=None, overlap=0.0, share=1.0, closed=True,
        approach=symbol.direction, origin=symbol.origin, local=poses[a].actInv(symbol.origin),
        direction=symbol.direction, size=constraint.size, words=why,
    )  # fmt: skip
    places = [_place(features[body], geometry) for body, geometry in zip((a, b), constraint.features, strict=True)]
    if constraint.kind not in KINDS or UNKNOWN in places:  # not what recognition could find by itself
        places = [UNKNOWN - 1 - number] * 2
    key = (a, places[0], b, places[1], constraint.kind)
    return Candidate(key, match, constraint, near=(), score=1.0, why=why, stated=True)


def _place(features: Sequence[Feature], geometry: object) -> int:
    return next((k for k, feature in enumerate(features) if feature.geometry is geometry), UNKNOWN)


def mates_surfaces(candidate: Candidate, features: Sequence[Sequence[Feature]]) -> bool:
    """Whether the two surfaces lie in each other while the constraint holds, so that collision must leave them out.

    True of all that recognition offers; of what is stated, where it is a fit of a hollow surface and a solid one, or of
    plane faces against each other.
    """
    if not candidate.stated:
        return True
    a, fa, b, fb, kind = candidate.key
    if kind not in FITS or fa < 0:
        return False
    return kind == "against" or features[a][fa].sense * features[b][fb].sense < 0


def taken_along(candidates: Iterable[Candidate], bodies: Iterable[int], still: Iterable[int]) -> frozenset[int]:
    """`bodies` and all that what is stated joins to them, directly or through others; none that is to stand `still`."""
    found, rest = set(bodies), set(still)
    pairs = [c.bodies for c in candidates if c.stated]
    grown = True
    while grown:
        new = {x for pair in pairs if not found.isdisjoint(pair) for x in pair} - found - rest
        found |= new
        grown = bool(new)
    return frozenset(found)


def contradiction(
    constraint: Constraint,
    held: Sequence[Constraint],
    poses: Sequence[pin.SE3],
    fixed: Iterable[int],
    tolerance: Tolerance,
    names: Names = None,
) -> Conflict | None:
    """Why a constraint cannot hold together with those in force, and its residual; None if it can.

    Considers all constraints connected to it through bodies that are not `fixed`. It holds if the solver brings every
    row within `Tolerance.linear`, starting from `poses`.
    """
    still = frozenset(fixed)
    near, rest = [constraint], list(held)
    grown = True
    while grown:
        bodies = {body for c in near for body in c.bodies} - still
        new = [c for c in rest if not bodies.isdisjoint(c.bodies)]
        near, rest, grown = [*near, *new], [c for c in rest if c not in new], bool(new)
    near = [*near[1:], constraint]
    now = constraint.residual(*(poses[i] for i in constraint.bodies))
    free = [i for i in sorted({i for c in near for i in c.bodies}) if i not in still]
    found = solve(near, poses, free, replace(tolerance, solver=0.1 * tolerance.linear))
    moved = [float(np.linalg.norm(pose.translation - poses[i].translation)) for i, pose in found.poses.items()]
    places = np.array([poses[i].translation for c in near for i in c.bodies])
    spread = float(np.ptp(places, axis=0).max()) + max(c.reach for c in near) + float(np.abs(now).max())
    if found.residual <= tolerance.linear and max(moved, default=0.0) <= FAR * spread:
        return None
    conflicts = mobility(near, poses, still, tolerance, names).conflicting
    mine = [conflict for conflict in conflicts if len(near) - 1 in conflict.constraints]
    if mine:
        return mine[0]
    unit, rows = ("rad", now) if constraint.angular.all() else ("m", now[~constraint.angular])
    off = float(np.abs(rows).max())
    return Conflict((len(near) - 1,), off, unit, f"it cannot hold together with the others: off by {off:.3g} {unit}")


def parameter_names(kind: type[Constraint]) -> tuple[str, ...]:
    """Names of the parameters that a kind takes besides bodies and features."""
    common = Constraint.__dataclass_fields__
    return tuple(name for name in kind.__dataclass_fields__ if name not in common)
