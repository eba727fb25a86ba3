"""`RerunRecorder`: a session on disk as a rerun recording (`.rrd`), readable at any moment while it grows.

Geometry is written once; poses, highlights, constraints, events and plots follow in columns, every two seconds and from
a thread of its own, so that the session does not wait for the disk and a recording that is killed loses no more than
its last seconds. Positions are single precision, as rerun keeps them.
Timelines: `step` and `time` (s since the session began). Plots are in the units their names say.
"""

from __future__ import annotations

import queue
import re
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
import rerun as rr
from numpy.typing import NDArray

from vpframe.errors import VpframeError
from vpframe.events import ConstraintView, Event, Frame
from vpframe.scene import Part, Scene
from vpframe.visualization import palette
from vpframe.visualization.blueprint import blueprint
from vpframe.visualization.camera import first_view, frame_scene
from vpframe.visualization.display import display_mesh
from vpframe.visualization.symbols import Symbol, frame_symbols, hand_symbols

if TYPE_CHECKING:
    from vpframe.session import Session

FLUSH_STEPS = 240
FLUSH_SECONDS = 2.0
"""the buffered steps go to the file when there are this many, or this long after the last time"""

VIEWS = 200
"""states of the scene, one a flush, that the final camera is fitted to at most"""
BACKLOG = 8
"""buffers that may wait for the writer before the session does"""

GONE = "removed"
"""the state of a constraint that is no longer listed"""

LEVEL = {"bad": "WARN", "plain": "DEBUG"}
"""rerun's level of an event by its tone; INFO for the rest"""

Buffered = dict[tuple[str, str], list[tuple[int, float, Any]]]
"""by entity and kind of value: step, time, value"""


