"""Redundant and conflicting constraints, with explanations in the user's terms.

Redundant: a constraint whose rows lie, at the solved pose, in the span of the rows of constraints before it; those that
imply it are the ones with a weight in that combination. Conflicting: an irreducible infeasible set, all proper subsets
of which can hold, found by deletion (Chinneck and Dravnieks, ORSA J. Computing 3, 1991).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pinocchio as pin

from collision import Tolerance
from constraints.kinds.base import Constraint
from constraints.solve import kernels
from constraints.solve.pose_kernels import move
from constraints.solve.ranks import least_norm, null_basis, pivoted_qr, row_space
from constraints.solve.solver import run
from constraints.solve.system import System, build

Names = Mapping[int, str] | Sequence[str] | None
STEPS = 30
"""greatest number of Gauss-Newton steps that reduce the residual of the last constraint of a conflict"""
WEIGHT = 1e-6
"""1: a row with less weight in a combination does not count"""
_NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


@dataclass(frozen=True)
class Redundancy:
    """A constraint that earlier ones imply in whole or in part."""

    constraint: int
    """its index in the given sequence"""
    implied: int
    """number of its equations that are implied"""
    equations: int
    """number of its equations"""
    by: tuple[int, ...]
    """indices of the constraints that imply them, ascending"""
    text: str

    @property
    def wholly(self) -> bool:
        """Whether all its equations are implied."""
        return self.implied == self.equations


@dataclass(frozen=True)
class Conflict:
    """Constraints that cannot hold together, while any proper subset can."""

    constraints: tuple[int, ...]
    """indices in the given sequence, ascending"""
    off: float
    """residual of the last one while the others hold"""
    unit: str
    """"m" or "rad\""""
    text: str


def labels(constraints: Sequence[Constraint], names: Names) -> list[str]:
    """Return a text for each: "concentric between bolt_2 and plate", with faces (or index) if a pair has several."""
    texts = [f"{c.kind} between {_name(c.bodies[0], names)} and {_name(c.bodies[1], names)}" for c in constraints]
    counts = Counter(texts)
    for i, c in enumerate(constraints):
        if counts[texts[i]] > 1:
            a, b = (",".join(map(str, s)) for s in c.surfaces)
            texts[i] += f" (faces {a} and {b})" if a and b else f" (no. {i})"
    return texts


def _name(body: int, names: Names) -> str:
    try:
        return names[body] if names is not None else f"part {body}"
    except (KeyError, IndexError):
        return f"part {body}"


def _listed(texts: Sequence[str]) -> str:
    return texts[0] if len(texts) == 1 else ", ".join(texts[:-1]) + " and " + texts[-1]


def redundancies(
    constraints: Sequence[Constraint],
    system: System,
    without: Collection[int],
    at: Mapping[int, pin.SE3],
    threshold: float,
    tolerance: Tolerance,
    texts: Sequence[str],
) -> list[Redundancy]:
    """Return the redundant constraints of one system, in the given order; `without`: conflicting ones, left out.

    A row within `threshold` of the span of earlier rows counts as lying in it.
    """
    members = [i for i in system.members if i not in without]
    poses, _ = _holds(constraints, members, system, at, tolerance)
    part = build(constraints, tuple(members), system.movable, bounds=False)
    _, jacobian = part.dense(*part.gather(poses, tolerance.rigid))
    lengths = np.linalg.norm(jacobian, axis=1, keepdims=True)
    unit = np.divide(jacobian, lengths, out=jacobian, where=lengths > 0.0)
    place, weights = row_space(unit, threshold)
    owner = np.array(members)[part.owner]
    kept = owner[place >= 0]
    out: list[Redundancy] = []
    for c in members:
        mine = owner == c
        implied = mine & (place < 0)
        if implied.any():
            by = np.unique(kept[(np.abs(weights[implied]) > max(WEIGHT, 1e3 * threshold)).any(axis=0)])
            by = by[by != c]
            out.append(_redundancy(c, int(implied.sum()), int(mine.sum()), tuple(by.tolist()), texts))
    return out


def _redundancy(place: int, implied: int, equations: int, by: tuple[int, ...], texts: Sequence[str]) -> Redundancy:
    source = _listed([texts[i] for i in by]) if by else "nothing that can move"
    if implied == equations:
        text = f"{texts[place]} is implied by {source}"
    else:
        text = f"{implied} of the {equations} equations of {texts[place]} are implied by {source}"
    return Redundancy(place, implied, equations, by, text)


def conflicts(
    constraints: Sequence[Constraint],
    systems: Sequence[System],
    at: Mapping[int, pin.SE3],
    fixed: frozenset[int],
    tolerance: Tolerance,
    texts: Sequence[str],
) -> tuple[Conflict, ...]:
    """Return irreducible sets of constraints that cannot hold together, by falling residual of the last of each."""
    out: list[Conflict] = []
    for i, c in enumerate(constraints):
        if fixed.issuperset(c.bodies):
            off, unit = _worst(c, at)
            if off > tolerance.conflict:
                text = f"{texts[i]} cannot hold, both are fixed: off by {_amount(off, unit)}"
                out.append(Conflict((i,), off, unit, text))
    for system in systems:
        members = list(system.members)
        rotation, translation = system.gather(at, tolerance.rigid)
        worst = float(np.abs(system.evaluate(rotation, translation)[0]).max())
        holds = worst <= kernels.resolution(system.element, translation, tolerance.conflict)
        poses = dict(at)
        stuck: set[tuple[int, ...]] = set()
        while not holds:
            core = _irreducible(constraints, members, system, poses, tolerance)
            off, unit, nearest = _miss(constraints, core, system, poses, tolerance)
            if off <= tolerance.conflict:  # no contradiction, but a start from which the solver gets stuck
                if tuple(core) in stuck:  # continue without its last constraint
                    members.remove(core[-1])
                stuck.add(tuple(core))
                poses, holds = _holds(constraints, members, system, nearest, tolerance)
                continue
            count = _NUMBERS[len(core)] if len(core) < len(_NUMBERS) else str(len(core))
            head = f"these {count} cannot hold together" if len(core) > 1 else "this cannot hold"
            text = f"{head}: off by {_amount(off, unit)}: {_listed([texts[i] for i in core])}"
            out.append(Conflict(tuple(core), off, unit, text))
            members.remove(core[-1])
            poses, holds = _holds(constraints, members, system, at, tolerance)
    return tuple(sorted(out, key=lambda x: (-x.off, x.constraints)))


