"""`ConstraintManager`: which constraints are offered, accepted and refused while parts move.

It is the only state of this package. Each step: move the parts (`constraints.motion.motion`), ask collision for
contacts within `manager.within`, then `update(poses, contacts, wanted)` returns what changed.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from collision import Tolerance
from collision.contact import picked
from constraints.errors import ConstraintsError
from constraints.freedom.lower_pairs import orthonormal
from constraints.geometry.features import Feature
from constraints.geometry.surfaces import Cone, Plane
from constraints.geometry.views import Limits
from constraints.kinds import Constraint
from constraints.recognition.attention import Attention, rows_about
from constraints.recognition.candidate import Candidate, Key, Match, Pair, known_kinds
from constraints.recognition.implied import without_implied
from constraints.recognition.pairings import FITS, PAIRINGS, rows_for
from constraints.recognition.pulls import Pulls
from constraints.recognition.recognise import Near, Recogniser
from constraints.solve.groups import ALONE, Groups
from constraints.solve.solver import solve
from constraints.solve.together import Together

APPROACHING = 0.5
"""Cosine of the angle between a hand's way and a face's normal up to which it goes to the face, not past it (60°)."""

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


@dataclass(frozen=True, eq=False)
class ConstraintsState:
    """What decisions and updates change, at one instant, see `ConstraintManager.snapshot`."""

    ids: dict[Key, int]
    """of all pairs of features ever offered or stated"""
    candidates: dict[int, Candidate]
    accepted: dict[int, Accepted]
    refused: dict[int, Candidate]
    pulled: dict[int, Candidate]
    """broken by a pull that has not relaxed yet"""
    pending: tuple[Change, ...]
    """changes that the next update reports"""
    poses: tuple[pin.SE3, ...]
    """of the last update; none before the first"""
    unproven: tuple[int, ...]
    """ids accepted since the last update"""


_TABLES = {"_ids": "ids", "candidates": "candidates", "accepted": "accepted", "refused": "refused", "_pulled": "pulled"}
"""attributes of a `ConstraintManager` that are fields of a `ConstraintsState`"""


@dataclass(frozen=True, eq=False)
class InForce:
    """The constraints in force at one moment, and quantities derived from them at first use."""

    accepted: Mapping[int, Accepted]
    """by id, in the order of acceptance"""

    @cached_property
    def constraints(self) -> tuple[Constraint, ...]:
        """In the order of acceptance."""
        return tuple(a.candidate.constraint for a in self.accepted.values())

    @cached_property
    def together(self) -> Together:
        """`constraints` as arrays."""
        return Together.of(self.constraints)

    @cached_property
    def stated(self) -> tuple[Candidate, ...]:
        """Those that the caller stated."""
        return tuple(a.candidate for a in self.accepted.values() if a.candidate.stated)

    @cached_property
    def unseen(self) -> tuple[int, ...]:
        """Ids of those that the parts have not been seen to obey."""
        return tuple(id for id, a in self.accepted.items() if not a.satisfied)

    @cached_property
    def of_body(self) -> Mapping[int, tuple[int, ...]]:
        """Ids by body."""
        out: dict[int, list[int]] = {}
        for id, entry in self.accepted.items():
            for body in entry.candidate.bodies:
                out.setdefault(body, []).append(id)
        return {body: tuple(ids) for body, ids in out.items()}

    @cached_property
    def place(self) -> Mapping[int, int]:
        """Id -> place in the order of acceptance."""
        return {id: k for k, id in enumerate(self.accepted)}

    def about(self, bodies: Collection[int], groups: Groups) -> tuple[int, ...]:
        """Ids of those on some bodies, in the order of acceptance; those between bodies that move as one left out."""
        key = frozenset(bodies)
        known = self._about.get(key)
        if known is None or known[0] is not groups:
            found = {id for body in bodies for id in self.of_body.get(body, ())}
            entries = ((id, self.accepted[id].candidate.bodies) for id in sorted(found, key=self.place.__getitem__))
            known = self._about[key] = groups, tuple(id for id, pair in entries if not groups.within(pair))
        return known[1]

    @cached_property
    def _about(self) -> dict[frozenset[int], tuple[Groups, tuple[int, ...]]]:
        return {}


class Ranges(NamedTuple):
    """How far surfaces may be from each other, by a tolerance."""

    tolerance: Tolerance
    offer: Limits
    """within which a candidate is offered"""
    keep: Limits
    """within which it stays offered"""
    overlapping: Limits
    """within which what is in force still overlaps"""
    offered: float
    """m: how near surfaces are that are offered a constraint"""
    kept: float
    """m: how near they are as long as it stays offered"""

    @classmethod
    def of(cls, tolerance: Tolerance, recogniser: Recogniser) -> Ranges:
        """The ranges of a tolerance, among the features of a recogniser."""
        offer, keep, t = Limits.offer(tolerance), Limits.keep(tolerance), tolerance
        widest, as_far = recogniser.widest(offer), t.release * max(t.linear, t.reach)
        offered = max(offer.clearance, float(np.hypot(widest, offer.linear)))
        kept = max(offered, t.release * t.clearance, as_far, float(np.hypot(widest, as_far)))
        return cls(t, offer, keep, replace(keep, linear=np.inf, angular=np.pi / 2), offered, kept)


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
    named: words of the bodies' names that speak of threads, see `Recogniser`.
    rules: called in order with each new candidate; the first that does not return None decides.
    fixed: ids of bodies that cannot move: two of them may make constraints contradict each other.
    kinds: what is offered; by default surfaces that coincide (`pairings.FITS`), no tangencies.

    A pair of features keeps its id as long as the manager lives, whatever `snapshot` it goes back to.
    """

    def __init__(
        self,
        features: Sequence[Sequence[Feature]],
        tolerance: Tolerance | None = None,
        *,
        threads: Mapping[tuple[int, int], float] | None = None,
        named: Mapping[int, Collection[str]] | None = None,
        rules: Sequence[Rule] = (),
        fixed: Iterable[int] = (),
        kinds: Iterable[str] = FITS,
    ) -> None:
        self.tolerance = tolerance or Tolerance()
        self.recogniser = Recogniser(features, threads, named)
        self.rules: list[Rule] = list(rules)
        self.fixed = frozenset(fixed)
        self.kinds = known_kinds(kinds)
        self.candidates: dict[int, Candidate] = {}
        """offered, by id"""
        self.accepted: dict[int, Accepted] = {}
        """in force, by id, in the order of acceptance"""
        self.refused: dict[int, Candidate] = {}
        """refused until their parts part, by id"""
        self.groups: Groups = ALONE
        """what is carried (see `ConstrainedMotion.carry`): among bodies that move as one nothing is looked at"""
        self.drawn: tuple[pin.SE3, ...] = ()
        """poses of all bodies in the assembly as drawn; none if not known"""
        self.assisted = False
        """whether mates within the reach are offered to a hand that passes by, too"""
        self._ids: dict[Key, int] = {}
        self._pulled: dict[int, Candidate] = {}  # broken by a pull that has not relaxed yet
        self._pending: list[Change] = []
        self._poses: tuple[pin.SE3, ...] = ()
        self._unproven: list[int] = []  # accepted since the last update
        self._shared: set[str] = {"accepted"}  # dicts that a snapshot has: they are copied before they are changed
        self._in_force = InForce(self.accepted)
        self._known_matched: tuple[Any, tuple[tuple[int, ...], tuple[Pair, ...], list[str | None]]] = None, ((), (), [])
        self._known_pulls: tuple[Any, tuple[tuple[int, ...], Pulls]] = None, ((), Pulls((), ()))
        self._known_pairs: dict[int, tuple[NDArray[np.int64], dict[Pair, None]]] = {}
        self._attention = Attention()
        self._known_ranges: Ranges | None = None

    @property
    def ranges(self) -> Ranges:
        """How far surfaces may be from each other by the present tolerance."""
        known = self._known_ranges
        if known is None or known.tolerance is not self.tolerance:
            known = self._known_ranges = Ranges.of(self.tolerance, self.recogniser)
        return known

    @property
    def within(self) -> float:
        """m: `CollisionManager.contacts(within=manager.within)` gives `update` all it needs.

        More as long as there are candidates: they are withdrawn farther away than they are offered.
        """
        return self.ranges.kept if self.candidates or self.refused or self._pulled else self.ranges.offered

    @property
    def in_force(self) -> InForce:
        """The constraints in force; the same object as long as they are the same."""
        if self._in_force.accepted is not self.accepted:
            self._in_force = InForce(self.accepted)
            self._shared.add("accepted")
        return self._in_force

    def _own(self, name: str) -> dict[Any, Any]:
        """One of the dicts, to be changed: a copy where the one there is was given away."""
        if name in self._shared:
            setattr(self, name, dict(getattr(self, name)))
            self._shared.discard(name)
        own: dict[Any, Any] = getattr(self, name)
        return own

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """The constraints in force, in the order of acceptance; the same object as long as they are the same."""
        return self.in_force.constraints

    # -- decisions

    def accept(self, id: int, *, break_distance: float | None = None, break_force: float = np.inf) -> Change:
        """Put a candidate (or a refused one) in force. The change is also reported by the next `update`."""
        candidate = self._own("candidates").pop(id, None) or self._own("refused").pop(id, None)
        if candidate is None:
            raise UnknownConstraintError(self._unknown(id, "candidate", [*self.candidates, *self.refused]), id)
        if self._poses:
            candidate = candidate.engaged(self._poses)
        self._unproven.append(id)
        self._own("accepted")[id] = Accepted(candidate, break_distance=break_distance, break_force=break_force)
        return self._note("accepted", id, candidate, candidate.why)

    def impose(self, candidate: Candidate, *, break_distance: float | None = None, break_force: float = np.inf) -> int:
        """Put what the caller states (see `constraints.kinds.stated`) in force; return its id.

        Of a pair of features that is on offer already, or was refused, it takes the place. It holds whatever a hand
        pulls, unless `break_distance` (m) or `break_force` (N) is given.
        """
        id = self.id_of(candidate)
        if id in self.accepted:
            raise ConstraintsError(f"{candidate.kind} of these two features is in force already, as constraint {id}")
        self._own("_ids")[candidate.key] = id
        for known in ("candidates", "refused", "_pulled"):
            self._own(known).pop(id, None)
        self._unproven.append(id)
        self._own("accepted")[id] = Accepted(candidate, break_distance=break_distance, break_force=break_force)
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
        candidate = self._own("refused")[id] = self._own("candidates").pop(id)
        return self._note("refused", id, candidate, "refused until the parts part")

    def remove(self, id: int, reason: str = "removed on request") -> Change:
        """Take a constraint out of force; it may be offered again."""
        if id not in self.accepted:
            raise UnknownConstraintError(self._unknown(id, "constraint in force", list(self.accepted)), id)
        return self._note("removed", id, self._own("accepted").pop(id).candidate, reason)

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
        versions: NDArray[np.int64] | None = None,
        goals: Mapping[int, pin.SE3] | None = None,
        begun: Set[int] = frozenset(),
    ) -> tuple[Change, ...]:
        """Bring candidates and constraints up to date with where the parts are now.

        poses: one a body, after the motion. contacts: rows within `self.within`. wanted: the poses hands ask for,
        by body: what pulls constraints apart. force: N, with which hands pull, by body: a (3,) vector in the world's
        frame, of which the part that a constraint bears counts against its `break_force` (faces bear what parts them,
        an axis what is across it); or a number, which counts in full. versions: (n,) one number a body, another one
        whenever its pose may be (`CollisionManager.versions`); without, poses are compared. goals: the poses in which
        motions of hands end, by held body; begun: those of them whose motion begins. Faces that are apart at its end
        part when it begins, though no pull gets as far as `break_distance`.

        Returns the changes since the last call, decisions of `accept`, `refuse` and `remove` first. Only bodies that
        moved, whose rows are other ones, or about which something was decided are looked at: the rest is as it was.
        """
        if len(poses) < len(self.recogniser.features):
            count = len(self.recogniser.features)
            raise ConstraintsError(f"{len(poses)} poses for {count} bodies; give one a body, by id")
        before = self._poses or None
        self._poses = poses if isinstance(poses, tuple) else tuple(poses)
        about = self._attention.begin((self.tolerance, self.kinds), poses, contacts, versions)
        self._remove_broken(
            about | (force or {}).keys(),
            poses,
            wanted or {},
            force or {},
            self.groups.with_carried({b: pose for b, pose in (goals or {}).items() if b in begun}),
        )
        about |= self._attention.noted().union(*(candidate.bodies for candidate in self._pulled.values()))
        asked = frozenset(self._unproven)
        self._offer(about, before, poses, contacts, wanted or {}, goals or {})
        self._remove_contradicted(poses, asked)
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
        goals: Mapping[int, pin.SE3],
    ) -> None:
        ids, pairs, kinds = self._matched(about)
        found = self.recogniser.verdicts.kinds("in force", pairs, poses, self.ranges.overlapping, PAIRINGS)
        if found != kinds or force:
            gone = {id for id, kind, now in zip(ids, kinds, found, strict=True) if kind != now}
            for id in self.in_force.about(about, self.groups):
                entry = self.accepted[id]
                if id in gone:
                    self.remove(id, "the surfaces no longer overlap")
                    continue
                bodies = [body for body in entry.candidate.bodies if body in force]
                hardest = max((_borne(entry.candidate, x, poses, force[x]) for x in bodies), default=0.0)
                if hardest > entry.break_force:
                    self._break(id, f"pulled with {hardest:.4g} N, more than {entry.break_force:.4g} N")
        for id in self.in_force.about(wanted.keys(), self.groups):
            off = self._off_where_wanted(self.accepted[id].candidate, wanted, poses)
            if off > self.tolerance.linear:
                self._break(id, f"the parts are wanted where they are drawn, where it is {1e3 * off:.3g} mm off")
        ids, pulls = self._pulled_at(wanted.keys())
        if not ids:
            return
        self._break_all(ids, poses, wanted, lambda at: self._reasons(ids, pulls, at, poses))
        if goals:
            self._break_all(ids, poses, goals, lambda at: self._reasons_to_part(ids, at))

    def _break_all(
        self,
        ids: Sequence[int],
        poses: Sequence[pin.SE3],
        wanted: Mapping[int, pin.SE3],
        reasons_at: Callable[[Sequence[pin.SE3]], Mapping[int, str]],
    ) -> None:
        """Break the constraints for which there are reasons where hands want bodies, and where the others allow it."""
        at = list(poses)
        for body, pose in wanted.items():
            at[body] = pose
        reasons = {id: why for id, why in reasons_at(at).items() if id in self.accepted}
        if reasons:
            # what the other constraints bear is no pull on these: a bore takes a tilt off the face beside it
            rest = (e.candidate.constraint for id, e in self.accepted.items() if id not in reasons)
            held = wanted.keys() - self.groups.seats.keys()
            borne = solve(self.groups.constraints(rest), at, held, self.tolerance).poses
            for body, pose in self.groups.followed(borne, poses).items():
                at[body] = pose
            now = reasons_at(at)
            for id in reasons:
                if id in now:
                    self._break(id, now[id])

    def wanted_as_drawn(self, candidate: Candidate, wanted: Mapping[int, pin.SE3], poses: Sequence[pin.SE3]) -> bool:
        """Whether hands want the two bodies of a candidate where they are drawn, relative to each other."""
        if not self.drawn:
            return False
        a, b = candidate.bodies
        goal = wanted.get(a, poses[a]).actInv(wanted.get(b, poses[b]))
        drawn, most = self.drawn[a].actInv(self.drawn[b]), self.tolerance.satisfied
        way = goal.translation - drawn.translation
        if way @ way > 3.0 * most * most:
            return False
        return bool(np.abs(drawn.actInv(goal).homogeneous - np.eye(4)).max() <= most)

    def _off_where_wanted(self, candidate: Candidate, wanted: Mapping[int, pin.SE3], poses: Sequence[pin.SE3]) -> float:
        """`off_as_drawn` of a candidate whose bodies hands want where they are drawn, else 0; 0 if stated."""
        if candidate.stated or not self.wanted_as_drawn(candidate, wanted, poses):
            return 0.0
        return self.off_as_drawn(candidate)

    def off_as_drawn(self, candidate: Candidate) -> float:
        """Greatest residual of a candidate's constraint in the assembly as drawn, m or rad."""
        return float(np.abs(candidate.constraint.residual(*(self.drawn[i] for i in candidate.bodies))).max())

    def _matched(self, about: Set[int]) -> tuple[tuple[int, ...], tuple[Pair, ...], list[str | None]]:
        """Of the constraints on some bodies that are not stated: ids, pairs of features, kinds."""
        key = self.in_force, self.groups, frozenset(about)
        if self._known_matched[0] != key:
            ids = self.in_force.about(about, self.groups)
            keys = {id: c.key for id in ids if not (c := self.accepted[id].candidate).stated}
            kinds: list[str | None] = [k[4] for k in keys.values()]
            self._known_matched = key, (tuple(keys), tuple(k[:4] for k in keys.values()), kinds)
        return self._known_matched[1]

    def _pulled_at(self, held: Collection[int]) -> tuple[tuple[int, ...], Pulls]:
        """The constraints that a pull on these bodies may break: ids, and what measures it."""
        t = self.tolerance
        key = self.in_force, self.groups, frozenset(held), t.break_distance
        if self._known_pulls[0] != key:
            entries = {id: self.accepted[id] for id in self.in_force.about(held, self.groups)}
            entries = {
                id: e for id, e in entries.items() if not e.candidate.match.closed or e.break_distance is not None
            }
            limits = [t.break_distance if e.break_distance is None else e.break_distance for e in entries.values()]
            pulls = Pulls([e.candidate for e in entries.values()], limits)
            self._known_pulls = key, (tuple(entries), pulls)
        return self._known_pulls[1]

    def _reasons(
        self, ids: Sequence[int], pulls: Pulls, at: Sequence[pin.SE3], poses: Sequence[pin.SE3]
    ) -> dict[int, str]:
        """Why the hands' pull from `poses` to `at` breaks constraints, of those that it does."""
        distance, turn = pulls.apart(at, poses)
        most = self.tolerance.break_angular
        out = {}
        for k in np.flatnonzero((distance > pulls.distances) | (turn > most)).tolist():
            if distance[k] > pulls.distances[k]:
                limit = pulls.distances[k]
                out[ids[k]] = f"pulled {1e3 * distance[k]:.4g} mm apart, more than {1e3 * limit:.4g} mm"
            else:
                out[ids[k]] = f"turned {np.degrees(turn[k]):.3g}° apart, more than {np.degrees(most):.3g}°"
        return out

    def _reasons_to_part(self, ids: Sequence[int], at: Sequence[pin.SE3]) -> dict[int, str]:
        """Why faces part, of those that are apart, but by no more than breaks them, where motions of hands end."""
        out = {}
        for id in ids:
            entry = self.accepted.get(id)
            if entry is None or entry.break_distance is not None:
                continue
            far = _opening(entry.candidate, at)
            if self.tolerance.linear < far <= self.tolerance.break_distance:
                out[id] = f"the hand takes them {1e3 * far:.3g} mm apart"
        return out

    def _break(self, id: int, reason: str) -> None:
        if not self.accepted[id].candidate.stated:
            self._own("_pulled")[id] = self.accepted[id].candidate
        self.remove(id, reason)

    def _note_satisfied(self, about: Set[int], poses: Sequence[pin.SE3]) -> None:
        for id in self.in_force.unseen:
            entry = self.accepted[id]
            if about.isdisjoint(entry.candidate.bodies):
                continue
            a, b = entry.candidate.bodies
            residual = float(np.abs(entry.candidate.constraint.residual(poses[a], poses[b])).max())
            if residual <= self.tolerance.satisfied:
                self._own("accepted")[id] = replace(entry, satisfied=True)
                self._note("satisfied", id, entry.candidate, f"the parts are in place, within {residual * 1e3:.1g} mm")

    def _offer(
        self,
        about: Set[int],
        before: Sequence[pin.SE3] | None,
        poses: Sequence[pin.SE3],
        contacts: NDArray[Any],
        wanted: Mapping[int, pin.SE3],
        goals: Mapping[int, pin.SE3],
    ) -> None:
        t, recogniser, within = self.tolerance, self.recogniser, self.groups.within
        offer, keep, reach = self.ranges.offer, self.ranges.keep, self.ranges.offered
        contacts = self._between_groups(contacts, rows_about(contacts["object_a"], contacts["object_b"], about))
        codes = recogniser.codes(contacts)
        distance = contacts["distance"]
        near = self._pairs(0, codes[distance <= self.within])
        offered = self._pairs(1, codes[distance <= reach])
        mine = [(id, c) for id, c in self.candidates.items() if not (about.isdisjoint(c.bodies) or within(c.bodies))]
        kinds = recogniser.verdicts.kinds("offered", tuple(c.key[:4] for _, c in mine), poses, keep, PAIRINGS)
        for (id, candidate), kind in zip(mine, kinds, strict=True):
            if kind != candidate.kind or candidate.key[:4] not in near:
                del self._own("candidates")[id]
                self._note("withdrawn", id, candidate, "the surfaces no longer fit each other")
        if self.refused or self._pulled:
            together = {(k[0], k[2]) for k in near} | {e.candidate.bodies for e in self.accepted.values()}
            self.refused = {
                i: c
                for i, c in self.refused.items()
                if c.bodies in together or about.isdisjoint(c.bodies) or within(c.bodies)
            }
            at = [wanted.get(i, pose) for i, pose in enumerate(poses)] if self._pulled else poses
            goals = self.groups.with_carried(goals) if self._pulled else {}
            ends = [goals.get(i, pose) for i, pose in enumerate(at)] if goals else at
            for id, candidate in [(i, c) for i, c in self._pulled.items() if not within(c.bodies)]:
                if goals and candidate.bodies in together and _opening(candidate, ends) > t.linear:
                    continue  # a motion that separates the faces is allowed
                if candidate.bodies not in together or recogniser.match(candidate.key, at, offer) is not None:
                    del self._own("_pulled")[id]
        asked = self.kinds | {"concentric"} if "screw" in self.kinds else self.kinds  # a screw is a fit with pitch
        rows = rows_for(asked)
        kinds = recogniser.verdicts.kinds("near", tuple(offered), poses, offer, rows)
        if all(
            kind not in self.kinds or self._is_known((*pair, kind)) for pair, kind in zip(offered, kinds, strict=True)
        ):
            return
        made = [pair for pair, kind in zip(offered, kinds, strict=True) if kind is not None]
        found = [(pair, recogniser.matches(pair, poses, offer, rows)) for pair in made]
        matches = [(pair, match) for pair, match in found if match is not None]
        faces = recogniser.near(contacts, reach)
        for pair, match in without_implied(matches, recogniser.features, recogniser.threads, offer):
            if match.kind not in self.kinds:
                continue
            if self._passes_by(pair, match, before, poses, wanted):
                self._attention.note((pair[0], pair[2]))  # hands that stop or let go change the answer
            else:
                self._recognise(pair, match, faces[pair], poses, wanted)

    def _pairs(self, which: int, codes: NDArray[np.int64]) -> dict[Pair, None]:
        """The pairs of features of contact rows by their codes, ascending; `which` names the cache entry."""
        known = self._known_pairs.get(which)
        if known is None or not np.array_equal(known[0], codes):
            pairs = map(self.recogniser.pair, np.unique(codes[codes >= 0]).tolist())
            known = self._known_pairs[which] = codes, dict.fromkeys(pairs)
        return known[1]

    def _is_known(self, key: Key) -> bool:
        """Whether a pair is offered, in force, refused or pulled apart already."""
        id = self._ids.get(key)
        return id is not None and any(id in d for d in (self.candidates, self.accepted, self.refused, self._pulled))

    def _between_groups(self, contacts: NDArray[Any], chosen: NDArray[np.bool_]) -> NDArray[Any]:
        """Those of the chosen contact rows (n,) that are not between bodies that move as one."""
        if self.groups.seats:
            carrier = self.groups.carriers(len(self.recogniser.features))
            chosen = chosen & (carrier[contacts["object_a"]] != carrier[contacts["object_b"]])
        return picked(contacts, chosen)

    def _passes_by(
        self, pair: Pair, match: Match, before: Sequence[pin.SE3] | None, poses: Sequence[pin.SE3],
        wanted: Mapping[int, pin.SE3],
    ) -> bool:  # fmt: skip
        """Whether hands bring two surfaces past each other: not in place, and not on their way there.

        Faces and cones are on their way if the hands want them to meet, on a way that closes them at `APPROACHING` of
        its length or more; a shaft is if it comes nearer to the axis of its bore, or farther into it; a thread that is
        drawn plain is if it does not go straight along it. At the first look nothing is on its way yet.
        """
        bodies, exact = (pair[0], pair[2]), 0.5 * self.tolerance.slop * self.tolerance.linear
        if self.assisted or before is None or wanted.keys().isdisjoint(bodies):
            return False
        if match.kind == "screw" and self.recogniser.pitch(pair) is None:
            ends = [(before[i].inverse() * wanted.get(i, poses[i])) for i in bodies]
            axial = [
                float((before[i].rotation @ e.translation) @ match.direction) for i, e in zip(bodies, ends, strict=True)
            ]
            turned = [
                float((before[i].rotation @ pin.log3(e.rotation)) @ match.direction)
                for i, e in zip(bodies, ends, strict=True)
            ]
            if abs(axial[1] - axial[0]) > abs(match.parameters["pitch"] * (turned[1] - turned[0])) + exact:
                return True
        if match.kind in ("concentric", "screw"):
            if match.residual <= exact + max(match.fit or 0.0, 0.0):
                return False
            limits, key = self.ranges.offer, (*pair, match.kind)
            was = self.recogniser.match(key, before, limits)
            goal = self.recogniser.match(key, [wanted.get(i, pose) for i, pose in enumerate(poses)], limits)
            if was is None or goal is None:
                return goal is None
            return goal.residual >= was.residual - exact and goal.overlap <= was.overlap + exact
        if match.kind not in ("against", "conical") or match.residual <= exact:
            return False
        apart = match.residual
        if match.kind == "conical":
            cone = self.recogniser.features[pair[0]][pair[1]].geometry
            assert isinstance(cone, Cone) and match.fit is not None
            apart = abs(match.fit) / float(np.sin(cone.half_angle))
        shift, ahead = np.zeros(3), np.zeros(3)
        for body, sign in zip(bodies, (1.0, -1.0), strict=True):
            local = poses[body].actInv(match.origin)
            goal_point = wanted.get(body, poses[body]).act(local)
            shift += sign * (goal_point - before[body].act(local))
            ahead += sign * (goal_point - match.origin)
        closing, left = float(shift @ match.approach), apart - float(ahead @ match.approach)
        return left > exact or closing <= 0.0 or closing < APPROACHING * float(np.linalg.norm(shift))

    def _recognise(
        self, pair: Pair, match: Match, near: Sequence[Near], poses: Sequence[pin.SE3], wanted: Mapping[int, pin.SE3]
    ) -> None:
        """Offer a match that is not known yet, and ask the rules; not one that is off where hands want the parts."""
        id = self._ids.get((*pair, match.kind), len(self._ids))
        if id == len(self._ids):
            self._own("_ids")[*pair, match.kind] = id
        if self._is_known((*pair, match.kind)):
            return
        candidate = self.recogniser.candidate(pair, match, near, self.ranges.offer, poses)
        if self._off_where_wanted(candidate, wanted, poses) > self.tolerance.linear:
            self._attention.note(candidate.bodies)
            return
        self._own("candidates")[id] = candidate
        self._note("recognised", id, candidate, candidate.why)
        verdict = next((v for v in (rule(candidate) for rule in self.rules) if v is not None), None)
        if verdict is not None:
            (self.accept if verdict else self.refuse)(id)

    def _remove_contradicted(self, poses: Sequence[pin.SE3], asked: Set[int]) -> None:
        """Where a newly accepted constraint cannot hold with the older ones, these give way, the newest first.

        What is stated never does: it was found to hold when it was stated. A fit that a rule accepted, not the caller
        (`asked`), gives way itself to a tighter one.
        """
        fresh, self._unproven = [i for i in self._unproven if i in self.accepted], []
        if not fresh or self._holds(list(self.accepted), poses):
            return
        fresh.sort(key=self._looseness)
        for k, id in enumerate(fresh):
            proven = [i for i in self.accepted if i not in fresh[k + 1 :]]
            if id not in self.accepted or self._holds(proven, poses):
                continue
            mine = self.accepted[id].candidate
            stated = [i for i in proven if self.accepted[i].candidate.stated]
            better = [i for i in proven if i in fresh[:k] or (id not in asked and self._is_tighter(i, id))]
            if better and not mine.stated and not self._holds([*better, id], poses):
                self._give_way(id, "cannot hold together with a better fit; until the parts part")
                continue
            if stated and not mine.stated and not self._holds([*stated, id], poses):
                self._give_way(id, "cannot hold together with what is stated; until the parts part")
                continue
            older = [i for i in reversed(proven) if i != id and i not in stated]
            culprit = next((i for i in older if self._holds([k for k in proven if k != i], poses)), None)
            same_pair = [i for i in older if self.accepted[i].candidate.bodies == mine.bodies]
            for i in same_pair if culprit is None else [culprit]:
                self.remove(i, f"cannot hold together with the {mine.kind} just accepted")

    def _looseness(self, id: int) -> tuple[bool, bool, float]:
        """Orders constraints that were accepted together: what is stated, fits that can be, those that share most."""
        candidate = self.accepted[id].candidate
        fit = candidate.match.fit
        pressed = fit is not None and fit < -self.tolerance.linear
        return not candidate.stated, pressed, -candidate.match.overlap

    def _is_tighter(self, id: int, other: int) -> bool:
        """Whether parts obey a fit whose surfaces have less room between them than those of another."""
        entry, loose = self.accepted[id], self.accepted[other].candidate.match.fit
        fit = entry.candidate.match.fit
        return entry.satisfied and fit is not None and loose is not None and abs(fit) < abs(loose)

    def _give_way(self, id: int, reason: str) -> None:
        """Refuse what was just accepted, else it would be offered again in the next step."""
        mine = self._own("accepted").pop(id).candidate
        self._own("refused")[id] = mine
        self._note("refused", id, mine, reason)

    def _holds(self, ids: Sequence[int], poses: Sequence[pin.SE3]) -> bool:
        """Whether the constraints of these ids can hold together, starting from `poses`."""
        limit = self.tolerance.linear  # real hole patterns are off by less, and still go together
        constraints = [self.accepted[i].candidate.constraint for i in ids]
        if all(np.abs(c.residual(poses[c.bodies[0]], poses[c.bodies[1]])).max() <= limit for c in constraints):
            return True
        free = [i for i in range(len(poses)) if i not in self.fixed]
        return solve(constraints, poses, free, replace(self.tolerance, solver=0.1 * limit)).residual <= limit

    # -- going back

    @property
    def snapshot(self) -> ConstraintsState:
        """All that decisions and updates change, at this instant; assigning it takes back later changes.

        Its dicts and lists must not be changed. Features, rules and settings are not in it.
        """
        self._shared |= _TABLES.keys()
        tables = {name: getattr(self, own) for own, name in _TABLES.items()}
        return ConstraintsState(
            **tables, pending=tuple(self._pending), poses=self._poses, unproven=tuple(self._unproven)
        )

    @snapshot.setter
    def snapshot(self, there: ConstraintsState) -> None:
        self._shared |= _TABLES.keys()
        for own, name in _TABLES.items():
            setattr(self, own, getattr(there, name))
        self._pending, self._unproven = list(there.pending), list(there.unproven)
        self._poses = there.poses
        self.drop_caches()

    def drop_caches(self) -> None:
        """Forget what was computed from earlier poses; the next update gives the same changes without it."""
        self._attention.forget()
        self.recogniser.verdicts.forget()


def _opening(candidate: Candidate, at: Sequence[pin.SE3]) -> float:
    """m: gap between the faces of a candidate with its bodies `at` these poses; 0 for any other kind."""
    p, q = candidate.geometries
    if candidate.kind != "against" or not (isinstance(p, Plane) and isinstance(q, Plane)):
        return 0.0
    a, b = (at[i] for i in candidate.bodies)
    normal = b.rotation @ q.normal
    facing = float(normal @ (a.rotation @ p.normal))
    return float((b.act(q.origin) - a.act(candidate.match.local)) @ normal) / facing if facing < 0.0 else np.inf
