"""`Engine`: collision, constraints, motion, hands and physics of a session, and its `State`.

before = engine.state; engine.state = before     a value: undoes a failed step in microseconds
data = engine.save(); engine.restore(data)       bytes, also for another process: continues bit for bit
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from operator import attrgetter
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CollisionManager, Tolerance
from collision.poses import unpack_all
from constraints import ConstraintManager
from constraints.geometry.views import Limits
from constraints.kinds import Constraint
from constraints.manager import Change
from constraints.motion.motion import ConstrainedMotion
from constraints.recognition.candidate import Candidate
from constraints.recognition.misfits import Misfit, misfits
from constraints.solve.groups import Groups
from physics import Behaviour, Body, Material
from vpframe.analysis.meanings import Meaning, meanings_of
from vpframe.analysis.static import analysis_of, named_threads, threaded_features
from vpframe.codec import WRONG
from vpframe.errors import VpframeError
from vpframe.events import NewEvent
from vpframe.hands.gripper import Gripper
from vpframe.scene.deflection import deflections
from vpframe.scene.scene import Part, Scene
from vpframe.session.authorised import AuthorisedPairs
from vpframe.session.dynamics import Dynamics
from vpframe.session.state import Changes, HandMotion, HandState, State, Values, damaged, loaded, require_changes, saved

Judge = Callable[[Candidate], bool | None]
"""rule for a candidate: True accepts, False refuses, None leaves it on offer"""
_KEPT = tuple(f.name for f in fields(Values))
_OF_HAND = tuple(f.name for f in fields(HandState) if f.name != "motion")
_kept, _of_hand, _of_motion = attrgetter(*_KEPT), attrgetter(*_OF_HAND), attrgetter(*HandMotion._fields)


@dataclass(frozen=True, eq=False)
class HeldOverlap:
    """An overlap that is meant, of parts in a hand with another part."""

    meaning: Meaning
    other: str
    """name of that part"""
    origin: NDArray[np.float64]
    """(3,) m, world, on the axis"""
    axis: NDArray[np.float64]
    """(3,) unit, world"""
    out: float
    """1 or -1: the way out along the axis, for the parts in the hand; 0 if it is not known"""


def rows_of(found: Iterable[Misfit]) -> NDArray[np.int32]:
    """(k, 4) object, surface, object, surface of shafts and bores that clash."""
    rows = [(m.pair[0], i, m.pair[2], j) for m in found for i, j in m.faces]
    return np.array(rows, np.int32).reshape(-1, 4)


class Engine(Values):
    """The managers of a session and its state; the stages of a step read and change it.

    `start` creates the managers; before it a session costs nothing but its scene.

    Parameters
    ----------
    gravity: (3,) m/s², on parts with mass.
    judge: rule called for each new candidate.
    make_hand: creates a hand of a name and world pose.
    """

    def __init__(
        self,
        scene: Scene,
        tolerance: Tolerance,
        gravity: NDArray[np.float64],
        judge: Judge,
        make_hand: Callable[[str, pin.SE3], Gripper],
    ) -> None:
        super().__init__()
        self.scene = scene
        self.tolerance = tolerance
        self.started = False
        self.dynamics: Dynamics | None = None
        """None until a part gets mass"""
        self.hands: dict[str, Gripper] = {}
        self.initial: frozenset[Any] = frozenset()
        """keys of the constraints recognised in the initial assembly"""
        self.boxes: dict[int, tuple[Groups, NDArray[np.float64]]] = {}
        """cache by object: its carried groups, and the corners (n, 3) of their boxes in its frame, m"""
        self.recognised: tuple[Tolerance, NDArray[Any], tuple[pin.SE3, ...]] | None = None
        """cache: inputs of the last recognition without hand motion and forces; None if it must run again"""
        self.gripped: tuple[tuple[str, tuple[str, ...], bool], ...] | None = None
        """cache: grips of the last step, of held part, carried parts, whether rigid; None: unknown"""
        self._made: dict[str, Gripper] = {}  # all hands ever made, so that each stays the same object
        self._authorised: AuthorisedPairs | None = None
        self.meanings: tuple[Meaning, ...] = ()
        """what overlaps as drawn mean, of parts with an axis: found at the start"""
        self._gravity = gravity
        self._judge = judge
        self._make_hand = make_hand
        self._on_drop: list[Callable[[], None]] = []
        self._placed: object = None  # `Part.placed` when all parts were known to be in this session
        for i, part in enumerate(scene.parts):
            part.enter(self, i)

    # ---- the managers

    def start(self) -> None:
        """Create the managers at the present poses; the first step calls this."""
        if self.started:
            return
        scene = self.scene
        self.names = scene.names
        self.number = {name: i for i, name in enumerate(self.names)}
        self.collision = CollisionManager(self.tolerance)
        for i, part in enumerate(scene.parts):
            self.collision.add(part.mesh, part.pose, movable=not part.fixed)
            part.enter(self, i)
        for a, b in (*self.authorised, *self.ignored):
            self.collision.ignore(a, b)
        features, threads = threaded_features(scene)
        fixed = [i for i, part in enumerate(scene.parts) if part.fixed]
        self.mates = ConstraintManager(
            features, self.tolerance, threads=threads, named=named_threads(scene), rules=[self._judge], fixed=fixed
        )
        self.motion = ConstrainedMotion(self.collision, self.mates, self.tolerance, drawn=self.poses)
        self.motion.barrier = self._authorised_stop
        self._leave_out_meant()
        near = self._recognise_as_it_stands()
        found = self.misfits(near)
        self.motion.jammed = {(m.pair[0], m.pair[2]): -m.fit.gap for m in found}
        self.colliding = np.unique(np.concatenate([self.collision.colliding_surfaces(), rows_of(found)]), axis=0)
        first, at_rest = self.state, HandMotion("", None, None)
        self._first = replace(first, hands={name: replace(h, motion=at_rest) for name, h in first.hands.items()})
        self.started = True  # set last, so that an interrupted start is repeated

    def _leave_out_meant(self) -> None:
        """Leave the surfaces of overlaps that are meant out of collision; `AuthorisedPairs` sweeps them instead.

        Pairs that are authorised or ignored are left out as a whole.
        """
        known = {*self.authorised, *self.ignored}
        analysis = analysis_of(self.scene, self.tolerance)
        rows = self.collision.contacts(analysis.within_deflection)
        pairs = sorted({*zip(rows["object_a"].tolist(), rows["object_b"].tolist(), strict=True)} - known)
        self.meanings = meanings_of(self.scene, analysis).between(pairs)
        for meaning in self.meanings:
            assert meaning.fit is not None
            a, b = meaning.parts
            hollow = b if meaning.solid == a else a
            everything = range(self.collision.mesh(hollow).n_surfaces)
            self.motion.mated.leave_out((meaning.solid, meaning.fit.surfaces, hollow, tuple(everything)))

    def held_by(self, group: Collection[int]) -> tuple[HeldOverlap, ...]:
        """Overlaps that are meant between objects of a group and others, which hold them now; threads first."""
        out = []
        for meaning in self.meanings:
            a, b = meaning.parts
            if (a in group) == (b in group) or meaning.fit is None:
                continue
            moved = [self.poses[i] * self.motion.drawn[i].inverse() for i in (a, b)]
            if not meaning.engaged(moved[1].actInv(moved[0])):
                continue
            at = moved[0] if meaning.solid == a else moved[1]
            origin, axis = meaning.fit.line
            way_in = 0.0 if not meaning.driven else 1.0 if meaning.part in group else -1.0
            other = self.names[b if a in group else a]
            out.append(HeldOverlap(meaning, other, np.asarray(at.act(origin)), at.rotation @ axis, -way_in))
        return tuple(sorted(out, key=lambda held: held.meaning.kind != "thread"))

    def _recognise_as_it_stands(self) -> NDArray[Any]:
        """Recognise the exact fits of the initial assembly without moving parts; return the contact rows."""
        self.mates.tolerance = replace(self.tolerance, reach=0.0, reach_angular=0.0)
        rows = self.collision.contacts(self.mates.within)
        changes = self.mates.update(self.poses, rows, {})
        self.untold = tuple(self.event(change) for change in changes)
        self.initial = frozenset(change.candidate.key for change in changes)
        self.joined = frozenset(self.pair(change.candidate) for change in changes if change.kind == "accepted")
        self.mates.tolerance = self.tolerance
        self.motion.sync()
        open_pairs = {c.bodies for d in (self.mates.candidates, self.mates.refused) for c in d.values()}
        pairs = zip(rows["object_a"].tolist(), rows["object_b"].tolist(), strict=True)
        self.rows = rows[np.array([pair in open_pairs for pair in pairs], dtype=bool)]
        return rows

    def misfits(self, rows: NDArray[Any] | None = None) -> tuple[Misfit, ...]:
        """Shafts in bores that clash now, also where no facets intersect; without mated and authorised pairs.

        rows: contacts at the present poses, if they are known.
        """
        slack = [float(deflections(part.shape).max(initial=0.0)) for part in self.scene.parts]
        limits = Limits.offer(replace(self.tolerance, reach=0.0, reach_angular=0.0))
        rows = self.collision.contacts(self.mates.within) if rows is None else rows
        meshes = [part.mesh for part in self.scene.parts]
        return misfits(self.mates.recogniser, meshes, self.poses, rows, limits, slack)

    def event(self, change: Change) -> NewEvent:
        """Return the event of a change in the constraint manager."""
        candidate = change.candidate
        a, b = self.pair(candidate)
        data = {"id": change.id, "constraint": candidate.kind, "residual": candidate.residual}
        text = f"{candidate.kind} between {a} and {b}: {change.text}"
        return NewEvent(change.kind, (a, b), candidate.surfaces, text, data)

    def pair(self, candidate: Candidate) -> tuple[str, str]:
        """Return the names of a candidate's parts."""
        a, b = candidate.bodies
        return self.names[a], self.names[b]

    def authorise(self, a: int, b: int) -> None:
        """Let a pair of objects overlap as drawn: it is no clash, and motions never deepen it."""
        self.authorised = self._without_collision(self.authorised, a, b)

    def ignore(self, a: int, b: int) -> None:
        """Let a pair of objects pass through each other."""
        self.ignored = self._without_collision(self.ignored, a, b)

    def _without_collision(self, pairs: tuple[tuple[int, int], ...], a: int, b: int) -> tuple[tuple[int, int], ...]:
        if self.started:
            self.collision.ignore(a, b)
        self.searched = {}
        return tuple(dict.fromkeys((*pairs, (min(a, b), max(a, b)))))

    @property
    def passing(self) -> tuple[tuple[int, int], ...]:
        """The pairs of objects that may pass through each other: those ignored, and authorised ones that forces move,
        which know of no overlap as drawn."""
        forced = () if self.dynamics is None else self.dynamics.bodies
        return tuple(dict.fromkeys((*self.ignored, *(p for p in self.authorised if p[0] in forced or p[1] in forced))))

    def _authorised_stop(
        self, poses: Sequence[pin.SE3], target: Mapping[int, pin.SE3]
    ) -> tuple[float, NDArray[Any]] | None:
        """Where and by what the overlap of an authorised pair stops a motion, see `AuthorisedPairs.stop`."""
        meant = frozenset(meaning.parts for meaning in self.meanings).difference(self.authorised)
        pairs = [pair for pair in (*self.authorised, *sorted(meant)) if pair not in self.ignored]
        if not pairs:
            return None
        known = self._authorised
        if (
            known is None
            or known.drawn is not self.motion.drawn
            or known.threads != self.threads
            or known.meant != meant
        ):
            known = AuthorisedPairs(self.scene, self.motion.drawn, self.tolerance, self.threads, meant)
            self._authorised = known
        return known.stop(pairs, poses, target)

    def behave(
        self, i: int, body: Body, behaviours: Sequence[Behaviour], material: Material | str | None = None
    ) -> None:
        """Give a part mass, behaviours and a material: forces move it whenever no hand holds it."""
        self.start()
        if self.dynamics is None:
            self.dynamics = Dynamics(self.scene, self.collision, self.tolerance, self._gravity)
        self.dynamics.add(i, body, behaviours, material)

    def on_drop(self, forget: Callable[[], None]) -> None:
        """Call `forget` whenever caches are dropped."""
        self._on_drop.append(forget)

    # ---- poses

    @property
    def poses(self) -> tuple[pin.SE3, ...]:
        """Poses of all parts, in scene order; a pose object stays the same until its part moves."""
        return self.collision.poses

    def pose(self, i: int) -> pin.SE3 | None:
        """Return a copy of a part's pose; None before `start`."""
        return self.collision.pose(i) if self.started else None

    def keep_parts(self) -> None:
        """Attach parts again that another session has left; they return to their poses in this state.

        Raises VpframeError while another session has them.
        """
        if self._placed is Part.placed:
            return
        for i, part in enumerate(self.scene.parts):
            mine = part.is_placed_by(self)
            if mine is False:
                raise VpframeError(
                    f"{part.name} is in another session, opened later on the same parts; close that before this one "
                    "goes on, or load the model once for each session"
                )
            if mine is None:
                part.enter(self, i)
        self._placed = Part.placed

    def leave(self) -> None:
        """Detach the parts: each keeps its present pose."""
        for part in self.scene.parts:
            part.leave(self)

    def in_force(self) -> dict[int, Constraint]:
        """Return the constraints in force, by id."""
        return {id: entry.candidate.constraint for id, entry in self.mates.accepted.items()}

    # ---- state

    @property
    def state(self) -> State:
        """The present state. Assigning an earlier one goes back to it, also from within an interrupted step; parts must
        not have been given mass in between."""
        objects = self.collision.snapshot
        return State(
            values=Values(*_kept(self)),
            poses=objects.poses,
            drawn=self.motion.drawn,
            carried=self.motion.groups.seats,
            mates=self.mates.snapshot,
            hands={name: _hand_state(h) for name, h in self.hands.items()},
            dynamics=None if self.dynamics is None else self.dynamics.snapshot,
            objects=objects,
        )

    @state.setter
    def state(self, state: State) -> None:
        passed = {*self.authorised, *self.ignored}
        for name in _KEPT:
            setattr(self, name, getattr(state.values, name))
        self._take_hands(state.hands)
        self.mates.snapshot, self.mates.tolerance = state.mates, self.tolerance
        self._place(state)
        if self.dynamics is not None and state.dynamics is not None:
            self.dynamics.go_to(state.dynamics, self.in_force())
            self._place(state)  # physics moves parts of other poses, and keeps those of held ones with rounding
        if self.motion.groups.seats is not state.carried:
            self.motion.regroup(Groups(state.carried))
        if self.motion.drawn is not state.drawn:
            self.motion.redraw(state.drawn)
        passing = {*self.authorised, *self.ignored}
        for pair in passed - passing:
            self.collision.enable(*pair)
        for pair in passing:
            self.collision.ignore(*pair)
        self.motion.sync()
        self.drop_caches()

    def _place(self, state: State) -> None:
        """Bring all parts to the poses of a state."""
        if state.objects is not None:
            self.collision.snapshot = state.objects
            return
        self.collision.set_poses(range(len(state.poses)), unpack_all(state.poses))

    def _take_hands(self, hands: Mapping[str, HandState]) -> None:
        """Bring the hands to their states; those that are not among `hands` open."""
        self._made |= self.hands
        for name in self.hands.keys() - hands.keys():
            hand = self.hands.pop(name)
            hand.held, hand.surfaces, hand.carried, hand.stopped_by = None, (), (), ""
        self.hands.clear()
        for name, there in hands.items():
            self.hands[name] = hand = self._made.get(name) or self._make_hand(name, there.pose)
            for of in _OF_HAND:
                setattr(hand, of, getattr(there, of))
            if there.motion is not None:
                hand.doing, hand.segment, hand.wanted = there.motion

    def drop_caches(self) -> None:
        """Forget all that can be computed again; the next steps give the same bytes."""
        self.recognised = self.gripped = None
        self.boxes.clear()
        self.mates.drop_caches()
        self.motion.drop_caches()
        for forget in self._on_drop:
            forget()

    def restart(self) -> None:
        """Return to the start of the session: initial poses and constraints, all at rest, no hands.

        Masses, behaviours, threads, authorised and ignored pairs are kept.
        """
        self.start()
        kept = {name: getattr(self, name) for name in ("threads", "authorised", "ignored")}
        self.state = replace(self._first, values=replace(self._first.values, **kept))
        if self.dynamics is not None:
            self.dynamics.restart(self.in_force())

    def save(self) -> bytes:
        """Return the state as bytes."""
        self.start()
        state = self.state
        if self.dynamics is not None:
            state = replace(state, dynamics=self.dynamics.saved())
        return saved(self.scene, state)

    def restore(self, data: bytes) -> None:
        """Restore the bytes that `save` returned, in this or another process; the run continues bit for bit.

        The session must have the same scene, tolerance, rule, masses and behaviours. Raises StateError, and changes
        nothing, if the bytes are damaged or belong to another scene.
        """
        self.start()
        there = loaded(self.scene, data)
        if (there.dynamics is None) != (self.dynamics is None):
            raise damaged(ValueError("which parts have behaviours is not of this scene"))
        before = self.state
        try:
            self.state = there
        except BaseException as error:
            self.state = before
            if isinstance(error, WRONG):
                raise damaged(error) from None
            raise

    def follow(self, changes: Changes) -> None:
        """Take over the changes of a recorded step, so that queries return its results.

        Raises
        ------
        ValueError, TypeError, LookupError: the changes are damaged or of another scene.
        """
        require_changes(self.scene, changes)
        poses = {self.scene.index(name): pose for name, pose in changes.poses.items()}
        self.last = {i: self.poses[i] for i in poses}
        for i, pose in poses.items():
            self.collision.set_pose(i, pose)
        if changes.mates is not None:
            self.mates.snapshot = changes.mates
            self.motion.sync()
        self.clearance, self.searched = changes.clearance, {}
        self.step += 1


def _hand_state(hand: Gripper) -> HandState:
    return HandState(*(*_of_hand(hand), HandMotion(*_of_motion(hand))))
