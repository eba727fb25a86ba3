"""One step of constrained motion: the god-object method of Ortega, Redon and Coquillart (2007), for many bodies.

The motion x of least distance to what the hand wants is a quadratic program, min ½|A x - e|², with the accepted
constraints as equalities J x = -r and one inequality n·(v_a - v_b) <= gap a pair of surfaces that come near. The
constraints are then solved to the end (Newton), and the way there is swept for contacts that the linear rows did not
foresee, so that no speed carries a part through another. What is left of the motion is tried again along the new
surfaces: the part slides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple, Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CONTACT_DTYPE, Tolerance
from collision.contact import surfaces_of
from constraints.motion.passage import Drawn, Sweeping, passable
from constraints.motion.quadratic_program import UNMOVED, UndecidedError, minimum, quadratic_program
from constraints.motion.unknowns import Unknowns
from constraints.motion.walls import NOT_SEARCHED, Searched, Walls
from constraints.recognition.mated import MatedSurfaces
from constraints.solve.allowed import allowed
from constraints.solve.solver import solve

Array = NDArray[np.float64]

MAX_PASSES = 12
"""Passes of plan, project and sweep a step; what is left of the motion after them is left to the next step."""
MAX_TURN = 0.5
"""rad a pass, within which a linear step is a fair guess for Newton."""
MARGIN = 2.0
"""Of `Tolerance.linear`: the gap that the linear rows keep, so that a slide stays out of the sweep's way."""
SHORT = 0.9
"""Of the way to an unforeseen contact that a pass goes."""
FINE = 1e-2
"""Of `Tolerance.linear`: a step ends where going on would move no point farther; a hand moves on before it matters."""
FOLLOW = 1e-6
"""Weight of moving the other bodies as if they were of one piece with the held one, against 1 of obeying the hand."""

Barrier = Callable[[Sequence[pin.SE3], Mapping[int, pin.SE3]], tuple[float, NDArray[Any]] | None]
"""(poses of all bodies, targets to which some go along one screw each) -> how far they get, in [0, 1), and the contact
rows of what stops them; None where nothing does"""


def open_way(poses: Sequence[pin.SE3], target: Mapping[int, pin.SE3]) -> None:
    """The barrier that stops nothing."""


class Swept(Sweeping, Protocol):
    """The queries of `collision.CollisionManager` that a step needs."""

    def ignored_surfaces(self, i: int, j: int) -> frozenset[tuple[int, int]]: ...


class MotionResult(NamedTuple):
    """The result of one step: poses, contacts, and what is left of the motion."""

    poses: Mapping[int, pin.SE3]
    """of every body that moved or was held, by id"""
    blocked: bool
    """whether a solid body kept a held part from a pose that its constraints allow"""
    contacts: NDArray[Any]
    """rows of the surface pairs that stopped or deflected the motion"""
    residual: float
    """m or rad: greatest row of the constraints in force after the motion"""
    remaining: Mapping[int, tuple[float, float]]
    """m and rad between where each held body is and where its hand wants it"""
    way: Sequence[Mapping[int, pin.SE3]] = ()
    """poses that the bodies went through before `poses`, in order; one screw motion leads from each to the next"""


class Linear(NamedTuple):
    """The constraints linearised at some poses: residual (m,), and the motions x = origin + basis·y that they allow."""

    unknowns: Unknowns
    key: bytes
    """the poses"""
    residual: Array
    origin: Array
    basis: Array

    @classmethod
    def at(cls, unknowns: Unknowns, poses: Sequence[pin.SE3], known: Linear | None, rigid: float) -> Linear:
        """The constraints linearised at `poses`; `known` if it is of the same: a step begins where the last ended."""
        key = b"".join([poses[b].homogeneous.tobytes() for b in unknowns.named])
        if known is not None and known.unknowns is unknowns and known.key == key:
            return known
        residual, jacobian = unknowns.linearised(poses, rigid)
        return cls(unknowns, key, residual, *allowed(residual, jacobian))


