"""`Motion`: where parts are over time, as keys between which they move straight."""

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
    """Poses of parts over time; a part without keys stays where the scene has it."""

    keys: Mapping[str, Keys]
    """by part name"""
    end: float = 0.0
    """s: until when it is known, if that is later than the last key"""
    precision: float = 0.0
    """of what the poses were read from, of 1 and of a part's distance from the origin: 1e-7 of single precision"""

    def __post_init__(self) -> None:
        for name, (times, rows) in self.keys.items():
            if not (np.isfinite(times).all() and np.isfinite(rows).all()):
                raise VpframeError(f"motion of {name}: a time or pose is not finite")
            if rows.shape != (len(times), 7) or not len(times) or (np.diff(times) <= 0.0).any():
                raise VpframeError(f"motion of {name}: times must ascend, with 7 numbers a pose")

    @staticmethod
    def of(frames: Iterable[tuple[float, Mapping[str, pin.SE3]]]) -> Motion:
        """From the poses at ascending times (s), each mapping as complete as the first; parts that rest get two keys
        a rest."""
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
        """From the poses (7,) that changed, each with its place in `times` (s, ascending): a part rests between."""
        keys: dict[str, Keys] = {}
        for name, own in changes.items():
            at: list[int] = []
            rows: list[NDArray[np.float64]] = []
            for number, row in own:
                if at and at[-1] < number - 1:
                    at.append(number - 1)
                    rows.append(rows[-1])
                flipped = rows and row[3:] @ rows[-1][3:] < 0.0  # the same rotation; between the two lies no turn
                at.append(number)
                rows.append(np.concatenate([row[:3], -row[3:]]) if flipped else row)
            keys[name] = np.array([times[k] for k in at]), np.array(rows).reshape(-1, 7)
        return Motion(keys, end, precision)

    @cached_property
    def duration(self) -> float:
        """s, from 0 to where it ends."""
        return max([self.end, *(float(times[-1]) for times, _ in self.keys.values())])

    @property
    def moving(self) -> tuple[str, ...]:
        """The parts that have more than one pose."""
        return tuple(name for name, (_, rows) in self.keys.items() if (rows != rows[0]).any())

    def placed(self, poses: Mapping[str, pin.SE3], time: float) -> dict[str, pin.SE3]:
        """`at`, but parts that are at the `poses` given, as exactly as this knows, are there to the last bit."""
        out = self.at(time)
        for name in out.keys() & poses.keys():
            here = poses[name]
            away = float(np.abs(out[name].homogeneous - here.homogeneous).max())
            if away <= self.precision * (1.0 + float(np.abs(here.translation).max())):
                out[name] = here
        return out

    def at(self, time: float) -> dict[str, pin.SE3]:
        """The pose of every part that has keys at a time (s): before the first key it is the first, after the last the
        last; position straight, rotation about one axis between."""
        out = {}
        for name, (times, rows) in self.keys.items():
            i = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(times) - 1))
            j = min(i + 1, len(times) - 1)
            s = float(np.clip((time - times[i]) / (times[j] - times[i]), 0.0, 1.0)) if j > i else 0.0
            a, b = (pin.Quaternion(rows[k, 3:]) for k in (i, j))
            turned = a if s == 0.0 else b if s == 1.0 else a.slerp(s, b)
            out[name] = pin.SE3(turned.normalized().matrix(), (1.0 - s) * rows[i, :3] + s * rows[j, :3])
        return out
