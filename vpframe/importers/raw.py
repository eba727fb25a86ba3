"""Plain values that cross from the CAD kernel to the scene: arrays, numbers and strings, nothing of the kernel.

The reading process makes them, so this module imports numpy alone. Lengths are metres.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Color = tuple[float, float, float, float]
"""red, green, blue (sRGB, as drawn) and opacity, each in 0 … 1"""


Size = tuple[float, float | None, float | None, str]
"""a toleranced diameter: nominal, lower and upper deviation (m), tolerance class ("H7")"""


class UnreadableError(Exception):
    """A file that cannot be used; the message says what is wrong and how to mend it, without the file's name."""


@dataclass
class RawFace:
    """One B-rep face."""

    name: str
    kind: str = ""
    """"plane", "cylinder", "cone", "sphere", "torus"; "" when neither file nor kernel can type it"""
    numbers: tuple[float, ...] = ()
    """plane: point, normal · cylinder: point, axis, radius · cone: apex, axis, half angle · sphere: centre, radius ·
    torus: centre, axis, major, minor"""
    typed: bool = False
    """whether the type is settled: the file itself gives it, or it was fitted"""
    samples: Array = field(default_factory=lambda: np.empty((0, 3)))
    """(k, 3) points of the true surface inside the face; only for faces the file leaves untyped"""
    color: Color | None = None
    residual: float = 0.0
    """m, of a typed face: greatest distance of its points to the surface that was fitted to them"""
    size: Size | None = None


@dataclass
class RawEdge:
    """One B-rep edge as the polyline of its mesh."""

    points: Array
    faces: tuple[int, ...]
    circle: tuple[Array, Array, float] | None = None


@dataclass
class RawShape:
    """One solid (or sheet) with its mesh, in its own frame."""

    vertices: Array
    triangles: NDArray[np.int32]
    face_of_triangle: NDArray[np.int32]
    faces: list[RawFace]
    edges: list[RawEdge] = field(default_factory=list)
    volume: float | None = None
    """m³; None when it is not known other than from the mesh"""
    center: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))
    notes: list[str] = field(default_factory=list)
    settled: bool = False
    """whether all is decided that takes time, as `build.settled` does"""
    brep: bytes = b""
    """the exact B-rep in OpenCascade's binary form, mm, without a mesh; empty of what is a mesh by itself"""


@dataclass
class RawPart:
    """One instance of a shape."""

    name: str
    shape: int
    """its place in `RawScene.shapes`"""
    rotation: Array
    translation: Array
    color: Color | None = None
    density: float | None = None
    mass: tuple[float, Array, Array] | None = None
    """where the file gives it: kg, (3,) centre, m, and (3, 3) inertia about it, kg·m², in the part's frame"""


Axis = tuple[str, Array, Array]
""""revolute" or "prismatic", (3,) origin, m, and (3,) unit direction, world"""


@dataclass(eq=False)
class RawJoint:
    """What holds two links of a mechanism together, where they stand."""

    name: str
    links: tuple[int, int]
    """places in `RawScene.links`"""
    axes: list[Axis]
    """one after another; none where it is fixed"""
    free: bool = False
    """whether it holds nothing"""
    note: str = ""
    """what of it is not read"""


@dataclass
class RawScene:
    """All that a file holds."""

    shapes: list[RawShape] = field(default_factory=list)
    parts: list[RawPart] = field(default_factory=list)
    instances: Counter[str] = field(default_factory=Counter)
    """how often each product of a CAD file was found, by the product's name"""
    faces: Counter[str] = field(default_factory=Counter)
    """how many faces all instances of each product have together"""
    notes: list[str] = field(default_factory=list)
    links: list[list[str]] = field(default_factory=list)
    """of a mechanism: names of the parts of each link; the first is the ground"""
    joints: list[RawJoint] = field(default_factory=list)
    whole: bool = True
    """False where parts were left out that crashed the kernel, or took too much time or memory: that may go better"""
