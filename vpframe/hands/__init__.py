"""Hands, their verbs and paths, and the conditions that end a motion."""

from collision.lazy import attributes

_MODULE = {
    name: f"vpframe.hands.{module}"
    for module, names in {
        "access": ("Reach",),
        "arguments": ("pose_from",),
        "assist": ("Assist",),
        "conditions": ("blocked", "candidate", "clearance", "constraint", "contact", "free", "freedom"),
        "hand": ("Hand",),
        "paths": ("Path", "Resting", "Reversed", "Spline", "Straight", "Track", "Turning", "read_track"),
        "segment": ("Condition", "MotionSegment", "Outcome"),
    }.items()
    for name in names
}
__all__ = [*_MODULE]
__getattr__, __dir__ = attributes(__name__, _MODULE)
