"""The scene graph: a `Scene` has `Part`s, a part is an instance of a `Shape`, a shape has `Surface`s."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import InitVar, dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Protocol, overload

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import SurfaceMesh
from constraints.geometry.features import Feature, group_features
from constraints.geometry.surfaces import Geometry
from vpframe import services
from vpframe.errors import UnknownPartError, VpframeError
from vpframe.scene.edges import Edge, edges_of
from vpframe.scene.joints import Statement
from vpframe.scene.motion import Motion
from vpframe.scene.overlap_rules import OverlapRule
from vpframe.scene.poses import rigid


@dataclass(frozen=True)
class Size:
    """Toleranced diameter of a bore or shaft from the model's PMI, m."""

    nominal: float
    lower: float | None = None
    upper: float | None = None
    """deviations from `nominal`"""
    fit: str = ""
    """ISO 286 tolerance class: "H7" (bore), "g6" (shaft)"""

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
    """greatest distance of the face's vertices from `geometry`, m; 0 if the file states the geometry"""
    area: float
    """m²"""
    color: tuple[float, float, float, float] | None = None
    size: Size | None = None
    """diameter from the file's PMI"""


Mass = tuple[float, NDArray[np.float64], NDArray[np.float64]]
"""volume, m³, centre (3,), m, and inertia (3, 3) about it at density 1 kg/m³, kg·m²"""


@dataclass(frozen=True, eq=False)
class Shape:
    """Data shared by instances, in the part's frame: mesh, surfaces, features, edges, mass properties at density 1."""

    mesh: SurfaceMesh
    given: InitVar[tuple[Surface, ...] | Callable[[], tuple[Surface, ...]]]
    """`surfaces`, or a function that finds them at their first use"""
    grouped: InitVar[tuple[Feature, ...] | None] = None
    """`features`; by default they are found at their first use"""
    measured: InitVar[Mass | Callable[[], Mass] | None] = None
    """volume, centre and inertia, or a function that computes them at their first use"""
    enclosed: float = 0.0
    """m³ inside the triangles: `volume` less the facets' deflection, known at once"""
    closed: bool = True
    """whether the mesh bounds a volume (each edge is used equally in both directions)"""
    notes: tuple[str, ...] = ()
    """remarks of the reader: open mesh, lost or repaired faces, dropped triangles"""
    brep: bytes = field(default=b"", repr=False)
    """exact B-rep in OpenCascade's binary format, mm; empty for a mesh"""
    faceted: bool = False
    """whether the triangles are taken as the exact surface: a bare mesh as one surface without features"""

    def __post_init__(
        self,
        given: tuple[Surface, ...] | Callable[[], tuple[Surface, ...]],
        grouped: tuple[Feature, ...] | None,
        measured: Mass | Callable[[], Mass] | None,
    ) -> None:
        self.__dict__["_find" if callable(given) else "surfaces"] = given
        self.__dict__["_measure" if callable(measured) else "_mass"] = measured or (0.0, np.zeros(3), np.zeros((3, 3)))
        if grouped is not None:
            self.__dict__["features"] = grouped

    def __getstate__(self) -> dict[str, Any]:
        known = {name: value for name, value in vars(self).items() if name not in ("_find", "_measure")}
        return {"surfaces": self.surfaces, "_mass": self._mass, **known}

    @property
    def unsegmented(self) -> Shape:
        """The shape itself; of a bare mesh one of a single surface, for which no surfaces are searched."""
        return self

    @property
    def volume(self) -> float:
        """m³; of the CAD solid, else of the closed mesh."""
        return self._mass[0]

    @property
    def center(self) -> NDArray[np.float64]:
        """(3,) centre of volume, m."""
        return self._mass[1]

    @property
    def inertia(self) -> NDArray[np.float64]:
        """(3, 3) about `center` at density 1 kg/m³, kg·m²."""
        return self._mass[2]

    @cached_property
    def _mass(self) -> Mass:
        measure: Callable[[], Mass] = self.__dict__["_measure"]
        return measure()

    @cached_property
    def surfaces(self) -> tuple[Surface, ...]:
        """One `Surface` for each B-rep face; `surfaces[i].index == i`."""
        find: Callable[[], tuple[Surface, ...]] = self.__dict__.pop("_find")
        return find()

    @property
    def counts(self) -> tuple[int, int]:
        """Numbers of faces and triangles; no faces while those of a mesh were not needed."""
        return self.mesh.n_surfaces, self.mesh.n_triangles

    @cached_property
    def features(self) -> tuple[Feature, ...]:
        """Analytic surfaces, each of one or more faces."""
        senses = [-1 if surface.orientation == "concave" else 1 for surface in self.surfaces]
        residuals = [surface.residual for surface in self.surfaces]
        return group_features(self.mesh, [surface.geometry for surface in self.surfaces], senses, residuals)

    @cached_property
    def edges(self) -> tuple[Edge, ...]:
        """Polylines along which surfaces meet."""
        return edges_of(self.mesh)


