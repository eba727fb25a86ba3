"""`ConstraintManager`: which constraints are offered, accepted and refused while parts move.

It is the only state of this package. Each step: move the parts (`constraints.motion.motion`), ask collision for
contacts within `manager.within`, then `update(poses, contacts, wanted)` tells what changed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from collision import Tolerance
from constraints.errors import ConstraintsError
from constraints.freedom.lower_pairs import orthonormal
from constraints.geometry.features import Feature
from constraints.geometry.surfaces import Plane
from constraints.geometry.views import Limits
from constraints.kinds import Constraint
from constraints.recognition.attention import Attention, rows_about
from constraints.recognition.candidate import Candidate, Key, Match, Pair, known_kinds
from constraints.recognition.implied import without_implied
from constraints.recognition.pairings import FITS, rows_for
from constraints.recognition.recognise import Near, Recogniser
from constraints.solve.solver import solve

Rule = Callable[[Candidate], bool | None]
"""Decides on a new candidate: True accepts, False refuses, None leaves it open."""


class UnknownConstraintError(ConstraintsError):
    """An id that is not among the candidates or constraints. `id` was given."""

    def __init__(self, message: str, id: int) -> None:
        super().__init__(message)
        self.id = id


@dataclass(frozen=True, eq=False)
class Change:
    """Something that happened to a candidate or constraint."""

    kind: str
    """"recognised", "withdrawn", "accepted", "refused", "satisfied" or "removed\""""
    id: int
    candidate: Candidate
    text: str
    """the reason, one line"""


@dataclass(frozen=True, eq=False)
class Accepted:
    """A constraint in force."""

    candidate: Candidate
    satisfied: bool = False
    """whether the parts have been seen obeying it"""
    break_distance: float | None = None
    """m; None: `Tolerance.break_distance`, and a closed fit is never pulled apart across its axis"""
    break_force: float = np.inf
    """N: greatest force of a hand that it bears"""


def _borne(candidate: Candidate, body: int, poses: Sequence[pin.SE3], force: ArrayLike) -> float:
    """N: how much of a force on one of its bodies the constraint bears; of faces against each other what parts them."""
    f = np.asarray(force, dtype=np.float64)
    if f.shape not in ((), (3,)) or not np.isfinite(f).all():
        raise ConstraintsError(f"the force on body {body} is {force!r}; give newtons, or three of them along the axes")
    if f.ndim == 0:
        return abs(float(f))
    a, b = candidate.bodies
    constraint, first = candidate.constraint, candidate.geometries[0]
    if candidate.kind == "against" and isinstance(first, Plane):
        outward = poses[a].rotation @ first.normal
        return max(0.0, float(f @ outward) * (-1.0 if body == a else 1.0))
    rows = constraint.jacobian(poses[a], poses[b])[body == b][~constraint.angular, :3]
    held = orthonormal(poses[body].rotation @ rows.T, 1e-9)
    return float(np.linalg.norm(held.T @ f))


