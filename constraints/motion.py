"""Constrained motion: a hand wants a pose, the part goes to the nearest one that constraints and solid bodies allow.

The god-object method of Ortega, Redon and Coquillart (2007), for any number of bodies: the motion x of least distance
to what the hand wants is a quadratic program, min ½|A x - e|², with the accepted constraints as equalities J x = -r
and one inequality n·(v_a - v_b) <= gap a pair of surfaces that come near. The constraints are then solved to the end
(Newton), and the way there is swept for contacts that the linear rows did not foresee, so that no speed carries a
part through another. What is left of the motion is tried again along the new surfaces: the part slides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CONTACT_DTYPE, SurfaceMesh, Tolerance
from constraints.candidate import Candidate
from constraints.errors import ConstraintsError
from constraints.geometry import Plane
from constraints.kinds import Constraint
from constraints.manager import ConstraintManager
from constraints.overlap import facing_area
from constraints.quadratic_program import UNMOVED, quadratic_program
from constraints.sleeve import sleeve
from constraints.solver import solve
from constraints.system import System, systems

Array = NDArray[np.float64]

MAX_PASSES = 12
"""Passes of plan, project and sweep a step; what is left of the motion after them is left to the next step."""
MAX_TURN = 0.5
"""rad a pass, within which a linear step is a fair guess for Newton."""
MARGIN = 2.0
"""Of `Tolerance.linear`: the gap that the linear rows keep, so that a slide stays out of the sweep's way."""
TOUCHING = 1e-3
"""Of `Tolerance.linear`: nearer than this two witnesses no longer tell a direction."""
FACING = 0.99
"""Cosine of the angle up to which two planes count as facing each other (8°)."""
SHORT = 0.9
"""Of the way to an unforeseen contact that a pass goes."""
FINE = 1e-2
"""Of `Tolerance.linear`: a step ends where going on would move no point farther; a hand moves on before it matters."""
FOLLOW = 1e-6
"""Weight of moving the other bodies as if they were of one piece with the held one, against 1 of obeying the hand."""


Pairing = tuple[int, tuple[int, ...], int, tuple[int, ...]]
"""Body a, surfaces of it, body b, surfaces of it: each of the first with each of the second."""


class Solids(Protocol):
    """What motion needs of `collision.CollisionManager`."""

    def mesh(self, i: int) -> SurfaceMesh: ...
    def pose(self, i: int) -> pin.SE3: ...
    def set_pose(self, i: int, pose: pin.SE3) -> None: ...
    def contacts(self, within: float = 0.0, objects: Iterable[int] | None = None) -> NDArray[Any]: ...
    def time_of_contact(self, moves: Mapping[int, pin.SE3]) -> Any: ...
    def ignore_surfaces(self, i: int, surfaces_i: Iterable[int], j: int, surfaces_j: Iterable[int]) -> None: ...
    def heed_surfaces(self, i: int, surfaces_i: Iterable[int], j: int, surfaces_j: Iterable[int]) -> None: ...
    def ignored_surfaces(self, i: int, j: int) -> frozenset[tuple[int, int]]: ...


@dataclass(frozen=True, eq=False)
class MotionResult:
    """Where the parts went."""

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


def adjacent_surfaces(mesh: SurfaceMesh, surfaces: Iterable[int]) -> tuple[int, ...]:
    """Surfaces that share a vertex position with one of `surfaces`, these left out; ascending."""
    table = mesh._cache.get("surface_adjacency")
    if table is None:
        table = mesh._cache["surface_adjacency"] = _adjacency(mesh)
    mine = set(surfaces)
    return tuple(sorted({int(t) for s in mine for t in table[s]} - mine))


def _adjacency(mesh: SurfaceMesh) -> list[NDArray[np.int64]]:
    corners = mesh.vertices[mesh.triangles].reshape(-1, 3)
    scale = float(np.abs(corners).max()) or 1.0
    _, point = np.unique(np.round(corners / (1e-9 * scale)), axis=0, return_inverse=True)
    pairs = np.unique(np.stack([point.reshape(-1), np.repeat(mesh.surface_of_triangle, 3)], axis=1), axis=0)
    groups = np.split(pairs[:, 1], np.flatnonzero(np.diff(pairs[:, 0])) + 1)
    table: list[set[int]] = [set() for _ in range(mesh.n_surfaces)]
    for group in groups:
        for s in group:
            table[s].update(group.tolist())
    return [np.array(sorted(t - {s}), dtype=np.int64) for s, t in enumerate(table)]


