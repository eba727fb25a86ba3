"""`mobility`: degrees of freedom and joint of each part and each pair, redundant and conflicting constraints.

The graph of constraints is cut into blocks (see `constraints.freedom.biconnected`). In each block a rank-revealing
factorisation of the Jacobian at the solved pose gives the instantaneous motions. Where equations are redundant these
may not be finite motions (a shaky structure): the block is then moved along them by a finite step and solved again; a
motion that returns to its start is not free. A part's motions are spanned by those of the blocks between the ground and
the part.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
import pinocchio as pin

from collision import Tolerance
from constraints.errors import ConstraintsError
from constraints.freedom.biconnected import GROUND, Block, blocks
from constraints.freedom.lower_pairs import SUBGROUPS, name_joint, orthonormal
from constraints.freedom.redundancy import Conflict, Names, Redundancy, conflicts, labels, redundancies
from constraints.kinds.base import Constraint
from constraints.solve import kernels
from constraints.solve.null_space import null_space
from constraints.solve.pose_kernels import move
from constraints.solve.solver import run, solve
from constraints.solve.system import Array, Poses, System, build

STEP = 0.02
"""rad (or of a part's size): the finite step; small enough to stay on a branch, large enough that a contact of fourth
order (residual STEP⁴ = 1.6e-7) is distinguished from a motion"""
AS_GOOD = 10.0
"""a displaced pose holds if its residual is at most this times that of the pose it comes from (files are not exact)"""


@dataclass(frozen=True, eq=False)
class Freedom:
    """What motion is left to a part against the fixed ones, or to a part against another."""

    freedom: int
    """degrees of freedom at this pose, instantaneous"""
    finite: int
    """degrees of freedom of true motions; fewer than `freedom` where the pose is singular or the part merely shaky"""
    twists: Array
    """(6, freedom) orthonormal twists that span it, in the part's local frame, linear first"""
    joint: str
    """"rigid", "revolute", "prismatic", "screw", "cylindrical", "planar", "spherical", …, "free" or "n-dof\""""


@dataclass(frozen=True, eq=False)
class Mobility:
    """Freedom at a pose that satisfies the constraints as well as can be."""

    freedom: int
    """of the whole: parameters that fix every part, instantaneous; parts that nothing constrains are left out"""
    finite: int
    """the same, of true motions"""
    parts: Mapping[int, Freedom]
    """by body id: each body that a constraint or `poses` names and that is not fixed"""
    residual: float
    """m or rad: greatest row at the pose looked at"""
    margin: float
    """least pivot that counts, over the largest: near `tolerance.rank` the count hangs on that tolerance"""
    _study: _Study = field(repr=False)

    @cached_property
    def pairs(self) -> Mapping[tuple[int, int], Freedom]:
        """Freedom of body b relative to a, by (a, b) with a < b, for each pair that a constraint joins."""
        out: dict[tuple[int, int], Freedom] = {}
        for m in self._study.moves:
            for a, b in sorted({(min(c.bodies), max(c.bodies)) for c in m.system.constraints}):
                out[a, b] = _freedom(_Carried().between(m, a, b), self._study.at[b])
        return out

    @cached_property
    def conflicting(self) -> tuple[Conflict, ...]:
        """Sets of constraints that cannot hold together, largest residual first; computed at first use."""
        s = self._study
        systems = [m.system for m in s.moves]
        return conflicts(s.constraints, systems, s.at, s.fixed, s.tolerance, s.texts)

    @cached_property
    def redundant(self) -> tuple[Redundancy, ...]:
        """Constraints that earlier ones imply, in whole or in part, in the given order; computed at first use."""
        s = self._study
        out = {c.constraints[-1] for c in self.conflicting}
        found = [
            redundancies(s.constraints, m.system, out, s.at, s.threshold(m), s.tolerance, s.texts) for m in s.moves
        ]
        return tuple(sorted((x for each in found for x in each), key=lambda x: x.constraint))


@dataclass(frozen=True, eq=False)
class _Study:
    """Input of the redundancy and conflict analysis, which runs at first use."""

    constraints: tuple[Constraint, ...]
    moves: tuple[_Moves, ...]
    at: Mapping[int, pin.SE3]
    fixed: frozenset[int]
    tolerance: Tolerance
    names: Names

    def threshold(self, m: _Moves) -> float:
        """Relative pivot below which rows are dependent; contradictions beyond `tolerance.conflict` do not widen it."""
        return m.threshold if m.worst <= self.tolerance.conflict else self.tolerance.rank

    @cached_property
    def texts(self) -> list[str]:
        return labels(self.constraints, self.names)


@dataclass(frozen=True, eq=False)
class _Moves:
    """The motions of one block."""

    block: Block
    system: System
    twists: Mapping[int, Array]
    """world twists (6, k) of each body against the block's root, k instantaneous motions"""
    samples: Mapping[int, tuple[pin.SE3, ...]] | None
    """world displacements of each body in the finite motions that were reached; None where motions need no proof"""
    finite: int
    worst: float
    """m or rad: greatest residual"""
    margin: float
    threshold: float
    """relative pivot up to which a motion is free"""
    across: float
    """rad: how exactly directions are known"""

    @property
    def freedom(self) -> int:
        """Instantaneous motions."""
        return next(iter(self.twists.values())).shape[1]


def mobility(
    constraints: Sequence[Constraint],
    poses: Poses,
    fixed: Iterable[int],
    tolerance: Tolerance | None = None,
    names: Names = None,
) -> Mobility:
    """Freedom of each part and pair, and which constraints are redundant or cannot hold together.

    Where the constraints do not hold at `poses` they are solved first, and the answer is for the pose found.

    Parameters
    ----------
    poses: of every body, by id. fixed: ids of the bodies that do not move.
    names: of the bodies, for the texts; "part 3" otherwise.
    """
    tol = tolerance or Tolerance()
    constraints = tuple(constraints)
    held = frozenset(fixed)
    known = set(poses) if isinstance(poses, Mapping) else set(range(len(poses)))
    if not held <= known:
        raise ConstraintsError(f"body {min(held - known)} is said to be fixed and has no pose; pass one")
    known |= {b for c in constraints for b in c.bodies}
    solution = solve(constraints, poses, known - held, tol)
    at = {b: solution.poses[b] if b in solution.poses else poses[b] for b in known}
    moves = [_moves(block, _system(constraints, block), at, tol) for block in _blocks(constraints, held)]
    carried: dict[int, _Carried] = {GROUND: _Carried()}
    grounded = {GROUND}
    bases: set[int] = set()  # lowest bodies of components without a fixed one
    for m in moves:  # roots come before what hangs from them
        root = m.block.root
        if root not in carried:
            carried[root] = _Carried()
            bases.add(root)
        for b in m.block.bodies:
            carried[b] = carried[root].then(m, b)
        if root in grounded:
            grounded |= set(m.block.bodies)
    unbound = Freedom(6, 6, np.eye(6), "free")
    parts = {b: _freedom(carried[b], at[b]) if b in grounded else unbound for b in sorted(known - held)}
    return Mobility(
        sum(m.freedom for m in moves) + 6 * len(bases),
        sum(m.finite for m in moves) + 6 * len(bases),
        parts,
        solution.residual,
        min((m.margin for m in moves), default=1.0),
        _Study(constraints, tuple(moves), at, held, tol, names),
    )


@lru_cache(maxsize=32)
def _blocks(constraints: tuple[Constraint, ...], fixed: frozenset[int]) -> tuple[Block, ...]:
    return blocks([c if c.freedom < 6 else None for c in constraints], fixed)


@lru_cache(maxsize=256)
def _system(constraints: tuple[Constraint, ...], block: Block) -> System:
    return build(constraints, block.constraints, block.bodies, bounds=False)


def _moves(block: Block, system: System, at: Mapping[int, pin.SE3], tolerance: Tolerance) -> _Moves:
    rotation, translation = system.gather(at, tolerance.rigid)
    worst = float(np.abs(system.evaluate(rotation, translation)[0]).max())
    null, threshold, margin = null_space(system, rotation, translation, tolerance)
    twists = {
        b: _world(system, null[system.slot[i]], i, rotation, translation)
        for i, b in enumerate(system.bodies)
        if system.slot[i] >= 0
    }
    k = null.shape[2]
    across = max(tolerance.lower_pair, 4.0 * threshold)
    series = len(block.bodies) == 1 and all(c.subgroup for c in system.constraints)
    if k == 0 or series:  # an intersection of subgroups is one: its motions are true and named by their twists
        return _Moves(block, system, twists, None, k, worst, margin, threshold, across)
    samples, finite = _sample(system, null, rotation, translation, worst, tolerance)
    return _Moves(block, system, twists, samples, finite, worst, margin, threshold, across)


def _world(system: System, local: Array, i: int, rotation: Array, translation: Array) -> Array:
    """World twists (6, k) about the world's origin from scaled local ones (6, k) about the centre of body i."""
    scaled = np.vstack([local[:3], local[3:] / system.extent[i]])
    return pin.SE3(rotation[i], translation[i]).action @ scaled


def _sample(
    system: System, null: Array, rotation: Array, translation: Array, worst: float, tolerance: Tolerance
) -> tuple[dict[int, tuple[pin.SE3, ...]], int]:
    """Finite displacements reached along each null direction (and one between them), and how many are independent."""
    k = null.shape[2]
    directions = list(np.moveaxis(null, 2, 0))
    if k > 1:
        directions.append(null @ (np.arange(1.0, k + 1) / np.linalg.norm(np.arange(1.0, k + 1))))
    limit = max(kernels.resolution(system.element, translation, tolerance.solver), AS_GOOD * worst)
    slots = [i for i in range(len(system.bodies)) if system.slot[i] >= 0]
    extent = system.extent[slots][:, None]
    slot_of_column = np.argsort(system.elimination.position)
    spanned: list[Array] = []
    samples: dict[int, list[pin.SE3]] = {system.bodies[i]: [] for i in slots}
    nullity = 0
    for direction in directions:
        step = direction * (STEP / np.abs(direction / extent).max())
        turned, moved = rotation.copy(), translation.copy()
        move(rotation, translation, system.extent, system.columns, step[slot_of_column], turned, moved)
        _, _, off = run(system, turned, moved, tolerance)
        before = [pin.SE3(rotation[i], translation[i]) for i in slots]
        after = [pin.SE3(turned[i], moved[i]) for i in slots]
        local = np.array([pin.log6(x.inverse() * y).vector for x, y in zip(before, after, strict=True)])
        local[:, 3:] *= extent
        if off > limit or np.linalg.norm(local) < 0.5 * np.linalg.norm(step):
            continue  # it came back: no motion that way
        spanned.append(local.ravel() / np.linalg.norm(local))
        for i, x, y in zip(slots, before, after, strict=True):
            samples[system.bodies[i]].append(y * x.inverse())
        nullity = max(nullity, null_space(system, turned, moved, tolerance)[0].shape[2])
    span = orthonormal(np.array(spanned).reshape(-1, 6 * len(slots)).T, 0.1).shape[1]
    return {b: tuple(s) for b, s in samples.items()}, min(span, nullity)


@dataclass(frozen=True, eq=False)
class _Carried:
    """World motions of a body, gathered over the blocks between it and the ground."""

    twists: Array = field(default_factory=lambda: np.zeros((6, 0)))
    """(6, n) instantaneous"""
    reached: Array = field(default_factory=lambda: np.zeros((6, 0)))
    """(6, n) finite displacements over STEP, or the twists where these are true motions"""
    finite: int = 0
    """true motions of all the blocks together"""
    proven: bool = True
    """whether all instantaneous motions are true"""
    blocks: int = 0
    """how many blocks have a part in it"""
    closed: bool = True
    """whether it is one block whose motions are a subgroup's"""
    length: float = np.inf
    across: float = 0.0

    def then(self, m: _Moves, b: int) -> _Carried:
        """With the motion of body b against the root of its block."""
        return self._with(m, b, m.twists[b], None if m.samples is None else m.samples[b])

    def between(self, m: _Moves, a: int, b: int) -> _Carried:
        """The motion of body b against body a, both in one block or at its root."""
        none = np.zeros((6, m.freedom))
        twists = m.twists.get(b, none) - m.twists.get(a, none)
        if m.samples is None:
            return self._with(m, b, twists, None)
        still = (pin.SE3.Identity(),) * max(map(len, m.samples.values()))
        pair = zip(m.samples.get(a, still), m.samples.get(b, still), strict=True)
        return self._with(m, b, twists, tuple(x.inverse() * y for x, y in pair))

    def _with(self, m: _Moves, b: int, twists: Array, samples: tuple[pin.SE3, ...] | None) -> _Carried:
        extent = float(m.system.extent[m.system.bodies.index(b)])
        moves = np.abs(twists).max(initial=0.0) > m.across * min(1.0, extent)
        reached = twists
        if samples is not None:
            reached = np.array([pin.log6(x).vector / STEP for x in samples]).reshape(-1, 6).T
        return _Carried(
            _compact(np.hstack([self.twists, twists])),
            _compact(np.hstack([self.reached, reached])),
            self.finite + m.finite,
            self.proven and m.finite == m.freedom,
            self.blocks + int(moves),
            m.samples is None,
            min(self.length, extent),
            max(self.across, m.across),
        )


def _compact(columns: Array) -> Array:
    """At most six columns with the same span and the same Gram matrix A Aᵀ."""
    if columns.shape[1] <= 6:
        return columns
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    return u * s


def _freedom(c: _Carried, pose: pin.SE3) -> Freedom:
    """Freedom and joint of the gathered motions, in the frame of `pose`."""
    scale = np.array([1.0 / c.length] * 3 + [1.0] * 3)[:, None]
    to_local = scale * pose.inverse().action
    basis = orthonormal(to_local @ c.twists, c.across)
    freedom = finite = basis.shape[1]
    reached = to_local @ c.reached
    if not c.proven:
        finite = min(freedom, orthonormal(reached, 0.1).shape[1], c.finite)
    joint = name_joint(basis / scale, c.length, c.across)
    if c.blocks > 1 and joint not in SUBGROUPS:
        joint = joint if joint == "universal" and c.blocks == 2 else f"{freedom}-dof"
    elif c.blocks == 1 and not c.closed:
        outside = reached - basis @ (basis.T @ reached)
        if finite < freedom or np.abs(outside).max(initial=0.0) > c.across / STEP:
            joint = f"{freedom}-dof"
    return Freedom(freedom, finite, np.linalg.qr(basis / scale)[0], joint)
