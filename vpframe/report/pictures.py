"""Pictures of the report: each clash, the scene at events, the place of least clearance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vpframe.analysis.pairs import meeting_box
from vpframe.events import Frame
from vpframe.scene.boxes import half_size
from vpframe.scene.scene import Scene
from vpframe.view.camera import DIRECTION, Camera, look_at
from vpframe.view.display import display_mesh
from vpframe.view.snapshot import Look, render
from vpframe.view.symbols import SceneSymbol, frame_symbols, hand_symbols

SIZE = (480, 360)
PAIR_SIZE = (360, 270)
SEEN = 0.4
"""radius of the view of a clash, as a fraction of the smaller part's size"""
GLASS = 0.5
GHOST = 0.12
"""opacity of the larger of two clashing parts, and of all others"""


def scene_picture(
    scene: Scene,
    frame: Frame,
    camera: Camera,
    size: tuple[int, int] = SIZE,
    marks: Sequence[SceneSymbol] = (),
    marked: Sequence[tuple[str, int]] = (),
) -> NDArray[np.uint8]:
    """Render the scene at one step, with the surfaces `marked`, the constraints and `marks`."""
    symbols = (*frame_symbols(frame), *hand_symbols(frame.hands, 0.06 * camera.radius), *marks)
    return render(scene, frame.poses, marked, size, camera, symbols)


def pair_picture(
    scene: Scene,
    frame: Frame,
    surfaces: Sequence[tuple[str, int]],
    marked: Sequence[tuple[str, int]] = (),
    size: tuple[int, int] = PAIR_SIZE,
) -> NDArray[np.uint8]:
    """Render two surfaces at one step from near by; the larger part is transparent, others are faint.

    marked: all intersecting surfaces of the two parts; default: only the two.
    """
    opacity = dict.fromkeys(scene.names, GHOST)
    large, small = sorted((name for name, _ in surfaces), key=lambda name: -half_size(scene[name].mesh))
    opacity.update({large: GLASS, small: 1.0})
    return render(scene, frame.poses, marked or surfaces, size, pair_camera(scene, frame, surfaces), look=Look(opacity))


def pair_camera(scene: Scene, frame: Frame, surfaces: Sequence[tuple[str, int]]) -> Camera:
    """Return a camera at the intersection of two surfaces' bounding boxes, on the side of their normals."""
    sizes, whole, facing = [], [], np.zeros(3)
    parts = [scene[name] for name, _ in surfaces]
    poses = [frame.poses.get(part.name, part.pose) for part in parts]
    for part, pose, (_, surface) in zip(parts, poses, surfaces, strict=True):
        mesh = display_mesh(part.shape)
        chosen = slice(mesh.vertex_start[surface], mesh.vertex_start[surface + 1])
        sizes.append(float(np.linalg.norm(np.ptp(mesh.positions[chosen], axis=0))))
        whole.append(2.0 * half_size(part.mesh))
        facing += pose.rotation @ mesh.normals[chosen].astype(np.float64).mean(axis=0)
    low, high = meeting_box(parts, poses, [surface for _, surface in surfaces])
    half = max(0.6 * min(sizes), SEEN * min(whole), 1e-9)
    direction = np.array(DIRECTION) / np.linalg.norm(DIRECTION) + 0.35 * facing
    return look_at(0.5 * (low + high) + half * np.concatenate([np.eye(3), -np.eye(3)]), direction)
