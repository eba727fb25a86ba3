"""`State`: all that changes while a session runs, as one value; `Changes`: the result of a step; how both are saved.

The scene is the model and never changes. A `State` is never changed either: undoing is keeping an earlier one and
assigning it to `Engine.state`. `saved` and `loaded` convert it to bytes and back, for files and other processes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, NamedTuple, get_type_hints

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CONTACT_DTYPE, ObjectsState
from collision.contact import surfaces_of
from collision.poses import unpack_all
from constraints import kinds
from constraints.geometry.surfaces import Cone, Cylinder, Freeform, Plane, Sphere, Torus
from constraints.manager import Accepted, Change, ConstraintsState
from constraints.recognition.candidate import Candidate, Match
from physics import Snapshot, SpringHand
from vpframe.codec import WRONG, Codec, CodecError, Packing, conforms
from vpframe.errors import VpframeError
from vpframe.events import ConstraintView, NewEvent
from vpframe.hands.arguments import rigid
from vpframe.hands.segment import MotionSegment
from vpframe.scene.scene import Scene

NO_PAIRS = np.zeros((0, 4), np.int32)
FARTHEST = 1e12
"""m: greatest coordinate of a part in a saved state"""
GREATEST = 1e30
"""greatest number in a saved state, SI units"""


class StateError(VpframeError):
    """A saved state is damaged or belongs to another scene."""


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
    mates: ConstraintsState | None = None
    """state of the constraint manager, if it changed"""
    way: tuple[Mapping[str, pin.SE3], ...] = ()
    """poses of the moved parts where their way bends within the step, in order"""
    timings: Mapping[str, float] = field(default_factory=dict)


@dataclass(eq=False)
class Values:
    """What the stages of a step keep themselves; values are replaced, never changed in place."""

    step: int = 0
    """number of steps taken"""
    decisions: tuple[Decision, ...] = ()
    """the script's decisions for the next step"""
    authorised: tuple[tuple[int, int], ...] = ()
    """pairs of objects, a < b, whose overlap as drawn is meant; it is never deepened"""
    ignored: tuple[tuple[int, int], ...] = ()
    """pairs of objects, a < b, that may pass through each other"""
    threads: Mapping[int, float] = field(default_factory=dict)
    """pitch declared by the script, m a turn, negative for left-hand threads, by object"""
    held: frozenset[int] = frozenset()
    """objects that a hand holds or carries"""
    moved: frozenset[int] = frozenset()
    """objects that have ever moved or been held"""
    blocked: Mapping[str, str] = field(default_factory=dict)
    """held parts stopped by solid bodies, each with a text that names the obstacles"""
    rows: NDArray[Any] = field(default_factory=lambda: np.zeros(0, CONTACT_DTYPE))
    """contact rows of the objects in `moved`, within the distance that recognition needs"""
    searched: Mapping[int, float] = field(default_factory=dict)
    """objects of which `rows` has all contacts at the present poses, and within what distance, m"""
    colliding: NDArray[np.int32] = field(default_factory=lambda: NO_PAIRS)
    """(k, 4) object, surface, object, surface that intersect"""
    joined: frozenset[tuple[str, str]] = frozenset()
    """pairs of parts that an accepted constraint has ever joined"""
    targets: Mapping[int, pin.SE3] = field(default_factory=dict)
    """target poses of the hands in the last step"""
    last: Mapping[int, pin.SE3] = field(default_factory=dict)
    """poses before the last step of the objects it moved"""
    clearance: float | None = None
    """least distance of moving parts to others after the last step, m; None if not measured"""
    untold: tuple[NewEvent, ...] = ()
    """events found by `Engine.start`, reported by the first step"""
    remated: frozenset[int] = frozenset()
    """objects whose mated surfaces changed since the colliding surfaces were last computed"""
    decided: bool = False
    """whether a decision was made since the last recognition"""


class HandMotion(NamedTuple):
    """The running motion of a hand: attributes of its `Gripper`."""

    doing: str
    segment: MotionSegment | None
    wanted: pin.SE3 | None