class Aim(NamedTuple):
    """The objective ½ yᵀHy + gᵀy of the hand over the motions x = origin + basis·y that the constraints allow."""

    origin: Array
    basis: Array
    hessian: Array
    gradient: Array

    def free(self) -> Array:
        """(n,) the best motion without contacts."""
        return self.origin + self.basis @ minimum(self.hessian, self.gradient)

    def along(self, pressed: Array) -> Array:
        """(n,) the motion that neither closes nor opens the gaps that `pressed` (k, n) are the rows of."""
        if not len(pressed):
            return self.free()
        _, s, vt = np.linalg.svd(pressed @ self.basis)
        slide = vt[int((s > UNMOVED).sum()) :].T
        hessian = slide.T @ self.hessian @ slide
        return self.origin + self.basis @ (slide @ np.linalg.solve(hessian, -slide.T @ self.gradient))


class Proposal(NamedTuple):
    """The motion that one pass plans."""

    x: Array
    rows: NDArray[Any]
    """contacts it was planned with"""
    active: NDArray[np.int64]
    """places of the rows that it presses on"""
    pressed: Array
    """(k, n) rows of the quadratic program of `active`"""
    covered: bool
    """whether no other contact can be met on the way"""
    lifts: bool
    """whether it only makes room between surfaces that are too near each other"""
    whole: bool
    """whether it ends at the wanted poses"""


class Met:
    """Facets of hollow surfaces that were met in this step, fixed to their bodies: what is inside stays before each.

    This is so wherever it goes, since the room in a bore is convex; of other surfaces the last witness says enough.
    """

    def __init__(self) -> None:
        self.rows = np.empty(0, CONTACT_DTYPE)
        self.local = np.empty((0, 3, 3))
        """(k, 3, 3) the normal and the point of a in a's frame, the point of b in b's"""

    def add(self, rows: NDArray[Any], normals: Array, poses: Sequence[pin.SE3]) -> None:
        """Keep contact rows with their directions (k, 3) from a to b, world, at `poses`."""
        local = np.empty((len(rows), 3, 3))
        for k, (a, b) in enumerate(zip(rows["object_a"].tolist(), rows["object_b"].tolist(), strict=True)):
            local[k, 0] = poses[a].rotation.T @ normals[k]
            local[k, 1], local[k, 2] = poses[a].actInv(rows["point_a"][k]), poses[b].actInv(rows["point_b"][k])
        self.rows, self.local = np.concatenate([self.rows, rows]), np.concatenate([self.local, local])

    def now(self, poses: Sequence[pin.SE3]) -> tuple[NDArray[Any], Array, Array]:
        """The rows where their bodies are at `poses`, their directions (k, 3) and their gaps (k,) along these."""
        rows, normals = self.rows.copy(), np.empty((len(self.rows), 3))
        for k, (a, b) in enumerate(zip(rows["object_a"].tolist(), rows["object_b"].tolist(), strict=True)):
            normals[k] = poses[a].rotation @ self.local[k, 0]
            rows["point_a"][k], rows["point_b"][k] = poses[a].act(self.local[k, 1]), poses[b].act(self.local[k, 2])
        gaps = ((rows["point_b"] - rows["point_a"]) * normals).sum(axis=1)
        rows["distance"] = np.maximum(gaps, 0.0)
        return rows, normals, gaps


class Surroundings(NamedTuple):
    """What bodies move among."""

    drawn: Drawn
    collision: Swept
    walls: Walls
    mated: MatedSurfaces
    tolerance: Tolerance
    solving: Tolerance
    """how exactly the constraints must hold"""
    barrier: Barrier
    searched: Searched = NOT_SEARCHED
    """contacts of the bodies where the step begins"""


