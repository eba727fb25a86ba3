"""Where a picture is taken from; the page, the recording and the still pictures frame a scene alike."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from vpframe.scene.scene import Part, Scene

DIRECTION = (0.62, -0.66, 0.42)
"""from the scene towards the eye: front right, a little above; z is up"""


ASPECT = 4.0 / 3.0
"""width over height that scenes are framed for"""
MARGIN = 1.08


@dataclass(frozen=True, eq=False)
class Camera:
    """A parallel projection from `eye` to `target`; a disc of `radius` metres about the target fills the picture."""

    eye: NDArray[np.float64]
    target: NDArray[np.float64]
    up: NDArray[np.float64]
    radius: float

    def axes(self) -> NDArray[np.float64]:
        """(3, 3) rows: right, up, and towards the eye."""
        return view_axes(self.eye - self.target, self.up)


def view_axes(back: NDArray[np.float64], up: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) rows right, up, back of a view along -`back`, with `up` (or x, when they are parallel) upwards."""
    back = back / np.linalg.norm(back)
    right = np.cross(up, back)
    if np.linalg.norm(right) < 1e-9:
        right = np.cross([0.0, 1.0, 0.0], back) if abs(back[1]) < 0.9 else np.cross([1.0, 0.0, 0.0], back)
    right = right / np.linalg.norm(right)
    return np.array([right, np.cross(back, right), back])


def look_at(points: ArrayLike, direction: ArrayLike = DIRECTION, up: ArrayLike = (0.0, 0.0, 1.0)) -> Camera:
    """The camera that sees all `points` (n, 3) from `direction` (towards the eye), as near as a 4:3 picture allows."""
    p = np.asarray(points, dtype=np.float64)
    axes = view_axes(np.asarray(direction, dtype=np.float64), np.asarray(up, dtype=np.float64))
    seen = p @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    target = 0.5 * (low + high) @ axes
    half = 0.5 * (high - low)
    radius = MARGIN * max(half[0] / ASPECT, half[1], 0.05 * float(np.linalg.norm(half)), 1e-9)
    distance = 2.0 * radius + float(np.linalg.norm(half))
    return Camera(target + distance * axes[2], target, np.asarray(up, dtype=np.float64), radius)


def frame_scene(
    scene: Scene, *poses: Mapping[str, pin.SE3], direction: ArrayLike = DIRECTION, names: Iterable[str] = ()
) -> Camera:
    """The camera that sees all parts (or `names`) at each of `poses`, and at their own pose where none names them."""
    corners = []
    for name in tuple(names) or scene.names:
        part = scene[name]
        own = box_corners(part, pin.SE3.Identity())
        # what stands still has one and the same pose at most steps
        there = {id(pose): pose for pose in (given.get(name, part.pose) for given in poses or ({},))}
        corners += [own @ pose.rotation.T + pose.translation for pose in there.values()]
    return look_at(np.concatenate(corners) if corners else np.array([[-0.5] * 3, [0.5] * 3]), direction)


def first_view(scene: Scene) -> Camera:
    """The camera for a session whose way is not known yet: room is left for what can move to be lifted."""
    corners = [box_corners(part, part.pose) for part in scene.parts]
    if not corners:
        return frame_scene(scene)
    height = float(np.ptp(np.concatenate(corners)[:, 2]))
    lift = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.6 * height]))
    return frame_scene(scene, {}, {part.name: lift * part.pose for part in scene.parts if not part.fixed})


def box_corners(part: Part, pose: pin.SE3) -> NDArray[np.float64]:
    """(8, 3) corners of the part's own bounding box, in the world."""
    v = part.mesh.vertices
    low, high = v.min(axis=0), v.max(axis=0)
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    return corners @ pose.rotation.T + pose.translation
