"""vpframe: load a CAD assembly, grasp and move its parts, and verify whether it can be serviced.

`import vpframe as vp` provides every name that a task script needs. Names are imported at first use, so that `import
vpframe` and `vpframe --help` are fast.
May use `collision`, `constraints` and `physics`; its folders import only those before them in the order that stands in
`pyproject.toml`.
Start with `session/session.py`, and `session/step.py` beside it; CONTRIBUTING.md goes through one step.
"""

from __future__ import annotations

from collision.lazy import attributes
from vpframe import services

__version__ = "0.1.0"

_NAMES: dict[str, tuple[str, ...]] = {
    # scene
    "vpframe.importers": ("load",),
    "vpframe.scene.scene": ("Edge", "Part", "Scene", "Shape", "Size", "Surface"),
    "vpframe.scene.units": ("length",),
    "vpframe.scene.boxes": ("bounds", "half_size"),
    "vpframe.scene.motion": ("Motion",),
    "vpframe.scene.joints": ("Statement",),
    # in and out
    "vpframe.exporters.motion": ("read_motion",),
    "vpframe.exporters.export": ("export",),
    "vpframe.exporters.tables": ("write_table",),
    "vpframe.exporters.bcf": ("write_bcf",),
    "constraints.geometry.surfaces": ("Cone", "Cylinder", "Freeform", "Plane", "Sphere", "Torus"),
    # session
    "vpframe.session.session": ("Session",),
    "vpframe.session.state": ("State", "StateError"),
    "vpframe.events": ("ConstraintView", "ContactPoint", "Event", "Frame", "Frames", "Observer"),
    "vpframe.session.rules": (
        "accept_all", "accept_between", "accept_kinds", "accept_standing", "ask", "first_of", "leave_all",
        "refuse_between", "refuse_kinds",
    ),
    "collision": ("Tolerance",),
    # hands
    "vpframe.hands.hand": ("Hand",),
    "vpframe.hands.segment": ("Condition", "MotionSegment", "Outcome"),
    "vpframe.hands.access": ("Reach",),
    "vpframe.hands.assist": ("Assist",),
    "vpframe.hands.arguments": ("pose_from",),
    "vpframe.hands.paths": (
        "Path", "Resting", "Reversed", "Spline", "Straight", "Track", "Turning", "read_track", "write_track",
    ),
    "vpframe.hands.conditions": (
        "blocked", "candidate", "clearance", "constraint", "contact", "free", "freedom",
    ),
    # constraint kinds
    "constraints.kinds": (
        "Against", "Angle", "Belt", "Circle", "Concentric", "Conical", "Constraint", "Contact", "Coplanar", "Distance",
        "Fixed", "Gear", "Groove", "Line", "Offset", "Parallel", "Perpendicular", "Point", "RackAndPinion", "Screw",
        "Spherical", "Tangent", "Toroidal",
    ),
    # mass, forces, behaviours
    "physics": (
        "DENSITY", "MATERIALS", "PAIRS", "Behaviour", "Body", "Buoyancy", "Drag", "Elastic", "Friction", "Gravity",
        "Magnet", "Material", "Motor", "Pair", "Reaction", "ScriptedPath", "Sleeping", "Solidity", "Spring",
        "SpringHand", "Touch", "View", "Wind", "force",
    ),
    # view
    "vpframe.view.meshcat_viewer": ("MeshcatViewer",),
    "vpframe.view.recorder": ("RerunRecorder",),
    # studies
    "vpframe.studies.distributions": ("Choice", "LogNormal", "Normal", "Triangular", "Uniform"),
    # errors
    "vpframe.errors": (
        "CheckpointError", "LoadError", "OutputError", "TaskError", "UnknownPartError", "VpframeError",
    ),
    "vpframe.session.statements": ("ContradictionError",),
    # the last line of a script
    "vpframe.app.task_runner": ("main",),
}  # fmt: skip
_LAZY = {name: module for module, names in _NAMES.items() for name in names}
_MODULES = {"planning": "vpframe.planning", "rules": "vpframe.session.rules"}

__all__ = ["__version__", *_LAZY, *_MODULES]
_SERVICES = {
    "load": ("vpframe.importers", "load"),
    "export": ("vpframe.exporters.export", "export"),
    "tessellate": ("vpframe.importers.build", "tessellated"),
    "page": ("vpframe.view.notebook", "shown"),
    "viewer": ("vpframe.view.meshcat_viewer", "watched"),
    "recorder": ("vpframe.view.recorder", "RerunRecorder"),
    "report": ("vpframe.report", "write"),
    "report_folder": ("vpframe.view.notebook", "ReportFolder"),
    "removal": ("vpframe.planning.plan", "removal"),
}
"""functions that lower floors call (`vpframe.services`): module and name"""
services.provide(_SERVICES)

_MODULE = {**_LAZY, **{name: f"{module}:" for name, module in _MODULES.items()}}
__getattr__, __dir__ = attributes(__name__, _MODULE)