class RerunRecorder:
    """Writes what a session shows to `path` (an `.rrd` file; folders are made, an older file is replaced).

    Raises
    ------
    VpframeError: the file cannot be written.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.path.open("wb").close()
        except OSError as error:
            raise VpframeError(f"{path}: cannot be written: {error.strerror}; give another file") from None
        self._stream: rr.RecordingStream | None = None

    def begin(self, session: Session) -> None:
        """Write the geometry and how to look at it."""
        scene = session.scene
        self._stream = stream = rr.RecordingStream("vpframe", recording_id=None, send_properties=True)
        camera = first_view(scene)
        stream.save(self.path, default_blueprint=blueprint(camera))
        stream.send_recording_name(Path(scene.source).name if scene.source else "session")
        self._scene = scene
        self._names = scene.names
        self._seen: list[dict[str, pin.SE3]] = []
        self._paths = {name: _path("parts", name) for name in scene.names}
        self._colors = palette.part_colors(scene)
        self._symbol_size = 0.06 * camera.radius
        self._rows = _Rows()
        self._pose: dict[str, pin.SE3] = {}
        self._red: set[tuple[int, int]] = set()
        self._symbols: dict[str, tuple[object, ...]] = {}
        self._placed: dict[str, pin.SE3] = {}
        self._state: dict[int, str] = {}
        self._lanes: dict[int, str] = {}
        self._script = ""
        self._lines: dict[tuple[str, str], str] = {}
        self._hand: dict[str, NDArray[np.float64]] = {}
        self._last_flush = time.monotonic()
        stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for part in scene.parts:
            self._log_part(stream, part)
        self._failure: Exception | None = None
        self._queue: queue.Queue[Buffered | None] = queue.Queue(maxsize=BACKLOG)
        self._writer = threading.Thread(target=self._write, args=(stream,), name="vpframe recorder", daemon=True)
        self._writer.start()
        self._start(scene)
        self._flush()

    def frame(self, frame: Frame) -> None:
        """Buffer one step; now and then hand it to the writer. Raises what stopped the writer, if anything did."""
        if self._failure is not None:
            raise self._failure
        rows = self._rows
        rows.at(frame.step, frame.time)
        self._poses(frame.poses)
        self._highlight(frame.colliding)
        self._draw(frame)
        self._states(frame.constraints)
        for event in frame.events:
            rows.add("events", "text", event, (event.step, event.time))
        if frame.script != self._script:
            self._script = frame.script
            rows.add("script", "document", frame.script)
        for part, freedom in frame.freedom.items():
            self._plot("plots/freedom", part, freedom, name=part)
        if frame.clearance is not None or ("plots/clearance", "") in self._lines:
            clearance = np.nan if frame.clearance is None else 1e3 * frame.clearance  # NaN leaves a gap
            self._plot("plots/clearance", "", clearance, "clearance (mm)", palette.FREEDOM)
        self._plot("plots/clashes", "", len(frame.colliding), "colliding surface pairs", palette.COLLIDING)
        for name, seconds in frame.timings.items():
            self._plot("plots/timings", name, 1e3 * seconds, f"{name} (ms)")
        if rows.steps >= FLUSH_STEPS or time.monotonic() - self._last_flush > FLUSH_SECONDS:
            self._flush()

    def end(self) -> None:
        """Write what is left and close the file."""
        if self._stream is not None:
            self._flush()
            self._queue.put(None)
            self._writer.join()
            camera = frame_scene(self._scene, *self._seen)  # all that was seen is known now
            self._stream.send_blueprint(blueprint(camera), make_default=True)
            self._stream.disconnect()
            self._stream = None
            if self._failure is not None:
                raise self._failure

    def _log_part(self, stream: rr.RecordingStream, part: Part) -> None:
        mesh = display_mesh(part.shape)
        for surface in range(mesh.n_surfaces):
            v0, v1 = mesh.vertex_start[surface : surface + 2]
            t0, t1 = mesh.triangle_start[surface : surface + 2]
            stream.log(
                _surface_path(part.name, surface),
                rr.Mesh3D(
                    vertex_positions=mesh.positions[v0:v1],
                    vertex_normals=mesh.normals[v0:v1],
                    triangle_indices=mesh.triangles[t0:t1] - np.uint32(v0),
                ),
                static=True,
            )
        if len(mesh.lines):
            lines = rr.LineStrips3D(mesh.lines, colors=[_rgba(palette.EDGE)], radii=rr.Radius.ui_points(0.6))
            stream.log(f"{_path('parts', part.name)}/lines", lines, static=True)

    def _start(self, scene: Scene) -> None:
        """Poses and colours before the first step: a later value of a static component would not be seen."""
        self._rows.at(0, 0.0)
        self._poses({part.name: part.pose.copy() for part in scene.parts})
        for part in scene.parts:
            for surface in range(part.mesh.n_surfaces):
                self._rows.add(_surface_path(part.name, surface), "albedo", self._colors[part.name])

    def _poses(self, poses: Mapping[str, pin.SE3]) -> None:
        for name, pose in poses.items():
            before = self._pose.get(name)
            if before is pose:  # what nothing moves costs one look-up a step
                continue
            self._pose[name] = pose
            if before is None or before != pose:
                self._rows.add(self._paths[name], "transform", pose)

    def _highlight(self, colliding: NDArray[np.int32]) -> None:
        red = {(int(o), int(s)) for row in colliding for o, s in (row[:2], row[2:])}
        for part, surface in sorted(red ^ self._red):
            name = self._names[part]
            color = palette.COLLIDING if (part, surface) in red else self._colors[name]
            self._rows.add(_surface_path(name, surface), "albedo", color)
        self._red = red

    def _draw(self, frame: Frame) -> None:
        seen = set()
        for symbol in (*frame_symbols(frame), *hand_symbols(frame.hands, self._symbol_size)):
            seen.add(symbol.name)
            path = f"symbols/{symbol.name}"
            if self._symbols.get(symbol.name) != symbol.key:
                self._symbols[symbol.name] = symbol.key
                self._rows.add(path, "strips", symbol)
            if symbol.name not in self._placed or self._placed[symbol.name] != symbol.pose:
                self._placed[symbol.name] = symbol.pose
                self._rows.add(path, "transform", symbol.pose)
        for name in [name for name in self._symbols if name not in seen]:
            del self._symbols[name]
            self._rows.add(f"symbols/{name}", "strips", None)
        for name, pose in frame.hands.items():
            place = pose.translation.copy()
            if name in self._hand and not np.array_equal(self._hand[name], place):
                self._rows.add(_path("trail", name), "segment", np.array([self._hand[name], place]))
            self._hand[name] = place

    def _states(self, views: tuple[ConstraintView, ...]) -> None:
        """Keep the state of each constraint when it changes; GONE is drawn as a gap."""
        now = {view.id: view.state for view in views}
        if now == self._state:
            return
        for view in views:
            if view.id not in self._lanes:
                path = self._lanes[view.id] = f"constraints/{_lane(view)}"
                values = [*palette.STATE, GONE]
                colors = _colors([*palette.STATE.values(), palette.REFUSED])
                visible = [value != GONE for value in values]
                style = rr.StateConfiguration(values=values, labels=values, colors=colors, visible=visible)
                self._rows.add(path, "style", style)
            if self._state.get(view.id) != view.state:
                self._rows.add(self._lanes[view.id], "state", view.state)
        for gone in self._state.keys() - now.keys():
            self._rows.add(self._lanes[gone], "state", GONE)
        self._state = now

    def _plot(self, root: str, leaf: str, value: float, name: str, color: palette.Color | None = None) -> None:
        """One point of a line; its name, with the unit, is written the first time."""
        path = self._lines.get((root, leaf))
        if path is None:
            path = self._lines[root, leaf] = _path(root, leaf) if leaf else root
            colors = [_rgba(color)] if color else None
            self._rows.add(path, "style", rr.SeriesLines(names=[name], colors=colors, widths=[1.8]))
        self._rows.add(path, "scalar", float(value))

    def _flush(self) -> None:
        if len(self._seen) < VIEWS:
            self._seen.append(dict(self._pose))
        self._queue.put(self._rows.take())
        self._last_flush = time.monotonic()

    def _write(self, stream: rr.RecordingStream) -> None:
        """Send rows to the file until None comes (in the writer's thread)."""
        try:
            while (rows := self._queue.get()) is not None:
                for (path, kind), entries in rows.items():
                    if kind == "style":
                        stream.log(path, entries[0][2], static=True)
                        continue
                    steps, times, values = (list(column) for column in zip(*entries, strict=True))
                    index = [rr.TimeColumn("step", sequence=steps), rr.TimeColumn("time", duration=times)]
                    stream.send_columns(path, index, _COLUMNS[kind](values))
                stream.flush()
        except Exception as error:
            self._failure = error
            while self._queue.get() is not None:  # the session must not wait for a writer that is gone
                pass


class _Rows:
    """Buffered rows by entity and kind of value."""

    def __init__(self) -> None:
        self.steps = 0
        self._now = (0, 0.0)
        self._rows: Buffered = {}

    def at(self, step: int, seconds: float) -> None:
        self._now = (step, seconds)
        self.steps += 1

    def add(self, path: str, kind: str, value: Any, at: tuple[int, float] | None = None) -> None:
        """Buffer a value, at the present step unless `at` says another (step, s)."""
        self._rows.setdefault((path, kind), []).append((*(at or self._now), value))

    def take(self) -> Buffered:
        """All rows by entity and kind; the buffers are empty afterwards."""
        rows, self._rows, self.steps = self._rows, {}, 0
        return rows


def _transforms(values: list[pin.SE3]) -> Any:
    quaternions = [pin.Quaternion(pose.rotation).coeffs() for pose in values]
    return rr.Transform3D.columns(translation=[pose.translation for pose in values], quaternion=quaternions)


def _strips(values: list[Symbol | None]) -> Any:
    drawn = [symbol for symbol in values if symbol]
    each = [1 if symbol else 0 for symbol in values]  # no strips and no colour: the symbol is gone
    strips = rr.LineStrips3D.columns(strips=[strip for symbol in drawn for strip in symbol.strips])
    style = rr.LineStrips3D.columns(
        colors=_colors([symbol.color for symbol in drawn]),
        radii=_ui_radii([0.5 * symbol.width for symbol in drawn]),
        labels=[symbol.label for symbol in drawn],
        show_labels=[False] * len(drawn),
    )
    return [*strips.partition([len(symbol.strips) if symbol else 0 for symbol in values]), *style.partition(each)]


def _segments(values: list[NDArray[np.float64]]) -> Any:
    colors = _colors([palette.TRAIL] * len(values))
    return rr.LineStrips3D.columns(strips=values, colors=colors, radii=_ui_radii([1.0] * len(values)))


def _texts(events: list[Event]) -> Any:
    tones = [palette.tone(event) for event in events]
    return rr.TextLog.columns(
        text=[f"{event.kind}: {event.text or ' – '.join(event.parts)}" for event in events],
        level=[LEVEL.get(tone, "INFO") for tone in tones],
        color=_colors([palette.TONES[tone] for tone in tones]),
    )


_COLUMNS: dict[str, Callable[[list[Any]], Any]] = {
    "transform": _transforms,
    "strips": _strips,
    "segment": _segments,
    "text": _texts,
    "albedo": lambda values: rr.Mesh3D.columns(albedo_factor=_colors(values)),
    "scalar": lambda values: rr.Scalars.columns(scalars=values),
    "state": lambda values: rr.StateChange.columns(state=values),
    "document": lambda values: rr.TextDocument.columns(text=values),
}


def _lane(view: ConstraintView) -> str:
    """The entity that keeps a constraint's state: its kind and parts, as a person would call it."""
    return re.sub(r"[^\w.-]", "_", f"{view.kind}-{view.parts[0]}-{view.parts[1]}-{view.id}")


def _surface_path(part: str, surface: int) -> str:
    return f"{_path('parts', part)}/surfaces/{surface}"


def _rgba(color: palette.Color) -> int:
    r, g, b = (round(255 * min(max(c, 0.0), 1.0)) for c in color)
    return (r << 24) | (g << 16) | (b << 8) | 0xFF


def _ui_radii(points: list[float]) -> NDArray[np.float32]:
    """Radii that do not shrink with distance, in points of the screen: rerun keeps them as negative numbers."""
    return -np.array(points, dtype=np.float32)


def _colors(colors: list[palette.Color]) -> NDArray[np.uint32]:
    return np.array([_rgba(color) for color in colors], dtype=np.uint32)


def _path(root: str, name: str) -> str:
    """`root/name` with the name as one step of the path, whatever it holds."""
    return f"{root}/{rr.escape_entity_path_part(name)}"
