"""`State`: all data that changes while a session runs.

A `Scene` is the model and never changes. The state holds the poses (in the collision manager, with a version each),
constraints in force, offered and refused, velocities and sleep, contacts, grips of hands, the script's decisions for
the next step, and the time. Three ways to restore it:

    mark = state.mark();  state.undo(mark)      within a process, in microseconds: undoes a failed step
    data = state.save();  state.restore(data)   bytes, also for another process: continues bit for bit
    state.reset()                               start of the session
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from operator import attrgetter
from typing import Any, NamedTuple, get_type_hints

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CONTACT_DTYPE, CollisionManager, Tolerance
from constraints import ConstraintManager, kinds
from constraints.geometry.surfaces import Cone, Cylinder, Freeform, Plane, Sphere, Torus
from constraints.geometry.views import Limits
from constraints.kinds import Constraint
from constraints.manager import Accepted, Change
from constraints.motion.motion import Motion
from constraints.recognition.candidate import Candidate, Key, Match
from constraints.recognition.misfits import Misfit, misfits
from constraints.solve.groups import Groups
from physics import Behaviour, Body, Material, SpringHand
from vpframe.analysis.static import named_threads, threaded_features
from vpframe.codec import WRONG, Codec, CodecError, Packing, conforms
from vpframe.errors import VpframeError
from vpframe.events import ConstraintView, NewEvent
from vpframe.hands.arguments import rigid
from vpframe.hands.gripper import Gripper
from vpframe.scene.deflection import deflections
from vpframe.scene.scene import Scene
from vpframe.session.authorised import AuthorisedPairs
from vpframe.session.dynamics import Dynamics

NO_PAIRS = np.zeros((0, 4), np.int32)
FARTHEST = 1e12
"""m: greatest coordinate of a part in a saved state"""
GREATEST = 1e30
"""greatest number in a saved state, SI units"""
COLUMNS = ("object_a", "surface_a", "object_b", "surface_b")
Judge = Callable[[Candidate], bool | None]
"""rule for a candidate: True accepts, False refuses, None leaves it on offer"""


@dataclass(frozen=True)
class Decision:
    """A decision about a candidate or constraint: "accept", "refuse", "remove" or "impose"."""

    verb: str
    id: int
    limits: tuple[tuple[str, float], ...] = ()
    """limits of an accepted constraint: "break_distance" (m), "break_force" (N)"""
    stated: Candidate | None = None
    """for "impose": the stated constraint"""


@dataclass(frozen=True, eq=False)
class Changes:
    """Result of a step, by value; `poses` contains only parts that moved."""

    poses: Mapping[str, pin.SE3]
    colliding: NDArray[np.int32]
    touching: NDArray[np.int32]
    """(k, 4) object, surface, object, surface in contact, for parts that were ever held, without mated surfaces"""
    constraints: Sequence[ConstraintView]
    freedom: Mapping[str, int]
    joint: Mapping[str, str]
    clearance: float | None
    blocked: Mapping[str, str]
    """held parts stopped by solid bodies, each with a text that names the obstacles"""
    events: tuple[NewEvent, ...]
    mates: Mapping[str, Any] | None = None
    """state of the constraint manager, if it changed"""
    way: tuple[Mapping[str, pin.SE3], ...] = ()
    """poses of the moved parts where their way bends within the step, in order"""
    timings: Mapping[str, float] = field(default_factory=dict)


def rows_of(found: Iterable[Misfit]) -> NDArray[np.int32]:
    """(k, 4) object, surface, object, surface of shafts and bores that clash."""
    rows = [(m.pair[0], i, m.pair[2], j) for m in found for i, j in m.faces]
    return np.array(rows, np.int32).reshape(-1, 4)


def _pose(rows: NDArray[np.float64]) -> pin.SE3:
    if not isinstance(rows, np.ndarray) or rows.shape != (3, 4) or rows.dtype != np.float64:
        raise ValueError("a pose is no (3, 4) matrix")
    return rigid(pin.SE3(rows[:, :3], rows[:, 3]), "a pose")


def _new_event(fields: tuple[Any, ...]) -> NewEvent:
    hints = get_type_hints(NewEvent).values()
    if len(fields) != len(hints) or not all(map(conforms, fields, hints)):
        raise ValueError("an event has other fields")
    return NewEvent(*fields)


CODEC = Codec(
    [
        *(Plane, Cylinder, Cone, Sphere, Torus, Freeform, kinds.Line, kinds.Point, kinds.Circle),
        *(kinds.Against, kinds.Angle, kinds.Belt, kinds.Concentric, kinds.Conical, kinds.Contact, kinds.Coplanar),
        *(kinds.Distance, kinds.Fixed, kinds.Gear, kinds.Groove, kinds.Offset, kinds.Parallel, kinds.Perpendicular),
        *(kinds.RackAndPinion, kinds.Screw, kinds.Spherical, kinds.Tangent, kinds.Toroidal),
        *(Match, Candidate, Accepted, Change, ConstraintView, Changes, Decision, SpringHand),
    ],
    {
        pin.SE3: Packing(lambda pose: np.ascontiguousarray(pose.homogeneous[:3]), _pose),
        NewEvent: Packing(tuple, _new_event),
    },
)
"""encoding of steps and states"""


class StateError(VpframeError):
    """A saved state is damaged or belongs to another scene."""


class Mark(NamedTuple):
    """Data kept by `State.mark`: references and small copies."""

    own: tuple[Any, ...]
    hands: list[tuple[str, Gripper, tuple[Any, ...]]]
    collision: Any
    mates: Any
    motion: Any
    dynamics: Any


class State:
    """All data of a session that changes.

    `start` creates the managers; before it a session costs nothing but its scene. The values below are replaced, never
    changed in place, because marks refer to them.

    Parameters
    ----------
    gravity: (3,) m/s², on parts with mass.
    judge: rule called for each new candidate.
    make_hand: creates a hand of a name and world pose in `hands`.
    """

    _OWN = (
        "step", "decisions", "authorised", "ignored", "threads", "held", "moved", "blocked", "rows", "colliding",
        "joined", "targets", "last", "untold", "remated", "decided", "renewed", "gripped",
    )  # fmt: skip
    _HAND = ("pose", "held", "grip", "surfaces", "carried", "stopped_by", "doing", "segment", "clock", "wanted")
    _values = staticmethod(attrgetter(*_HAND))

    def __init__(
        self,
        scene: Scene,
        tolerance: Tolerance,
        gravity: NDArray[np.float64],
        judge: Judge,
        make_hand: Callable[[str, pin.SE3], Gripper],
    ) -> None:
        self.scene = scene
        self.tolerance = tolerance
        self.started = False
        self.dynamics: Dynamics | None = None
        """None until a part gets mass"""
        self.hands: dict[str, Gripper] = {}
        self.threads: Mapping[int, float] = {}
        """pitch declared by the script, m a turn, negative for left-hand threads, by object"""
        self.authorised: tuple[tuple[int, int], ...] = ()
        """pairs of objects, a < b, whose overlap as drawn is meant; it is never deepened"""
        self.ignored: tuple[tuple[int, int], ...] = ()
        """pairs of objects, a < b, that may pass through each other"""
        self._authorised: AuthorisedPairs | None = None
        self.decisions: tuple[Decision, ...] = ()
        """the script's decisions for the next step"""
        self.boxes: dict[int, tuple[Groups, NDArray[np.float64]]] = {}
        """cache by object: its carried groups, and the corners (n, 3) of their boxes in its frame, m"""
        self._gravity = gravity
        self._judge = judge
        self._make_hand = make_hand
        self._on_change: list[Callable[[], None]] = []
        self._begin()
        for i, part in enumerate(scene.parts):
            part.enter(self, i)

    def _begin(self) -> None:
        self.recognised: tuple[Tolerance, NDArray[Any], tuple[pin.SE3, ...]] | None = None
        """inputs of the last recognition without hand motion and forces; None if it must run again"""
        self.step = 0
        """number of steps taken"""
        self.held: frozenset[int] = frozenset()
        """objects that a hand holds or carries"""
        self.moved: frozenset[int] = frozenset()
        """objects that have ever moved or been held"""
        self.blocked: Mapping[str, str] = {}
        """held parts stopped by solid bodies, each with a text that names the obstacles"""
        self.rows: NDArray[Any] = np.zeros(0, CONTACT_DTYPE)
        """contact rows of the objects in `moved`, within the distance that recognition needs"""
        self.gripped: tuple[tuple[str, tuple[str, ...], bool], ...] | None = None
        """grips of the last step: held part, carried parts, whether rigid; None: unknown"""
        self.renewed = np.full(len(self.scene), -1, np.int64)
        """(n,) version of each object's pose at which its contact rows were computed"""
        self.colliding: NDArray[np.int32] = NO_PAIRS
        self.joined: frozenset[tuple[str, str]] = frozenset()
        """pairs of parts that an accepted constraint has ever joined"""
        self.targets: Mapping[int, pin.SE3] = {}
        """target poses of the hands in the last step"""
        self.last: Mapping[int, pin.SE3] = {}
        """poses before the last step of the objects it moved"""
        self.untold: tuple[NewEvent, ...] = ()
        """events found by `start`, reported by the first step"""
        self.remated: frozenset[int] = frozenset()
        """objects whose mated surfaces changed since the colliding surfaces were last computed"""
        self.standing: frozenset[Any] = frozenset()
        """keys of the constraints recognised in the initial assembly"""
        self.decided = False
        """whether a decision was made since the last recognition"""

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
        self.motion = Motion(self.collision, self.mates, self.tolerance, drawn=self.poses)
        self.motion.barrier = self._authorised_stop
        near = self._recognise_as_it_stands()
        found = self.misfits(near)
        self.motion.jammed = {(m.pair[0], m.pair[2]): -m.fit.gap for m in found}
        self.colliding = np.unique(np.concatenate([self.collision.colliding_surfaces(), rows_of(found)]), axis=0)
        self.started = True  # set last, so that an interrupted start is repeated
        self._first = self.mark()

    def _recognise_as_it_stands(self) -> NDArray[Any]:
        """Recognise the exact fits of the initial assembly without moving parts; return the contact rows."""
        self.mates.tolerance = replace(self.tolerance, reach=0.0, reach_angular=0.0)
        rows = self.collision.contacts(self.mates.within)
        changes = self.mates.update(self.poses, rows, {})
        self.untold = tuple(self.event(change) for change in changes)
        self.standing = frozenset(change.candidate.key for change in changes)
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
        near = self.mates.recogniser.near(self.collision.contacts(self.mates.within) if rows is None else rows)
        meshes = [part.mesh for part in self.scene.parts]
        return misfits(self.mates.recogniser, meshes, self.poses, near, limits, slack)

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
        pairs = [pair for pair in self.authorised if pair not in self.ignored]
        if not pairs:
            return None
        known = self._authorised
        if known is None or known.drawn is not self.motion.drawn or known.threads != self.threads:
            known = AuthorisedPairs(self.scene, self.motion.drawn, self.tolerance, self.threads)
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

    def on_change(self, forget: Callable[[], None]) -> None:
        """Call `forget` whenever an earlier state is restored, so that derived data is dropped."""
        self._on_change.append(forget)

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
        for i, part in enumerate(self.scene.parts):
            mine = part.is_placed_by(self)
            if mine is False:
                raise VpframeError(
                    f"{part.name} is in another session, opened later on the same parts; close that before this one "
                    "goes on, or load the model once for each session"
                )
            if mine is None:
                part.enter(self, i)

    def leave(self) -> None:
        """Detach the parts: each keeps its present pose."""
        for part in self.scene.parts:
            part.leave(self)

    def in_force(self) -> dict[int, Constraint]:
        """Return the constraints in force, by id."""
        return {id: entry.candidate.constraint for id, entry in self.mates.accepted.items()}

    # ---- mark, undo, reset

    def mark(self) -> Mark:
        """Return a mark of the present state; `undo(mark)` goes back to it."""
        return Mark(
            tuple(getattr(self, name) for name in self._OWN),
            [(name, hand, self._values(hand)) for name, hand in self.hands.items()],
            self.collision.mark(),
            self.mates.mark(),
            self.motion.mark(),
            None if self.dynamics is None else self.dynamics.mark(),
        )

    def undo(self, mark: Mark) -> None:
        """Go back to a mark, also after an interrupted step; parts must not have been given mass in between."""
        for name, value in zip(self._OWN, mark.own, strict=True):
            setattr(self, name, value)
        self.hands.clear()
        for name, hand, values in mark.hands:
            self.hands[name] = hand
            for field_name, value in zip(self._HAND, values, strict=True):
                setattr(hand, field_name, value)
        if self.dynamics is not None and mark.dynamics is not None:
            self.dynamics.undo(mark.dynamics)
        self.collision.undo(mark.collision)
        self.mates.undo(mark.mates)
        self.motion.undo(mark.motion)
        self._changed()

    def reset(self) -> None:
        """Return to the start of the session: initial poses and constraints, all at rest, no hands.

        Masses, behaviours, threads, authorised and ignored pairs are kept.
        """
        self.start()
        authorised, ignored, threads = self.authorised, self.ignored, self.threads
        for hand in self.hands.values():
            hand.held, hand.surfaces, hand.carried, hand.stopped_by = None, (), (), ""
        self.undo(self._first)
        self.threads = threads
        self.authorised, self.ignored = authorised, ignored
        for a, b in (*authorised, *ignored):
            self.collision.ignore(a, b)
        if self.dynamics is not None:
            self.dynamics.reset(self.in_force())

    def _changed(self) -> None:
        self.recognised = None
        for forget in self._on_change:
            forget()

    # ---- save and restore

    def save(self) -> bytes:
        """Return all data on which the next steps depend, except scene, behaviours and rules, as bytes."""
        return CODEC.encode(self.data())

    def data(self) -> dict[str, Any]:
        """Return the data of `save` before encoding."""
        self.start()
        return {
            "schema": CODEC.schema,
            "parts": list(self.names),
            "step": self.step,
            "poses": list(self.poses),
            "drawn": list(self.motion.drawn),
            "mates": self.mates.state(),
            "rows": self.rows,
            "colliding": self.colliding,
            "active": set(self.held),
            "moved": set(self.moved),
            "blocked": dict(self.blocked),
            "joined": sorted(self.joined),
            "last_wanted": dict(self.targets),
            "last": dict(self.last),
            "carried": dict(self.motion.groups.seats),
            "untold": list(self.untold),
            "remated": set(self.remated),
            "decided": self.decided,
            "decisions": list(self.decisions),
            "authorised": list(self.authorised),
            "ignored": list(self.ignored),
            "threads": dict(self.threads),
            "hands": {
                name: (h.pose, h.held, h.grip, h.surfaces, h.carried, h.stopped_by, float(h.clock))
                for name, h in self.hands.items()
            },
            "dynamics": None if self.dynamics is None else self.dynamics.state(),
        }

    def restore(self, saved: bytes) -> None:
        """Restore the bytes that `save` returned, in this or another process; the run continues bit for bit.

        The session must have the same scene, tolerance, rule, masses and behaviours. Raises StateError, and changes
        nothing, if the bytes are damaged or belong to another scene.
        """
        try:
            data = CODEC.decode(saved)
        except CodecError as error:
            raise StateError(str(error)) from None
        self.restore_data(data)

    def restore_data(self, data: Mapping[str, Any]) -> None:
        """Restore the values that `data` returned; raises as `restore` does."""
        self.start()
        before = self.mark()
        try:
            self._adopt(data)
        except BaseException as error:
            self.undo(before)
            if isinstance(error, WRONG):
                what = " ".join(str(error).split()) or type(error).__name__
                raise StateError(f"damaged: {what}") from None
            raise

    def _adopt(self, data: Mapping[str, Any]) -> None:
        self._require_data(data)
        self.mates.restore(data["mates"])
        poses = data["poses"]
        self.collision.set_poses(range(len(poses)), poses)
        if self.dynamics is not None:
            self.dynamics.restore(data["dynamics"], self.in_force())
            self.collision.set_poses(range(len(poses)), poses)  # dynamics stores poses of carried parts with rounding
        self.motion.sync()
        for a, b in (*self.authorised, *self.ignored):
            self.collision.enable(a, b)
        for a, b in (*data["authorised"], *data["ignored"]):
            self.collision.ignore(a, b)
        self.motion.regroup(Groups(dict(data["carried"])))
        self.motion.redraw(data["drawn"])
        self.step, self.rows, self.colliding = data["step"], data["rows"], data["colliding"]
        self.held, self.moved, self.blocked = frozenset(data["active"]), frozenset(data["moved"]), data["blocked"]
        self.joined, self.targets, self.untold = frozenset(data["joined"]), data["last_wanted"], tuple(data["untold"])
        self.last, self.renewed, self.gripped = data["last"], np.full(len(self.names), -1, np.int64), None
        self.remated, self.decided = frozenset(data["remated"]), data["decided"]
        self.decisions = tuple(data["decisions"])
        self.authorised, self.ignored = tuple(data["authorised"]), tuple(data["ignored"])
        self.threads = data["threads"]
        for name in [name for name in self.hands if name not in data["hands"]]:
            hand = self.hands.pop(name)
            hand.held, hand.surfaces, hand.carried, hand.stopped_by = None, (), (), ""
        for name, values in data["hands"].items():
            hand = self.hands.get(name) or self._make_hand(name, values[0])
            hand.pose, hand.held, hand.grip, hand.surfaces, hand.carried, hand.stopped_by, hand.clock = values
        self._changed()

    def follow(self, changes: Changes) -> None:
        """Apply the changes of a recorded step, so that queries return its results.

        Raises
        ------
        ValueError, TypeError, LookupError: the changes are damaged or of another scene.
        """
        _require(isinstance(changes, Changes), "result")
        self._require_rows(changes.colliding)
        self._require_rows(changes.touching)
        named = (*changes.freedom, *changes.joint, *(name for view in changes.constraints for name in view.parts))
        for name in (*named, *(name for poses in changes.way for name in poses)):
            self.scene.index(name)
        if changes.mates is not None:
            self._require_mates(changes.mates)
        poses = {self.scene.index(name): pose for name, pose in changes.poses.items()}
        self.last = {i: self.poses[i] for i in poses}
        for i, pose in poses.items():
            self.collision.set_pose(i, pose)
        if changes.mates is not None:
            self.mates.restore(changes.mates)
            self.motion.sync()

    # ---- checks of data from files

    def _require_data(self, data: Mapping[str, Any]) -> None:
        if data["schema"] != CODEC.schema:
            raise ValueError("it was saved by another version of vpframe")
        for name, hint in _DATA.items():
            _require(conforms(data[name], hint), name)
        for name, value in data.items():
            _require_numbers(value, name)
        _require(data["step"] >= 0, "step")
        _require(len(data["poses"]) == len(self.names) and tuple(data["parts"]) == self.names, "list of parts")
        _require(len(data["drawn"]) == len(self.names), "list of parts")
        _require(data["rows"].dtype == CONTACT_DTYPE and data["rows"].ndim == 1, "rows")
        rows = data["rows"]
        self._require_rows(np.stack([rows[c] for c in COLUMNS], axis=1))
        self._require_rows(data["colliding"])
        self._require_mates(data["mates"])
        for name in ("active", "moved", "last_wanted", "last", "remated", "threads"):
            self._require_parts(data[name])
        self._require_parts([*data["carried"], *(i for i, _ in data["carried"].values())])
        _require(all(i not in data["carried"] for i, _ in data["carried"].values()), "what is carried")
        self._require_parts([i for name in ("authorised", "ignored") for pair in data[name] for i in pair])
        _require(bool((data["rows"]["distance"] >= 0.0).all()), "rows")
        _require(all(pitch != 0.0 for pitch in data["threads"].values()), "threads")
        for decision in data["decisions"]:
            _require(decision.verb in ("accept", "refuse", "remove", "impose"), "a decision")
            if decision.stated is not None:
                self._require_candidate(decision.stated)
        held = [name for _, held, _, _, carried, _, _ in data["hands"].values() for name in (held, *carried) if name]
        clocks = [values[6] for values in data["hands"].values()]
        _require(min(clocks, default=0.0) >= 0.0, "the time of a hand")
        _require(all(name in self.number for name in held), "what a hand holds")
        _require((data["dynamics"] is None) == (self.dynamics is None), "which parts have behaviours")

    def _require_parts(self, ids: Iterable[int]) -> None:
        _require(all(0 <= i < len(self.names) for i in ids), "an object's number")

    def _require_rows(self, rows: NDArray[Any]) -> None:
        """Raise ValueError unless rows (k, 4) of object, surface, object, surface are in range."""
        _require(rows.ndim == 2 and rows.shape[1] == 4, "rows")
        surfaces = np.array([part.mesh.n_surfaces for part in self.scene.parts])
        for objects, of_them in ((rows[:, 0], rows[:, 1]), (rows[:, 2], rows[:, 3])):
            _require(bool(((objects >= 0) & (objects < len(surfaces))).all()), "an object's number")
            _require(bool(((of_them >= 0) & (of_them < surfaces[objects])).all()), "a surface's number")

    def _require_mates(self, state: Mapping[str, Any]) -> None:
        for name, hint in _MATES.items():
            _require(conforms(state[name], hint), name)
        _require(len(state["poses"]) in (0, len(self.names)), "poses")
        offered = (c for name in ("candidates", "refused", "pulled") for c in state[name].values())
        in_force = (entry.candidate for entry in state["accepted"].values())
        for c in (*offered, *in_force, *(change.candidate for change in state["pending"])):
            self._require_candidate(c)

    def _require_candidate(self, c: Candidate) -> None:
        _require(c.constraint.bodies == c.bodies and type(c.match.local) is np.ndarray, "a constraint")
        self._require_parts(c.bodies)