def _miss(
    constraints: Sequence[Constraint],
    core: Sequence[int],
    system: System,
    at: Mapping[int, pin.SE3],
    tolerance: Tolerance,
) -> tuple[float, str, dict[int, pin.SE3]]:
    """Least residual of the last constraint of the core while the others hold, and the poses there.

    Gauss-Newton in the null space of the others, which are solved again after each step. It starts at the poses that
    solve all of them together, the last one with little weight.
    """
    part = build(constraints, tuple(core), system.movable, bounds=False)
    last = part.owner == len(core) - 1
    firm = replace(part, weight=np.where(last, part.weight, 1e3 * part.weight))
    rotation, translation = part.gather(at, tolerance.rigid)
    run(part, rotation, translation, tolerance)
    run(firm, rotation, translation, tolerance)
    poses = _holds(constraints, core[:-1], system, {**at, **part.scatter(rotation, translation)}, tolerance)[0]
    columns = np.argsort(part.elimination.position)
    scale = 1.0
    for _ in range(STEPS):
        rotation, translation = part.gather(poses, tolerance.rigid)
        r, jacobian = part.dense(rotation, translation)
        order, upper, rank, _ = pivoted_qr(np.ascontiguousarray(jacobian[~last].T), tolerance.rank)
        free = null_basis(order, upper, rank).T
        slope = jacobian[last] @ free
        most, steepest = float(np.linalg.norm(jacobian[last])), float(np.linalg.norm(slope))
        if steepest <= WEIGHT * most:
            break  # the others leave it no motion
        wanted = free @ least_norm(np.ascontiguousarray(slope.T), -r[last], WEIGHT * most / steepest)
        wanted /= max(1.0, float(np.linalg.norm(wanted)) / part.length)
        step = scale * wanted.reshape(-1, 6)[columns]
        turned, moved = rotation.copy(), translation.copy()
        move(rotation, translation, part.extent, part.columns, step, turned, moved)
        there = _holds(constraints, core[:-1], system, {**poses, **part.scatter(turned, moved)}, tolerance)[0]
        now = part.dense(*part.gather(there, tolerance.rigid))[0]
        if np.linalg.norm(now[last]) < 0.999 * np.linalg.norm(r[last]):
            poses = there
        elif scale < 0.1:
            break
        else:
            scale *= 0.5
    return *_worst(constraints[core[-1]], poses), poses


def _irreducible(
    constraints: Sequence[Constraint],
    members: Sequence[int],
    system: System,
    at: Mapping[int, pin.SE3],
    tolerance: Tolerance,
) -> list[int]:
    """A subset that cannot hold while its proper subsets can: members are removed while the rest still cannot."""
    core = list(members)
    # at a least-squares pose Jᵀr = 0: only rows with a residual contribute, so most members can be removed at once
    strained = [i for i in core if _worst(constraints[i], at)[0] > 1e-3 * tolerance.conflict]
    if strained and not _holds(constraints, strained, system, at, tolerance)[1]:
        core = strained
    for i in list(core):
        rest = [k for k in core if k != i]
        if rest and not _holds(constraints, rest, system, at, tolerance)[1]:
            core = rest
    return core


def _holds(
    constraints: Sequence[Constraint],
    members: Sequence[int],
    system: System,
    at: Mapping[int, pin.SE3],
    tolerance: Tolerance,
) -> tuple[dict[int, pin.SE3], bool]:
    """(poses after solving these members alone, whether they hold)."""
    poses = dict(at)
    if not members:
        return poses, True
    part = build(constraints, tuple(members), system.movable, bounds=False)
    rotation, translation = part.gather(at, tolerance.rigid)
    _, _, worst = run(part, rotation, translation, tolerance)
    poses.update(part.scatter(rotation, translation))
    return poses, worst <= kernels.resolution(part.element, translation, tolerance.conflict)


def _worst(constraint: Constraint, at: Mapping[int, pin.SE3]) -> tuple[float, str]:
    """(greatest residual, its unit): a length, unless an angle displaces the features by more."""
    r = constraint.residual(at[constraint.bodies[0]], at[constraint.bodies[1]])
    found = {False: 0.0, True: 0.0}
    for start, stop in pairwise([*constraint.compiled.start, len(r)]):
        angular = bool(constraint.angular[start])
        found[angular] = max(found[angular], float(np.linalg.norm(r[start:stop])))
    return (found[False], "m") if found[False] >= found[True] * constraint.reach else (found[True], "rad")


def _amount(value: float, unit: str) -> str:
    if unit == "rad":
        return f"{np.degrees(value):.3g}°"
    return f"{1e3 * value:.3g} mm"
