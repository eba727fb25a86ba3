"""Hands, their verbs and paths, and the conditions that end a motion."""

from vpframe.hands.access import Reach
from vpframe.hands.arguments import pose_from
from vpframe.hands.assist import Assist
from vpframe.hands.conditions import (
    Condition,
    blocked,
    candidate,
    clearance,
    constraint,
    contact,
    free,
    freedom,
)
from vpframe.hands.hand import Hand
from vpframe.hands.paths import Path, Resting, Reversed, Spline, Straight, Track, Turning, read_track
from vpframe.hands.segment import MotionSegment, Outcome

__all__ = [
    "Assist",
    "Condition",
    "Hand",
    "MotionSegment",
    "Outcome",
    "Path",
    "Reach",
    "Resting",
    "Reversed",
    "Spline",
    "Straight",
    "Track",
    "Turning",
    "blocked",
    "candidate",
    "clearance",
    "constraint",
    "contact",
    "free",
    "freedom",
    "pose_from",
    "read_track",
]
