"""The camera of a picture; the page, the recording and the still pictures frame a scene alike."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from vpframe.scene.boxes import corners, half_size, placed_corners
from vpframe.scene.scene import Part, Scene, Shape

DIRECTION = (0.62, -0.66, 0.42)
"""from the scene towards the eye: front right, a little above; z is up"""


ASPECT = 4.0 / 3.0
"""aspect ratio for which scenes are framed"""
MARGIN = 1.08
WIRE = 0.1
"""a part is long and thin if its surface is less than this times the square of its box's diagonal"""
LITTLE = 0.25
"""a picture may cut the ends of long thin parts that make up at most this share of all surface"""
STUB = 0.1
"""visible length of a cut part beyond the others, relative to their size"""
BESIDE = 0.05
"""distance up to which a part is a neighbour, relative to the size of the moving parts"""
AROUND = 0.5
"""distance up to which neighbours are in the picture, relative to the same"""
_AREAS: WeakKeyDictionary[Shape, float] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Camera:
    """A parallel projection from `eye` to `target`; a disc of `radius` metres about the target fills the picture."""

    eye: NDArray[np.float64]
    target: NDArray[np.float64]
    up: NDArray[np.float64]
    radius: float
    across: float = 0.0
    """half the width of what is to be seen, m: a picture narrower than 4:3 is taken from farther away for it"""

    def axes(self) -> NDArray[np.float64]:
        """Return (3, 3) rows: right, up, and towards the eye."""
        return view_axes(self.eye - self.target, self.up)


def view_axes(back: NDArray[np.float64], up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (3, 3) rows right, up, back of a view along -`back`, with `up` (or x, if parallel) upwards."""
    back = back / np.linalg.norm(back)
    right = np.cross(up, back)
    if np.linalg.norm(right) < 1e-9:
        right = np.cross([0.0, 1.0, 0.0], back) if abs(back[1]) < 0.9 else np.cross([1.0, 0.0, 0.0], back)
    right = right / np.linalg.norm(right)
    return np.array([right, np.cross(back, right), back])


def look_at(points: ArrayLike, direction: ArrayLike = DIRECTION, up: ArrayLike = (0.0, 0.0, 1.0)) -> Camera:
    """Return the nearest camera that sees all `points` (n, 3) from `direction` (towards the eye) in a 4:3 picture."""
    p = np.asarray(points, dtype=np.float64)
    axes = view_axes(np.asarray(direction, dtype=np.float64), np.asarray(up, dtype=np.float64))
    seen = p @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    target = 0.5 * (low + high) @ axes
    half = 0.5 * (high - low)
    radius = MARGIN * max(half[0] / ASPECT, half[1], 0.05 * float(np.linalg.norm(half)), 1e-9)
    distance = 2.0 * radius + float(np.linalg.norm(half))
    across = MARGIN * float(half[0])
    return Camera(target + distance * axes[2], target, np.asarray(up, dtype=np.float64), radius, across)


def frame_scene(
    scene: Scene, *poses: Mapping[str, pin.SE3], direction: ArrayLike = DIRECTION, names: Iterable[str] = ()
) -> Camera:
    """Return the camera that sees the parts that move over `poses` and their neighbours; all (or `names`) if none does.

    A part that `poses` do not name stands at its own pose. Of a neighbour, what reaches far beyond is not in the
    picture; neither is what reaches beyond all others of a long thin part, a wire, among stouter ones (`slender`).
    """
    chosen = tuple(names) or scene.names
    if not chosen:
        return look_at(np.array([[-0.5] * 3, [0.5] * 3]), direction)
    boxes, moving = [], []
    for name in chosen:
        part = scene[name]
        own = corners(part.mesh)
        seen = (given.get(name, part.pose) for given in poses or ({},))
        there = list({pose.homogeneous.tobytes(): pose for pose in seen}.values())
        boxes.append(np.concatenate([own @ pose.rotation.T + pose.translation for pose in there]))
        moving.append(any(_apart(there[0], pose, own) for pose in there[1:]))
    parts = [scene[name] for name in chosen]
    thin = [slender(part) for part in parts]
    if any(moving) and not all(moving):
        return look_at(_with_neighbours(boxes, moving, thin), direction)
    return look_at(_without_ends(parts, boxes, thin), direction)


def first_view(scene: Scene) -> Camera:
    """Return the camera for a session whose motion is not known yet, with room to lift what can move."""
    if not len(scene):
        return frame_scene(scene)
    parts = scene.parts
    boxes, thin = [placed_corners(part, part.pose) for part in parts], [slender(part) for part in parts]
    lift = np.array([0.0, 0.0, 0.6 * float(np.ptp(_without_ends(parts, boxes, thin)[:, 2]))])
    boxes = [box if part.fixed else np.concatenate([box, box + lift]) for part, box in zip(parts, boxes, strict=True)]
    return look_at(_without_ends(parts, boxes, thin))


def slender(part: Part) -> bool:
    """Whether a part is a wire: its surface is less than `WIRE` of the square of its box's diagonal.

    A straight round bar is at a length of 31 diameters; sheet never is.
    """
    return _area(part) < WIRE * (2.0 * half_size(part.mesh)) ** 2


def _area(part: Part) -> float:
    """Return the area of a part's surface, m²; measured once per shape."""
    if part.shape not in _AREAS:
        at = part.mesh.vertices[part.mesh.triangles]
        sides = np.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0])
        _AREAS[part.shape] = 0.5 * float(np.linalg.norm(sides, axis=1).sum())
    return _AREAS[part.shape]


