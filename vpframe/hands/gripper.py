"""`Gripper`: the state of a hand (grip, target, running motion); the verbs of `vpframe.hands.verbs` move it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from vpframe.errors import TaskError
from vpframe.hands import paths
from vpframe.hands.access import Reach
from vpframe.hands.arguments import FAR, metres, number, rigid
from vpframe.hands.assist import Assist
from vpframe.hands.reach import surface_distances
from vpframe.hands.segment import MotionSegment, Outcome
from vpframe.scene.boxes import half_size
from vpframe.scene.names import face_words, holders, mates_words, obstacles_words
from vpframe.scene.subassembly import listed, name_of

if TYPE_CHECKING:
    from physics import SpringHand
    from vpframe.events import ConstraintView
    from vpframe.scene.scene import Part, Scene

MOST_BLOCKERS = 3
"""maximum number of parts named as obstacles"""
FACING = 0.1
"""least cosine between motion and contact direction for an obstacle that lies ahead"""


class Gripper:
    """A hand without verbs: grip, target pose and outcome of motions.

    A hand is a point in space: it can grab a part with a surface within `reach`. The held part moves to the pose
    nearest to its target that its constraints and solid parts allow, and may lag behind the hand by `give`.
    """

    reach = 0.015
    """maximum distance from the hand to a surface that it grabs, m"""
    give = 0.03
    """lag at which a motion counts as blocked, m"""
    slack = 1e-3
    """maximum distance from the goal at which a motion counts as done, m (rotations count by the part's size)"""
    exact = 1e-6
    """maximum distance from the goal at which a motion ends in "arrived" without the distance that is left, m"""
    speed = 0.25
    """default speed of motions, m/s"""
    turn_speed = np.pi
    """default angular speed of motions, rad/s"""

    def __init__(self, session: Any, name: str, pose: pin.SE3) -> None:
        self.session = session
        """the `vpframe.session.session.Session` that made the hand, of a higher floor"""
        self.scene: Scene = session.scene
        self.name = name
        self.pose = pose
        """world pose of the hand"""
        self.held: str | None = None
        """name of the part in the hand"""
        self.grip = pin.SE3.Identity()
        """pose of the held part in the hand's frame"""
        self.surfaces: tuple[int, ...] = ()
        """surfaces of the held part that the hand touches"""
        self.carried: tuple[str, ...] = ()
        """parts that move rigidly with the held part"""
        self.assist = Assist()
        self.access: Reach | None = None
        """tool that must reach what the hand grabs or turns; None: no check"""
        self.spring: SpringHand | None = None
        """a `physics.SpringHand` that pulls dynamic parts with limited force instead of carrying them"""
        self.stopped_by: str = ""
        """text that names the obstacles; empty while the held part follows"""
        self.doing = ""
        """text of the running verb"""
        self.segment: MotionSegment | None = None
        self.clock = 0.0
        """time along the segment's path, s"""
        self.wanted: pin.SE3 | None = None
        """target pose of the held part (of the empty hand) in this step"""

    # ---- motion

    @property
    def subject(self) -> pin.SE3:
        """World pose of the held part, or of the empty hand; poses in verbs refer to it."""
        return self.scene[self.held].pose if self.held else self.pose

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the held part and of those carried with it; empty if nothing is held."""
        return (self.held, *self.carried) if self.held else ()

    @property
    def load(self) -> str:
        """Name of the held part, or of the subassembly that it is with what it carries; empty if nothing is held."""
        return name_of(self.scene.names, self.parts) if self.held else ""

    @property
    def title(self) -> str:
        """Name of the hand, with that of its load."""
        return f"{self.name}[{self.load}]" if self.held else self.name

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r}, holds {self.held!r})"

    # ---- called by verbs and by the session

    def mates(self) -> Sequence[ConstraintView]:
        """Return the active constraints that join the parts in the hand to others."""
        found: Sequence[ConstraintView] = self.session.constraints_of(*self.parts)
        return found

    def againsts(self) -> list[ConstraintView]:
        """Return those of the constraints of `mates` on which parts rest."""
        return [c for c in self.mates() if c.kind == "against"]

    def partner(self, c: ConstraintView) -> int:
        """Return on which side (0, 1) of a constraint of the parts in the hand the other part is."""
        return 1 if c.parts[0] in self.parts else 0

    def leaving(self, against: ConstraintView) -> NDArray[np.float64]:
        """Return the direction (3,), unit, world, away from the partner of an against constraint."""
        # an against's direction is the normal of its first part's plane, which points at the second part
        return -against.direction if self.partner(against) else against.direction

    def body(self, verb: str) -> Part:
        """Return the held part; TaskError if the hand is empty."""
        if self.held is None:
            raise TaskError(f"{self.name}.{verb}: the hand is empty; grab a part first")
        return self.scene[self.held]

    def bodies(self, verb: str) -> list[Part]:
        """Return the held and carried parts, the held one first; TaskError if the hand is empty."""
        return [self.body(verb), *(self.scene[name] for name in self.carried)]

    def others(self, verb: str, name: str) -> list[Part]:
        """Return the parts of a verb's target; TaskError if one of them is in the hand."""
        group = self.session.group(name)
        if not set(group).isdisjoint(self.parts):
            raise TaskError(f"{self.title}.{verb}({name!r}): that is the part in the hand; name another")
        return [self.scene[name] for name in group]

    def check_length(self, way: ArrayLike, what: str) -> None:
        """Refuse a motion (m, or (3,) m) that must be meant in millimetres; a way back to the scene is always allowed.

        Raises TaskError.
        """
        length = float(np.linalg.norm(way))
        if length > 1.0:
            low, high = self.session.bounds
            astray = float(np.linalg.norm(self.subject.translation - 0.5 * (low + high)))
            size = float(np.linalg.norm(high - low))
            metres(length, f"{self.title}.{what}", "the scene", size, max(1.0, FAR * size + astray))

    def length(self, value: float, verb: str, name: str, least: float = -np.inf, above: float = -np.inf) -> float:
        """Return a verb's argument as a length, m: finite, at least `least` and greater than `above`.

        Raises TaskError, also for a length that must be meant in millimetres.
        """
        given = number(value, f"{self.title}.{verb}: {name}", least, above)
        self.check_length(given, f"{verb}: {name}={value!r}")
        return given

    def outcome(self, reason: str, done: bool = True) -> Outcome:
        """Return the outcome of a verb that ends now."""
        return Outcome(done, reason, self.session.time)

    def touched(self, part: str) -> tuple[int, ...]:
        """Return the surfaces of a part within reach."""
        body = self.scene[part]
        distances, _ = surface_distances(body.mesh, body.pose, self.pose.translation)
        return tuple(int(s) for s in np.flatnonzero(distances <= self.reach))

    def take(self, part: str, surface: int | None, carried: tuple[str, ...], named: str = "") -> None:
        """Close the hand on a part within reach; `named`: the script's name for it, if different."""
        touched = self.touched(part)
        if not touched or (surface is not None and surface not in touched):
            what = part if surface is None else f"surface {surface} of {part}"
            raise TaskError(f"{self.name} does not touch {what} (reach {self.reach * 1e3:g} mm); approach it first")
        self.held, self.surfaces, self.carried = part, touched, carried
        self.grip = self.pose.actInv(self.scene[part].pose)
        self.stopped_by = ""
        self.session.note_grab(self, named)

    def holding(self, named: str = "", how: str = "") -> str:
        """Describe the held and carried parts: `named` comes first if given, `how` follows the held part."""
        words = f"{named}: {self.held}{how}" if named else f"{self.held}{how}"
        return f"{words}, carrying {listed(self.carried)}" if self.carried else words

    def let_go(self) -> None:
        """Open the hand."""
        if self.held is None:
            raise TaskError(f"{self.name} holds nothing; grab a part before releasing it")
        self.session.note_release(self)
        self.held, self.surfaces, self.carried, self.stopped_by = None, (), (), ""

    def start(self, segment: MotionSegment) -> None:
        """Begin a segment."""
        self.segment, self.clock, self.doing, self.stopped_by = segment, 0.0, segment.text, ""

    def desire(self, dt: float, rate: float) -> pin.SE3:
        """Advance the path by `dt` seconds at `rate` times its speed; return the target pose of the subject."""
        if self.segment is None:
            self.wanted = pin.SE3(self.subject)
        else:
            self.clock += dt * rate
            aim = rigid(self.segment.path.pose(self.clock), f"{self.doing}: the path at {self.clock:.3f} s")
            self.wanted = self.assist.shape(self.segment.path, aim)
        if self.held is None:
            self.pose = self.wanted
        else:
            self.pose = self.wanted * self.grip.inverse()
        return self.wanted

    def goal(self) -> pin.SE3 | None:
        """Target pose of the subject at the end of a straight or turning motion; None in any other."""
        path = None if self.segment is None else self.segment.path
        if not isinstance(path, paths.Straight | paths.Turning):
            return None
        return self.assist.shape(path, path.pose(path.duration))

    def lag(self) -> float:
        """Distance from the subject to its target pose, m; rotation counts by half the part's size."""
        if self.held is None or self.wanted is None:
            return 0.0
        behind = self.wanted.actInv(self.subject)
        arm = half_size(self.scene[self.held].mesh)
        return float(np.linalg.norm(behind.translation) + arm * np.linalg.norm(pin.log3(behind.rotation)))

    def judge(self) -> Outcome | None:
        """Return how the segment ended after a step; None before its end."""
        segment, session = self.segment, self.session
        if segment is None:
            return None
        if segment.until is not None and segment.until.test(session, self):
            return self._finish(True, segment.until.text)
        over = self.clock >= segment.path.duration - 1e-9 * session.dt
        behind = self.lag()
        if not over and behind <= self.give:
            return None
        if segment.until is None and behind <= self.slack:
            return self._finish(True, "arrived" if behind <= self.exact else self._nearly(behind))
        reason = f"the motion ended before its condition held: {segment.until}"
        if behind > self.slack:
            reason = self._obstacle(behind, over)
        outcome = self._finish(False, reason)
        if segment.required:
            raise TaskError(f"{segment.text}: {reason}")
        return outcome

    def _obstacle(self, behind: float, over: bool) -> str:
        """Describe why the held part is `behind` (m), at the end of its path (`over`) or before."""
        assert self.held is not None and self.segment is not None
        way = self.segment.path.pose(0.0).actInv(self.subject)
        far, turned = float(np.linalg.norm(way.translation)), float(np.linalg.norm(pin.log3(way.rotation)))
        turns = turned * half_size(self.scene[self.held].mesh) > far + self.exact
        text = f"{self.load} stopped after {f'{np.degrees(turned):.1f}°' if turns else f'{1e3 * far:.1f} mm'}"
        if over:
            text += f", {1e3 * behind:.2f} mm short of its target"
        why = self._kept_by()
        return f"{text}: {why}" if why else text

    def _nearly(self, behind: float) -> str:
        """Describe an arrival `behind` m from the target."""
        left = f"{1e6 * behind:.1f} µm" if behind < 1e-4 else f"{1e3 * behind:.2f} mm"
        why = self._kept_by()
        return f"arrived {left} from its target" + (f": {why}" if why else "")

    def _kept_by(self) -> str:
        """Describe what keeps the held part from its target; empty if not known."""
        if self.stopped_by:
            return self.stopped_by
        on_it = self.mates()
        if met := self._pressed_on():
            names = [part.name for part, _ in met]
            pairs = [c.parts for c in (*on_it, *self.session.constraints_of(*names))]
            return obstacles_words(met, holders(names, self.parts, pairs))
        return mates_words((c.kind, c.parts[self.partner(c)]) for c in on_it)

    def _pressed_on(self) -> list[tuple[Part, str]]:
        """Return the parts that the way to the target leads into across an `against`, and their faces."""
        if self.wanted is None:
            return []
        way = self.wanted.translation - self.subject.translation
        met: dict[str, tuple[Part, str]] = {}
        for c in self.againsts():
            if float(way @ -self.leaving(c)) > FACING * float(np.linalg.norm(way)):
                other = self.partner(c)
                part = self.scene[c.parts[other]]
                met[part.name] = part, face_words(part, *c.surfaces[other])
        return list(met.values())

    def _finish(self, done: bool, reason: str) -> Outcome:
        self.segment, self.doing = None, ""
        if self.held is not None:  # the hand returns to the held part
            self.pose = self.subject * self.grip.inverse()
        self.wanted = None
        return self.outcome(reason, done)