class Step:
    """Brings held bodies towards the poses wanted of them, in passes of plan, project and sweep."""

    def __init__(
        self, unknowns: Unknowns, wanted: Mapping[int, pin.SE3], poses: Sequence[pin.SE3], known: Linear | None,
        around: Surroundings, home: bool = False,
    ) -> None:  # fmt: skip
        """known: linearisation at the end of the step before. home: whether all bodies are wanted where they are drawn:
        the constraints hold there as they do in the drawing."""
        self.unknowns, self.wanted, self.bodies = unknowns, dict(wanted), unknowns.bodies
        (
            self.drawn, self.collision, self.walls, self.mated, self.tolerance, self.solving, self.barrier,
            self.searched,
        ) = around  # fmt: skip
        self.home = home
        self.poses: list[pin.SE3] = list(poses)
        self.acting: list[NDArray[Any]] = []
        self.way: list[dict[int, pin.SE3]] = []
        self.flush: set[tuple[int, ...]] = set()
        self.met = Met()
        self.refused: dict[int, pin.SE3] = {}
        """where the last pass was planned to end, if it was stopped on its way"""
        self.linear = Linear.at(unknowns, self.poses, known, self.tolerance.rigid)
        self.left = self._left()
        self.error = self._error()

    def run(self) -> MotionResult:
        """Move the bodies towards the wanted poses; return where they are then."""
        begin, at = {b: self.poses[b] for b in self.unknowns.place}, self.linear
        if self.home and max(_length(e) for e in self.left.values()) <= self.tolerance.satisfied:
            return self._result(blocked=False)
        before = self.error
        blocked = self._approach()
        # without solids, only a thread that skips turns can get nearer than the nearest pose that was found
        stalled = self.error > 0.5 * before and any(c.periodic for c in self.unknowns.constraints)
        near = self.error <= FINE * self.tolerance.linear and not self.home
        if near or ((blocked or stalled or self.home) and self._pass(begin, at)):
            blocked = False
            self.acting.clear()
        elif blocked:
            self._slide()
        return self._result(blocked)

    def _result(self, blocked: bool) -> MotionResult:
        return MotionResult(
            poses={b: self.poses[b] for b in self.unknowns.place},
            blocked=blocked,
            contacts=_latest(self.acting),
            residual=float(np.abs(self.linear.residual).max(initial=0.0)),
            remaining={b: (_length(e[:3]), _length(e[3:])) for b, e in sorted(self.left.items())},
            way=self.way[:-1],
        )

    def _approach(self) -> bool:
        """Go to the nearest allowed pose, at a margin from what is solid; whether anything stood in the way."""
        blocked = lifted = False
        best = self.error
        aim = self._aim()
        for _ in range(MAX_PASSES):
            proposal = self._propose(aim, may_lift=not lifted)
            lifted = proposal.lifts
            target = self._followed(self.wanted) if proposal.whole else self._moved(proposal.x)
            self.refused = {}
            if not proposal.covered or len(proposal.rows) or self.barrier(self.poses, target):
                planned = target
                with self._flush_ignored():
                    target, hit = self._sweep(planned, proposal.rows)
                if hit is not None:
                    self.refused = planned
                    self.acting.append(hit)
                    blocked = True
            travel = self._commit(target)
            if lifted:
                best, aim = self.error, self._aim()
                continue
            if len(proposal.active):
                self.acting.append(proposal.rows[proposal.active])
                blocked = True
            error = self.error
            # a motion to the nearest allowed pose brings the squared error down by its own square, at least
            if error <= self.tolerance.satisfied or travel == 0.0 or best**2 - error**2 < 1e-3 * travel**2:
                break
            aim = self._aim()
            if self.unknowns.travel(aim.along(proposal.pressed)) <= FINE * self.tolerance.linear:
                break
            best = error
        return blocked

    def _pass(self, begin: dict[int, pin.SE3], at: Linear) -> bool:
        """Go straight to the wanted poses from `begin` instead, where solid bodies leave a way without any margin."""
        here, error = {b: self.poses[b] for b in begin}, self.error
        self._put(begin, at)
        passed = self._passed(self._followed(self.wanted) if self.home else self._target(), error)
        if passed:
            self.way.clear()
        else:
            self._put(here)
        return passed

    def _slide(self) -> None:
        """Go on to where the last pass was planned to end, if it was stopped on a way that is a passage."""
        if self.refused and self._passed(self.refused, self.error):
            self.way.append(self.refused)

    def _passed(self, target: dict[int, pin.SE3], error: float) -> bool:
        """Go straight to a target that has less than an error (m), if that way is a passage; otherwise stay."""
        here, at = {b: self.poses[b] for b in target}, self.linear
        self._put(target)
        nearer = self.home or self.error < error - FINE * self.tolerance.linear
        self._put(here, at)
        with self._flush_ignored():
            passed = nearer and passable(self.collision, self.walls, self.drawn, self.poses, target, self.tolerance)
        passed = passed and self.barrier(self.poses, target) is None
        self._put(target if passed else here, None if passed else at)
        return passed

    def _target(self) -> dict[int, pin.SE3]:
        """The wanted poses as the constraints allow them."""
        target = dict(self.wanted)
        held = min(self.wanted)
        shift = self.wanted[held] * self.poses[held].inverse()
        for body in self.bodies:
            target.setdefault(body, shift * self.poses[body])
        return self._projected(target)

    def _put(self, poses: Mapping[int, pin.SE3], linear: Linear | None = None) -> None:
        """Set poses of bodies, without a motion there."""
        for body, pose in poses.items():
            self.poses[body] = pose
        self.collision.set_poses(list(poses), list(poses.values()))
        known = self.linear if linear is None else linear
        self.linear = Linear.at(self.unknowns, self.poses, known, self.tolerance.rigid)
        self.left = self._left()
        self.error = self._error()

    # -- what is wanted

    def _left(self) -> dict[int, Array]:
        """For each held body the (6,) local twist about its centre that would bring it to its wanted pose, m and rad:
        the straight way of the centre, and the turn."""
        out = {}
        for body, target in self.wanted.items():
            center, now = self.unknowns.center[self.unknowns.place[body]], self.poses[body]
            e = out[body] = np.empty(6)
            e[:3] = now.rotation.T @ (target.act(center) - now.act(center))
            e[3:] = pin.log3(now.rotation.T @ target.rotation)
        return out

    def _error(self) -> float:
        """m: distance to the wanted poses and violation of the constraints, as one norm."""
        residual = self.linear.residual
        total = float(residual @ residual)
        for body, e in self.left.items():
            radius = self.unknowns.radius[self.unknowns.place[body]]
            total += float(e[:3] @ e[:3]) + float(radius * radius * (e[3:] @ e[3:]))
        return float(np.sqrt(total))

    def _aim(self) -> Aim:
        unknowns, origin, basis = self.unknowns, self.linear.origin, self.linear.basis
        goal, weight = np.zeros(unknowns.n), np.full(unknowns.n, FOLLOW)
        for body, e in self.left.items():
            k = unknowns.place[body]
            if float(e[3:] @ e[3:]) < MAX_TURN**2:  # the screw that ends there, as `Unknowns.moved` goes it
                e = pin.log6(pin.SE3(pin.exp3(e[3:]), e[:3])).vector
            goal[6 * k : 6 * k + 3], goal[6 * k + 3 : 6 * k + 6] = e[:3], e[3:] * unknowns.radius[k]
            weight[6 * k : 6 * k + 6] = 1.0
        # minimise Σ w (F x - goal)² over x = origin + basis y
        d, there = basis, origin
        if len(self.wanted) < len(self.bodies):
            follow = self._following()
            d, there = follow @ basis, follow @ origin
        weighed = d.T * weight
        return Aim(origin, basis, weighed @ d, weighed @ (there - goal))

    def _following(self) -> Array:
        """(n, n) F: x of held bodies as it is, of the others relative to the first held one, as one rigid body."""
        u = self.unknowns
        out = np.eye(u.n)
        held = u.place[min(self.wanted)]
        pose, k = self.poses[self.bodies[held]], 6 * held
        for body, place in u.place.items():
            if body in self.wanted:
                continue
            i = 6 * place
            turn = self.poses[body].rotation.T @ pose.rotation
            arm = pose.actInv(self.poses[body].act(u.center[place])) - u.center[held]
            out[i : i + 3, k : k + 3] = -turn
            out[i : i + 3, k + 3 : k + 6] = turn @ pin.skew(arm) / u.radius[held]
            out[i + 3 : i + 6, k + 3 : k + 6] = -turn * (u.radius[place] / u.radius[held])
        return out

    # -- the quadratic program

    def _propose(self, aim: Aim, may_lift: bool) -> Proposal:
        """The next motion towards the wanted poses; before it one off what is too near, if there `may` be one."""
        unknowns, origin, basis = self.unknowns, aim.origin, aim.basis
        x = unknowns.clipped(aim.free(), MAX_TURN)
        margin = MARGIN * self.tolerance.linear
        # a long motion is not looked at to its end: beyond a few reaches the sweep finds what it meets
        reach = min(unknowns.closing(x), 5.0 * self.tolerance.reach) + 2.0 * margin
        rows = self.walls.near(reach, unknowns.place, self.poses, self.searched)
        self.searched = NOT_SEARCHED
        active, pressed = np.zeros(0, np.int64), np.zeros((0, unknowns.n))
        lifts = False
        if len(rows) and basis.shape[1]:
            c, gap = self._inequalities(rows)
            lift = _lift(basis, c, gap, margin) if may_lift and unknowns.travel(x) > margin else None
            if len(self.met.rows):
                again, normals, further = self.met.now(self.poses)
                rows = np.concatenate([rows, again])
                c = np.vstack([c, unknowns.gap_rows(again, normals, self.poses)])
                gap = np.concatenate([gap, further])
            lower = np.minimum(margin - gap, 0.0)
            if lift is not None:
                x, lifts = lift, True
            elif (c @ x < lower - 1e-15).any():
                found = _least(aim.hessian, aim.gradient, c @ basis, lower - c @ origin)
                if found is not None:
                    y, active = found
                    pressed = c[active]
                    # an arm that turns by this sinks half the margin below its tangent
                    x = unknowns.clipped(origin + basis @ y, float(np.sqrt(margin / unknowns.reach.max())))
        whole = not unknowns.constraints and not len(active) and not lifts and unknowns.turn(x) < 0.99 * MAX_TURN
        return Proposal(x, rows, active, pressed, unknowns.closing(x) < reach, lifts, whole)

    def _inequalities(self, rows: NDArray[Any]) -> tuple[Array, Array]:
        """C (k, n) and gap (k,): the gap of each pair of surfaces grows by C x, to first order."""
        normals, gaps = self.walls.parted(rows, self.poses)
        for a, s, b, t in surfaces_of(rows)[np.isinf(gaps)].tolist():
            if self.mated.beside(a, s, b, t):
                self.flush.add((a, s, b, t))
        return self.unknowns.gap_rows(rows, normals, self.poses), gaps

    def _remember(self, rows: NDArray[Any], hit: NDArray[Any], there: Mapping[int, pin.SE3]) -> None:
        """Keep where hollow surfaces stop this pass, foreseen (`rows`) and met (`hit`, bodies `there`), for those to
        come: a pair has one witness at a time, and a shaft pressed into a trough would go from facet to facet.
        """
        pairs = set(map(tuple, surfaces_of(hit).tolist()))
        again = [pair in pairs for pair in map(tuple, surfaces_of(rows).tolist())]
        at = [there.get(i, pose) for i, pose in enumerate(self.poses)]
        for block, poses in ((rows[np.array(again, bool)], self.poses), (hit, at)):
            hollow, normals = self.walls.hollow(block, poses)
            self.met.add(block[hollow], normals, poses)

    # -- along the way

    def _moved(self, x: Array) -> dict[int, pin.SE3]:
        """Poses after the motion x, constraints solved to the end."""
        return self._projected(self.unknowns.moved(x, self.poses))

    def _projected(self, target: dict[int, pin.SE3]) -> dict[int, pin.SE3]:
        if self.unknowns.constraints:
            at = dict(enumerate(self.poses)) | target
            target = target | dict(solve(self.unknowns.constraints, at, self.bodies, self.solving).poses)
        return self._followed(target)

    def _followed(self, target: Mapping[int, pin.SE3]) -> dict[int, pin.SE3]:
        return self.unknowns.groups.followed(target, self.poses)

    @contextmanager
    def _flush_ignored(self) -> Iterator[None]:
        """Leave out faces that run on flush from one part to the other across a mate (the rims of two flanges).

        They meet all along its edge, and cannot go deeper while it holds; bodies that move apart on two screws would
        jam there by rounding.
        """
        collision = self.collision
        flush = [(a, s, b, t) for a, s, b, t in sorted(self.flush) if (s, t) not in collision.ignored_surfaces(a, b)]
        for a, s, b, t in flush:
            collision.ignore_surfaces(a, (s,), b, (t,))
        try:
            yield
        finally:
            for a, s, b, t in flush:
                collision.enable_surfaces(a, (s,), b, (t,))

    def _sweep(self, target: dict[int, pin.SE3], rows: NDArray[Any]) -> tuple[dict[int, pin.SE3], NDArray[Any] | None]:
        """How far along the screws to `target` the bodies get, and what stopped them; `rows` were foreseen."""
        hit = None
        for _ in range(3):
            found, stop = self.collision.time_of_impact(target), self.barrier(self.poses, target)
            if stop is not None and stop[0] < found.t:
                t, hit = stop
            elif found.t < 1.0:
                t, hit = found.t, found.contacts
                self._remember(rows, hit, found.poses)
            else:
                return target, hit
            # stop before a contact that the linear rows lacked: the next pass has it among them and continues
            target = self._projected({b: pin.SE3.Interpolate(self.poses[b], target[b], SHORT * t) for b in self.bodies})
        return {b: self.poses[b] for b in target}, hit

    def _commit(self, target: dict[int, pin.SE3]) -> float:
        """Set the poses; return a bound (m) of the way of any point."""
        travel = 0.0
        for k, body in enumerate(self.bodies):
            center, reach = self.unknowns.center[k], float(self.unknowns.reach[k])
            step = self.poses[body].actInv(target[body])
            travel = max(travel, _length(step.act(center) - center) + reach * _length(pin.log3(step.rotation)))
        self._put(target)
        if travel > 0.0:
            self.way.append(target)
        return travel


def _lift(basis: Array, c: Array, gap: Array, margin: float) -> Array | None:
    """The least motion that brings pairs nearer than half the margin back to it; None where none is, or can be."""
    if (gap >= 0.5 * margin).all():
        return None
    lower = np.minimum(margin - gap, margin * (gap < margin))
    found = _least(np.eye(basis.shape[1]), np.zeros(basis.shape[1]), c @ basis, lower)
    return None if found is None else basis @ found[0]


def _least(hessian: Array, gradient: Array, c: Array, lower: Array) -> tuple[Array, NDArray[np.int64]] | None:
    """`quadratic_program`; None also where it is undecided: the way is then straight, and the sweep ends it."""
    try:
        return quadratic_program(hessian, gradient, c, lower)
    except UndecidedError:
        return None


def _length(vector: Array) -> float:
    return float(np.sqrt(vector @ vector))


def _latest(rows: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """The last row of each pair of surfaces, sorted."""
    if not rows:
        return np.empty(0, CONTACT_DTYPE)
    every = np.concatenate(rows) if len(rows) > 1 else rows[0]
    last = {pair: k for k, pair in enumerate(map(tuple, surfaces_of(every).tolist()))}
    return every[[last[key] for key in sorted(last)]]