def _apart(first: pin.SE3, second: pin.SE3, box: NDArray[np.float64]) -> bool:
    """Whether a part with these box corners (8, 3) is displaced in the second pose by more than 1e-4 of its size."""
    moved = box @ (second.rotation - first.rotation).T + (second.translation - first.translation)
    return bool(np.abs(moved).max() > 1e-4 * np.abs(np.ptp(box, axis=0)).max())


def _with_neighbours(
    boxes: Sequence[NDArray[np.float64]], moving: Sequence[bool], thin: Sequence[bool]
) -> NDArray[np.float64]:
    """Return points (n, 3) of moving parts and of the near ends of the parts beside their way; wires are cut."""
    way = np.concatenate([box for box, moves in zip(boxes, moving, strict=True) if moves])
    low, high = way.min(axis=0), way.max(axis=0)
    size = float(np.linalg.norm(high - low))
    points = way
    for wires, margin in ((False, AROUND * size), (True, STUB * size)):
        floor, top = points.min(axis=0) - margin, points.max(axis=0) + margin
        near = [
            np.clip(box, floor, top)
            for box, moves, wire in zip(boxes, moving, thin, strict=True)
            if not moves
            and wire == wires
            and (box.min(axis=0) <= high + BESIDE * size).all()
            and (box.max(axis=0) >= low - BESIDE * size).all()
        ]
        points = np.concatenate([points, *near])
    return points


def _without_ends(
    parts: Sequence[Part], boxes: Sequence[NDArray[np.float64]], thin: Sequence[bool]
) -> NDArray[np.float64]:
    """Return points (n, 3) of all boxes; thin parts with little surface are cut a little beyond the others."""
    if not any(thin) or all(thin):
        return np.concatenate(boxes)
    area, cut = np.array([_area(part) for part in parts]), np.array(thin)
    area = np.minimum(area, area[~cut].max())  # a longer wire must not count more
    if area[cut].sum() > LITTLE * area.sum():
        return np.concatenate(boxes)
    stout = np.concatenate([box for box, out in zip(boxes, thin, strict=True) if not out])
    low, high = stout.min(axis=0), stout.max(axis=0)
    margin = STUB * float(np.linalg.norm(high - low))
    return np.concatenate(
        [stout, *(np.clip(b, low - margin, high + margin) for b, t in zip(boxes, thin, strict=True) if t)]
    )