@dataclass(frozen=True, eq=False)
class HandState:
    """State of a hand: attributes of its `Gripper`."""

    pose: pin.SE3
    held: str | None
    grip: pin.SE3
    surfaces: tuple[int, ...]
    carried: tuple[str, ...]
    stopped_by: str
    clock: float
    motion: HandMotion | None
    """None in a saved state: the script that continues from it has its own"""


@dataclass(frozen=True, eq=False)
class DynamicsState:
    """State of a session's physics."""

    world: Any
    """`physics.Snapshot`; in a saved state what `World.save` returned"""
    held: frozenset[int]
    """bodies that hands hold"""
    springs: frozenset[int]
    """bodies that hands pull by springs"""
    joined: tuple[int, ...]
    """ids of the constraints that are joints of the world"""


@dataclass(frozen=True, eq=False)
class State:
    """All that changes while a session runs, except what behaviours and rules of the script keep for themselves."""

    values: Values
    poses: NDArray[np.float64]
    """(n, 12) poses of the parts in scene order: rotation by rows, translation in m"""
    drawn: tuple[pin.SE3, ...]
    """poses of the parts in the assembly as drawn"""
    carried: Mapping[int, tuple[int, pin.SE3]]
    """carrier of each carried object, and its pose in the carrier's frame"""
    mates: ConstraintsState
    hands: Mapping[str, HandState]
    dynamics: DynamicsState | None
    """None until a part gets mass"""
    objects: ObjectsState | None = None
    """`poses`, with the versions that caches refer to; None in a saved state"""


STATES = (State, Values, DynamicsState, ConstraintsState, Snapshot)
"""the dataclasses of which a state consists"""


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
        *(Match, Candidate, Accepted, Change, ConstraintsState, ConstraintView, Changes, Decision, SpringHand),
        *(Values, HandState, DynamicsState, State),
    ],
    {
        pin.SE3: Packing(lambda pose: np.ascontiguousarray(pose.homogeneous[:3]), _pose),
        NewEvent: Packing(tuple, _new_event),
    },
)
"""encoding of steps and states"""


def saved(scene: Scene, state: State) -> bytes:
    """Return a state of a scene as bytes. `state.dynamics.world` must be what `World.save` returned."""
    hands = {name: replace(hand, motion=None) for name, hand in state.hands.items()}
    return CODEC.encode((CODEC.schema, scene.names, replace(state, objects=None, hands=hands)))


def loaded(scene: Scene, data: bytes) -> State:
    """Return the state that `saved` was given.

    Raises StateError if the bytes are damaged, of another version or of another scene.
    """
    try:
        content = CODEC.decode(data)
        _require(type(content) is tuple and len(content) == 3, "the data")
        schema, names, state = content
        if schema != CODEC.schema:
            raise ValueError("it was saved by another version of vpframe")
        _require(names == scene.names and isinstance(state, State), "list of parts")
        _require_state(scene, state)
    except CodecError as error:
        raise StateError(str(error)) from None
    except WRONG as error:
        raise damaged(error) from None
    assert isinstance(state, State)
    return state


def damaged(error: BaseException) -> StateError:
    """Return the StateError for an error that damaged data caused."""
    return StateError(f"damaged: {' '.join(str(error).split()) or type(error).__name__}")


def require_changes(scene: Scene, changes: Changes) -> None:
    """Raise ValueError, TypeError or LookupError if the recorded changes of a step are damaged or of another scene."""
    _require(isinstance(changes, Changes), "result")
    _require_rows(scene, changes.colliding)
    _require_rows(scene, changes.touching)
    named = (*changes.freedom, *changes.joint, *(name for view in changes.constraints for name in view.parts))
    for name in (*named, *changes.poses, *(name for poses in changes.way for name in poses)):
        scene.index(name)
    if changes.mates is not None:
        _require_mates(scene, changes.mates)