class ConstraintManager:
    """Candidates, accepted and refused constraints of bodies with known features.

    Parameters
    ----------
    features: one sequence of `Feature` a body, in the order of the object ids.
    tolerance: `reach`, `release`, `break_distance`, `break_angular` are used here.
    threads: pitch (m a turn) of threaded features, by (body, feature).
    rules: asked in order about each new candidate; the first that does not say None decides.
    fixed: ids of bodies that cannot move: two of them may make constraints contradict each other.
    kinds: what is offered; by default surfaces that coincide (`pairings.FITS`), no tangencies.

    A pair of features keeps its id as long as the manager lives, through `state` and `restore` too.
    """

    def __init__(
        self,
        features: Sequence[Sequence[Feature]],
        tolerance: Tolerance | None = None,
        *,
        threads: Mapping[tuple[int, int], float] | None = None,
        rules: Sequence[Rule] = (),
        fixed: Iterable[int] = (),
        kinds: Iterable[str] = FITS,
    ) -> None:
        self.tolerance = tolerance or Tolerance()
        self.recogniser = Recogniser(features, threads)
        self.rules: list[Rule] = list(rules)
        self.fixed = frozenset(fixed)
        self.kinds = known_kinds(kinds)
        self.candidates: dict[int, Candidate] = {}
        """offered, by id"""
        self.accepted: dict[int, Accepted] = {}
        """in force, by id, in the order of acceptance"""
        self.refused: dict[int, Candidate] = {}
        """refused until their parts part, by id"""
        self._ids: dict[Key, int] = {}
        self._pulled: dict[int, Candidate] = {}  # broken by a pull that has not relaxed yet
        self._pending: list[Change] = []
        self._poses: tuple[pin.SE3, ...] = ()
        self._unproven: list[int] = []  # accepted since the last update
        self._attention = Attention()
        self._known_widest: tuple[tuple[float, ...], float] = ((), 0.0)

    @property
    def _widest(self) -> float:
        """m: how far apart the faces of a fit may be; kept for one tolerance at a time."""
        t = self.tolerance
        asked = (t.linear, t.clearance, t.clearance_relative)
        if self._known_widest[0] != asked:
            self._known_widest = asked, self.recogniser.widest(Limits.offer(t))
        return self._known_widest[1]

    @property
    def within(self) -> float:
        """m: `CollisionManager.contacts(within=manager.within)` gives `update` all it needs."""
        t = self.tolerance
        as_far = t.release * max(t.linear, t.reach)
        return max(t.release * t.clearance, as_far, float(np.hypot(self._widest, as_far)))

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """The constraints in force, in the order of acceptance."""
        return tuple(a.candidate.constraint for a in self.accepted.values())

    # -- decisions

    def accept(self, id: int, *, break_distance: float | None = None, break_force: float = np.inf) -> Change:
        """Put a candidate (or a refused one) in force. The change is also reported by the next `update`."""
        candidate = self.candidates.pop(id, None) or self.refused.pop(id, None)
        if candidate is None:
            raise UnknownConstraintError(self._unknown(id, "candidate", [*self.candidates, *self.refused]), id)
        if self._poses:
            candidate = candidate.engaged(self._poses)
        self._unproven.append(id)
        self.accepted[id] = Accepted(candidate, break_distance=break_distance, break_force=break_force)
        return self._note("accepted", id, candidate, candidate.why)

    def impose(self, candidate: Candidate, *, break_distance: float | None = None, break_force: float = np.inf) -> int:
        """Put what the caller states (see `constraints.kinds.stated`) in force, and tell its id.

        Of a pair of features that is on offer already, or was refused, it takes the place. It holds whatever a hand
        pulls, unless `break_distance` (m) or `break_force` (N) is given.
        """
        id = self.id_of(candidate)
        if id in self.accepted:
            raise ConstraintsError(f"{candidate.kind} of these two features is in force already, as constraint {id}")
        self._ids[candidate.key] = id
        for known in (self.candidates, self.refused, self._pulled):
            known.pop(id, None)
        self._unproven.append(id)
        self.accepted[id] = Accepted(candidate, break_distance=break_distance, break_force=break_force)
        self._note("accepted", id, candidate, candidate.why)
        return id

    @property
    def known(self) -> int:
        """How many candidates and constraints there have been: the next new one's id."""
        return len(self._ids)

    def id_of(self, candidate: Candidate, unknown: int = 0) -> int:
        """The id that a candidate has, or will have when `unknown` others come to be known before it."""
        return self._ids.get(candidate.key, len(self._ids) + unknown)

    def refuse(self, id: int) -> Change:
        """Turn a candidate down: it is not offered again before its two parts have parted."""
        if id not in self.candidates:
            raise UnknownConstraintError(self._unknown(id, "candidate", list(self.candidates)), id)
        candidate = self.refused[id] = self.candidates.pop(id)
        return self._note("refused", id, candidate, "refused until the parts part")

    def remove(self, id: int, reason: str = "removed on request") -> Change:
        """Take a constraint out of force; it may be offered again."""
        if id not in self.accepted:
            raise UnknownConstraintError(self._unknown(id, "constraint in force", list(self.accepted)), id)
        return self._note("removed", id, self.accepted.pop(id).candidate, reason)

    @staticmethod
    def _unknown(id: int, what: str, known: list[int]) -> str:
        return f"no {what} has id {id}; there are: {', '.join(map(str, known)) or 'none'}"

    def _note(self, kind: str, id: int, candidate: Candidate, text: str) -> Change:
        change = Change(kind, id, candidate, text)
        self._pending.append(change)
        self._attention.note(candidate.bodies)
        return change

    # -- the step

    def update(
        self,
        poses: Sequence[pin.SE3],
        contacts: NDArray[Any],
        wanted: Mapping[int, pin.SE3] | None = None,
        force: Mapping[int, ArrayLike] | None = None,
    ) -> tuple[Change, ...]:
        """Bring candidates and constraints up to date with where the parts are now.

        poses: one a body, after the motion. contacts: rows within `self.within`. wanted: the poses hands ask for,
        by body: what pulls constraints apart. force: N, with which hands pull, by body: a (3,) vector in the world's
        frame, of which the part that a constraint bears counts against its `break_force` (faces bear what parts them,
        an axis what is across it); or a number, which counts in full.

        Returns the changes since the last call, decisions of `accept`, `refuse` and `remove` first. Only bodies that
        moved, whose rows are other ones, or about which something was decided are looked at: the rest is as it was.
        """
        if len(poses) < len(self.recogniser.features):
            count = len(self.recogniser.features)
            raise ConstraintsError(f"{len(poses)} poses for {count} bodies; give one a body, by id")
        self._poses = tuple(poses)
        about = self._attention.begin((self.tolerance, self.kinds), poses, contacts)
        self._remove_broken(about | (force or {}).keys(), poses, wanted or {}, force or {})
        about |= self._attention.noted().union(*(candidate.bodies for candidate in self._pulled.values()))
        self._offer(about, poses, contacts, wanted or {})
        self._remove_contradicted(poses)
        self._note_satisfied(about | self._attention.noted(), poses)
        self._attention.end()
        changes, self._pending = tuple(self._pending), []
        return changes

    def _remove_broken(
        self,
        about: Set[int],
        poses: Sequence[pin.SE3],
        wanted: Mapping[int, pin.SE3],
        force: Mapping[int, ArrayLike],
    ) -> None:
        overlapping = replace(Limits.keep(self.tolerance), linear=np.inf, angular=np.pi / 2)
        for id, entry in [(i, e) for i, e in self.accepted.items() if not about.isdisjoint(e.candidate.bodies)]:
            a, b = entry.candidate.bodies
            if not entry.candidate.stated and self.recogniser.match(entry.candidate.key, poses, overlapping) is None:
                self.remove(id, "the surfaces no longer overlap")
                continue
            hardest = max((_borne(entry.candidate, x, poses, force[x]) for x in (a, b) if x in force), default=0.0)
            if hardest > entry.break_force:
                self._break(id, f"pulled with {hardest:.4g} N, more than {entry.break_force:.4g} N")
        at = dict(enumerate(poses)) | dict(wanted)
        strained = [
            id
            for id, entry in self.accepted.items()
            if not wanted.keys().isdisjoint(entry.candidate.bodies) and self._pulled_apart(entry, at) is not None
        ]
        if strained:
            # what the other constraints bear is no pull on these: a bore takes a tilt off the face beside it
            others = [e.candidate.constraint for id, e in self.accepted.items() if id not in strained]
            at |= solve(others, at, wanted, self.tolerance).poses
        for id in strained:
            reason = self._pulled_apart(self.accepted[id], at)
            if reason is not None:
                self._break(id, reason)

    def _break(self, id: int, reason: str) -> None:
        if not self.accepted[id].candidate.stated:
            self._pulled[id] = self.accepted[id].candidate
        self.remove(id, reason)

    def _pulled_apart(self, entry: Accepted, at: Mapping[int, pin.SE3]) -> str | None:
        """Why the hand's pull breaks a constraint, or None while it holds."""
        candidate, t = entry.candidate, self.tolerance
        limit = t.break_distance if entry.break_distance is None else entry.break_distance
        if candidate.match.closed and entry.break_distance is None:
            return None
        a, b = candidate.bodies
        constraint = candidate.constraint
        residual = constraint.residual(at[a], at[b])
        turn = float(np.linalg.norm(residual[constraint.angular]))
        distance = float(np.linalg.norm(residual[~constraint.angular]))
        first, second = candidate.geometries
        if candidate.kind == "against" and isinstance(first, Plane) and isinstance(second, Plane):
            p, q = first.transformed(at[a]), second.transformed(at[b])
            middle = at[a].act(candidate.match.local)
            facing = float(p.normal @ q.normal)
            # only parting counts: pressing together is what the faces are for
            distance = max(0.0, float((q.origin - middle) @ q.normal) / facing) if facing < 0 else np.inf
        if distance > limit:
            return f"pulled {1e3 * distance:.4g} mm apart, more than {1e3 * limit:.4g} mm"
        if turn > t.break_angular:
            return f"turned {np.degrees(turn):.3g}° apart, more than {np.degrees(t.break_angular):.3g}°"
        return None

    def _note_satisfied(self, about: Set[int], poses: Sequence[pin.SE3]) -> None:
        for id, entry in self.accepted.items():
            if entry.satisfied or about.isdisjoint(entry.candidate.bodies):
                continue
            a, b = entry.candidate.bodies
            residual = float(np.abs(entry.candidate.constraint.residual(poses[a], poses[b])).max())
            if residual <= self.tolerance.satisfied:
                self.accepted[id] = replace(entry, satisfied=True)
                self._note("satisfied", id, entry.candidate, f"holds to {residual:.1e}")

    def _offer(
        self, about: Set[int], poses: Sequence[pin.SE3], contacts: NDArray[Any], wanted: Mapping[int, pin.SE3]
    ) -> None:
        t = self.tolerance
        offer, keep = Limits.offer(t), Limits.keep(t)
        contacts = rows_about(contacts, about)
        near = self.recogniser.near(contacts, self.within)
        offered = self.recogniser.near(contacts, max(offer.clearance, float(np.hypot(self._widest, offer.linear))))
        together = {(k[0], k[2]) for k in near} | {e.candidate.bodies for e in self.accepted.values()}
        for id, candidate in [(i, c) for i, c in self.candidates.items() if not about.isdisjoint(c.bodies)]:
            if candidate.key[:4] not in near or self.recogniser.match(candidate.key, poses, keep) is None:
                del self.candidates[id]
                self._note("withdrawn", id, candidate, "the surfaces no longer fit each other")
        self.refused = {i: c for i, c in self.refused.items() if c.bodies in together or about.isdisjoint(c.bodies)}
        at = [wanted.get(i, pose) for i, pose in enumerate(poses)] if self._pulled else poses
        for id, candidate in list(self._pulled.items()):
            if candidate.bodies not in together or self.recogniser.match(candidate.key, at, offer) is not None:
                del self._pulled[id]
        told = self.kinds | {"concentric"} if "screw" in self.kinds else self.kinds  # a screw is a fit with pitch
        rows = rows_for(told)
        found = [(pair, self.recogniser.matches(pair, poses, offer, rows)) for pair in sorted(offered)]
        matches = [(pair, match) for pair, match in found if match is not None]
        for pair, match in without_implied(matches, self.recogniser.features, self.recogniser.threads, offer):
            if match.kind in self.kinds:
                self._recognise(pair, match, offered[pair], poses)

    def _recognise(self, pair: Pair, match: Match, near: Sequence[Near], poses: Sequence[pin.SE3]) -> None:
        """Offer a match that is not known yet, and ask the rules."""
        id = self._ids.setdefault((*pair, match.kind), len(self._ids))
        if any(id in known for known in (self.candidates, self.accepted, self.refused, self._pulled)):
            return
        candidate = self.recogniser.candidate(pair, match, near, Limits.offer(self.tolerance), poses)
        self.candidates[id] = candidate
        self._note("recognised", id, candidate, candidate.why)
        verdict = next((v for v in (rule(candidate) for rule in self.rules) if v is not None), None)
        if verdict is not None:
            (self.accept if verdict else self.refuse)(id)

    def _remove_contradicted(self, poses: Sequence[pin.SE3]) -> None:
        """Where a newly accepted constraint cannot hold with the older ones, these give way, the newest first.

        What is stated never does: it was found to hold when it was stated.
        """
        fresh, self._unproven = [i for i in self._unproven if i in self.accepted], []
        if not fresh or self._holds(list(self.accepted), poses):
            return
        for k, id in enumerate(fresh):
            proven = [i for i in self.accepted if i not in fresh[k + 1 :]]
            if id not in self.accepted or self._holds(proven, poses):
                continue
            mine = self.accepted[id].candidate
            stated = [i for i in proven if self.accepted[i].candidate.stated]
            if stated and not mine.stated and not self._holds([*stated, id], poses):
                del self.accepted[id]
                self.refused[id] = mine  # else it would be offered again in the next step
                self._note("refused", id, mine, "cannot hold together with what is stated; until the parts part")
                continue
            older = [i for i in reversed(proven) if i != id and i not in stated]
            culprit = next((i for i in older if self._holds([k for k in proven if k != i], poses)), None)
            same_pair = [i for i in older if self.accepted[i].candidate.bodies == mine.bodies]
            for i in same_pair if culprit is None else [culprit]:
                self.remove(i, f"cannot hold together with the {mine.kind} just accepted")

    def _holds(self, ids: Sequence[int], poses: Sequence[pin.SE3]) -> bool:
        """Whether the constraints of these ids can hold together, starting from `poses`."""
        limit = self.tolerance.linear  # real hole patterns are off by less, and still go together
        constraints = [self.accepted[i].candidate.constraint for i in ids]
        if all(np.abs(c.residual(poses[c.bodies[0]], poses[c.bodies[1]])).max() <= limit for c in constraints):
            return True
        free = [i for i in range(len(poses)) if i not in self.fixed]
        return solve(constraints, poses, free, replace(self.tolerance, solver=0.1 * limit)).residual <= limit

    # -- checkpoint

    def state(self) -> dict[str, Any]:
        """Everything needed to go on later, as plain values; the features and rules are not in it."""
        return {
            "ids": dict(self._ids),
            "candidates": dict(self.candidates),
            "accepted": dict(self.accepted),
            "refused": dict(self.refused),
            "pulled": dict(self._pulled),
            "pending": list(self._pending),
            "poses": self._poses,
            "unproven": list(self._unproven),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to what `state` returned."""
        self._ids = dict(state["ids"])
        self.candidates = dict(state["candidates"])
        self.accepted = dict(state["accepted"])
        self.refused = dict(state["refused"])
        self._pulled = dict(state["pulled"])
        self._pending = list(state["pending"])
        self._poses = state["poses"]
        self._unproven = list(state["unproven"])
        self._attention.forget()
