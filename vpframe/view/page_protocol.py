"""Messages to the page: scenes and frames as JSON, arrays as base64 of little-endian numbers."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from constraints.geometry.surfaces import Cone, Cylinder, Geometry, Plane, Sphere, Torus
from vpframe.events import ConstraintView, Event, Frame, moved
from vpframe.scene.names import face_words
from vpframe.scene.scene import Part, Scene, Shape
from vpframe.text import plain
from vpframe.view import palette
from vpframe.view.camera import Camera, frame_scene
from vpframe.view.display import display_mesh
from vpframe.view.symbols import SceneSymbol, frame_symbols, hand_symbols

Message = dict[str, Any]


class Encoder:
    """Encodes the frames of one scene as messages; strips of symbols are sent once and referred to by number."""

    def __init__(self, scene: Scene, start: Mapping[str, pin.SE3] | None = None, camera: Camera | None = None) -> None:
        self.scene = scene
        self.start = {part.name: (start or {}).get(part.name, part.pose).copy() for part in scene.parts}
        self.camera = camera or frame_scene(scene, self.start)
        self._index = {name: i for i, name in enumerate(scene.names)}
        self._known: Mapping[str, pin.SE3] = {}
        self._moved: dict[int, str] = {}
        """indices of the parts that ever moved"""
        self._strips: dict[tuple[object, ...], int] = {}
        self._symbols: dict[int, tuple[ConstraintView, SceneSymbol]] = {}

    def begin(self) -> Message:
        """Return the message of the scene: shapes once, parts with poses and colours, camera."""
        return scene_message(self.scene, self.start, self.camera)

    def frame(self, frame: Frame, events: Iterable[Event] = ()) -> tuple[list[Message], Message]:
        """Return messages with new strips, and the message of the frame.

        A page that has all strips can show any frame: each has the poses of all parts that moved in an encoded frame.
        """
        names, self._known = moved(self._known, frame.poses), frame.poses
        for name in names:
            if frame.poses[name] != self.start[name]:
                self._moved[self._index[name]] = name
        fresh: list[Message] = []
        drawn, places = [], []
        for symbol in (*frame_symbols(frame, self._symbols), *hand_symbols(frame.hands, 0.06 * self.camera.radius)):
            number = self._strips.get(symbol.key)
            if number is None:
                number = self._strips[symbol.key] = len(self._strips)
                fresh.append(strips_message(number, symbol))
            places.append(matrix(symbol.pose))
            drawn.append(
                {
                    "name": plain(symbol.name),
                    "strips": number,
                    "color": palette.hex_color(symbol.color),
                }
            )
        message = {
            "type": "frame",
            "step": frame.step,
            "time": frame.time,
            "moved": list(self._moved),
            "poses": pack(np.array([matrix(frame.poses[name]) for name in self._moved.values()], dtype=np.float32)),
            "colliding": frame.colliding.tolist(),
            "constraints": [
                {
                    "id": view.id,
                    "kind": view.kind,
                    "parts": [plain(part) for part in view.parts],
                    "state": view.state,
                    "surfaces": view.surfaces,
                    "at": view.origin.tolist(),
                    "residual": view.residual,
                    "why": plain(view.why),
                }
                for view in frame.constraints
            ],
            "symbols": drawn,
            "symbol_poses": pack(np.array(places, dtype=np.float32)),
            "freedom": {plain(name): [freedom, frame.joint.get(name, "")] for name, freedom in frame.freedom.items()},
            "clearance": frame.clearance,
            "held": [plain(name) for name in frame.held],
            "hands": {plain(name): pose.translation.tolist() for name, pose in frame.hands.items()},
            "script": plain(frame.script),
            "events": [event_message(event) for event in events],
        }
        return fresh, message


def scene_message(scene: Scene, poses: Mapping[str, pin.SE3], camera: Camera) -> Message:
    """Return the message that a page needs before the first frame."""
    shapes: dict[Shape, int] = {}
    first: list[Part] = []
    for part in scene.parts:
        if part.shape not in shapes:
            shapes[part.shape] = len(shapes)
            first.append(part)
    colors = palette.part_colors(scene)
    return {
        "type": "scene",
        "title": plain(scene.source or "vpframe"),
        "shapes": [shape_message(part) for part in first],
        "parts": [
            {
                "name": plain(part.name),
                "shape": shapes[part.shape],
                "color": palette.hex_color(colors[part.name]),
                "fixed": part.fixed,
                "pose": matrix(poses[part.name]).tolist(),
            }
            for part in scene.parts
        ],
        "camera": {
            "eye": camera.eye.tolist(),
            "target": camera.target.tolist(),
            "radius": camera.radius,
            "across": camera.across,
        },
        "colors": {
            "colliding": palette.hex_color(palette.COLLIDING),
            "edge": palette.hex_color(palette.EDGE),
            "trail": palette.hex_color(palette.TRAIL),
            "background": [palette.hex_color(color) for color in palette.BACKGROUND],
            "state": {state: palette.hex_color(color) for state, color in palette.STATE.items()},
        },
    }


def shape_message(part: Part) -> Message:
    """Return a shape: triangles by surface, lines, and names and measures of its faces."""
    mesh = display_mesh(part.shape)
    return {
        "positions": pack(mesh.positions),
        "normals": pack(mesh.normals),
        "triangles": pack(mesh.triangles),
        "vertex_start": mesh.vertex_start.tolist(),
        "triangle_start": mesh.triangle_start.tolist(),
        "lines": pack(mesh.lines),
        "closed": part.shape.closed,
        "faces": [plain(face_words(part, s)) for s in range(len(part.surfaces))],
        "measures": [_measure(surface.geometry) for surface in part.surfaces],
    }


def _measure(geometry: Geometry) -> list[Any] | None:
    """Return the measures of a face: kind, point and direction (part frame, m), radius (m; 0 for planes and cones)."""
    match geometry:
        case Plane(origin=origin, normal=direction):
            kind, radius = "plane", 0.0
        case (
            Cylinder(origin=origin, axis=direction, radius=radius) | Torus(center=origin, axis=direction, major=radius)
        ):
            kind = "axis"
        case Cone(apex=origin, axis=direction):
            kind, radius = "axis", 0.0
        case Sphere(center=origin, radius=radius):
            kind, direction = "point", np.zeros(3)
        case _:
            return None
    return [kind, np.asarray(origin).tolist(), np.asarray(direction).tolist(), float(radius)]


def strips_message(number: int, symbol: SceneSymbol) -> Message:
    """Return the polylines of a symbol, in its own frame."""
    return {
        "type": "strips",
        "number": number,
        "width": symbol.width,
        "hidden": symbol.hidden,
        "strips": [pack(strip.astype(np.float32)) for strip in symbol.strips],
    }


def event_message(event: Event, frame: int | None = None) -> Message:
    """Return an event as a line of the page's log; `frame`: number of the event's frame."""
    return {
        "frame": frame,
        "parts": [plain(name) for name in event.parts],
        "time": event.time,
        "kind": event.kind,
        "tone": palette.tone(event),
        "text": plain(event.text or " – ".join(event.parts)),
    }


def matrix(pose: pin.SE3) -> NDArray[np.float64]:
    """Return the homogeneous matrix (16,) by columns, as in three.js."""
    return pose.homogeneous.T.ravel()


def pack(array: NDArray[Any]) -> str:
    """Return base64 of the array's little-endian bytes."""
    return base64.b64encode(np.ascontiguousarray(array).astype(array.dtype.newbyteorder("<")).tobytes()).decode("ascii")
