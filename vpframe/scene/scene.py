"""The scene graph: a `Scene` of `Part`s, each an instance of a `Shape`, each shape its `Surface`s."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, overload

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import SurfaceMesh
from constraints.geometry.features import Feature
from constraints.geometry.surfaces import Geometry
from vpframe.errors import UnknownPartError, VpframeError
from vpframe.scene.joints import Statement
from vpframe.scene.motion import Motion


@dataclass(frozen=True, eq=False)
class Edge:
    """A B-rep edge as a polyline (n, 3) in the part's frame, metres; `circle` = (center, axis, radius) if it is one."""

    points: NDArray[np.float64]
    surfaces: tuple[int, ...]
    circle: tuple[NDArray[np.float64], NDArray[np.float64], float] | None = None


@dataclass(frozen=True)
class Size:
    """The diameter that a model's PMI gives a bore or shaft, m."""

    nominal: float
    lower: float | None = None
    upper: float | None = None
    """deviations from it"""
    fit: str = ""
    """tolerance class by ISO 286, "H7" of a bore, "g6" of a shaft"""

    def __str__(self) -> str:
        limits = "" if self.lower is None or self.upper is None else f" {self.upper * 1e3:+.4g}/{self.lower * 1e3:+.4g}"
        return f"Ø{round(self.nominal * 1e3, 6):g}{f' {self.fit}' if self.fit else ''}{limits}"


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
    size: Size | None = None
    """what the file's PMI says of its diameter"""


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
    brep: bytes = b""
    """the exact B-rep in OpenCascade's binary form, mm, as `Scene.export` writes it; empty of a mesh"""


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
    inertia: pin.Inertia | None = None
    """mass, centre and inertia in the part's frame where the model gives them; None: of density and shape"""
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

    def __init__(
        self,
        parts: Iterable[Part] = (),
        source: str | None = None,
        notes: Iterable[str] = (),
        statements: Iterable[Statement] = (),
    ) -> None:
        self._parts: dict[str, Part] = {}
        self.source = source
        self.notes: tuple[str, ...] = tuple(notes)
        self.statements: tuple[Statement, ...] = tuple(statements)
        """constraints that the model itself states, of its joints"""
        for part in parts:
            self.add(part)

    @overload
    def add(self, source: Part) -> Part: ...
    @overload
    def add(
        self, source: Any, name: str | None = None, pose: pin.SE3 | None = None, **options: Any
    ) -> tuple[Part, ...]: ...
    def add(
        self, source: Any, name: str | None = None, pose: pin.SE3 | None = None, **options: Any
    ) -> Part | tuple[Part, ...]:
        """Add one part, or all parts of whatever `vpframe.load` takes; names must be new.

        name: of the part that was loaded; of several it comes before theirs ("gearbox/shaft"). pose: moves them all.
        options: as of `vpframe.load`. Statements and notes of what is loaded come along. Returns the part that was
        given, or the parts that were loaded; of an error the scene has changed nothing.
        """
        if isinstance(source, Part):
            self._check_new([source.name])
            self._parts[source.name] = source
            return source
        loaded: Scene = importlib.import_module("vpframe.importers").load(source, **options)
        names = {own: own if name is None else name if len(loaded) == 1 else f"{name}/{own}" for own in loaded}
        self._check_new(names.values())
        for part in loaded.parts:
            part.name = names[part.name]
            part.pose = part.pose if pose is None else pin.SE3(pose) * part.pose
            self._parts[part.name] = part
        self.notes += loaded.notes
        self.statements += tuple(statement.renamed(names) for statement in loaded.statements)
        return loaded.parts

    def _check_new(self, names: Iterable[str]) -> None:
        for name in names:
            if name in self._parts:
                raise VpframeError(f"two parts are called {name!r}; names must be unique, rename one")

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

    def export(
        self, path: str | os.PathLike[str], motion: Motion | None = None, time: float | None = None
    ) -> tuple[str, ...]:
        """Write the scene, its parts where they are now, as STEP, GLB, URDF, MJCF, USD, CSV or Parquet.

        See `vpframe.exporters.export`: the name's ending tells the format; returns what that could not carry.
        """
        return tuple(importlib.import_module("vpframe.exporters").export(self, path, motion, time))

    def copy(self) -> Scene:
        """A scene of the same shapes, with parts of its own where these are now."""
        parts = (replace(part, pose=part.pose.copy()) for part in self.parts)
        return Scene(parts, self.source, self.notes, self.statements)

    def __getitem__(self, name: str) -> Part:
        try:
            return self._parts[name]
        except KeyError:
            raise UnknownPartError(name, self._parts) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)

    def _repr_html_(self) -> str:
        """The scene as a notebook shows it."""
        page: str = importlib.import_module("vpframe.view.notebook").shown(self)  # which knows scenes
        return page

    def __repr__(self) -> str:
        return f"Scene({len(self)} parts, source={self.source!r})"
