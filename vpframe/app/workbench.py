"""`Workbench`: a session on a live page, where a user holds parts with the session's own verbs.

Pages send requests; the session's thread performs them in order and records each as a statement of a script.
Between requests only missing data of the page is computed: clash depths, freedom of all parts.
"""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from vpframe import console, files
from vpframe.analysis.clash import clash, document
from vpframe.analysis.fasteners import fasteners_of
from vpframe.analysis.fits import BAD_KINDS
from vpframe.app.written_task import VerbCall, task_source
from vpframe.errors import TaskError, VpframeError
from vpframe.hands.arguments import FAR
from vpframe.hands.assist import Assist
from vpframe.hands.dragging import along_freedom
from vpframe.hands.hand import Hand
from vpframe.hands.paths import apart, between
from vpframe.outputs import Output
from vpframe.scene.names import holding_words
from vpframe.scene.scene import Scene
from vpframe.session.requests import ABOUT_CONSTRAINTS, Request
from vpframe.session.rules import accept_standing
from vpframe.session.session import Session, SessionMark
from vpframe.session.state import STATES
from vpframe.text import plain
from vpframe.view.meshcat_viewer import MeshcatViewer

WAITING = 200
"""maximum number of waiting requests; further ones are dropped"""
LINGER = 10.0
"""time limit for the end of the clash search, s"""
STILL = 1e-6
"""m and rad: motion in a step below which a part rests"""
SNAP = 0.05
"""reach of the assist's snapping, as a fraction of half the scene's size"""
MOST_SNAP = 1.5e-3
"""maximum reach, m"""
DIGITS = 7, 9
"""decimals of lengths (m) and of quaternions in scripts"""
STEP_SECONDS = 0.02
"""computing time of a step of a drag, s, beyond which the next one has a shorter way to go"""
DRAWN_SECONDS = 0.05
"""longest wait of a drag, s, until the page has drawn all frames but the latest: unseen steps take its time"""
UNHINDERED = 0.25
"""of the way that a step was to go: what is dragged is hindered where it goes less"""
MOVES = ("drag", "place")
"""requests that replace the previous one of the same kind"""
MOST_UNDO = 100
"""maximum number of statements that can be undone"""
MOST_BYTES = 1 << 26
"""maximum memory of their marks, bytes; the oldest are dropped first, the latest never"""


@dataclass(frozen=True)
class Holding:
    """What holds a part against a move that was asked for."""

    text: str = ""
    parts: tuple[str, ...] = ()
    """that hold it"""
    loose: tuple[str, ...] = ()
    """those of them that can be taken out first: screws and other smaller parts that are not fixed"""


NOTHING_HOLDS = Holding()


@dataclass
class Done:
    """Statements that are undone together, and a mark of the session before them; None: they cannot be undone."""

    statements: list[VerbCall]
    before: SessionMark | None


