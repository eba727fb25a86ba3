"""Paths of a hand: values with a `duration` and a world pose `pose(t)` for 0 ≤ t ≤ `duration`."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path as FilePath
from typing import Any, Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from vpframe import files
from vpframe.errors import TaskError
from vpframe.hands.arguments import number, pose_from, rigid, vector

_COLUMNS = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")


class Path(Protocol):
    """World poses over time."""

    @property
    def duration(self) -> float:
        """s"""

    def pose(self, t: float) -> pin.SE3:
        """World pose at `t` seconds; the end pose for any later t."""


def smooth(x: float) -> float:
    """Minimum-jerk progress in [0, 1] at a fraction x of the time (Flash & Hogan 1985, eq. 3): rest to rest."""
    x = min(max(x, 0.0), 1.0)
    return x * x * x * (10.0 + x * (6.0 * x - 15.0))


def _progress(t: float, duration: float, eased: bool) -> float:
    """Progress in [0, 1] of a motion of some duration (s) after `t` seconds, rest to rest (`eased`) or steady."""
    x = 1.0 if duration <= 0.0 else min(t / duration, 1.0)
    return smooth(x) if eased else x


def between(start: pin.SE3, end: pin.SE3, s: float) -> pin.SE3:
    """Interpolate at fraction `s`: origin on a straight line, rotation at constant angular velocity."""
    if s >= 1.0:
        return pin.SE3(end)
    turned = start.rotation @ pin.exp3(s * pin.log3(start.rotation.T @ end.rotation))
    return pin.SE3(turned, (1.0 - s) * start.translation + s * end.translation)


def apart(a: pin.SE3, b: pin.SE3) -> float:
    """The larger of the distance (m) and the angle (rad) between two poses."""
    way = a.actInv(b)
    return max(float(np.linalg.norm(way.translation)), float(np.linalg.norm(pin.log3(way.rotation))))


def _check(path: Any, *poses: str) -> None:
    """Check a path's duration and its poses; TaskError names the field."""
    kind = type(path).__name__
    number(path.duration, f"{kind}: duration", least=0.0)
    for name in poses:
        rigid(getattr(path, name), f"{kind}: {name}")


@dataclass(frozen=True, eq=False)
class Straight:
    """Straight line between two poses, rest to rest (`eased`) or at constant speed."""

    start: pin.SE3
    end: pin.SE3
    duration: float
    """s"""
    eased: bool = True

    def __post_init__(self) -> None:
        _check(self, "start", "end")

    def pose(self, t: float) -> pin.SE3:
        return between(self.start, self.end, _progress(t, self.duration, self.eased))


@dataclass(frozen=True, eq=False)
class Turning:
    """Rotation by `angle` about a fixed world line with an advance of `pitch` m a turn, rest to rest or steady."""

    start: pin.SE3
    origin: NDArray[np.float64]
    """(3,) a point of the line, world, m"""
    axis: NDArray[np.float64]
    """(3,) unit, world"""
    angle: float
    """rad, right-handed about `axis`"""
    duration: float
    """s"""
    pitch: float = 0.0
    """m a turn along the axis; negative for a left-hand thread"""
    eased: bool = True

    def __post_init__(self) -> None:
        _check(self, "start")
        number(self.angle, "Turning: angle"), number(self.pitch, "Turning: pitch")
        axis = vector(self.axis, "Turning: axis")
        length = float(np.linalg.norm(axis))
        if length == 0.0:
            raise TaskError("Turning: axis is the zero vector; give a direction")
        object.__setattr__(self, "origin", vector(self.origin, "Turning: origin"))
        object.__setattr__(self, "axis", axis / length)

    def pose(self, t: float) -> pin.SE3:
        angle = self.angle * _progress(t, self.duration, self.eased)
        turn = pin.exp3(self.axis * angle)
        shift = self.origin - turn @ self.origin + self.axis * (self.pitch * angle / (2.0 * np.pi))
        return pin.SE3(turn, shift) * self.start


@dataclass(frozen=True, eq=False)
class Resting:
    """A constant pose for `duration` seconds."""

    start: pin.SE3
    duration: float

    def __post_init__(self) -> None:
        _check(self, "start")

    def pose(self, t: float) -> pin.SE3:
        return pin.SE3(self.start)