def _require_state(scene: Scene, state: State) -> None:
    _require_numbers(state, "state")
    own = state.values
    _require(own.step >= 0, "step")
    _require(state.poses.shape == (len(scene), 12) and len(state.drawn) == len(scene), "list of parts")
    for pose in unpack_all(state.poses):
        rigid(pose, "a pose")
    _require(bool((np.abs(state.poses) <= FARTHEST).all()), "a pose")
    _require(own.rows.dtype == CONTACT_DTYPE and own.rows.ndim == 1, "rows")
    _require_rows(scene, surfaces_of(own.rows))
    _require_rows(scene, own.colliding)
    _require_mates(scene, state.mates)
    for ids in (own.held, own.moved, own.targets, own.last, own.remated, own.threads, own.searched, state.carried):
        _require_parts(scene, ids)
    _require_parts(scene, [i for i, _ in state.carried.values()])
    _require(all(i not in state.carried for i, _ in state.carried.values()), "what is carried")
    _require_parts(scene, [i for pair in (*own.authorised, *own.ignored) for i in pair])
    _require(bool((own.rows["distance"] >= 0.0).all()), "rows")
    _require(all(pitch != 0.0 for pitch in own.threads.values()), "threads")
    for decision in own.decisions:
        _require(decision.verb in ("accept", "refuse", "remove", "impose"), "a decision")
        if decision.stated is not None:
            _require_candidate(scene, decision.stated)
    for hand in state.hands.values():
        _require(hand.clock >= 0.0, "the time of a hand")
        _require(all(name in scene for name in (hand.held, *hand.carried) if name), "what a hand holds")


def _require_parts(scene: Scene, ids: Iterable[int]) -> None:
    _require(all(0 <= i < len(scene) for i in ids), "an object's number")


def _require_rows(scene: Scene, rows: NDArray[Any]) -> None:
    """Raise ValueError unless rows (k, 4) of object, surface, object, surface are in range."""
    _require(rows.ndim == 2 and rows.shape[1] == 4, "rows")
    surfaces = np.array([part.mesh.n_surfaces for part in scene.parts])
    for objects, of_them in ((rows[:, 0], rows[:, 1]), (rows[:, 2], rows[:, 3])):
        _require(bool(((objects >= 0) & (objects < len(surfaces))).all()), "an object's number")
        _require(bool(((of_them >= 0) & (of_them < surfaces[objects])).all()), "a surface's number")


def _require_mates(scene: Scene, mates: ConstraintsState) -> None:
    _require(len(mates.poses) in (0, len(scene)), "poses")
    offered = (c for known in (mates.candidates, mates.refused, mates.pulled) for c in known.values())
    in_force = (entry.candidate for entry in mates.accepted.values())
    for c in (*offered, *in_force, *(change.candidate for change in mates.pending)):
        _require_candidate(scene, c)


def _require_candidate(scene: Scene, c: Candidate) -> None:
    _require(c.constraint.bodies == c.bodies and type(c.match.local) is np.ndarray, "a constraint")
    _require_parts(scene, c.bodies)


def _require_numbers(value: Any, what: str) -> None:
    """Raise ValueError for a number anywhere in a saved value that no session has: not finite, or beyond `GREATEST`."""
    holds, inside = True, list[tuple[Any, Any]]()
    if isinstance(value, float | np.floating):
        unlimited = what.endswith(("break_force", "break_distance")) and value == np.inf
        holds = unlimited or abs(float(value)) <= GREATEST
    elif isinstance(value, np.ndarray):
        inside = [(name, value[name]) for name in value.dtype.names or ()]
        holds = value.dtype.kind != "f" or bool((np.abs(value) <= GREATEST).all())
    elif isinstance(value, pin.SE3):
        holds = bool((np.abs(value.translation) <= FARTHEST).all())
    elif isinstance(value, Mapping):
        inside = list(value.items())
    elif isinstance(value, list | tuple | set | frozenset):
        inside = list(enumerate(value))
    elif is_dataclass(value):
        inside = [(f.name, getattr(value, f.name)) for f in fields(value)]
    for name, item in inside:
        _require_numbers(item, f"{what}, {name}" if isinstance(name, str) else what)
    if not holds:
        raise ValueError(f"{what} holds a number that is not finite or too great")


def _require(holds: bool, what: str) -> None:
    if not holds:
        raise ValueError(f"{what} is not of this scene")
