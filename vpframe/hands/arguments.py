"""What scripts hand to verbs and paths, checked where it comes in: one clear line says what is wrong with it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from vpframe.errors import TaskError

FAR = 20.0
"""1: no part goes farther in one motion than so many times the size of the scene; no thread is so coarse"""
RIGID = 1e-6
"""1: greatest entry of |RᵀR - I| of a rotation that was typed or read"""


def number(value: Any, what: str, least: float = -math.inf, above: float = -math.inf) -> float:
    """A finite number that is at least `least` and more than `above`; TaskError names `what`."""
    if isinstance(value, bool | str | bytes):
        raise TaskError(f"{what}={value!r}; give a number, in metres, seconds, radians or turns")
    try:
        x = float(value)
    except (TypeError, ValueError):
        raise TaskError(f"{what}={value!r}; give a number, in metres, seconds, radians or turns") from None
    if not math.isfinite(x) or x < least or x <= above:
        bound = f" more than {above:g}" if above > -math.inf else f", at least {least:g}" if least > -math.inf else ""
        raise TaskError(f"{what}={value!r}; give a finite number{bound}")
    return x


def metres(length: float, what: str, of: str, size: float, most: float) -> None:
    """Refuse a length over `most` (m): it can only be meant in millimetres.

    what, of, size: for the message: the length, and whose size (m) it exceeds by far.

    Raises
    ------
    TaskError: naming `what`, with the hint that lengths are metres.
    """
    x = abs(length)
    if x > most:
        raise TaskError(
            f"{what}: {x:g} m is {x / size:.0f} times the size of {of} ({size:.3g} m); lengths are metres, "
            f"write {x / 1e3:g} for {x:g} mm"
        )


def vector(value: ArrayLike, what: str) -> NDArray[np.float64]:
    """Three finite numbers; TaskError names `what`."""
    try:
        v = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        v = np.empty(0)
    if v.shape != (3,) or not np.isfinite(v).all():
        raise TaskError(f"{what} takes three finite numbers; got {value!r}")
    return v


def rigid(pose: Any, what: str) -> pin.SE3:
    """A pose that is finite and a rigid motion; TaskError names `what`."""
    if not isinstance(pose, pin.SE3):
        raise TaskError(f"{what} is {type(pose).__name__}; give a pinocchio.SE3")
    rotation = pose.rotation
    if not np.isfinite(pose.homogeneous).all():
        raise TaskError(f"{what} must be finite; the pose given holds NaN or infinity")
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    mirrored = a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g) < 0.0
    if mirrored or np.abs(rotation.T @ rotation - np.eye(3)).max() > RIGID:
        raise TaskError(f"{what} is no rigid motion: its rotation is stretched or mirrored; normalise it")
    return pose


def pose_from(row: ArrayLike) -> pin.SE3:
    """`x y z qx qy qz qw` (7 numbers, metres and a quaternion of any length but 0) as a pose."""
    try:
        r = np.asarray(row, dtype=np.float64)
    except (TypeError, ValueError):
        r = np.empty(0)
    if r.shape != (7,) or not np.isfinite(r).all() or not np.linalg.norm(r[3:]) > 0.0:
        raise TaskError(
            f"a pose is seven finite numbers, x y z qx qy qz qw with a non-zero quaternion; got {_short(row)}"
        )
    q = r[3:] / np.linalg.norm(r[3:])
    return pin.SE3(pin.Quaternion(q[3], q[0], q[1], q[2]).toRotationMatrix(), r[:3])


def as_pose(value: pin.SE3 | ArrayLike, like: pin.SE3) -> pin.SE3:
    """An SE3; a position (3,) keeps the rotation of `like`; seven numbers are a position and a quaternion x y z w."""
    if isinstance(value, pin.SE3):
        return pin.SE3(rigid(value, "a pose"))
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise TaskError(f"{_short(value)} is no pose; give an SE3, x y z, or x y z qx qy qz qw") from None
    if numbers.shape == (3,):
        return pin.SE3(like.rotation, vector(numbers, "a position"))
    return pose_from(numbers)


def _short(value: Any) -> str:
    return repr(value.tolist() if isinstance(value, np.ndarray) else value)[:80]
