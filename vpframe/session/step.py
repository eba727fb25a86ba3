"""`Engine`: what one step comes to. It joins collision, constraints and physics, and knows no scripts or viewers."""

from __future__ import annotations

import time as clock
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CONTACT_DTYPE, CollisionManager, Tolerance
from constraints import ConstraintManager
from constraints.freedom.mobility import mobility
from constraints.kinds import Constraint, Fixed
from constraints.kinds.stated import taken_along
from constraints.manager import Accepted, Change, UnknownConstraintError
from constraints.motion.motion import Motion
from constraints.recognition.candidate import Candidate, Key
from physics import Behaviour, Body, SpringHand
from vpframe.analysis.static import threaded_features
from vpframe.errors import TaskError
from vpframe.hands.paths import between
from vpframe.hands.reach import half_size
from vpframe.scene.scene import Scene
from vpframe.session.codec import conforms
from vpframe.session.dynamics import Dynamics, spring
from vpframe.session.events import ConstraintView
from vpframe.session.rules import Rule

Happening = tuple[str, tuple[str, ...], tuple[tuple[int, ...], ...], str, Mapping[str, Any]]
"""an event without its time: kind, parts, surfaces, text, data"""
NO_PAIRS = np.zeros((0, 4), np.int32)
MOST_PARTS = 16
"""into how many parts a hand's way in one step is cut at most"""
_MATING = ("recognised", "withdrawn", "accepted", "refused", "satisfied", "removed")


@dataclass(frozen=True, eq=False)
class Wish:
    """What a hand asks for in one step."""

    part: str
    pose: pin.SE3
    carried: tuple[str, ...] = ()
    snap: float = 0.0
    """m: reach of the assist's snapping"""
    snap_angle: float = 0.0
    """rad"""
    spring: SpringHand | None = None
    """pulls with limited force instead of carrying; its target is `pose`"""

    def key(self) -> bytes:
        """All of it as bytes: equal wishes have equal keys."""
        words = repr((self.part, self.carried, self.snap, self.snap_angle, self.spring is not None)).encode()
        return words + np.ascontiguousarray(self.pose.homogeneous).tobytes()


@dataclass(frozen=True)
class Request:
    """What a script decides about a candidate or constraint: "accept", "refuse", "remove" or "impose"."""

    verb: str
    id: int
    limits: tuple[tuple[str, float], ...] = ()
    """of what is accepted: "break_distance" (m), "break_force" (N)"""
    stated: Candidate | None = None
    """of the verb "impose": what the script states"""


@dataclass(frozen=True, eq=False)
class Result:
    """What a step came to, by value; poses of parts that moved only."""

    poses: Mapping[str, pin.SE3]
    colliding: NDArray[np.int32]
    touching: NDArray[np.int32]
    """(k, 4) object, surface, object, surface that touch, of parts that were ever held; mated surfaces left out"""
    constraints: tuple[ConstraintView, ...]
    freedom: Mapping[str, int]
    joint: Mapping[str, str]
    clearance: float | None
    blocked: Mapping[str, str]
    """held parts that solid bodies kept from following, and what stood in the way"""
    happenings: tuple[Happening, ...]
    mates: Mapping[str, Any] | None = None
    """state of the constraint manager, if it changed"""
    timings: Mapping[str, float] = field(default_factory=dict)


