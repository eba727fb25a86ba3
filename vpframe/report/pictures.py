"""The report's pictures: each clash at its first moment, the scene at what happened, the place of least clearance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vpframe.scene.scene import Scene
from vpframe.session.events import Frame
from vpframe.view.camera import DIRECTION, Camera, look_at
from vpframe.view.display import display_mesh
from vpframe.view.snapshot import render
from vpframe.view.symbols import Symbol, frame_symbols, hand_symbols

SIZE = (480, 360)
GHOST = 0.22
"""opacity of what stands between the eye and a clash"""


def scene_picture(
    scene: Scene, frame: Frame, camera: Camera, size: tuple[int, int] = SIZE, marks: Sequence[Symbol] = ()
) -> NDArray[np.uint8]:
    """The whole scene at one step, with what collides, the constraints and `marks`."""
    names = scene.names
    marked = [(names[o], int(s)) for row in frame.colliding for o, s in (row[:2], row[2:])]
    symbols = (*frame_symbols(frame), *hand_symbols(frame.hands, 0.06 * camera.radius), *marks)
    return render(scene, frame.poses, marked, size, camera, symbols)


def pair_picture(
    scene: Scene, frame: Frame, surfaces: Sequence[tuple[str, int]], size: tuple[int, int] = SIZE
) -> NDArray[np.uint8]:
    """Two surfaces at one step, from near by; other parts are drawn faint."""
    names = {name for name, _ in surfaces}
    opacity = {name: 1.0 if name in names else GHOST for name in scene.names}
    return render(scene, frame.poses, surfaces, size, _near(scene, frame, surfaces), opacity=opacity)


def _near(scene: Scene, frame: Frame, surfaces: Sequence[tuple[str, int]]) -> Camera:
    """A camera on where the boxes of the surfaces overlap, from the side their normals face."""
    lows, highs, facing = [], [], np.zeros(3)
    for name, surface in surfaces:
        mesh = display_mesh(scene[name].shape)
        pose = frame.poses.get(name, scene[name].pose)
        chosen = slice(mesh.vertex_start[surface], mesh.vertex_start[surface + 1])
        points = mesh.positions[chosen].astype(np.float64) @ pose.rotation.T + pose.translation
        lows.append(points.min(axis=0))
        highs.append(points.max(axis=0))
        facing += pose.rotation @ mesh.normals[chosen].astype(np.float64).mean(axis=0)
    low, high = np.max(lows, axis=0), np.min(highs, axis=0)
    middle = 0.5 * (low + high)
    sizes = [float(np.linalg.norm(h - lo)) for lo, h in zip(lows, highs, strict=True)]
    half = max(0.6 * min(sizes), 0.25 * max(sizes), 1e-9)
    direction = np.array(DIRECTION) / np.linalg.norm(DIRECTION) + 0.35 * facing
    return look_at(middle + half * np.concatenate([np.eye(3), -np.eye(3)]), direction)