_HAND = tuple[pin.SE3, str | None, pin.SE3, tuple[int, ...], tuple[str, ...], str, float]
_DATA: dict[str, Any] = {
    "parts": list[str],
    "step": int,
    "poses": list[pin.SE3],
    "drawn": list[pin.SE3],
    "mates": dict[str, Any],
    "rows": NDArray[Any],
    "colliding": NDArray[np.int32],
    "active": set[int],
    "moved": set[int],
    "blocked": dict[str, str],
    "joined": list[tuple[str, str]],
    "last_wanted": dict[int, pin.SE3],
    "last": dict[int, pin.SE3],
    "carried": dict[int, tuple[int, pin.SE3]],
    "untold": list[NewEvent],
    "remated": set[int],
    "decided": bool,
    "decisions": list[Decision],
    "authorised": list[tuple[int, int]],
    "ignored": list[tuple[int, int]],
    "threads": dict[int, float],
    "hands": dict[str, _HAND],
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
"""types of the data in a saved state"""


def _require_numbers(value: Any, what: str) -> None:
    """Raise ValueError for a number anywhere in a saved value that no session has: not finite, or beyond `GREATEST`."""
    if isinstance(value, float | np.floating):
        unlimited = what.endswith(("break_force", "break_distance")) and value == np.inf
        holds = unlimited or abs(float(value)) <= GREATEST
    elif isinstance(value, np.ndarray):
        for name in value.dtype.names or ():
            _require_numbers(value[name], f"{what}, {name}")
        holds = value.dtype.kind != "f" or bool((np.abs(value) <= GREATEST).all())
    elif isinstance(value, pin.SE3):
        holds = bool((np.abs(value.translation) <= FARTHEST).all())
    elif isinstance(value, Mapping):
        holds = True
        for key, item in value.items():
            _require_numbers(item, f"{what}, {key}" if isinstance(key, str) else what)
    elif isinstance(value, list | tuple | set | frozenset):
        holds = True
        for item in value:
            _require_numbers(item, what)
    else:
        holds = True
        for f in fields(value) if is_dataclass(value) else ():
            _require_numbers(getattr(value, f.name), f"{what}, {f.name}")
    if not holds:
        raise ValueError(f"{what} holds a number that is not finite or too great")


def _require(holds: bool, what: str) -> None:
    if not holds:
        raise ValueError(f"{what} is not of this scene")