class Motion:
    """Moves held parts and what hangs on them.

    Keeps the poses of `collision` up to date, and tells it to leave out the surfaces that a constraint in force mates:
    the two features, and the faces next to each of them against the other one (which meet it only along the rim, where
    facets would overlap). Everything else of both parts stays solid.

    Parameters
    ----------
    collision: a `CollisionManager` whose object ids are the bodies' ids.
    constraints: whose constraints in force hold.
    tolerance: `linear` is the distance that free motion keeps between solids.
    """

    def __init__(self, collision: Solids, constraints: ConstraintManager, tolerance: Tolerance | None = None) -> None:
        self.collision = collision
        self.constraints = constraints
        self.tolerance = tolerance or constraints.tolerance
        self._mated: dict[int, tuple[Pairing, ...]] = {}
        self._beside: dict[int, Pairing] = {}
        self._shape: dict[int, tuple[Array, float]] = {}
        self._layout: tuple[Any, _Layout] | None = None
        self.linear: tuple[_Layout, bytes, tuple[Array, Array, Array]] | None = None
        # a projection finer than this does not pay where measured features contradict one another by rounding
        self.solving = replace(self.tolerance, solver=max(self.tolerance.solver, 0.1 * self.tolerance.satisfied))

    def sync(self) -> None:
        """Tell collision which surfaces are mated now. `step` does so itself; call it before other queries."""
        accepted = self.constraints.accepted
        if self._mated.keys() == accepted.keys():
            return
        for id in [i for i in self._mated if i not in accepted]:
            del self._beside[id]
            for a, sa, b, sb in self._mated.pop(id):
                self.collision.heed_surfaces(a, sa, b, sb)
        for id, entry in accepted.items():
            a, b = entry.candidate.bodies
            sa, sb = entry.candidate.surfaces
            beside_a = adjacent_surfaces(self.collision.mesh(a), sa)
            beside_b = adjacent_surfaces(self.collision.mesh(b), sb)
            self._beside[id] = (a, beside_a, b, beside_b)
            self._mated[id] = ((a, sa, b, sb + beside_b), (a, beside_a, b, sb), *self._sleeve(entry.candidate))
            for row in self._mated[id]:  # again for the old ones too: pairs may share surfaces with one just heeded
                self.collision.ignore_surfaces(*row)

    def _sleeve(self, candidate: Candidate) -> tuple[Pairing, ...]:
        """The faces that cannot meet while a shaft shares its bore's axis, or planes are face to face."""
        a, _, b, _, _ = candidate.key
        meshes = self.collision.mesh(a), self.collision.mesh(b)
        faces = sleeve(candidate, self.constraints.recogniser.features, meshes, self.tolerance.fit)
        return () if faces is None else ((a, faces[0], b, faces[1]),)

    def beside_a_mate(self, row: Any) -> bool:
        """Whether the surfaces of a contact row both lie next to the surfaces of one mate."""
        a, sa, b, sb = (int(row[name]) for name in ("object_a", "surface_a", "object_b", "surface_b"))
        return any((i, j) == (a, b) and sa in si and sb in sj for i, si, j, sj in self._beside.values())

    def step(self, wanted: Mapping[int, pin.SE3], poses: Sequence[pin.SE3], movable: Iterable[int]) -> MotionResult:
        """Move the bodies in `wanted` towards the poses given, and with them what their constraints take along.

        wanted: target pose of each held body. poses: of all bodies, now. movable: ids that may move (held ones
        included); everything else stands still.

        Raises ConstraintsError for a pose that is not finite.
        """
        for body, pose in wanted.items():
            if not (np.isfinite(pose.translation).all() and np.isfinite(pose.rotation).all()):
                raise ConstraintsError(f"the pose wanted of body {body} is not finite; give a finite one")
        self.sync()
        if not wanted:
            return MotionResult({}, False, np.empty(0, CONTACT_DTYPE), 0.0, {})
        moves = frozenset(movable) | frozenset(wanted)
        key = (self.constraints.constraints, moves, frozenset(wanted))
        if self._layout is None or self._layout[0] != key:
            self._layout = (key, _Layout.of(*key, self.shape))
        return _Plan(self, self._layout[1], dict(wanted), poses).run()

    def shape(self, body: int) -> tuple[Array, float]:
        """Centre (3,) of a body's box in its frame and the radius of the ball about it that holds the body, m."""
        known = self._shape.get(body)
        if known is None:
            v = self.collision.mesh(body).vertices
            center = 0.5 * (v.min(axis=0) + v.max(axis=0))
            known = self._shape[body] = (center, float(np.sqrt(((v - center) ** 2).sum(axis=1).max())))
        return known