class Placing(Protocol):
    """Interface of a session's engine, which moves parts."""

    def pose(self, index: int) -> pin.SE3 | None:
        """Return a copy of the pose of part `index`; None while the part keeps its pose in the scene."""


GREY = (0.7, 0.7, 0.75, 1.0)
"""colour of a part that has none: red, green, blue (sRGB) and opacity"""


class Part:
    """One instance of a shape in the scene.

    Parameters
    ----------
    pose: world pose, `pinocchio.SE3` or the (4, 4) matrix of a rigid motion.
    color: red, green, blue (sRGB) and opacity, each in 0 … 1.
    density: kg/m³; None if the file gives no plausible value.
    inertia: mass, centre and inertia in the part's frame from the model; None: computed from density and shape.
    """

    placed: ClassVar[object] = object()
    """another object whenever any part was attached to a session or detached"""

    def __init__(
        self,
        name: str,
        shape: Shape,
        pose: pin.SE3,
        color: tuple[float, float, float, float] = GREY,
        density: float | None = None,
        fixed: bool = False,
        inertia: pin.Inertia | None = None,
    ) -> None:
        self.name, self.shape, self.color, self.density = name, shape, color, density
        self.fixed, self.inertia = fixed, inertia
        self._placing: tuple[Placing, int] | None = None
        self.pose = pose

    @property
    def pose(self) -> pin.SE3:
        """World pose of the part. During a session it is read-only and is the session's; hands and forces move it."""
        placed = None if self._placing is None else self._placing[0].pose(self._placing[1])
        return self._pose if placed is None else placed

    @pose.setter
    def pose(self, pose: pin.SE3) -> None:
        if self._placing is not None:
            raise VpframeError(
                f"{self.name} is in a session, which alone moves its parts: use hand.move_to(pose), or set part.pose "
                "before the session is opened or after it is closed"
            )
        self._pose = rigid(pose, f"{self.name}: pose")

    def copy(self, name: str | None = None, pose: pin.SE3 | None = None, shape: Shape | None = None) -> Part:
        """Return another part with the same properties, except those that are given."""
        where = self.pose.copy() if pose is None else pose
        of = self.shape if shape is None else shape
        return Part(name or self.name, of, where, self.color, self.density, self.fixed, self.inertia)

    def enter(self, session: Placing, index: int) -> None:
        """Attach the part to a session, which from now on provides its pose as part `index`."""
        self._pose = self.pose
        self._placing = (session, index)
        Part.placed = object()

    def is_placed_by(self, session: Placing) -> bool | None:
        """Whether that session provides the pose; None if no session does."""
        return None if self._placing is None else self._placing[0] is session

    def leave(self, session: Placing) -> None:
        """Detach the part from a session, keeping its pose, unless another session has attached it."""
        if self._placing is not None and self._placing[0] is session:
            self._pose = self.pose
            self._placing = None
            Part.placed = object()

    @property
    def mesh(self) -> SurfaceMesh:
        """Triangles grouped by surface, part frame, metres."""
        return self.shape.mesh

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        """One `Surface` for each B-rep face; `surfaces[i].index == i`."""
        return self.shape.surfaces

    @property
    def features(self) -> tuple[Feature, ...]:
        """Analytic surfaces, each of one or more faces."""
        return self.shape.features

    def __repr__(self) -> str:
        return f"Part({self.name!r}, surfaces={len(self.surfaces)})"


_NUMBER = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?")
_SHOWN = 3
_PLACE = re.compile(r"near \([^)]*\) mm")
"""most parts that a note names"""
_REPAIRED = ("repaired", "meshed again", "one by one")