class Workbench:
    """A session on a scene, controlled by pages.

    Parameters
    ----------
    model: file of the scene; loading: options it was loaded with.
    save: file in which the script is written after each statement; None: pages can request its text.
    host: as in `MeshcatViewer`.
    """

    def __init__(
        self,
        scene: Scene,
        model: str | Path,
        loading: Mapping[str, Any],
        save: Output | None = None,
        host: str = "127.0.0.1",
        open_browser: bool = False,
    ) -> None:
        self._model, self._loading, self._save = Path(model), loading, save
        self._requests: deque[Request] = deque()
        self._change = threading.Condition()
        self._stop = False
        self._as_it_stands = scene.copy()
        self.viewer = MeshcatViewer(open_browser=open_browser, host=host, ask=self.ask, gone=self._gone)
        self.viewer.show(scene)
        self.session = Session(scene, viewer=self.viewer, rule=accept_standing, name=self._model.stem)
        self.hand: Hand = self.session.hand()
        low, high = self.session.bounds
        self.snap = float(f"{min(SNAP * 0.5 * float(np.linalg.norm(high - low)), MOST_SNAP):.2g}")
        self.hand.assist = Assist(snap=self.snap)
        self.holding = NOTHING_HOLDS
        """what forbade the last move"""
        self.holder = 0
        """number of the page that controls the hand; 0: none"""
        self.done: list[Done] = []
        self.undone: list[Done] = []
        self._freedom_of: tuple[int, ...] | None = None
        decisions = dict.fromkeys(ABOUT_CONSTRAINTS, self._decide)
        self._actions: dict[str, Callable[[Request], None]] = {
            "grab": self._grab,
            "release": self._release,
            "drag": self._drag,
            "place": self._drag,
            "rest": lambda request: None,
            "loosen": self._loosen,
            "slide": self._slide,
            "turn": self._turn,
            **decisions,
            "undo": self._undo,
            "redo": self._redo,
            "save": self._give_script,
        }

    # ---- requests

    def ask(self, request: Request) -> None:
        """Queue a request (any thread); a move replaces the previous waiting move of its page."""
        with self._change:
            last = self._requests[-1] if self._requests else None
            if last and request.action in MOVES and (last.action, last.client) == (request.action, request.client):
                self._requests[-1] = request
            elif len(self._requests) < WAITING or self._must_be_heard(request):
                self._requests.append(request)
            self._change.notify_all()

    def _must_be_heard(self, request: Request) -> bool:
        """Whether a request is queued even if the queue is full: the first release of a page."""
        known = ((r.action, r.client) for r in self._requests)
        return request.action == "release" and ("release", request.client) not in known

    def _gone(self, client: int) -> None:
        self.ask(Request("release", client=client))

    def _next(self, timeout: float | None = None) -> Request | None:
        """Return the next request; None after `timeout` seconds without one, or at the end."""
        with self._change:
            self._change.wait_for(lambda: self._requests or self._stop, timeout)
            return None if self._stop or not self._requests else self._requests.popleft()

    def _next_move(self, wait: bool) -> Request | None:
        """Return the next request if it is a move of the controlling page; otherwise leave it in the queue."""
        with self._change:
            if wait:
                self._change.wait_for(lambda: self._requests or self._stop)
            first = self._requests[0] if self._requests and not self._stop else None
            if first is None or first.action not in MOVES or first.client != self.holder:
                return None
            return self._requests.popleft()

    def run(self) -> None:
        """Serve until Ctrl-C or `stop`, then close the session."""
        finder = threading.Thread(target=self._find_clashes, name="vpframe clashes", daemon=True)
        try:
            self.session.show()
            self._tell()
            finder.start()
            while not self._stop:
                request = self._next(None if self._freedom_of == self._in_force() else 0.3)
                if request is not None:
                    self.do(request)
                elif not self._stop:
                    self._tell_freedom()
        except KeyboardInterrupt:
            pass
        finally:
            self._stop = True
            self.session.close()
            if finder.ident is not None:
                finder.join(LINGER)  # it stops at its next progress report

    def stop(self) -> None:
        """End `run` (any thread)."""
        with self._change:
            self._stop = True
            self._change.notify_all()

    def do(self, request: Request) -> None:
        """Perform one request; errors are sent to its page."""
        if request.action not in ("rest", "save", "loosen", *MOVES):
            self.holding = NOTHING_HOLDS
        try:
            if request.action != "save" and self.holder not in (0, request.client):
                if request.action in ("release", "rest"):
                    return  # a page without control has closed
                raise TaskError(f"another page holds {self.hand.held}; it has to let go first")
            if request.action in (*MOVES, "slide", "turn", "loosen") and self.hand.held is None:
                raise TaskError("no part is held; take one in hand first")
            self._actions[request.action](request)
        except VpframeError as error:
            self._say(request.client, str(error))
        self._tell()

    # ---- actions

    def _grab(self, request: Request) -> None:
        names = self.session.scene.names
        if not 0 <= request.given["part"] < len(names):
            raise TaskError("there is no such part")
        name, level, surface = names[request.given["part"]], request.given["level"], request.given["surface"]
        if level > 0:
            name = "/".join(name.split("/")[:level])
        named = {"surface": surface} if surface >= 0 and level <= 0 else {}
        let_go = [VerbCall("hand", "release")] if self.hand.held else []
        self._perform([*let_go, VerbCall("hand", "grab", (name,), named)])
        self.holder = request.client

    def _release(self, request: Request) -> None:
        if self.hand.held is not None:
            self._perform([VerbCall("hand", "release")])
        self.holder = 0

    def _drag(self, request: Request) -> None:
        poses: list[tuple[float, ...]] = []
        before = self.session.mark()
        self._guarded(before, lambda: self.hand.drag(self._targets(request, poses)))
        if poses:
            self._keep([VerbCall("hand", "drag", (poses,))], before)

    def _loosen(self, request: Request) -> None:
        """Let go, take out what holds the part, and take it again."""
        if not self.holding.loose:
            raise TaskError("nothing that holds it can be taken out")
        out = VerbCall("hand", "remove", (list(self.holding.loose),))
        self._perform([VerbCall("hand", "release"), out, VerbCall("hand", "grab", (self.hand.held,))])
        self.holding = NOTHING_HOLDS
        self.holder = request.client

    def _held_by(self, request: Request) -> Holding:
        """What forbids a move that hardly anything of is allowed; nothing if a solid stops it or `free` is set."""
        hand = self.hand
        if request.given["free"] or hand.stopped_by or hand.held is None:
            return NOTHING_HOLDS
        here, wanted = pin.SE3(hand.subject), self._goal(replace(request, given={**request.given, "free": True}))
        if apart(here, self._goal(request)) > UNHINDERED * apart(here, wanted):
            return NOTHING_HOLDS
        views = self.session.holding(hand.held, pin.log6(here.actInv(wanted)).vector, hand.carried)
        own, way = {hand.held, *hand.carried}, wanted.translation - here.translation
        ahead = [v for v in views if v.kind == "against" and v.direction @ way * (1 if v.parts[0] in own else -1) > 0.0]
        mates = [(v.kind, *(v.parts if v.parts[0] in own else v.parts[::-1])) for v in ahead or views]
        others = tuple(dict.fromkeys(other for _, _, other in mates))
        scene, size = self.session.scene, self.session.half_size(hand.held)
        loose = tuple(n for n in others if not scene[n].fixed and self.session.half_size(n) < size)
        known = fasteners_of(scene)
        sizes = {name: known[i].size for name in others if (i := scene.index(name)) in known}
        return Holding(holding_words(mates, sizes), others, loose)

    def _slide(self, request: Request) -> None:
        distance, (low, high) = abs(request.given["distance"]), self.session.bounds
        size = float(np.linalg.norm(high - low))
        if distance > max(
            1.0, FAR * size
        ):  # people at pages write millimetres: the hand's hint about metres is no help
            what = f"{1e3 * distance:.7g} mm is {distance / size:.0f} times the size of the scene"
            raise TaskError(f"{what}; give less than {1e3 * max(1.0, FAR * size):.4g} mm")
        given = {"distance": request.given["distance"], "required": False}
        self._perform([VerbCall("hand", "slide", (request.given["along"],), given)], request.client)

    def _turn(self, request: Request) -> None:
        given = {"about": request.given["about"], "required": False}
        self._perform([VerbCall("hand", "turn", (request.given["angle"],), given)], request.client)

    def _decide(self, request: Request) -> None:
        views = self.session.frame.constraints if self.session.frame else ()
        view = next((c for c in views if c.id == request.id), None)
        if view is None:
            raise TaskError("that constraint is not there any more")
        remark = f"{view.kind}: {' – '.join(view.parts)}"
        decision = VerbCall("session", request.action, (view.id,), remark=remark)
        self._perform([decision, VerbCall("session", "step")])

    def _undo(self, request: Request) -> None:
        if not self.done:
            raise TaskError("there is nothing to undo")
        last = self.done[-1]
        if last.before is None:
            raise TaskError("what was done before cannot be undone any more")
        self._back_to(last.before)
        self.undone.append(Done(self.done.pop().statements, None))
        self.holder = request.client if self.hand.held else 0

    def _redo(self, request: Request) -> None:
        if not self.undone:
            raise TaskError("there is nothing to redo")
        again, rest = self.undone.pop(), self.undone
        self._perform(again.statements)
        self.undone = rest
        self.holder = request.client if self.hand.held else 0

    def _give_script(self, request: Request) -> None:
        if self._save is None:
            name = f"{self._model.stem}_task.py"
            self.viewer.publish({"type": "script", "name": plain(name), "text": self.source(Path())}, request.client)
            return
        self._write()
        self._say(request.client, f"written to {self._save.path.name}")

    # ---- statements

    def _perform(self, statements: list[VerbCall], client: int = 0) -> None:
        before = self.session.mark()
        outcome = None

        def go() -> None:
            nonlocal outcome
            for statement in statements:
                outcome = statement.perform(self.session, self.hand)

        self._guarded(before, go)
        self._keep(statements, before)
        if outcome is not None and not outcome.done and client:
            self._say(client, outcome.reason)

    def _guarded(self, before: SessionMark, act: Callable[[], object]) -> None:
        """Perform an action; undo it if it fails, so that the script need not contain it."""
        try:
            act()
        except BaseException:
            self._back_to(before)
            raise

    def _keep(self, statements: list[VerbCall], before: SessionMark) -> None:
        self.done.append(Done(statements, before))
        self.undone = []
        known: set[int] = set()
        room = MOST_BYTES
        for count, done in enumerate(reversed(self.done)):
            if done.before is None:
                break  # earlier marks are dropped already
            room -= _bytes(done.before, known)
            if count and (count >= MOST_UNDO or room < 0):
                done.before = None
        if self._save is not None:
            self._write()

    def _back_to(self, mark: SessionMark) -> None:
        self.session.undo(mark)
        self.session.show()

    def _targets(self, request: Request, poses: list[tuple[float, ...]]) -> Iterator[tuple[float, ...]]:
        """Yield a drag's target poses, appending each to `poses`, until the part rests or another request comes.

        A target is no farther away than steps can go in about `STEP_SECONDS`, or half the reach of snapping.
        """
        latest: Request | None = request
        way = self.snap
        while latest is not None:
            before = pin.SE3(self.hand.subject)
            goal = self._goal(latest)
            target = self._written(self._bounded(goal, way))
            poses.append(target)
            began = time.thread_time()
            yield target
            took = time.thread_time() - began
            self.viewer.wait_for(self.holder, DRAWN_SECONDS)
            moved, wanted = apart(before, self.hand.subject), way
            if took > STEP_SECONDS:
                way = max(0.5 * way, 0.5 * self.snap)
            elif took < 0.5 * STEP_SECONDS:
                way = 2.0 * way
            goes_on = moved > STILL and apart(self.hand.subject, goal) > STILL
            holding = NOTHING_HOLDS if moved > STILL else self._held_by(latest)
            if holding != self.holding:
                self.holding = holding
                self._tell()
            on_its_way = goes_on and moved > UNHINDERED * wanted  # it arrives before other requests are heard
            again = on_its_way or (goes_on and not self._requests)
            latest = self._next_move(wait=not goes_on) or (latest if again else None)

    def _bounded(self, goal: pin.SE3, way: float) -> pin.SE3:
        """Return the goal, or a pose towards it that is about `way` m away."""
        here = self.hand.subject
        assert self.hand.held is not None
        still = np.array_equal(goal.rotation, here.rotation)
        turn = 0.0 if still else float(np.linalg.norm(pin.log3(here.rotation.T @ goal.rotation)))
        far = float(np.linalg.norm(goal.translation - here.translation)) + turn * self.session.half_size(self.hand.held)
        if far <= way:
            return goal
        nearer = between(here, goal, way / far)
        return pin.SE3(here.rotation, nearer.translation) if still else nearer

    def _goal(self, request: Request) -> pin.SE3:
        """Return the pose that a move asks for."""
        hand, here = self.hand, pin.SE3(self.hand.subject)
        assert hand.held is not None
        given = request.given
        twists = None if given["free"] else self.session.twists(hand.held, hand.carried)
        if request.action == "place":
            goal = pin.XYZQUATToSE3(_unit(given["pose"]))
            if twists is None:
                return goal
            return here * pin.exp6(twists @ (twists.T @ pin.log6(here.actInv(goal)).vector))
        grip, to = np.array(given["point"]), np.array(given["to"])
        return along_freedom(here, grip, to, twists, self.session.half_size(hand.held))

    def _written(self, goal: pin.SE3) -> tuple[float, ...]:
        """Return a pose as scripts have it: x y z, or x y z qx qy qz qw where it turns what is held."""
        length, turn = DIGITS
        position = tuple(round(float(x), length) for x in goal.translation)
        if np.array_equal(goal.rotation, self.hand.subject.rotation):
            return position
        return (*position, *(round(float(x), turn) for x in pin.SE3ToXYZQUAT(goal)[3:]))

    # ---- messages to pages

    def source(self, folder: Path) -> str:
        """Return the script of all statements, for a folder."""
        statements = [statement for done in self.done for statement in done.statements]
        return task_source(statements, self._model.resolve(), folder.resolve(), self._loading, self.snap)

    def _write(self) -> None:
        assert self._save is not None
        files.replace(self._save.path, self.source(self._save.path.parent))

    def _say(self, client: int, text: str) -> None:
        self.viewer.publish({"type": "say", "text": plain(text), "at": time.monotonic()}, client)

    def _tell(self) -> None:
        names = self.session.scene.names
        held = [self.hand.held, *self.hand.carried] if self.hand.held else []
        self.viewer.publish(
            {
                "type": "desk",
                "holder": self.holder,
                "held": [names.index(name) for name in held],
                "stopped": plain(self.hand.stopped_by),
                "stopped_at": self._stopped_at(),
                "holding": {
                    "text": plain(self.holding.text),
                    "parts": [names.index(name) for name in self.holding.parts],
                    "loose": len(self.holding.loose),
                },
                "undo": sum(done.before is not None for done in self.done),
                "redo": len(self.undone),
                "script": [plain(s.short) for done in self.done[-20:] for s in done.statements],
                "saves": plain(self._save.path.name) if self._save else "",
            }
        )

    def _stopped_at(self) -> list[list[int]]:
        """Part and surface of each face that stops the held part."""
        if not self.hand.stopped_by:
            return []
        names = self.session.scene.names
        last = next((e for e in reversed(self.session.events) if e.kind == "blocked"), None)
        if last is None or self.hand.held not in last.parts:
            return []
        faces = zip(last.parts, last.surfaces, strict=False)
        return [[names.index(name), surface] for name, surfaces in faces for surface in surfaces]

    def _in_force(self) -> tuple[int, ...]:
        return tuple(c.id for c in self.session.constraints)

    def _tell_freedom(self) -> None:
        """Publish the freedom of all parts; stop if a request comes."""
        in_force = self._in_force()
        rows = []
        for name in self.session.scene.names:
            if self._requests or self._stop:
                return
            rows.append([self.session.freedom(name), self.session.joint(name)])
        self._freedom_of = in_force
        self.viewer.publish({"type": "freedom", "rows": rows})

    def _find_clashes(self) -> None:
        """Publish the clashes of the initial scene (runs in its own thread)."""
        index = self._as_it_stands.index

        def tell(rows: list[Any], done: bool, text: str) -> None:
            if not self._stop:
                self.viewer.publish({"type": "clashes", "rows": rows, "done": done, "text": text})

        def progress(fraction: float, text: str) -> None:
            if self._stop:
                raise KeyboardInterrupt
            tell([], False, f"{100 * fraction:.0f} %")

        with contextlib.suppress(KeyboardInterrupt):
            try:
                tell([], False, "looking for clashes")
                pairs = document(clash(self._as_it_stands, progress=progress))["pairs"]
            except VpframeError as error:
                console.warn(f"clashes: {error}")
                tell([], True, plain(str(error)))
                return
            rows = [
                {
                    "kind": pair["kind"],
                    "parts": [index(name) for name in pair["parts"]],
                    "surfaces": list(pair["surfaces"]),
                    "depth": pair["depth"],
                    "at": pair["point"],
                    "count": pair["count"],
                }
                for pair in pairs
                if pair["kind"] in BAD_KINDS
            ]
            tell(rows, True, "")


def _bytes(value: Any, known: set[int]) -> int:
    """Return the approximate size of a mark in bytes, without what is in `known` (other marks, parts, hands)."""
    if id(value) in known:
        return 0
    known.add(id(value))
    inside: Iterable[Any] = ()
    if isinstance(value, dict):
        inside = (*value.keys(), *value.values())
    elif isinstance(value, tuple | list):
        inside = value
    elif isinstance(value, STATES):
        inside = vars(value).values()
    elif isinstance(value, set | frozenset):  # of like things: pairs of surfaces, parts
        return sys.getsizeof(value) + len(value) * sys.getsizeof(next(iter(value), None))
    elif isinstance(value, np.ndarray) and value.base is not None:
        return value.nbytes
    return sys.getsizeof(value) + sum(_bytes(item, known) for item in inside)


def _unit(pose: tuple[float, ...]) -> np.ndarray:
    values = np.array(pose)
    length = float(np.linalg.norm(values[3:]))
    if length == 0.0:
        raise TaskError("the pose has no rotation")
    values[3:] /= length
    return values
