"""Checks of the arguments of verbs and paths; each error is one line that names the argument."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from vpframe.errors import TaskError
from vpframe.scene import poses

FAR = 20.0
"""1: maximum length of a motion or thread pitch, as a multiple of the size of the scene"""
MOST_TURNS = 10
"""maximum number of turns, unless the angle is a multiple of an eighth of a turn"""
COUNTED = 1e6
"""rad: angle from which on every number is near a multiple of an eighth of a turn"""


def number(value: Any, what: str, least: float = -math.inf, above: float = -math.inf) -> float:
    """Return a finite number, at least `least` and greater than `above`. Raises TaskError that names `what`."""
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
    """Refuse a length above `most` (m), which must be meant in millimetres.

    what, of, size: for the message: name of the length; name and size (m) of the object it is compared with.

    Raises
    ------
    TaskError: names `what`, with the hint that lengths are metres.
    """
    x = abs(length)
    if x > most:
        raise TaskError(
            f"{what}: {x:g} m is {x / size:.0f} times the size of {of} ({size:.3g} m); lengths are metres, "
            f"write {x / 1e3:g} for {x:g} mm"
        )


def radians(angle: float, what: str) -> float:
    """Return an angle (rad), unless it must be meant in degrees: more than a turn, and a whole or half number or more
    than `MOST_TURNS`. A multiple of an eighth of a turn is always allowed.

    Raises
    ------
    TaskError: names `what`, with the hint that angles are radians.
    """
    x, eighth = abs(angle), 0.25 * math.pi
    eighths = x < COUNTED and math.isclose(x / eighth, round(x / eighth), rel_tol=1e-9)
    if x > 2.0 * math.pi and not eighths and ((2.0 * x).is_integer() or x > MOST_TURNS * 2.0 * math.pi):
        raise TaskError(
            f"{what}={angle:g}: {x:g} rad is {x / (2.0 * math.pi):.3g} turns; angles are radians, write "
            f"math.radians({angle:g}) for {angle:g}°, or 2 * math.pi * n for n whole turns"
        )
    return angle


def vector(value: ArrayLike, what: str) -> NDArray[np.float64]:
    """Return three finite numbers as (3,). Raises TaskError that names `what`."""
    try:
        v = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        v = np.empty(0)
    if v.shape != (3,) or not np.isfinite(v).all():
        raise TaskError(f"{what} takes three finite numbers; got {value!r}")
    return v


def rigid(pose: Any, what: str) -> pin.SE3:
    """Return the pose if it is finite and a rigid motion. Raises TaskError that names `what`."""
    if not isinstance(pose, pin.SE3):
        raise TaskError(f"{what} is {type(pose).__name__}; give a pinocchio.SE3")
    return poses.rigid(pose, what, TaskError)


def pose_from(row: ArrayLike) -> pin.SE3:
    """Convert `x y z qx qy qz qw` (m, and a quaternion of any non-zero length) to a pose."""
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
    """Return an SE3 from an SE3, a position (3,) with the rotation of `like`, or `x y z qx qy qz qw`."""
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