class Scene(Mapping[str, Part]):
    """Parts by unique name, in a fixed order. `scene["shaft"]`, `for name in scene`, `scene.parts`."""

    def __init__(
        self,
        parts: Iterable[Part] = (),
        source: str | None = None,
        notes: Iterable[str] = (),
        statements: Iterable[Statement] = (),
        rules: Iterable[OverlapRule] = (),
    ) -> None:
        self._parts: dict[str, Part] = {}
        self.source = source
        self.notes: tuple[str, ...] = tuple(notes)
        self.statements: tuple[Statement, ...] = tuple(statements)
        """constraints of the model's joints"""
        self.rules: tuple[OverlapRule, ...] = tuple(rules)
        """what a person says of overlaps"""
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
        """Add one part, or all parts of a source that `vpframe.load` accepts; names must be new.

        name: name of a single loaded part, else prefix ("gearbox/shaft"). pose: moves all loaded parts. options: as in
        `vpframe.load`. Statements and notes are added too. Returns the given part, or the loaded parts; an error leaves
        the scene unchanged.
        """
        if isinstance(source, Part):
            self._check_new([source.name])
            self._parts[source.name] = source
            return source
        loaded: Scene = services.call("load", source, **options)
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
        """Parts in order; a part's index is its object id in collision, constraints and physics."""
        return tuple(self._parts.values())

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parts in order."""
        return tuple(self._parts)

    def index(self, name: str) -> int:
        """Index of a part: its object id in the other packages."""
        self[name]
        return self.names.index(name)

    def all_notes(self) -> tuple[str, ...]:
        """Notes on the scene and on its shapes, with the names of parts; notes of one kind are one line.

        Volume and containment of a part with the note "open" are estimates.
        """
        first: dict[Shape, str] = {}
        count: dict[Shape, int] = {}
        for part in self.parts:
            first.setdefault(part.shape, part.name)
            count[part.shape] = count.get(part.shape, 0) + 1
        kinds: dict[str, list[tuple[Shape, str]]] = {}
        for shape in first:
            for note in shape.notes:
                kinds.setdefault(_NUMBER.sub("#", note), []).append((shape, note))
        notes = []
        for found in kinds.values():
            shape, note = found[0]
            parts = sum(count[each] for each, _ in found)
            if len(found) > 1:
                named = ", ".join(first[each] for each, _ in found[:_SHOWN])
                who = f"{parts} parts of {len(found)} shapes ({named}{', …' if len(found) > _SHOWN else ''})"
                note = f"{note} (the first)" if any(other != note for _, other in found) else note
            else:
                who = f"{first[shape]}{f' (and {parts - 1} more of its shape)' if parts > 1 else ''}"
            notes.append(f"{who}: {note}")
        return (*self.notes, *notes)

    def summary(self) -> str:
        """Return the numbers of parts, faces, triangles and repaired and open shapes, and the places of the first of
        these, in one line. Meshes whose surfaces were not needed yet have no faces."""
        first = {part.shape: part.name for part in reversed(self.parts)}
        faces, triangles = (sum(numbers) for numbers in zip(*(shape.counts for shape in first), strict=True))
        repaired = {s: note for s in first for note in s.notes if any(word in note for word in _REPAIRED)}
        opened = {s: next((n for n in s.notes if n.startswith("open")), "") for s in first if not s.closed}

        def places(found: dict[Shape, str]) -> str:
            shown = list(found.items())[-1 : -1 - _SHOWN : -1]  # in the order of the parts
            named = (f"{first[s]}{f' {place[0]}' if (place := _PLACE.search(note)) else ''}" for s, note in shown)
            return f" ({', '.join(named)}{', …' if len(found) > _SHOWN else ''})" if found else ""

        return (
            f"{len(self)} parts of {len(first)} shapes, {faces} faces, {triangles} triangles; {len(repaired)} shapes "
            f"repaired{places(repaired)}, {len(opened)} open{places(opened)}"
        )

    def export(
        self, path: str | os.PathLike[str], motion: Motion | None = None, time: float | None = None
    ) -> tuple[str, ...]:
        """Write the scene at its present poses as STEP, GLB, URDF, MJCF, USD, CSV or Parquet, by the suffix.

        Returns notes on data that the format cannot contain. See `vpframe.exporters.export.export`.
        """
        return tuple(services.call("export", self, path, motion, time))

    def copy(self) -> Scene:
        """Return a scene with the same shapes and copies of the parts at their present poses."""
        parts = (part.copy() for part in self.parts)
        return Scene(parts, self.source, self.notes, self.statements, self.rules)

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
        """Return the HTML with which a notebook shows the scene."""
        page: str = services.call("page", self)
        return page

    def __repr__(self) -> str:
        return f"Scene({len(self)} parts, source={self.source!r})"
