"""`RerunRecorder`: a session on disk as a rerun recording (`.rrd`), readable at any moment while it grows.

Geometry is written once; poses, highlights, constraints, events and plots follow in columns, every two seconds and from
a thread of its own, so that the session does not wait for the disk and a recording that is killed loses no more than
its last seconds. rerun encodes in memory and the file is written here: its own writer may wait for ever on a full disk.
Positions are single precision, as rerun keeps them.
Of more than `crowd.SEPARATE` parts those that stand still are instances of their shape until they move or their
surfaces begin or cease to collide; of more than `symbols.DRAWN` constraints those are left out that were there when the
session began, have not changed since, and are of parts that no hand has held.
Timelines: `step` and `time` (s since the session began). Plots are in the units their names say.
"""

from __future__ import annotations

import os
import queue
import re
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
import rerun as rr
from numpy.typing import NDArray

from vpframe.errors import OutputError
from vpframe.events import ConstraintView, Event, Frame, moved
from vpframe.outputs import RECORDING, append, claimed
from vpframe.session.log import DRAWN
from vpframe.view import palette
from vpframe.view.blueprint import blueprint
from vpframe.view.camera import first_view, frame_scene
from vpframe.view.columns import COLUMNS, entity, geometry, rgba, rgbas, surface_path
from vpframe.view.crowd import SEPARATE, crowds
from vpframe.view.replay import HEADER, messages_end
from vpframe.view.symbols import frame_symbols, hand_symbols

if TYPE_CHECKING:
    from vpframe.scene.scene import Scene

FLUSH_STEPS = 240
FLUSH_SECONDS = 2.0
"""maximum number of buffered steps, and s after which they are written"""

VIEWS = 200
"""maximum number of states, one per flush, that the final camera frames"""
BACKLOG = 8
"""maximum number of buffers waiting for the writer; then the session waits"""

GONE = "removed"
"""the state of a constraint that is no longer listed"""

Buffered = dict[tuple[str, str], list[tuple[int, float, Any]]]
"""by entity and kind of value: step, time, value"""


