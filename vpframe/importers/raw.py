"""Plain values passed from the CAD kernel to the scene: arrays, numbers and strings. Lengths are metres.

The reading process creates them, so this module imports numpy only.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Color = tuple[float, float, float, float]
"""red, green, blue (sRGB) and opacity, each in 0 … 1"""


Size = tuple[float, float | None, float | None, str]
"""toleranced diameter: nominal, lower and upper deviation (m), tolerance class ("H7")"""


Progress = Callable[[float, str], None]
"""receives the fraction done and the present task"""


class Options(NamedTuple):
    """How a model is read: arguments of `vpframe.load`."""

    deflection: float
    angular: float
    unit: str | None = None
    timeout: float | None = None
    progress: Progress | None = None
    format: str | None = None
    bodies: str | None = None

    def within(self, begin: float, end: float) -> Options:
        """Return the options for a stage between two fractions of the work."""
        whole = self.progress
        if whole is None:
            return self
        return self._replace(progress=lambda fraction, text: whole(begin + (end - begin) * fraction, text))


NO_SAMPLES: Array = np.empty((0, 3))


class UnreadableError(Exception):
    """A file is unusable; the message names fault and remedy, without the file's name."""


@dataclass
class RawFace:
    """One B-rep face."""

    name: str
    kind: str = ""
    """"plane", "cylinder", "cone", "sphere", "torus"; "" if neither file nor kernel gives a type"""
    numbers: tuple[float, ...] = ()
    """plane: point, normal · cylinder: point, axis, radius · cone: apex, axis, half angle · sphere: centre, radius
    · torus: centre, axis, major, minor"""
    typed: bool = False
    """whether the type is final: stated by the file, or fitted"""
    samples: Array = field(default_factory=lambda: NO_SAMPLES)
    """(k, 3) points of the true surface inside the face; only for faces without a type in the file"""
    color: Color | None = None
    residual: float = 0.0
    """greatest distance of the face's points from the fitted surface, m"""
    size: Size | None = None


@dataclass
class RawShape:
    """One solid (or sheet) with its mesh, in its own frame."""

    vertices: Array
    triangles: NDArray[np.int32]
    face_of_triangle: NDArray[np.int32]
    faces: list[RawFace]
    volume: float | None = None
    """m³; None while it is not measured, as centre and inertia (`build.measure`)"""
    center: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))
    notes: list[str] = field(default_factory=list)
    settled: bool = False
    """whether `build.settled` has processed the shape"""
    brep: bytes = b""
    """exact B-rep in OpenCascade's binary format, mm, without triangles; empty for a mesh"""
    segmented: bool = True
    """False for a bare mesh whose surfaces have not been found: it has one face"""
    bounds: tuple[float, float] | None = None
    """m³ between which the volume of the exact solids must lie; None where they have none (sheets, open solids)"""
    sheet: bool = False
    """whether it is open only where the file has faces that belong to no solid"""


@dataclass
class RawPart:
    """One instance of a shape."""

    name: str
    shape: int
    """index into `RawScene.shapes`"""
    rotation: Array
    translation: Array
    color: Color | None = None
    density: float | None = None
    mass: tuple[float, Array, Array] | None = None
    """from the file: kg, centre (3,), m, and inertia (3, 3) about it, kg·m², in the part's frame"""


Axis = tuple[str, Array, Array]
""""revolute" or "prismatic", (3,) origin, m, and (3,) unit direction, world"""


@dataclass(eq=False)
class RawJoint:
    """A joint between two links of a mechanism at its present pose."""

    name: str
    links: tuple[int, int]
    """indices into `RawScene.links`"""
    axes: list[Axis]
    """in series; empty for a fixed joint"""
    free: bool = False
    """whether all six degrees of freedom are left"""
    note: str = ""
    """properties of the joint that are not read"""


@dataclass
class RawScene:
    """Content of a file."""

    shapes: list[RawShape] = field(default_factory=list)
    parts: list[RawPart] = field(default_factory=list)
    instances: Counter[str] = field(default_factory=Counter)
    """number of instances found of each product of a CAD file, by name"""
    faces: Counter[str] = field(default_factory=Counter)
    """number of faces of all instances of each product"""
    notes: list[str] = field(default_factory=list)
    links: list[list[str]] = field(default_factory=list)
    """names of the parts of each link of a mechanism; the first link is the ground"""
    joints: list[RawJoint] = field(default_factory=list)
    whole: bool = True
    """False if parts were left out for a crash, time or memory; another attempt may succeed"""
