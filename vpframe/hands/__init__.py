"""Hands, their verbs and paths, and the conditions that end a motion.

A verb is a generator of motion segments, so that several hands can work in the same steps.
May use `scene`, and from the packages surfaces and contacts; it moves nothing by itself: a session does.
Start with `verbs`, then `segment` (what a verb yields) and `gripper` (the state of a hand).
"""

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