@dataclass(frozen=True, eq=False)
class Track:
    """Poses at given times with linear interpolation, as from a recorded hand."""

    times: NDArray[np.float64]
    """(n,) s, ascending, from 0"""
    poses: Sequence[pin.SE3]

    def __post_init__(self) -> None:
        times = np.array(self.times, dtype=np.float64)
        if len(times) != len(self.poses) or len(times) < 2:
            raise TaskError(
                f"a track needs as many times as poses and at least two; {len(times)} and {len(self.poses)}"
            )
        for n, pose in enumerate(self.poses):
            rigid(pose, f"pose {n} of a track")
        if not np.isfinite(times).all() or (np.diff(times) <= 0.0).any():
            raise TaskError(f"a track's times must ascend; row {int(np.argmax(np.diff(times) <= 0.0)) + 1} does not")
        object.__setattr__(self, "times", times - times[0])

    @property
    def duration(self) -> float:
        return float(self.times[-1])

    def pose(self, t: float) -> pin.SE3:
        i = int(np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2))
        span = float(self.times[i + 1] - self.times[i])
        return between(self.poses[i], self.poses[i + 1], max(t - float(self.times[i]), 0.0) / span)


@dataclass(frozen=True, eq=False)
class Spline:
    """A smooth path through all `poses`, rest to rest, as fast as `speed` and `turn_speed` allow.

    Origins follow a natural cubic spline, rotations scipy's `RotationSpline`, over a common parameter (the time each
    leg needs at the limits). Progress is minimum-jerk in time, stretched until the fastest instant is at the limit.
    """

    poses: Sequence[pin.SE3]
    speed: float = 0.25
    """m/s, greatest speed of the origin"""
    turn_speed: float = np.pi / 2
    """rad/s, greatest angular speed"""

    def __post_init__(self) -> None:
        if len(self.poses) < 2:
            raise TaskError(f"a spline needs two poses or more; {len(self.poses)} given")
        for n, pose in enumerate(self.poses):
            rigid(pose, f"pose {n} of a spline")
        number(self.speed, "Spline: speed", above=0.0), number(self.turn_speed, "Spline: turn_speed", above=0.0)

    @cached_property
    def _curves(self) -> tuple[Any, Any]:
        from scipy.interpolate import CubicSpline
        from scipy.spatial.transform import Rotation, RotationSpline

        points = np.array([p.translation for p in self.poses])
        turns = [float(np.linalg.norm(pin.log3(a.rotation.T @ b.rotation))) for a, b in pairwise(self.poses)]
        # one parameter for both: the time each leg needs at the limits
        legs = np.maximum(
            np.linalg.norm(np.diff(points, axis=0), axis=1) / self.speed, np.array(turns) / self.turn_speed
        )
        if (legs <= 0.0).any():
            raise TaskError(f"poses {int(np.argmax(legs <= 0.0))} and the next of a spline are the same; drop one")
        knots = np.concatenate([[0.0], np.cumsum(legs)])
        rotations = Rotation.from_matrix(np.array([p.rotation for p in self.poses]))
        return CubicSpline(knots, points, bc_type="natural"), RotationSpline(knots, rotations)

    @cached_property
    def duration(self) -> float:
        origins, turns = self._curves
        end = float(origins.x[-1])
        x = np.linspace(0.0, 1.0, 50 * len(self.poses) + 1)
        at = np.array([smooth(v) for v in x]) * end
        rate = 30.0 * (x * (1.0 - x)) ** 2 * end  # d(progress)/dx of `smooth`, by the parameter's length
        fastest = max(
            float((np.linalg.norm(origins(at, 1), axis=1) * rate).max()) / self.speed,
            float((np.linalg.norm(turns(at, 1), axis=1) * rate).max()) / self.turn_speed,
        )
        return fastest

    def pose(self, t: float) -> pin.SE3:
        if t >= self.duration:
            return pin.SE3(self.poses[-1])
        origins, turns = self._curves
        at = smooth(t / self.duration) * float(origins.x[-1])
        return pin.SE3(turns(at).as_matrix(), origins(at))


