"""The scene graph: a `Scene` of `Part`s, each an instance of a `Shape`, each shape its `Surface`s."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import SurfaceMesh
from constraints.geometry.features import Feature
from constraints.geometry.surfaces import Geometry
from vpframe.errors import UnknownPartError, VpframeError


@dataclass(frozen=True, eq=False)
class Edge:
    """A B-rep edge as a polyline (n, 3) in the part's frame, metres; `circle` = (center, axis, radius) if it is one."""

    points: NDArray[np.float64]
    surfaces: tuple[int, ...]
    circle: tuple[NDArray[np.float64], NDArray[np.float64], float] | None = None


@dataclass(frozen=True, eq=False)
class Surface:
    """One B-rep face (or one segment of a mesh)."""

    index: int
    name: str
    geometry: Geometry
    """in the part's frame"""
    orientation: str
    """"convex", "concave" or "flat", from outward triangle normals; "free" for freeform"""
    residual: float
    """m: greatest distance of the face's vertices to `geometry`; 0 when the file itself types it"""
    area: float
    """m²"""
    color: tuple[float, float, float, float] | None = None


@dataclass(frozen=True, eq=False)
class Shape:
    """What instances share: mesh, surfaces, features, edges and mass properties at density 1, in the part's frame."""

    mesh: SurfaceMesh
    surfaces: tuple[Surface, ...]
    features: tuple[Feature, ...]
    edges: tuple[Edge, ...] = ()
    volume: float = 0.0
    """m³; of the solid where CAD tells, of the closed mesh otherwise"""
    center: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    """(3,) centre of volume, m"""
    inertia: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3, 3)))
    """(3, 3) of the volume about `center` at density 1 kg/m³, kg·m²"""
    closed: bool = True
    """whether the mesh bounds a volume (every edge is met as often one way as the other); a note says so if not"""
    notes: tuple[str, ...] = ()
    """what the reader had to say: open, faces lost or repaired, triangles dropped"""


class Placing(Protocol):
    """What moves parts: the state of a session."""

    def pose(self, index: int) -> pin.SE3 | None:
        """A copy of the pose of a part by its place in the scene; None while it is where the scene has it."""


@dataclass(eq=False)
class Part:
    """One instance of a shape, somewhere in the scene.

    In a session `pose` is where the session has the part, and cannot be set: hands and forces move it there.
    """

    name: str
    shape: Shape
    pose: pin.SE3
    color: tuple[float, float, float, float] = (0.7, 0.7, 0.75, 1.0)
    """red, green, blue (sRGB, as drawn) and opacity, each in 0 … 1"""
    density: float | None = None
    """kg/m³; None when the file gives none that is plausible"""
    fixed: bool = False
    _placing: tuple[Placing, int] | None = field(default=None, init=False, repr=False)

    def enter(self, session: Placing, index: int) -> None:
        """From now on a session moves the part, which has that place in its scene."""
        self._pose = _pose_of(self)
        self._placing = (session, index)

    def leave(self, session: Placing) -> None:
        """The session is over: the part stays where that left it, unless another session has it by now."""
        if self._placing is not None and self._placing[0] is session:
            self._pose = _pose_of(self)
            self._placing = None

    @property
    def mesh(self) -> SurfaceMesh:
        """Triangles grouped by surface, part frame, metres."""
        return self.shape.mesh

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        """One `Surface` a B-rep face; `surfaces[i].index == i`."""
        return self.shape.surfaces

    @property
    def features(self) -> tuple[Feature, ...]:
        """Analytic surfaces, each made of one or several faces."""
        return self.shape.features

    def __repr__(self) -> str:
        return f"Part({self.name!r}, surfaces={len(self.surfaces)})"


def _pose_of(part: Part) -> pin.SE3:
    placed = None if part._placing is None else part._placing[0].pose(part._placing[1])
    return part._pose if placed is None else placed


def _set_pose(part: Part, pose: pin.SE3) -> None:
    if getattr(part, "_placing", None) is not None:
        raise VpframeError(
            f"{part.name} is in a session, which alone moves its parts: use hand.move_to(pose), or set part.pose "
            "before the session is opened or after it is closed"
        )
    part._pose = pose


Part.pose = property(_pose_of, _set_pose, doc="Where the part is in the world.")  # type: ignore[assignment]


class Scene(Mapping[str, Part]):
    """Parts by unique name, in a fixed order. `scene["shaft"]`, `for name in scene`, `scene.parts`."""

    def __init__(self, parts: Iterable[Part] = (), source: str | None = None, notes: Iterable[str] = ()) -> None:
        self._parts: dict[str, Part] = {}
        self.source = source
        self.notes: tuple[str, ...] = tuple(notes)
        for part in parts:
            self.add(part)

    def add(self, part: Part) -> Part:
        """Add one part; its name must be new."""
        if part.name in self._parts:
            raise VpframeError(f"two parts are called {part.name!r}; names must be unique, rename one")
        self._parts[part.name] = part
        return part

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts in order; a part's place is its object id in collision, constraints and physics."""
        return tuple(self._parts.values())

    @property
    def names(self) -> tuple[str, ...]:
        """The names in order."""
        return tuple(self._parts)

    def index(self, name: str) -> int:
        """Place of a part: the id by which the other packages know it."""
        self[name]
        return self.names.index(name)

    def all_notes(self) -> tuple[str, ...]:
        """What there is to know of the scene and of each shape, a shape's under the name of the first part that has it.

        A part that says "open" is no closed solid: volumes and containment of it are estimates.
        """
        first: dict[Shape, str] = {}
        count: dict[Shape, int] = {}
        for part in self.parts:
            first.setdefault(part.shape, part.name)
            count[part.shape] = count.get(part.shape, 0) + 1
        return self.notes + tuple(
            f"{name}{f' (and {count[shape] - 1} more of its shape)' if count[shape] > 1 else ''}: {note}"
            for shape, name in first.items()
            for note in shape.notes
        )

    def copy(self) -> Scene:
        """A scene of the same shapes, with parts of its own where these are now."""
        parts = (replace(part, pose=part.pose.copy()) for part in self.parts)
        return Scene(parts, self.source, self.notes)

    def __getitem__(self, name: str) -> Part:
        try:
            return self._parts[name]
        except KeyError:
            raise UnknownPartError(name, self._parts) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)

    def __repr__(self) -> str:
        return f"Scene({len(self)} parts, source={self.source!r})"
