"""Where a picture is taken from; the page, the recording and the still pictures frame a scene alike."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from vpframe.scene import Scene
from vpframe.visualization.display import bounds

DIRECTION = (0.62, -0.66, 0.42)
"""from the scene towards the eye: front right, a little above; z is up"""


@dataclass(frozen=True, eq=False)
class Camera:
    """A parallel projection from `eye` to `target`; a disc of `radius` metres about the target fills the picture."""

    eye: NDArray[np.float64]
    target: NDArray[np.float64]
    up: NDArray[np.float64]
    radius: float

    def axes(self) -> NDArray[np.float64]:
        """(3, 3) rows: right, up, and towards the eye."""
        back = self.eye - self.target
        back = back / np.linalg.norm(back)
        right = np.cross(self.up, back)
        if np.linalg.norm(right) == 0.0:  # looking along `up`
            right = np.cross([0.0, 1.0, 0.0] if abs(back[1]) < 0.9 else [1.0, 0.0, 0.0], back)
        right = right / np.linalg.norm(right)
        return np.array([right, np.cross(back, right), back])


def look_at(
    low: ArrayLike,
    high: ArrayLike,
    direction: ArrayLike = DIRECTION,
    up: ArrayLike = (0.0, 0.0, 1.0),
    fill: float = 1.0,
) -> Camera:
    """The camera that sees the box from `low` to `high` (3,) whole, from `direction` (towards the eye).

    `fill` < 1 comes closer than the box's bounding sphere needs.
    """
    lo, hi = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    target = 0.5 * (lo + hi)
    radius = max(0.5 * float(np.linalg.norm(hi - lo)), 1e-9) * fill
    d = np.asarray(direction, dtype=np.float64)
    d = d / np.linalg.norm(d)
    return Camera(target + 4.0 * radius * d, target, np.asarray(up, dtype=np.float64), radius)


def frame_scene(
    scene: Scene,
    poses: Mapping[str, pin.SE3] | None = None,
    direction: ArrayLike = DIRECTION,
    fill: float = 1.0,
) -> Camera:
    """The camera that sees all parts, at `poses` where named and at their own otherwise."""
    return look_at(*bounds(scene, poses), direction=direction, fill=fill)
