"""`Readings`: quantities derived from a state and cached: views, freedom, clearance, velocity, contacts."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision.contact import surfaces_of
from constraints.freedom.mobility import Freedom, mobility
from constraints.kinds.stated import taken_along
from constraints.manager import InForce
from constraints.recognition.candidate import Candidate
from constraints.solve.groups import ALONE, Groups
from vpframe.events import ConstraintView, ContactPoint
from vpframe.scene.boxes import corners, half_size
from vpframe.session.engine import Engine, HeldOverlap, rows_of
from vpframe.session.views import Views, ViewsOfStep

NOTHING = np.zeros((0, 3))
FELT = 0.05
"""1: rate of a constraint's residual, over the speed of a motion, from which the constraint holds the part"""


class Readings:
    """Derived quantities of a state; reading changes nothing."""

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        self._corners: dict[int, NDArray[np.float64]] = {}
        self._placed: tuple[NDArray[np.float64], NDArray[np.float64], list[pin.SE3 | None]] = NOTHING, NOTHING, []
        self._forget()
        engine.on_drop(self._forget)

    def _forget(self) -> None:
        self._freedom: dict[tuple[int, tuple[int, ...], tuple[int, ...]], tuple[int, str]] = {}
        self._freedoms: tuple[Any, tuple[dict[str, int], dict[str, str]]] = None, ({}, {})
        self._active = Views()
        self._offered: dict[int, tuple[Candidate, ConstraintView]] = {}

    def near_pairs(self) -> NDArray[np.int32]:
        """(k, 4) object, surface, object, surface in contact, for parts that were ever held, without mated surfaces."""
        rows = self.engine.rows
        return surfaces_of(rows)[rows["distance"] <= 2.0 * self.engine.tolerance.linear]  # motions stop at `linear`

    def views(self) -> ViewsOfStep:
        """Views of all constraints: active by age, then candidates by score, then refused ones."""
        self.engine.start()
        mates = self.engine.mates
        there = mates.snapshot  # later changes are made to copies
        given = mates.in_force, there.candidates, there.refused
        return ViewsOfStep(partial(self._views, *given, self.engine.poses), given)

    def _views(
        self, in_force: InForce, offered: Mapping[int, Candidate], refused: Mapping[int, Candidate],
        poses: tuple[pin.SE3, ...],
    ) -> tuple[ConstraintView, ...]:  # fmt: skip
        active = self._active.active(in_force, self.engine.names, poses)
        offers = sorted(offered.items(), key=lambda item: (-item[1].score, item[0]))
        known, now = self._offered, {}
        for state, candidates in (("candidate", offers), ("refused", refused.items())):
            for id, candidate in candidates:
                old = known.get(id)
                same = old is not None and old[0] is candidate and old[1].state == state
                now[id] = old if same and old else (candidate, self.view(id, candidate, state))
        self._offered = now
        return (*active, *(view for _, view in now.values()))

    def view(self, id: int, candidate: Candidate, state: str) -> ConstraintView:
        """Return the view of a candidate or constraint."""
        names, poses = self.engine.names, self.engine.poses
        a, b = candidate.bodies
        match, residual = candidate.match, candidate.residual
        origin, direction = match.origin, match.direction
        if state == "active":
            constraint = candidate.constraint
            symbol = constraint.drawing(poses[a])
            origin, direction = poses[a].act(match.local), symbol.direction
            rows = constraint.residual(poses[a], poses[b])[~constraint.angular]
            residual = float(np.abs(rows).max(initial=0.0))
        return ConstraintView(
            id=id,
            kind=candidate.kind,
            parts=(names[a], names[b]),
            surfaces=candidate.surfaces,
            residual=residual,
            state=state,
            origin=_fixed(origin),
            direction=_fixed(direction),
            size=match.size,
            why=candidate.why,
            press=match.press,
        )

    def freedom(self, i: int, carried: Sequence[int] = (), to: Sequence[int] | None = None) -> tuple[int, str]:
        """Return a part's degrees of freedom and its lower pair; parts joined by stated constraints move along.

        carried: objects that move rigidly with it. to: consider only constraints with these; None: with all others.
        """
        engine = self.engine
        if any(engine.scene.parts[j].fixed for j in (i, *carried)):
            return 0, "rigid"
        group, rigid, on_it = self._constraining(i, carried, to)
        key = (i, (*carried, -1 if to is None else -2), tuple(sorted(on_it)))
        if key not in self._freedom:
            found = self._mobility(i, group, rigid, on_it)
            self._freedom[key] = (found.freedom, found.joint)
        return self._freedom[key]

    def twists(self, i: int, carried: Sequence[int] = ()) -> NDArray[np.float64]:
        """(6, k) orthonormal twists left to a part with the objects it carries, in the part's frame, linear first."""
        if any(self.engine.scene.parts[j].fixed for j in (i, *carried)):
            return np.zeros((6, 0))
        return self._mobility(i, *self._constraining(i, carried, None)).twists

    def holding(self, i: int, carried: Sequence[int], twist: NDArray[np.float64]) -> tuple[int, ...]:
        """Ids of the active constraints that a motion of a part, with the objects it carries, would break.

        twist: (6,) of the part in its frame, linear first.
        """
        group, _, on_it = self._constraining(i, carried, None)
        poses, motion = self.engine.poses, pin.Motion(twist)
        fast = FELT * float(
            np.linalg.norm(twist[:3]) + half_size(self.engine.scene.parts[i].mesh) * np.linalg.norm(twist[3:])
        )
        found = []
        for id, candidate in on_it.items():
            bodies = candidate.bodies
            jacobians = candidate.constraint.jacobian(*(poses[k] for k in bodies))
            moved = [(k, j) for k, j in zip(bodies, jacobians, strict=True) if k in group]
            rates = sum(j @ poses[k].actInv(poses[i]).act(motion).vector for k, j in moved)
            if np.abs(rates).max(initial=0.0) > fast:
                found.append(id)
        return tuple(found)

    def _constraining(
        self, i: int, carried: Sequence[int], to: Sequence[int] | None
    ) -> tuple[frozenset[int], Groups, dict[int, Candidate]]:
        """Return the objects that move with a part, the rigid group it carries, and the constraints on them by id."""
        engine = self.engine
        engine.start()
        one = {i, *carried}
        group = along(engine, one) if to is None else frozenset(one)
        rigid = Groups.of({i: carried}, engine.poses, ALONE) if carried else ALONE
        accepted = engine.mates.accepted
        on_it = {id: accepted[id].candidate for id in engine.mates.in_force.about(group, rigid)}
        if to is not None:
            on_it = {id: c for id, c in on_it.items() if not set(to).isdisjoint(c.bodies)}
        return group, rigid, on_it

    def _mobility(self, i: int, group: frozenset[int], rigid: Groups, on_it: dict[int, Candidate]) -> Freedom:
        others = [j for j in range(len(self.engine.names)) if j not in group]
        constraints = rigid.constraints(c.constraint for c in on_it.values())
        return mobility(constraints, self.engine.poses, others, self.engine.tolerance).parts[i]

    def freedoms(self) -> tuple[dict[str, int], dict[str, str]]:
        """Degrees of freedom and lower pairs of all parts that have moved or been held, by name."""
        engine = self.engine
        key = tuple(engine.mates.accepted), len(engine.moved)
        if self._freedoms[0] != key:
            found = {engine.names[i]: self.freedom(i) for i in sorted(engine.moved)}
            freedoms = {name: number for name, (number, _) in found.items()}
            self._freedoms = key, (freedoms, {name: joint for name, (_, joint) in found.items()})
        return self._freedoms[1]

    def pitch_of(self, i: int) -> float | None:
        """Pitch, m a turn, negative for a left-hand thread: from the script, else from a recognised thread."""
        engine = self.engine
        if i in engine.threads:
            return engine.threads[i]
        engine.start()
        pitches = [e.candidate.pitch for e in engine.mates.accepted.values() if i in e.candidate.bodies]
        pitches += [held.meaning.pitch for held in self.held_by((i,)) if held.meaning.part == i]
        return next((p for p in pitches if p is not None), None)

    def held_by(self, group: Collection[int]) -> tuple[HeldOverlap, ...]:
        """Overlaps that are meant between parts of a group and others, which hold them now; threads first."""
        self.engine.start()
        return self.engine.held_by(group)

    def clearance(self, i: int, others: Sequence[int]) -> float:
        """Least distance (m) from an object to others; inf if there are none."""
        self.engine.start()
        low, high = self._boxes()
        ids = np.array(others, np.int64)
        apart = np.maximum(0.0, np.maximum(low[ids] - high[i], low[i] - high[ids]))
        bounds = np.sqrt((apart * apart).sum(axis=1))
        best = np.inf
        for k in np.argsort(bounds, kind="stable").tolist():
            if bounds[k] >= best:
                break
            best = min(best, float(self.engine.collision.clearance(i, int(ids[k]))["distance"][0]))
        return best

    def misfits(self) -> NDArray[np.int32]:
        """(k, 4) object, surface, object, surface of shafts in bores that clash, whether or not their facets intersect;
        without mated and authorised pairs."""
        self.engine.start()
        return rows_of(self.engine.misfits())

    def velocity(self, i: int, dt: float) -> pin.Motion:
        """Twist of a part's frame, world axes at its origin, m/s and rad/s: from dynamics, else from the last step.

        dt: length of the last step, s.
        """
        engine = self.engine
        engine.start()
        here = engine.poses[i]
        if engine.dynamics is not None and i in engine.dynamics.bodies:
            v, center = engine.dynamics.velocity(i)
            return pin.Motion(v[:3] + np.cross(v[3:], here.translation - here.act(center)), v[3:])
        before = engine.last.get(i, here)
        turn = pin.log3(here.rotation @ before.rotation.T)
        return pin.Motion((here.translation - before.translation) / dt, turn / dt)

    def contacts(self, i: int) -> tuple[ContactPoint, ...]:
        """Contact points of a part with others, without mated surfaces; with forces if the part is dynamic."""
        engine = self.engine
        engine.start()
        found = []
        if engine.dynamics is not None and i in engine.dynamics.bodies:
            for touch, force in engine.dynamics.touches(i):
                found.append(ContactPoint(engine.names[touch.other], touch.point, touch.normal, force))
        pressed = {contact.other for contact in found}
        rows = engine.rows[engine.rows["distance"] <= 2.0 * engine.tolerance.linear]
        rows = rows[(rows["object_a"] == i) | (rows["object_b"] == i)]
        normals, gaps = engine.motion.walls.parted(rows, engine.poses)
        for row, normal, gap in zip(rows, normals, gaps, strict=True):
            first = row["object_a"] == i
            other = engine.names[row["object_b"] if first else row["object_a"]]
            if other not in pressed:
                point = np.array(row["point_a"] if first else row["point_b"])
                away = normal * (-1.0 if first else 1.0) if np.isfinite(gap) else np.zeros(3)
                found.append(ContactPoint(other, point, away, None))
        return tuple(found)

    def _boxes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper corners (n, 3), world, m, of boxes around the objects' rotated local boxes: never too small.

        A box is kept until its object moves.
        """
        poses = self.engine.poses
        low, high, known = self._placed
        if not known:
            low, high, known = np.empty((len(poses), 3)), np.empty((len(poses), 3)), [None] * len(poses)
            self._placed = low, high, known
        for i, pose in enumerate(poses):
            if known[i] is not pose:
                if i not in self._corners:
                    self._corners[i] = corners(self.engine.collision.mesh(i))
                placed = self._corners[i] @ pose.rotation.T + pose.translation
                low[i], high[i], known[i] = placed.min(0), placed.max(0), pose
        return low, high

    def least_clearance(self) -> float | None:
        """Least distance from held objects to all objects not constrained to them, m; None if there are none."""
        engine = self.engine
        mates: dict[int, set[int]] = {}
        for entry in engine.mates.accepted.values():
            a, b = entry.candidate.bodies
            mates.setdefault(a, set()).add(b)
            mates.setdefault(b, set()).add(a)
        n = range(len(engine.names))
        found = [
            self.clearance(i, [j for j in n if j not in engine.held and j not in mates.get(i, ())])
            for i in sorted(engine.held)
        ]
        least = min(found, default=np.inf)
        return least if np.isfinite(least) else None


def _fixed(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a read-only copy, safe to pass to observers."""
    out = np.array(vector)
    out.setflags(write=False)
    return out


def along(engine: Engine, bodies: set[int] | frozenset[int] | dict[int, pin.SE3]) -> frozenset[int]:
    """Return the given bodies and the bodies that stated constraints move along with them."""
    stated = engine.mates.in_force.stated
    if not stated:
        return frozenset(bodies)
    fixed = [i for i, part in enumerate(engine.scene.parts) if part.fixed]
    return taken_along(stated, bodies, fixed)
