"""Hands, their verbs and paths, and the conditions that end a motion."""

from vpframe.interaction.arguments import pose_from
from vpframe.interaction.assist import Assist
from vpframe.interaction.conditions import (
    Condition,
    blocked,
    candidate,
    clearance,
    constraint,
    contact,
    free,
    freedom,
)
from vpframe.interaction.hand import Hand, Outcome
from vpframe.interaction.paths import Path, Resting, Reversed, Spline, Straight, Track, Turning, read_track

__all__ = [
    "Assist",
    "Condition",
    "Hand",
    "Outcome",
    "Path",
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
