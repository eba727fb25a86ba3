"""Geometric constraints between analytic surfaces: recognised from contact, solved, and the motion they leave.

Knows analytic surfaces, poses and the witnesses of contacts; nothing of files, forces or viewers.
May use `collision`. Within it `geometry` and `kinds` are lowest, then `solve`, `freedom`, `recognition`, `motion`.
Start with `kinds` (what a constraint is), then `manager`, the door that a session uses.
"""

from __future__ import annotations

from collision.lazy import attributes, modules

_NAMES = {
    "constraints.errors": "ConstraintsError GeometryError",
    "constraints.freedom.mobility": "Freedom Mobility mobility",
    "constraints.kinds": """
        Against Angle Belt Circle Concentric Conical Constraint Contact Coplanar Distance Fixed Gear Groove Line Offset
        Parallel Perpendicular Point RackAndPinion Screw Spherical Tangent Toroidal""",
    "constraints.manager": "Accepted Change ConstraintManager UnknownConstraintError",
    "constraints.motion.god_object": "MotionResult",
    "constraints.motion.motion": "Motion",
    "constraints.recognition.candidate": "Candidate",
    "constraints.recognition.recognise": "recognise",
    "constraints.solve.solver": "Solution solve",
}
"""by module the names that it defines: imported at first use, because kernels take long to import"""

__all__ = sorted(modules(_NAMES))
__getattr__, __dir__ = attributes(__name__, modules(_NAMES))