class RerunRecorder:
    """Writes what a session shows to `path` (an `.rrd` file, or the `Output` of one; folders are made).

    An older recording of vpframe is replaced when the session begins.

    Raises
    ------
    OutputError: the file is no recording of ours, being recorded to by another run, or cannot be written. On a disk
        that fills up it is raised by `frame` and `end`, and what was written can be read.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._output = claimed(path, RECORDING)
        self._stream: rr.RecordingStream | None = None
        self._failure: Exception | None = None

    def begin(self, scene: Scene) -> None:
        """Write geometry and layout."""
        self._file = self._output.open()
        self._empty = True
        self._stream = stream = rr.RecordingStream("vpframe", recording_id=None, send_properties=True)
        self._encoded = rr.binary_stream(stream)
        camera = first_view(scene)
        stream.send_blueprint(blueprint(camera), make_active=False, make_default=True)
        stream.send_recording_name(Path(scene.source).name if scene.source else "session")
        self._scene = scene
        self._names = scene.names
        self._seen: list[dict[str, pin.SE3]] = []
        self._paths = {name: entity("parts", name) for name in scene.names}
        self._colors = palette.part_colors(scene)
        self._symbol_size = 0.06 * camera.radius
        self._rows: Buffered = {}
        self._now, self._steps = (0, 0.0), 0
        self._at_start = {part.name: part.pose.copy() for part in scene.parts}
        self._pose = dict(self._at_start)
        self._known: Mapping[str, pin.SE3] = {}
        self._colliding = np.empty((0, 4), np.int32)
        self._red: set[tuple[int, int]] = set()
        self._still: dict[str, dict[str, pin.SE3]] = {}
        self._crowd_of: dict[str, str] = {}
        self._left: set[str] = set()
        self._quiet: dict[int, str] | None = None
        self._symbols: dict[str, tuple[object, ...]] = {}
        self._placed: dict[str, pin.SE3] = {}
        self._state: dict[int, str] = {}
        self._lanes: dict[int, str] = {}
        self._script = ""
        self._lines: dict[tuple[str, str], str] = {}
        self._hand: dict[str, NDArray[np.float64]] = {}
        self._last_flush = time.monotonic()
        stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._gathered = len(scene) <= SEPARATE
        if self._gathered:
            for part in scene.parts:
                for path, drawn in geometry(part):
                    stream.log(path, drawn, static=True)
        self._queue: queue.Queue[Buffered | None] = queue.Queue(maxsize=BACKLOG)
        self._writer = threading.Thread(target=self._write, args=(stream,), name="vpframe recorder", daemon=True)
        self._writer.start()
        if self._gathered:
            self._now = (0, 0.0)
            for number in range(len(scene)):
                self._place(number)
            self._flush()

    def frame(self, frame: Frame) -> None:
        """Buffer one step; pass full buffers to the writer. Raises the error that stopped the writer, if any."""
        if self._failure is not None:
            raise self._failure
        if not self._gathered:
            self._gather(frame)
        self._now = (frame.step, frame.time)
        self._steps += 1
        self._poses(frame.poses)
        self._highlight(frame.colliding)
        for crowd in sorted({self._crowd_of.pop(name) for name in self._left}):
            if self._still[crowd]:
                self._add(crowd, "instances", list(self._still[crowd].values()))
            else:  # a mesh with a list of no poses would be drawn at the origin
                self._add(crowd, "cleared", False)
        self._left.clear()
        views = self._involved(frame)
        self._draw(frame, views)
        self._states(views)
        for event in frame.events:
            self._add("events", "text", event, (event.step, event.time))
        if frame.script != self._script:
            self._script = frame.script
            self._add("script", "document", frame.script)
        for part, freedom in frame.freedom.items():
            self._plot("plots/freedom", part, freedom, name=part)
        if frame.clearance is not None or ("plots/clearance", "") in self._lines:
            clearance = np.nan if frame.clearance is None else 1e3 * frame.clearance  # NaN leaves a gap
            self._plot("plots/clearance", "", clearance, "clearance (mm)", palette.FREEDOM)
        self._plot("plots/clashes", "", len(frame.colliding), "colliding surface pairs", palette.COLLIDING)
        for name, seconds in frame.timings.items():
            self._plot("plots/timings", name, 1e3 * seconds, f"{name} (ms)")
        if self._steps >= FLUSH_STEPS or time.monotonic() - self._last_flush > FLUSH_SECONDS:
            self._flush()

    def end(self) -> None:
        """Write the remaining buffers and close the file."""
        if self._stream is not None:
            if not self._gathered:
                self._gather(None)
            self._flush()
            self._queue.put(None)
            self._writer.join()
            if self._failure is None:
                camera = frame_scene(self._scene, *self._seen)  # all poses are known now
                self._stream.send_blueprint(blueprint(camera), make_default=True)
                try:
                    self._append()
                except OutputError as error:
                    self._failure = error
            self._stream.disconnect()
            self._stream = None
            self._file.close()
        self._output.close()
        if self._failure is not None:
            raise self._failure

    def _gather(self, frame: Frame | None) -> None:
        """Draw parts that stand still in the first frame as instances, all others one by one."""
        self._gathered = True
        scene, self._now = self._scene, (0, 0.0)
        moving: set[str] = set()
        meeting: set[tuple[int, int]] = set()
        if frame is not None:
            moving = {*frame.held, *(name for name, pose in frame.poses.items() if pose != self._at_start[name])}
            meeting = _meeting(frame.colliding)
        red: dict[str, frozenset[int]] = {}
        for o, s in sorted(meeting):
            if (name := self._names[o]) not in moving:
                red[name] = red.get(name, frozenset()) | {s}
                self._red.add((o, s))
        for crowd in crowds((p for p in scene.parts if p.name not in moving), self._colors, red):
            self._still[crowd.entity] = {name: self._at_start[name] for name in crowd.members}
            self._crowd_of |= dict.fromkeys(crowd.members, crowd.entity)
            self._add(crowd.entity, "geometry", crowd.mesh())
            self._add(crowd.entity, "static", rr.AnyValues(parts=list(crowd.members)))
            self._add(crowd.entity, "instances", list(self._still[crowd.entity].values()))
        for name in sorted(moving):
            self._come_out(name)
        self._last_flush = -np.inf  # geometry must not be lost

    def _come_out(self, name: str) -> None:
        """Draw a part of a crowd separately from now on."""
        if name in self._crowd_of:
            del self._still[self._crowd_of[name]][name]
            self._left.add(name)
        for path, drawn in geometry(self._scene[name]):
            self._add(path, "geometry", drawn)
        self._place(self._scene.index(name))

    def _place(self, part: int) -> None:
        """Write pose and colours as values in time, since static components could not change later."""
        name = self._names[part]
        self._add(self._paths[name], "transform", self._pose[name])
        for surface in range(self._scene[name].mesh.n_surfaces):
            self._add(surface_path(name, surface), "albedo", self._tint(part, surface))

    def _poses(self, poses: Mapping[str, pin.SE3]) -> None:
        names, self._known = moved(self._known, poses), poses
        for name in names:
            pose = poses[name]
            if self._pose[name] != pose:
                self._pose[name] = pose
                if name in self._crowd_of:
                    self._come_out(name)
                else:
                    self._add(self._paths[name], "transform", pose)

    def _highlight(self, colliding: NDArray[np.int32]) -> None:
        if colliding is self._colliding or np.array_equal(colliding, self._colliding):
            return
        self._colliding = colliding
        red = _meeting(colliding)
        changed, self._red = sorted(red ^ self._red), red
        fresh = {self._names[part] for part, _ in changed} & self._crowd_of.keys() - self._left
        for name in sorted(fresh):
            self._come_out(name)
        for part, surface in changed:
            if self._names[part] not in fresh:
                self._add(surface_path(self._names[part], surface), "albedo", self._tint(part, surface))

    def _tint(self, part: int, surface: int) -> palette.Color:
        return palette.COLLIDING if (part, surface) in self._red else self._colors[self._names[part]]

    def _involved(self, frame: Frame) -> Sequence[ConstraintView]:
        """Return the drawn constraints: of many, those changed since the session began or of parts once held."""
        views = frame.constraints
        if self._quiet is None:
            self._quiet = {view.id: view.state for view in views} if len(views) > DRAWN else {}
            if self._quiet:
                text = f"of {len(views)} constraints only those are drawn that change, or of parts that a hand holds"
                self._add("events", "text", Event(frame.step, frame.time, "note", text=text))
        if not self._quiet:
            return views
        held = set(frame.held)
        self._quiet = {
            view.id: view.state
            for view in views
            if self._quiet.get(view.id) == view.state and held.isdisjoint(view.parts)
        }
        return tuple(view for view in views if view.id not in self._quiet)

    def _draw(self, frame: Frame, views: Sequence[ConstraintView]) -> None:
        seen = set()
        for symbol in (
            *frame_symbols(replace(frame, constraints=views)),
            *hand_symbols(frame.hands, self._symbol_size),
        ):
            seen.add(symbol.name)
            path = _symbol_path(symbol.name)
            if self._symbols.get(symbol.name) != symbol.key:
                self._symbols[symbol.name] = symbol.key
                self._add(path, "strips", symbol)
            if symbol.name not in self._placed or self._placed[symbol.name] != symbol.pose:
                self._placed[symbol.name] = symbol.pose
                self._add(path, "transform", symbol.pose)
        for name in [name for name in self._symbols if name not in seen]:
            del self._symbols[name]
            self._add(_symbol_path(name), "strips", None)
        for name, pose in frame.hands.items():
            place = pose.translation.copy()
            if name in self._hand and not np.array_equal(self._hand[name], place):
                self._add(entity("trail", name), "segment", np.array([self._hand[name], place]))
            self._hand[name] = place

    def _states(self, views: Sequence[ConstraintView]) -> None:
        """Keep the state of each constraint when it changes; GONE is drawn as a gap."""
        now = {view.id: view.state for view in views}
        if now == self._state:
            return
        for view in views:
            if view.id not in self._lanes:
                path = self._lanes[view.id] = f"constraints/{_lane(view)}"
                values = [*palette.STATE, GONE]
                colors = rgbas([*palette.STATE.values(), palette.REFUSED])
                visible = [value != GONE for value in values]
                style = rr.StateConfiguration(values=values, labels=values, colors=colors, visible=visible)
                self._add(path, "static", style)
            if self._state.get(view.id) != view.state:
                self._add(self._lanes[view.id], "state", view.state)
        for gone in self._state.keys() - now.keys():
            self._add(self._lanes[gone], "state", GONE)
        self._state = now

    def _plot(self, root: str, leaf: str, value: float, name: str, color: palette.Color | None = None) -> None:
        """Add a point of a plot; its name, with the unit, is written the first time."""
        path = self._lines.get((root, leaf))
        if path is None:
            path = self._lines[root, leaf] = entity(root, leaf) if leaf else root
            colors = [rgba(color)] if color else None
            self._add(path, "static", rr.SeriesLines(names=[name], colors=colors, widths=[1.8]))
        self._add(path, "scalar", float(value))

    def _add(self, path: str, kind: str, value: Any, at: tuple[int, float] | None = None) -> None:
        """Buffer a value at the present step, or at `at` (step, s)."""
        self._rows.setdefault((path, kind), []).append((*(at or self._now), value))

    def _flush(self) -> None:
        if len(self._seen) < VIEWS:
            self._seen.append(dict(self._pose))
        self._queue.put(self._rows)
        self._rows, self._steps = {}, 0
        self._last_flush = time.monotonic()

    def _write(self, stream: rr.RecordingStream) -> None:
        """Send rows to the file until None comes (in the writer's thread)."""
        try:
            while (rows := self._queue.get()) is not None:
                for (path, kind), entries in rows.items():
                    if kind == "static":
                        for _, _, value in entries:
                            stream.log(path, value, static=True)
                        continue
                    steps, times, values = (list(column) for column in zip(*entries, strict=True))
                    index = [rr.TimeColumn("step", sequence=steps), rr.TimeColumn("time", duration=times)]
                    stream.send_columns(path, index, COLUMNS[kind](values))
                self._append()
        except Exception as error:
            self._failure = error
            self._encoded.read()  # else rerun warns
            while self._queue.get() is not None:  # the session must not wait for a writer that is gone
                pass

    def _append(self) -> None:
        """Append the encoded bytes to the file: all of them, or none."""
        whole = self._encoded.read()
        if whole is None:
            return
        begin = 0 if self._empty else HEADER
        try:
            append(self._file, memoryview(whole)[begin : messages_end(BytesIO(whole))])
        except OSError as error:
            text = f"{self.path}: cannot be written: {error.strerror}; what was recorded before can be replayed"
            raise OutputError(text, str(self.path)) from None
        self._empty = False


def _lane(view: ConstraintView) -> str:
    """Return the entity of a constraint's state, named by its kind and parts."""
    return re.sub(r"[^\w.-]", "_", f"{view.kind}-{view.parts[0]}-{view.parts[1]}-{view.id}")


def _meeting(colliding: NDArray[np.int32]) -> set[tuple[int, int]]:
    """Return (part, surface) of all colliding surfaces."""
    both = np.concatenate([colliding[:, :2], colliding[:, 2:]])
    return set(map(tuple, np.unique(both, axis=0).tolist()))


def _symbol_path(name: str) -> str:
    """The entity of a symbol: its kind, then what it belongs to, which is one step of the path."""
    kind, slash, of = name.partition("/")
    return entity(f"symbols/{kind}", of) if slash else f"symbols/{kind}"