class Engine:
    """The managers of one session and the order in which a step asks them.

    Managers come into being with the first step; until then a session costs nothing but its scene. A step asks only
    about parts that a hand holds, or that moved; what is known of the others is kept.
    """

    def __init__(self, scene: Scene, tolerance: Tolerance, dt: float, rule: Rule, measure_clearance: bool) -> None:
        self.scene = scene
        self.tolerance = tolerance
        self.dt = dt
        self.rule = rule
        self.measure_clearance = measure_clearance
        self.threads: dict[int, float] = {}
        """pitch (m a turn, negative for left-hand threads) that the script told of parts, by object"""
        self._authorised: list[tuple[int, int]] = []
        self._started = False
        self._active: set[int] = set()
        """parts that a hand holds or carries"""
        self._moved: set[int] = set()
        """parts that ever moved or were held"""
        self._blocked: dict[str, str] = {}
        self._rows: NDArray[Any] = np.zeros(0, CONTACT_DTYPE)
        self._colliding = NO_PAIRS
        self._freedom: dict[tuple[int, tuple[int, ...]], tuple[int, str]] = {}
        self._remated: set[int] = set()
        """parts whose mated surfaces changed since colliding surfaces were last asked for"""
        self._shown: dict[int, ConstraintView] = {}
        self._arm: dict[int, float] = {}
        self._corners: dict[int, NDArray[np.float64]] = {}
        self._told_at_start: list[Happening] = []
        self._decided = False
        self._mated: tuple[Tolerance, NDArray[Any], tuple[pin.SE3, ...]] | None = None
        self._offered: dict[int, tuple[Candidate, ConstraintView]] = {}
        self._last_wanted: dict[int, pin.SE3] = {}
        self.dynamics: Dynamics | None = None
        """None until a part is given behaviours"""
        self.joined: set[tuple[str, str]] = set()
        """pairs of parts that an accepted constraint joined at any time"""

    # ---- the managers

    def start(self) -> None:
        """Build the managers; the first step does it by itself."""
        if self._started:
            return
        self.names = self.scene.names
        self.poses = [pin.SE3(part.pose) for part in self.scene.parts]
        self.collision = CollisionManager(self.tolerance)
        for part in self.scene.parts:
            self.collision.add(part.mesh, part.pose, movable=not part.fixed)
        for a, b in self._authorised:
            self.collision.ignore(a, b)
        features, threads = threaded_features(self.scene)
        fixed = [i for i, part in enumerate(self.scene.parts) if part.fixed]
        self.mates = ConstraintManager(features, self.tolerance, threads=threads, rules=[self._judge], fixed=fixed)
        self.motion = Motion(self.collision, self.mates, self.tolerance)
        self._recognise_as_it_stands()
        self._colliding = self.collision.colliding_surfaces()
        self._started = True  # not before: a start that was interrupted is made again

    def _recognise_as_it_stands(self) -> None:
        """What the parts are to each other before anything moves: exact fits only, nothing is pulled into place."""
        self.mates.tolerance = replace(self.tolerance, reach=0.0, reach_angular=0.0)
        rows = self.collision.contacts(self.mates.within)
        changes = self.mates.update(self.poses, rows, {})
        self._told_at_start = [self._told(change) for change in changes]
        self.joined = {self._pair(change.candidate) for change in changes if change.kind == "accepted"}
        self.mates.tolerance = self.tolerance
        self.motion.sync()
        open_pairs = {c.bodies for d in (self.mates.candidates, self.mates.refused) for c in d.values()}
        pairs = zip(rows["object_a"].tolist(), rows["object_b"].tolist(), strict=True)
        self._rows = rows[np.array([pair in open_pairs for pair in pairs], dtype=bool)]

    def _judge(self, candidate: Candidate) -> bool | None:
        """The rule's word on mates that a hand makes or that the assembly has; what fell into place is offered."""
        if self._started and self._active.isdisjoint(candidate.bodies):
            return None
        verdict = self.rule(self.view(-1, candidate, "candidate"))
        return None if verdict is None else verdict == "accept"

    @property
    def authorised(self) -> list[tuple[str, str]]:
        """Pairs of parts that may overlap, by name."""
        return [(self.scene.names[a], self.scene.names[b]) for a, b in self._authorised]

    def authorise(self, a: int, b: int) -> None:
        """Leave a pair of objects out of collision for good."""
        self._authorised.append((a, b))
        if self._started:
            self.collision.ignore(a, b)

    # ---- a step

    def advance(self, wishes: Sequence[Wish], requests: Sequence[Request]) -> Result:
        """One step: motion, contacts, constraints, forces, freedom."""
        self.start()
        clocks = dict.fromkeys(("motion", "collision", "constraints", "physics"), 0.0)
        before = list(self.poses)
        for wish in wishes:
            if wish.spring is not None and (
                self.dynamics is None or self.scene.index(wish.part) not in self.dynamics.bodies
            ):
                raise TaskError(f"{wish.part} has no behaviours, so a spring cannot pull it; session.behave(...) first")
        firm = [wish for wish in wishes if wish.spring is None]
        wanted = self._wanted(firm)
        self._reach_for(wishes)
        self._active = set(wanted) | {self.scene.index(wish.part) for wish in wishes}
        happenings, self._told_at_start = self._told_at_start, []
        for candidate in self._decide(requests):
            if self._active.isdisjoint(candidate.bodies):
                self._settle(candidate, clocks)
        for part_way in self._part_ways(wanted):
            happenings += self._follow(part_way, firm, clocks)
        self._last_wanted = wanted
        if self.dynamics is not None:
            happenings += self._fall(wishes, clocks)
        happenings += self._clash(before, clocks)
        moved = [i for i in range(len(self.poses)) if self.poses[i] is not before[i]]
        self._moved |= set(moved) | self._active
        mated = any(kind in _MATING for kind, *_ in happenings)
        return Result(
            poses={self.names[i]: self.poses[i] for i in moved},
            colliding=self._colliding,
            touching=self._near_pairs(),
            constraints=self._views(before),
            freedom={self.names[i]: self.freedom(i)[0] for i in sorted(self._moved)},
            joint={self.names[i]: self.freedom(i)[1] for i in sorted(self._moved)},
            clearance=self._least_clearance() if self.measure_clearance else None,
            blocked=dict(self._blocked),
            happenings=tuple(happenings),
            mates=self.mates.state() if mated else None,
            timings=clocks,
        )

    def _reach_for(self, wishes: Sequence[Wish]) -> None:
        """Candidates are offered as far off as the assist of a hand reaches."""
        reach = max((w.snap for w in wishes), default=0.0)
        angle = max((w.snap_angle for w in wishes if w.snap > 0.0), default=0.0)
        known = self.tolerance
        self.mates.tolerance = (
            known
            if reach <= known.reach
            else replace(known, reach=reach, reach_angular=max(angle, known.reach_angular))
        )

    def _part_ways(self, wanted: dict[int, pin.SE3]) -> list[dict[int, pin.SE3]]:
        """The hands' way in this step, cut so finely that no mate is passed unseen where there is anything near."""
        last = {i: self._last_wanted.get(i, self.poses[i]) for i in wanted}
        far = max((self._travel(i, last[i], pose) for i, pose in wanted.items()), default=0.0)
        n = min(int(np.ceil(far / self.tolerance.reach)), MOST_PARTS)
        if n <= 1 or not len(self.collision.object_pairs(sorted(wanted), within=far + self.mates.within)):
            return [wanted]
        return [{i: between(last[i], pose, k / n) for i, pose in wanted.items()} for k in range(1, n + 1)]

    def _travel(self, i: int, a: pin.SE3, b: pin.SE3) -> float:
        way = a.actInv(b)
        if i not in self._arm:
            self._arm[i] = 2.0 * half_size(self.scene.parts[i].mesh)
        return float(np.linalg.norm(way.translation) + self._arm[i] * np.linalg.norm(pin.log3(way.rotation)))

    def _follow(self, wanted: dict[int, pin.SE3], wishes: Sequence[Wish], clocks: dict[str, float]) -> list[Happening]:
        """Hands move their parts; contacts, candidates and constraints follow."""
        before = list(self.poses)
        happenings = list(self._follow_hands(wanted, wishes, clocks))
        self._touch(before, clocks)
        changes = self._mate(wanted, clocks)
        happenings += changes
        if any(kind in ("accepted", "removed") for kind, *_ in changes):  # a part snaps on, or off, at once
            here = list(self.poses)
            self._follow_hands(wanted, wishes, clocks)
            self._touch(here, clocks)
            happenings += self._mate(wanted, clocks)
        return happenings

    def _fall(self, wishes: Sequence[Wish], clocks: dict[str, float]) -> list[Happening]:
        """What is free moves under its forces."""
        assert self.dynamics is not None
        began = clock.perf_counter()
        springs = {self.scene.index(w.part): spring(w.pose, w.spring) for w in wishes if w.spring is not None}
        self.dynamics.join(self._constraints_in_force())
        self.dynamics.hold({i: self.poses[i] for i in self._active if i not in springs}, springs)
        moved, rested = self.dynamics.step(self.dt)
        for i, pose in moved.items():
            if pose != self.poses[i]:
                self.poses[i] = pose
                self._moved.add(i)
        gone = [i for i in moved if i not in self._active]
        if gone:  # what was near to them is so no longer
            keep = ~np.isin(self._rows["object_a"], gone) & ~np.isin(self._rows["object_b"], gone)
            self._rows = self._rows[keep]
        if rested:  # what they fit is offered, from the next step on
            self._renew(rested)
        happenings: list[Happening] = []
        for i in sorted(rested):
            on = [self.names[j] for j in self.dynamics.resting_on(i)]
            text = f"{self.names[i]} comes to rest" + (f" on {', '.join(on)}" if on else "")
            happenings.append(("landed", (self.names[i], *on), (), text, {}))
        clocks["physics"] += clock.perf_counter() - began
        return happenings

    def _constraints_in_force(self) -> dict[int, Constraint]:
        return {id: entry.candidate.constraint for id, entry in self.mates.accepted.items()}

    def behave(self, i: int, body: Body, behaviours: Sequence[Behaviour]) -> None:
        """Give a part mass and behaviours: it moves under forces whenever no hand holds it."""
        self.start()
        if self.dynamics is None:
            self.dynamics = Dynamics(self.scene, self.collision, self.tolerance)
        self.dynamics.add(i, body, behaviours)

    def _wanted(self, wishes: Sequence[Wish]) -> dict[int, pin.SE3]:
        wanted: dict[int, pin.SE3] = {}
        for wish in wishes:
            held = self.scene.index(wish.part)
            wanted[held] = wish.pose
            for name in wish.carried:
                i = self.scene.index(name)
                wanted[i] = wish.pose * self.poses[held].actInv(self.poses[i])
        return wanted

    def _decide(self, requests: Sequence[Request]) -> list[Candidate]:
        """Do what the script and people decide; what was stated among it."""
        self._decided |= bool(requests)
        for request in requests:
            if request.stated is not None:
                self.mates.impose(request.stated, **dict(request.limits))
                continue
            try:
                getattr(self.mates, request.verb)(request.id, **dict(request.limits))
            except UnknownConstraintError as error:
                raise TaskError(f"{request.verb}: {error}") from None
        return [request.stated for request in requests if request.stated is not None]

    def _settle(self, candidate: Candidate, clocks: dict[str, float]) -> None:
        """Bring what no hand holds to where a stated constraint holds: b goes to a, unless it is fixed."""
        a, b = candidate.bodies
        mover = a if self.scene.parts[b].fixed else b
        before = list(self.poses)
        result = self.motion.step({mover: self.poses[mover]}, self.poses, self._along({mover}))
        for i, pose in result.poses.items():
            if pose != self.poses[i]:
                self.poses[i] = pose
        self._touch(before, clocks)

    def _along(self, bodies: Iterable[int]) -> frozenset[int]:
        """Bodies that move with some that do: what the script states takes along what it joins."""
        fixed = [i for i, part in enumerate(self.scene.parts) if part.fixed]
        return taken_along((e.candidate for e in self.mates.accepted.values()), bodies, fixed)

    def _follow_hands(
        self, wanted: dict[int, pin.SE3], wishes: Sequence[Wish], clocks: dict[str, float]
    ) -> tuple[Happening, ...]:
        if not wanted:
            self._blocked = {}
            return ()
        began = clock.perf_counter()
        carried = {self.scene.index(w.part): [self.scene.index(name) for name in w.carried] for w in wishes}
        result = self.motion.step({i: wanted[i] for i in carried}, self.poses, self._along(wanted), carried)
        for i, pose in result.poses.items():
            if pose != self.poses[i]:
                self.poses[i] = pose
        clocks["motion"] += clock.perf_counter() - began
        before, self._blocked = self._blocked, {}
        happenings: list[Happening] = []
        if result.blocked:
            for name in sorted(wish.part for wish in wishes):
                by = self._in_the_way(self.scene.index(name), result.contacts)
                if not by and len(wishes) > 1:
                    continue  # it was another hand's part that was stopped
                others = [self.names[i] for i in by]
                text = ", ".join(f"{self.names[i]} (surfaces {', '.join(map(str, s))})" for i, s in by.items())
                self._blocked[name] = text or "the parts it is held to"
                if name not in before:
                    told = f"{name} is stopped by {self._blocked[name]}"
                    happenings.append(("blocked", (name, *others), ((), *by.values()), told, {}))
        return tuple(happenings)

    @staticmethod
    def _in_the_way(me: int, rows: NDArray[Any]) -> dict[int, tuple[int, ...]]:
        """Surfaces of each other object in rows about `me`."""
        by: dict[int, set[int]] = {}
        for row in rows:
            a, b = int(row["object_a"]), int(row["object_b"])
            if me in (a, b):
                other, surface = (b, row["surface_b"]) if a == me else (a, row["surface_a"])
                by.setdefault(other, set()).add(int(surface))
        return {i: tuple(sorted(by[i])) for i in sorted(by)}

    def _touch(self, before: list[pin.SE3], clocks: dict[str, float]) -> None:
        """Bring the contact rows up to date for what moved since `before`, and for what is newly held."""
        began = clock.perf_counter()
        stale = {i for i, pose in enumerate(self.poses) if pose is not before[i]} | (self._active - self._moved)
        if stale:
            self._renew(stale)
        clocks["collision"] += clock.perf_counter() - began

    def _renew(self, about: set[int]) -> None:
        """Ask anew for the contact rows of some parts."""
        kept = self._rows[~np.isin(self._rows["object_a"], list(about)) & ~np.isin(self._rows["object_b"], list(about))]
        rows = np.concatenate([kept, self.collision.contacts(self.mates.within, sorted(about))])
        self._rows = rows[np.lexsort([rows[c] for c in ("surface_b", "object_b", "surface_a", "object_a")])]

    def _mate(self, wanted: dict[int, pin.SE3], clocks: dict[str, float]) -> list[Happening]:
        began = clock.perf_counter()
        force = {} if self.dynamics is None else self.dynamics.pull()
        if not (wanted or force or self._decided) and self._as_mated():
            return []  # nothing moved and nobody asked: the same answer again
        changes = self.mates.update(self.poses, self._rows, wanted, force)
        self._decided = False
        self._mated = None if wanted or force else (self.mates.tolerance, self._rows, tuple(self.poses))
        if changes:
            self.motion.sync()
            self._remated |= {i for change in changes for i in change.candidate.bodies}
            self.joined |= {self._pair(change.candidate) for change in changes if change.kind == "accepted"}
        clocks["constraints"] += clock.perf_counter() - began
        return [self._told(change) for change in changes]

    def _as_mated(self) -> bool:
        """Whether all that the constraint manager's answer depends on is as it was when it was asked last."""
        if self._mated is None:
            return False
        tolerance, rows, poses = self._mated
        same = tolerance == self.mates.tolerance and rows is self._rows  # both are replaced, never changed
        return same and all(a is b for a, b in zip(poses, self.poses, strict=True))

    def _pair(self, candidate: Candidate) -> tuple[str, str]:
        a, b = candidate.bodies
        return self.names[a], self.names[b]

    def _told(self, change: Change) -> Happening:
        candidate = change.candidate
        a, b = (self.names[i] for i in candidate.bodies)
        data = {"id": change.id, "constraint": candidate.kind, "residual": candidate.residual}
        return (change.kind, (a, b), candidate.surfaces, f"{candidate.kind} of {a} and {b}: {change.text}", data)

    def _clash(self, before: list[pin.SE3], clocks: dict[str, float]) -> list[Happening]:
        """Colliding surfaces of what moved, and who began or ceased to collide."""
        began = clock.perf_counter()
        about = sorted({i for i, pose in enumerate(self.poses) if pose is not before[i]} | self._remated)
        self._remated = set()
        if not about:
            return []
        old = self._colliding
        theirs = np.isin(old[:, 0], about) | np.isin(old[:, 2], about)
        new = self.collision.colliding_surfaces(about)
        rows = np.concatenate([old[~theirs], new])
        self._colliding = rows[np.lexsort(rows.T[::-1])]
        clocks["collision"] += clock.perf_counter() - began
        return self._compare(old[theirs], new)

    def _compare(self, old: NDArray[np.int32], new: NDArray[np.int32]) -> list[Happening]:
        """ "collided" and "parted" by pair of parts: all surfaces that meet now, or met until now."""
        was, now = _by_pair(old), _by_pair(new)
        out: list[Happening] = []
        for kind, pairs in (("collided", sorted(set(now) - set(was))), ("parted", sorted(set(was) - set(now)))):
            for pair in pairs:
                rows = np.array((now if kind == "collided" else was)[pair])
                a, b = (self.names[i] for i in pair)
                surfaces = (tuple(np.unique(rows[:, 1]).tolist()), tuple(np.unique(rows[:, 3]).tolist()))
                faces = [", ".join(map(str, s)) for s in surfaces]
                text = f"{a} (surfaces {faces[0]}) and {b} (surfaces {faces[1]})"
                data = {"pairs": rows[:, [1, 3]].tolist()}
                out.append(
                    (kind, (a, b), surfaces, f"{text} {'meet' if kind == 'collided' else 'no longer meet'}", data)
                )
        return out

    # ---- what is so after a step

    def _near_pairs(self) -> NDArray[np.int32]:
        rows = self._rows[self._rows["distance"] <= 2.0 * self.tolerance.linear]  # motion stops at `linear`
        return np.stack([rows[c] for c in ("object_a", "surface_a", "object_b", "surface_b")], axis=1)

    def views(self) -> tuple[ConstraintView, ...]:
        """All constraints as they stand."""
        self.start()
        return self._views(self.poses)

    def _views(self, before: list[pin.SE3]) -> tuple[ConstraintView, ...]:
        """All constraints in the user's terms: active by age, then candidates by score, then refused."""
        shown = {}
        for id, entry in self.mates.accepted.items():
            a, b = entry.candidate.bodies
            still = self.poses[a] is before[a] and self.poses[b] is before[b]
            view = self._shown.get(id) if still else None
            shown[id] = view or self.view(id, entry.candidate, "active")
        self._shown = shown
        offers = sorted(self.mates.candidates.items(), key=lambda item: (-item[1].score, item[0]))
        known, self._offered = self._offered, {}
        for state, candidates in (("candidate", offers), ("refused", self.mates.refused.items())):
            for id, candidate in candidates:
                old = known.get(id)
                same = old is not None and old[0] is candidate and old[1].state == state
                self._offered[id] = old if same and old else (candidate, self.view(id, candidate, state))
        return (*shown.values(), *(view for _, view in self._offered.values()))

    def view(self, id: int, candidate: Candidate, state: str) -> ConstraintView:
        """A candidate or constraint in the user's terms."""
        a, b = candidate.bodies
        match, residual = candidate.match, candidate.residual
        origin, direction = match.origin, match.direction
        if state == "active":
            constraint = candidate.constraint
            symbol = constraint.drawing(self.poses[a])
            origin, direction = self.poses[a].act(match.local), symbol.direction
            rows = constraint.residual(self.poses[a], self.poses[b])[~constraint.angular]
            residual = float(np.abs(rows).max(initial=0.0))
        return ConstraintView(
            id=id,
            kind=candidate.kind,
            parts=(self.names[a], self.names[b]),
            surfaces=candidate.surfaces,
            residual=residual,
            state=state,
            origin=np.asarray(origin),
            direction=np.asarray(direction),
            size=match.size,
            why=candidate.why,
        )

    def freedom(self, i: int) -> tuple[int, str]:
        """Degrees of freedom left to a part, and the lower pair's name; others stay, but what statements join to it."""
        if self.scene.parts[i].fixed:
            return 0, "rigid"
        if not self._started:
            self.start()
        group = self._along({i})
        on_it = {id: e.candidate for id, e in self.mates.accepted.items() if not group.isdisjoint(e.candidate.bodies)}
        key = (i, tuple(sorted(on_it)))
        if key not in self._freedom:
            others = [j for j in range(len(self.poses)) if j not in group]
            found = mobility([c.constraint for c in on_it.values()], self.poses, others, self.tolerance).parts[i]
            self._freedom[key] = (found.freedom, found.joint)
        return self._freedom[key]

    def pitch_of(self, i: int) -> float | None:
        """m a turn, negative for a left-hand thread: what the script said, else what a recognised thread says."""
        if i in self.threads:
            return self.threads[i]
        self.start()
        pitches = [e.candidate.pitch for e in self.mates.accepted.values() if i in e.candidate.bodies]
        return next((p for p in pitches if p is not None), None)

    def clearance(self, i: int, others: Sequence[int]) -> float:
        """Least distance (m) of an object to some others; inf if there are none."""
        self.start()
        low, high = self._box(i)
        boxes = [(j, *self._box(j)) for j in others]
        apart = [(float(np.linalg.norm(np.maximum(0.0, np.maximum(lo - high, low - hi)))), j) for j, lo, hi in boxes]
        best = np.inf
        for bound, j in sorted(apart):
            if bound >= best:
                break
            best = min(best, float(self.collision.clearance(i, j)["distance"][0]))
        return best

    def _box(self, i: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """World box of an object: that of its own box's corners, so it is never too small."""
        if i not in self._corners:
            v = self.collision.mesh(i).vertices
            self._corners[i] = np.array(list(product(*zip(v.min(0), v.max(0), strict=True))))
        corners = self._corners[i] @ self.poses[i].rotation.T + self.poses[i].translation
        return corners.min(0), corners.max(0)

    def _least_clearance(self) -> float | None:
        mates: dict[int, set[int]] = {}
        for entry in self.mates.accepted.values():
            a, b = entry.candidate.bodies
            mates.setdefault(a, set()).add(b)
            mates.setdefault(b, set()).add(a)
        n = range(len(self.poses))
        found = [
            self.clearance(i, [j for j in n if j not in self._active and j not in mates.get(i, ())])
            for i in sorted(self._active)
        ]
        least = min(found, default=np.inf)
        return least if np.isfinite(least) else None

    # ---- checkpoint

    def state(self) -> dict[str, Any]:
        """All that the next step depends on, as values that `vpframe.session.checkpoint.CODEC` knows."""
        return {
            "poses": [pin.SE3(p) for p in self.poses],
            "mates": self.mates.state(),
            "rows": self._rows,
            "colliding": self._colliding,
            "active": self._active,
            "moved": self._moved,
            "blocked": self._blocked,
            "joined": sorted(self.joined),
            "last_wanted": self._last_wanted,
            "carried": self.motion.carried,
            "dynamics": None if self.dynamics is None else self.dynamics.state(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to what `state` returned.

        Raises
        ------
        ValueError, TypeError, LookupError: it is no such state, or not of this scene.
        """
        self.start()
        for name, hint in _STATE.items():
            _require(conforms(state[name], hint), name)
        _require(len(state["poses"]) == len(self.poses), "number of parts")
        _require(state["rows"].dtype == CONTACT_DTYPE and state["rows"].ndim == 1, "rows")
        rows = state["rows"]
        self._require_rows(np.stack([rows[c] for c in ("object_a", "surface_a", "object_b", "surface_b")], axis=1))
        self._require_rows(state["colliding"])
        self._require_mates(state["mates"])
        self._require_parts([*state["active"], *state["moved"], *state["last_wanted"]])
        self._require_parts([i for weld in state["carried"].values() for i in weld.bodies])
        _require((state["dynamics"] is None) == (self.dynamics is None), "which parts have behaviours")
        self._place(dict(enumerate(state["poses"])))
        self.mates.restore(state["mates"])
        self.motion.sync()
        self._rows, self._colliding = state["rows"], state["colliding"]
        self._active, self._moved, self._blocked = set(state["active"]), set(state["moved"]), dict(state["blocked"])
        self.joined = set(state["joined"])
        self._last_wanted = dict(state["last_wanted"])
        self.motion.carried = dict(state["carried"])
        if self.dynamics is not None:
            self.dynamics.restore(state["dynamics"], self._constraints_in_force())
        self._told_at_start, self._remated, self._shown = [], set(), {}
        self._decided, self._mated, self._offered = False, None, {}

    def follow(self, result: Result) -> None:
        """Take over a step that was computed before, so that questions about it are answered as they were then.

        Raises
        ------
        ValueError, TypeError, LookupError: it is no such result, or not of this scene.
        """
        self.start()
        _require(isinstance(result, Result), "result")
        self._require_rows(result.colliding)
        self._require_rows(result.touching)
        for name in (*result.freedom, *result.joint, *(name for view in result.constraints for name in view.parts)):
            self.scene.index(name)
        if result.mates is not None:
            self._require_mates(result.mates)
        self._place({self.scene.index(name): pose for name, pose in result.poses.items()})
        if result.mates is not None:
            self.mates.restore(result.mates)
            self.motion.sync()

    def _require_parts(self, ids: Iterable[int]) -> None:
        _require(all(0 <= i < len(self.poses) for i in ids), "an object's number")

    def _require_rows(self, rows: NDArray[Any]) -> None:
        """Rows (k, 4) of object, surface, object, surface that there are."""
        _require(rows.ndim == 2 and rows.shape[1] == 4, "rows")
        surfaces = np.array([part.mesh.n_surfaces for part in self.scene.parts])
        for objects, of_them in ((rows[:, 0], rows[:, 1]), (rows[:, 2], rows[:, 3])):
            _require(bool(((objects >= 0) & (objects < len(surfaces))).all()), "an object's number")
            _require(bool(((of_them >= 0) & (of_them < surfaces[objects])).all()), "a surface's number")

    def _require_mates(self, state: Mapping[str, Any]) -> None:
        for name, hint in _MATES.items():
            _require(conforms(state[name], hint), name)
        _require(len(state["poses"]) in (0, len(self.poses)), "poses")
        offered = (c for name in ("candidates", "refused", "pulled") for c in state[name].values())
        in_force = (entry.candidate for entry in state["accepted"].values())
        for c in (*offered, *in_force, *(change.candidate for change in state["pending"])):
            _require(c.constraint.bodies == c.bodies and type(c.match.local) is np.ndarray, "a constraint")
            self._require_parts(c.bodies)

    def _place(self, poses: Mapping[int, pin.SE3]) -> None:
        for i, pose in poses.items():
            self.poses[i] = pose
            self.collision.set_pose(i, pose)


_STATE: dict[str, Any] = {
    "poses": list[pin.SE3],
    "mates": dict[str, Any],
    "rows": NDArray[Any],
    "colliding": NDArray[np.int32],
    "active": set[int],
    "moved": set[int],
    "blocked": dict[str, str],
    "joined": list[tuple[str, str]],
    "last_wanted": dict[int, pin.SE3],
    "carried": dict[tuple[int, int], Fixed],
    "dynamics": dict[str, Any] | None,
}
_MATES: dict[str, Any] = {
    "ids": dict[Key, int],
    "candidates": dict[int, Candidate],
    "accepted": dict[int, Accepted],
    "refused": dict[int, Candidate],
    "pulled": dict[int, Candidate],
    "pending": list[Change],
    "poses": tuple[pin.SE3, ...],
    "unproven": list[int],
}
"""of what types a state is that was read from a file"""


def _require(holds: bool, what: str) -> None:
    if not holds:
        raise ValueError(f"{what} is not of this scene")


def _by_pair(rows: NDArray[np.int32]) -> dict[tuple[int, int], list[list[int]]]:
    pairs: dict[tuple[int, int], list[list[int]]] = {}
    for row in rows.tolist():
        pairs.setdefault((row[0], row[2]), []).append(row)
    return pairs