@dataclass(frozen=True, eq=False)
class _Rows:
    """Where one system's Jacobian goes among the unknowns of a plan, for one of the two bodies of its equations."""

    rows: NDArray[np.intp]
    column: NDArray[np.intp]
    """(k,) block of six unknowns of each row"""
    shift: Array
    """(k, 3) from the plan's centre of the body to the system's"""
    radius: Array
    """(k,)"""


@dataclass(frozen=True, eq=False)
class _Layout:
    """What a plan knows as long as the same constraints hold and the same bodies are held."""

    bodies: tuple[int, ...]
    column: dict[int, int]
    systems: tuple[System, ...]
    scatter: tuple[tuple[_Rows, _Rows], ...]
    constraints: tuple[Constraint, ...]

    @classmethod
    def of(
        cls,
        constraints: tuple[Constraint, ...],
        moves: frozenset[int],
        held: frozenset[int],
        shape: Callable[[int], tuple[Array, float]],
    ) -> _Layout:
        """The held bodies, and those that a chain of constraints between movable ones joins to them."""
        own = tuple(s for s in systems(constraints, moves) if held & set(s.movable))
        bodies = tuple(sorted(held | {b for s in own for b in s.movable}))
        column = {b: 6 * k for k, b in enumerate(bodies)}
        members = tuple(constraints[k] for s in own for k in s.members)
        return cls(bodies, column, own, tuple(cls._rows(s, column, shape) for s in own), members)

    @staticmethod
    def _rows(
        system: System, column: dict[int, int], shape: Callable[[int], tuple[Array, float]]
    ) -> tuple[_Rows, _Rows]:
        equation = np.repeat(np.arange(len(system.code)), np.diff(np.append(system.start, system.rows)))
        sides = []
        for side in (0, 1):
            place = system.body[equation, side]
            rows = np.flatnonzero(system.slot[place] >= 0)
            bodies = [system.bodies[i] for i in place[rows]]
            shift = np.array([system.center[i] - shape(b)[0] for i, b in zip(place[rows], bodies, strict=True)])
            blocks = np.array([column[b] // 6 for b in bodies], dtype=np.intp)
            sides.append(_Rows(rows, blocks, shift.reshape(-1, 3), np.array([shape(b)[1] for b in bodies])))
        return sides[0], sides[1]


@dataclass(frozen=True, eq=False)
class _Aim:
    """What the hand wants of the motions x = origin + basis·y that the constraints allow: min ½ yᵀHy + gᵀy."""

    origin: Array
    basis: Array
    hessian: Array
    gradient: Array

    def free(self) -> Array:
        """(n,) the motion that it would be without contacts."""
        return self.origin + self.basis @ np.linalg.solve(self.hessian, -self.gradient)

    def along(self, pressed: Array) -> Array:
        """(n,) the motion that neither closes nor opens the gaps that `pressed` (k, n) are the rows of."""
        if not len(pressed):
            return self.free()
        _, s, vt = np.linalg.svd(pressed @ self.basis)
        slide = vt[int((s > UNMOVED).sum()) :].T
        hessian = slide.T @ self.hessian @ slide
        return self.origin + self.basis @ (slide @ np.linalg.solve(hessian, -slide.T @ self.gradient))


@dataclass(frozen=True, eq=False)
class _Proposal:
    """What one pass is about to do."""

    x: Array
    rows: NDArray[Any]
    """contacts it was planned with"""
    active: NDArray[np.int64]
    """which of them it presses on"""
    pressed: Array
    """(k, n) their rows of the program"""
    covered: bool
    """whether no other contact can be met on the way"""
    lifts: bool
    """whether it only makes room between surfaces that are too near each other"""
    whole: bool
    """whether it is all the way to the wanted pose"""


class _Plan:
    """One step. Unknowns: for each body the local twist about its centre, rotation measured in metres at its rim."""

    def __init__(self, motion: Motion, layout: _Layout, wanted: dict[int, pin.SE3], poses: Sequence[pin.SE3]) -> None:
        self.motion, self.layout, self.wanted, self.tolerance = motion, layout, wanted, motion.tolerance
        self.bodies, self.column = layout.bodies, layout.column
        self.n = 6 * len(self.bodies)
        self.poses: list[pin.SE3] = list(poses)
        self.acting: list[NDArray[Any]] = []
        self.flush: set[tuple[int, ...]] = set()
        self.residual, self.origin, self.basis = self._linear()

    def run(self) -> MotionResult:
        blocked = lifted = False
        best = self._error()
        aim = self._aim()
        for _ in range(MAX_PASSES):
            proposal = self._propose(aim, may_lift=not lifted)
            lifted = proposal.lifts
            target = dict(self.wanted) if proposal.whole else self._moved(proposal.x)
            if not proposal.covered or len(proposal.rows):
                target, hit = self._sweep(target)
                if hit is not None:
                    self.acting.append(hit)
                    blocked = True
            travel = self._commit(target)
            aim = self._aim()
            if lifted:
                best = self._error()
                continue
            if len(proposal.active):
                self.acting.append(proposal.rows[proposal.active])
                blocked = True
            error = self._error()
            # a motion to the nearest allowed pose brings the squared error down by its own square, at least
            if error <= self.tolerance.satisfied or travel == 0.0 or best**2 - error**2 < 1e-3 * travel**2:
                break
            if self._travel(aim.along(proposal.pressed)) <= FINE * self.tolerance.linear:
                break
            best = error
        return MotionResult(
            poses={b: self.poses[b] for b in self.bodies},
            blocked=blocked,
            contacts=_latest(self.acting),
            residual=float(np.abs(self.residual).max(initial=0.0)),
            remaining={b: self._remaining(b) for b in sorted(self.wanted)},
        )

    # -- what is wanted

    def _remaining(self, body: int) -> tuple[float, float]:
        e = self._hand_error(body)
        return float(np.linalg.norm(e[:3])), float(np.linalg.norm(e[3:]))

    def _hand_error(self, body: int) -> Array:
        """(6,) local twist about the centre that would bring a held body to its wanted pose."""
        center, _ = self.motion.shape(body)
        now, target = self.poses[body], self.wanted[body]
        shift = now.rotation.T @ (target.act(center) - now.act(center))
        return np.concatenate([shift, pin.log3(now.rotation.T @ target.rotation)])

    def _error(self) -> float:
        """m: what is left to do: distance to the wanted poses, and to the constraints."""
        total = 0.0
        for body in self.wanted:
            e = self._hand_error(body)
            e[3:] *= self.motion.shape(body)[1]
            total += float(e @ e)
        return float(np.sqrt(total + self.residual @ self.residual))

    # -- the quadratic program

    def _aim(self) -> _Aim:
        goal, weight = np.zeros(self.n), np.full(self.n, FOLLOW)
        for body in self.wanted:
            k = self.column[body]
            e = self._hand_error(body)
            if float(e[3:] @ e[3:]) < MAX_TURN**2:  # the screw that ends there, as `_moved` goes it
                e = pin.log6(pin.SE3(pin.exp3(e[3:]), e[:3])).vector
            e[3:] *= self.motion.shape(body)[1]
            goal[k : k + 6], weight[k : k + 6] = e, 1.0
        origin, basis = self.origin, self.basis
        # minimise Σ w (F x - goal)² over x = origin + basis y
        follow = self._following()
        d = follow @ basis
        return _Aim(origin, basis, d.T @ (weight[:, None] * d), -d.T @ (weight * (goal - follow @ origin)))

    def _propose(self, aim: _Aim, may_lift: bool) -> _Proposal:
        """The next motion towards the wanted poses; before it one off what is too near, if there `may` be one."""
        origin, basis = aim.origin, aim.basis
        x = self._clipped(aim.free())
        rows, reach = self._near(x)
        active, pressed = np.zeros(0, np.int64), np.zeros((0, self.n))
        lifts = False
        if len(rows) and basis.shape[1]:
            c, gap = self._inequalities(rows)
            margin = MARGIN * self.tolerance.linear
            lift = self._lift(basis, c, gap, margin) if may_lift and self._travel(x) > margin else None
            lower = np.minimum(margin - gap, 0.0)
            if lift is not None:
                x, lifts = lift, True
            elif (c @ x < lower - 1e-15).any():
                found = quadratic_program(aim.hessian, aim.gradient, c @ basis, lower - c @ origin)
                if found is not None:
                    y, active = found
                    pressed = c[active]
                    # an arm that turns by this sinks half the margin below its tangent
                    longest = max(self.motion.shape(b)[1] for b in self.bodies)
                    x = self._clipped(origin + basis @ y, float(np.sqrt(margin / longest)))
        whole = not self.layout.constraints and not len(active) and not lifts and self._turn(x) < 0.99 * MAX_TURN
        return _Proposal(x, rows, active, pressed, self._travel(x) < reach, lifts, whole)

    def _lift(self, basis: Array, c: Array, gap: Array, margin: float) -> Array | None:
        """The least motion that brings pairs nearer than half the margin back to it; None where none is, or can be."""
        if (gap >= 0.5 * margin).all():
            return None
        d = c @ basis
        found = quadratic_program(
            np.eye(basis.shape[1]), np.zeros(basis.shape[1]), d, np.minimum(margin - gap, margin * (gap < margin))
        )
        return None if found is None else basis @ found[0]

    def _following(self) -> Array:
        """(n, n) F: x of held bodies as it is, of the others relative to the first held one, as one rigid body."""
        out = np.eye(self.n)
        held = min(self.wanted)
        center, radius = self.motion.shape(held)
        pose, k = self.poses[held], self.column[held]
        for body, i in self.column.items():
            if body in self.wanted:
                continue
            other_center, other_radius = self.motion.shape(body)
            turn = self.poses[body].rotation.T @ pose.rotation
            arm = pose.actInv(self.poses[body].act(other_center)) - center
            out[i : i + 3, k : k + 3] = -turn
            out[i : i + 3, k + 3 : k + 6] = turn @ pin.skew(arm) / radius
            out[i + 3 : i + 6, k + 3 : k + 6] = -turn * (other_radius / radius)
        return out

    def _linear(self) -> tuple[Array, Array, Array]:
        """Residual (m,) of the constraints and, to first order, their solutions x = origin + basis·y: (n,), (n, k).

        A step begins where the one before ended: what was found there is kept.
        """
        bodies = sorted({b for system in self.layout.systems for b in system.bodies})
        key = b"".join(self.poses[b].homogeneous.tobytes() for b in bodies)
        known = self.motion.linear
        if known is None or known[0] is not self.layout or known[1] != key:
            residual, jacobian = self._linearised()
            known = self.motion.linear = (self.layout, key, (residual, *self._allowed(residual, jacobian)))
        return known[2]

    def _linearised(self) -> tuple[Array, Array]:
        """Residual (m,) and Jacobian (m, n) of the constraints, in metres (radians at the size of the features)."""
        residuals, jacobians = [np.zeros(0)], [np.zeros((0, self.n))]
        for system, sides in zip(self.layout.systems, self.layout.scatter, strict=True):
            r, *both = system.evaluate(*system.gather(self.poses))
            out = np.zeros((system.rows, len(self.bodies), 6))
            for j, to in zip(both, sides, strict=True):
                linear = j[to.rows, :3]
                out[to.rows, to.column, :3] += linear
                out[to.rows, to.column, 3:] += (j[to.rows, 3:] + _cross(to.shift, linear)) / to.radius[:, None]
            residuals.append(r * system.weight)
            jacobians.append(out.reshape(system.rows, -1) * system.weight[:, None])
        return np.concatenate(residuals), np.vstack(jacobians)

    def _allowed(self, residual: Array, jacobian: Array) -> tuple[Array, Array]:
        """The linearised constraints' solutions x = origin + basis·y: (n,) and (n, k)."""
        if not len(residual):
            return np.zeros(self.n), np.eye(self.n)
        u, s, vt = np.linalg.svd(jacobian)
        rank = int((s > 1e-7 * s[0]).sum())
        return -vt[:rank].T @ ((u[:, :rank].T @ residual) / s[:rank]), vt[rank:].T

    def _clipped(self, x: Array, most: float = MAX_TURN) -> Array:
        """A motion shortened until no body turns by more than `most` rad."""
        turn = self._turn(x)
        return x if turn <= most else x * (most / turn)

    def _turn(self, x: Array) -> float:
        """rad: the most that a body turns."""
        return max(float(np.linalg.norm(x[k + 3 : k + 6])) / self.motion.shape(b)[1] for b, k in self.column.items())

    def _travel(self, x: Array) -> float:
        """m: the farthest that any point of any body goes."""
        return max(float(np.linalg.norm(x[k : k + 3]) + np.linalg.norm(x[k + 3 : k + 6])) for k in self.column.values())

    def _near(self, x: Array) -> tuple[NDArray[Any], float]:
        """Contact rows of the moving bodies that this motion might close, and how far it may go without meeting others.

        A long motion is not looked at to its end: beyond a few reaches the sweep finds what it meets. A pair of facing
        planes gives a row a corner of the area they share: one witness alone would let the part tilt about it.
        """
        reach = min(self._travel(x), 5.0 * self.tolerance.reach) + 2.0 * MARGIN * self.tolerance.linear
        rows = self.motion.collision.contacts(reach, self.bodies)
        return np.concatenate([rows[:0], *(self._spread(rows[i : i + 1]) for i in range(len(rows)))]), reach

    def _spread(self, row: NDArray[Any]) -> NDArray[Any]:
        """A contact of two facing planes as one row a corner of the area they share; others as they are."""
        recogniser = self.motion.constraints.recogniser
        a, sa, b, sb = (int(row[name][0]) for name in ("object_a", "surface_a", "object_b", "surface_b"))
        fa, fb = recogniser.feature_of(a, sa), recogniser.feature_of(b, sb)
        if fa is None or fb is None:
            return row
        first, second = recogniser.view(a, fa, self.poses[a]), recogniser.view(b, fb, self.poses[b])
        p, q = first.geometry, second.geometry
        if not (isinstance(p, Plane) and isinstance(q, Plane)) or p.normal @ q.normal > -FACING:
            return row
        region = facing_area(p.origin, p.normal, first.triangles, second.triangles, q.origin, q.normal)
        apart = row["distance"][0] > TOUCHING * self.tolerance.linear
        if not len(region.gaps) or (apart and region.gap_min < 0.0):  # back to back through a thin plate
            return row
        out = np.repeat(row, len(region.gaps))
        out["distance"] = np.maximum(region.gaps, 0.0)
        out["point_a"] = region.corners
        out["point_b"] = region.corners + region.gaps[:, None] * p.normal
        return out

    def _inequalities(self, rows: NDArray[Any]) -> tuple[Array, Array]:
        """C (k, n) and gap (k,): the gap of each pair of surfaces grows by C x, to first order."""
        c, gaps = np.zeros((len(rows), self.n)), rows["distance"].copy()
        normals = np.zeros((len(rows), 3))
        apart = gaps > TOUCHING * self.tolerance.linear
        normals[apart] = (rows["point_b"] - rows["point_a"])[apart] / gaps[apart, None]
        for i in np.flatnonzero(~apart).tolist():
            normal = self._parting(rows[i])
            if normal is not None:
                normals[i] = normal
                continue
            gaps[i] = np.inf
            if self.motion.beside_a_mate(rows[i]):
                self.flush.add(tuple(int(rows[i][n]) for n in ("object_a", "surface_a", "object_b", "surface_b")))
        for body, k in self.column.items():
            center, radius = self.motion.shape(body)
            pose = self.poses[body]
            for side, sign in (("a", -1.0), ("b", 1.0)):
                own = np.flatnonzero(rows["object_" + side] == body)
                if len(own):
                    local = sign * (normals[own] @ pose.rotation)
                    arm = (rows["point_" + side][own] - pose.translation) @ pose.rotation - center
                    c[own, k : k + 3] = local
                    c[own, k + 3 : k + 6] = _cross(arm, local) / radius
        return c, gaps

    def _parting(self, row: Any) -> Array | None:
        """(3,) unit, from a to b, where two surfaces touch.

        It is the outward normal of the triangle that parts the two best, of those that have the other's material in
        front of them; None where neither has (edges side by side), which is left to the sweep.
        """
        a, b = int(row["object_a"]), int(row["object_b"])
        ta, na = self._triangle(a, int(row["triangle_a"]))
        tb, nb = self._triangle(b, int(row["triangle_b"]))
        if na @ nb > self.tolerance.angular:
            return None
        beneath_a = -float(((tb - ta[0]) @ na).min())
        beneath_b = -float(((ta - tb[0]) @ nb).min())
        return na if beneath_a <= beneath_b else -nb

    def _triangle(self, body: int, triangle: int) -> tuple[Array, Array]:
        mesh, pose = self.motion.collision.mesh(body), self.poses[body]
        t = mesh.vertices[mesh.triangles[triangle]] @ pose.rotation.T + pose.translation
        n = np.cross(t[1] - t[0], t[2] - t[0])
        length = float(np.linalg.norm(n))
        return t, n / length if length > 0 else np.array([0.0, 0.0, 1.0])

    # -- along the way

    def _moved(self, x: Array) -> dict[int, pin.SE3]:
        """Poses after the motion x, constraints solved to the end."""
        target = {}
        for body, k in self.column.items():
            center, radius = self.motion.shape(body)
            pose = self.poses[body]
            turn = x[k + 3 : k + 6] / radius
            twist = pin.Motion(x[k : k + 3] - pin.skew(turn) @ center, turn)  # one screw for bodies that move as one
            moved = pose * pin.exp6(twist)
            target[body] = pin.SE3(pin.Quaternion(moved.rotation).normalized().matrix(), moved.translation)
        return self._projected(target)

    def _projected(self, target: dict[int, pin.SE3]) -> dict[int, pin.SE3]:
        if self.layout.constraints:
            at = dict(enumerate(self.poses)) | target
            target = target | dict(solve(self.layout.constraints, at, self.bodies, self.motion.solving).poses)
        return target

    def _sweep(self, target: dict[int, pin.SE3]) -> tuple[dict[int, pin.SE3], NDArray[Any] | None]:
        """How far along the screws to `target` the bodies get, and the rows of what stopped them.

        Faces that run on flush from one part to the other across a mate (the rims of two flanges) meet all along its
        edge, and cannot go deeper while it holds; bodies that move apart on two screws would jam there by rounding.
        """
        collision = self.motion.collision
        flush = [(a, s, b, t) for a, s, b, t in sorted(self.flush) if (s, t) not in collision.ignored_surfaces(a, b)]
        for a, s, b, t in flush:
            collision.ignore_surfaces(a, (s,), b, (t,))
        try:
            return self._advance(target)
        finally:
            for a, s, b, t in flush:
                collision.heed_surfaces(a, (s,), b, (t,))

    def _advance(self, target: dict[int, pin.SE3]) -> tuple[dict[int, pin.SE3], NDArray[Any] | None]:
        hit = None
        for _ in range(3):
            found = self.motion.collision.time_of_contact(target)
            if found.t >= 1.0:
                return target, hit
            hit = found.contacts
            # stop short of what the linear rows did not foresee: with it among them the next pass goes on from afar
            target = self._projected(
                {b: pin.SE3.Interpolate(self.poses[b], pose, SHORT * found.t) for b, pose in target.items()}
            )
        return {b: self.poses[b] for b in target}, hit

    def _commit(self, target: dict[int, pin.SE3]) -> float:
        """Go there; how far the farthest point of a body went (m, at most)."""
        travel = 0.0
        for body, pose in target.items():
            center, radius = self.motion.shape(body)
            step = self.poses[body].actInv(pose)
            shift = float(np.linalg.norm(step.act(center) - center))
            travel = max(travel, shift + radius * float(np.linalg.norm(pin.log3(step.rotation))))
            self.poses[body] = pose
            self.motion.collision.set_pose(body, pose)
        self.residual, self.origin, self.basis = self._linear()
        return travel


def _latest(rows: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """The last row of each pair of surfaces, sorted."""
    names = ("object_a", "surface_a", "object_b", "surface_b")
    last = {tuple(int(row[n]) for n in names): row for block in rows for row in block}
    return np.array([last[key] for key in sorted(last)], CONTACT_DTYPE)


def _cross(u: Array, v: Array) -> Array:
    """Row-wise cross product of (k, 3) arrays; numpy's own costs ten times as much on small ones."""
    out = np.empty_like(u)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[:, i] = u[:, j] * v[:, k] - u[:, k] * v[:, j]
    return out