@dataclass(frozen=True, eq=False)
class Reversed:
    """Another path backwards."""

    path: Path

    @property
    def duration(self) -> float:
        return self.path.duration

    def pose(self, t: float) -> pin.SE3:
        return self.path.pose(max(self.path.duration - t, 0.0))


def read_track(path: str | FilePath) -> Track:
    """Read a track from a file of poses over time.

    `.csv`: a header `t,x,y,z,qx,qy,qz,qw` and one row for each pose. `.json`: a list of objects `{"t": s, "position":
    [x, y, z], "quaternion": [qx, qy, qz, qw]}`. Metres and seconds, world frame.

    Raises
    ------
    TaskError: names the file and the row.
    """
    file = FilePath(path)
    try:
        text = file.read_text()
        rows = list(_json_rows(text) if file.suffix.lower() == ".json" else _csv_rows(text))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise TaskError(f"{file}: cannot be read as a track: {error}") from None
    except (KeyError, TypeError, ValueError) as error:
        raise TaskError(f"{file}: {error}; a track has t, x y z, qx qy qz qw in each row") from None
    poses = []
    for n, row in enumerate(rows):
        try:
            poses.append(pose_from(row[1:]))
        except TaskError as error:
            raise TaskError(f"{file}: row {n}: {error}") from None
    try:
        return Track(np.array([row[0] for row in rows]), tuple(poses))
    except TaskError as error:
        raise TaskError(f"{file}: {error}") from None


def write_track(path: str | FilePath, track: Path, rate: float = 60.0) -> FilePath:
    """Write a path in the format of `read_track` (.csv or .json, by the suffix); return the file's path.

    A `Track` is written with its own times and poses, exact to the last bit of its positions; other paths are sampled.

    Parameters
    ----------
    rate: samples a second of a path that is not a `Track`; its end is always sampled.

    Raises
    ------
    TaskError: the path has no duration, or the suffix is unknown. OutputError: the file cannot be written.
    """
    file = FilePath(path)
    if file.suffix.lower() not in (".csv", ".json"):
        raise TaskError(f"{file}: tracks are written as .csv or .json")
    if isinstance(track, Track):
        times, poses = track.times.tolist(), list(track.poses)
    else:
        steps = int(np.ceil(track.duration * number(rate, "write_track: rate", above=0.0)))
        if steps < 1:
            raise TaskError(f"{file}: the path takes no time; a track has two poses or more")
        times = (track.duration * np.arange(steps + 1) / steps).tolist()
        poses = [track.pose(t) for t in times]
    rows = [[t, *pin.SE3ToXYZQUAT(pose).tolist()] for t, pose in zip(times, poses, strict=True)]
    if file.suffix.lower() == ".csv":
        text = "\n".join([",".join(_COLUMNS), *(",".join(map(repr, row)) for row in rows)]) + "\n"
    else:
        objects = [{"t": row[0], "position": row[1:4], "quaternion": row[4:]} for row in rows]
        text = json.dumps(objects, indent=1) + "\n"
    files.replace(file, text)
    return file


def _csv_rows(text: str) -> Iterable[list[float]]:
    reader = csv.DictReader(text.splitlines(), skipinitialspace=True)
    missing = [c for c in _COLUMNS if c not in (reader.fieldnames or ())]
    if missing:
        raise ValueError(f"no column {', '.join(missing)}")
    for n, row in enumerate(reader):
        try:
            yield [float(row[c]) for c in _COLUMNS]
        except (TypeError, ValueError):
            raise ValueError(f"row {n} is {list(row.values())}") from None


def _json_rows(text: str) -> Iterable[list[float]]:
    for n, row in enumerate(json.loads(text)):
        try:
            yield [float(row["t"]), *map(float, row["position"]), *map(float, row["quaternion"])]
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"row {n}: {error}") from None


def lifted(pose: pin.SE3, shift: ArrayLike) -> pin.SE3:
    """Return `pose` moved by `shift` (3,), m, world axes."""
    return pin.SE3(pose.rotation, pose.translation + np.asarray(shift, dtype=np.float64))
