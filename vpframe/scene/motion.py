"""`Motion`: poses of parts over time, as keys with linear interpolation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vpframe.errors import VpframeError

Keys = tuple[NDArray[np.float64], NDArray[np.float64]]
"""(k,) times, s, ascending; (k, 7) position, m, and unit quaternion x y z w, world"""


@dataclass(frozen=True, eq=False)
class Motion:
    """Poses of parts over time; a part without keys keeps its pose in the scene."""

    keys: Mapping[str, Keys]
    """by part name"""
    end: float = 0.0
    """end of the motion, s, if later than the last key"""
    precision: float = 0.0
    """relative precision of the poses' source, of 1 m and of the distance from the origin: 1e-7 for single precision"""

    def __post_init__(self) -> None:
        for name, (times, rows) in self.keys.items():
            if not (np.isfinite(times).all() and np.isfinite(rows).all()):
                raise VpframeError(f"motion of {name}: a time or pose is not finite")
            if rows.shape != (len(times), 7) or not len(times) or (np.diff(times) <= 0.0).any():
                raise VpframeError(f"motion of {name}: times must ascend, with 7 numbers a pose")

    @staticmethod
    def of(frames: Iterable[tuple[float, Mapping[str, pin.SE3]]]) -> Motion:
        """Create a motion from poses at ascending times (s), each mapping as complete as the first; equal poses in
        sequence keep two keys."""
        times: list[float] = []
        rows: dict[str, list[tuple[int, NDArray[np.float64]]]] = {}
        for number, (time, poses) in enumerate(frames):
            times.append(time)
            for name, pose in poses.items():
                own = rows.setdefault(name, [])
                row = pin.SE3ToXYZQUAT(pose)
                if not own or not np.array_equal(own[-1][1], row):
                    own.append((number, row))
        return Motion.of_changes(times, rows, times[-1] if times else 0.0)

    @staticmethod
    def of_changes(
        times: list[float],
        changes: Mapping[str, Iterable[tuple[int, NDArray[np.float64]]]],
        end: float = 0.0,
        precision: float = 0.0,
    ) -> Motion:
        """Create a motion from the changed poses (7,), each with its index in `times` (s, ascending)."""
        keys: dict[str, Keys] = {}
        for name, own in changes.items():
            at: list[int] = []
            rows: list[NDArray[np.float64]] = []
            for number, row in own:
                if at and at[-1] < number - 1:
                    at.append(number - 1)
                    rows.append(rows[-1])
                flipped = rows and row[3:] @ rows[-1][3:] < 0.0  # the same rotation, by the shorter way
                at.append(number)
                rows.append(np.concatenate([row[:3], -row[3:]]) if flipped else row)
            keys[name] = np.array([times[k] for k in at]), np.array(rows).reshape(-1, 7)
        return Motion(keys, end, precision)

    @cached_property
    def duration(self) -> float:
        """Time from 0 to the end, s."""
        return max([self.end, *(float(times[-1]) for times, _ in self.keys.values())])

    @property
    def moving(self) -> tuple[str, ...]:
        """Names of the parts that move."""
        return tuple(name for name, (_, rows) in self.keys.items() if (rows != rows[0]).any())

    def placed(self, poses: Mapping[str, pin.SE3], time: float) -> dict[str, pin.SE3]:
        """Return poses as `at` does, with the given `poses` substituted where both agree within `precision`."""
        out = self.at(time)
        for name in out.keys() & poses.keys():
            here = poses[name]
            away = float(np.abs(out[name].homogeneous - here.homogeneous).max())
            if away <= self.precision * (1.0 + float(np.abs(here.translation).max())):
                out[name] = here
        return out

    def at(self, time: float) -> dict[str, pin.SE3]:
        """Return the poses at a time (s) of all parts with keys: linear position and slerp between keys, constant
        outside."""
        out = {}
        for name, (times, rows) in self.keys.items():
            i = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(times) - 1))
            j = min(i + 1, len(times) - 1)
            s = float(np.clip((time - times[i]) / (times[j] - times[i]), 0.0, 1.0)) if j > i else 0.0
            a, b = (pin.Quaternion(rows[k, 3:]) for k in (i, j))
            turned = a if s == 0.0 else b if s == 1.0 else a.slerp(s, b)
            out[name] = pin.SE3(turned.normalized().matrix(), (1.0 - s) * rows[i, :3] + s * rows[j, :3])
        return out
