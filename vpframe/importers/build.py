"""Convert raw arrays to a `Scene`: type and orient surfaces, compute mass properties."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import SurfaceMesh
from constraints.geometry.surfaces import Freeform
from vpframe.importers import cache
from vpframe.importers.face_geometry import orientation, raw_geometry, raw_numbers, recognised
from vpframe.importers.polyhedron import mass_properties, open_edges, signed_volume, triangle_area_vectors, without_flat
from vpframe.importers.raw import NO_SAMPLES, RawFace, RawPart, RawScene, RawShape
from vpframe.scene.scene import Mass, Part, Scene, Shape, Size, Surface

Array = NDArray[np.float64]


def scene(
    raw: RawScene,
    source: str | None = None,
    progress: Callable[[float, str], None] | None = None,
    keep: Callable[[RawScene], None] = lambda raw: None,
) -> Scene:
    """Return the scene of a raw scene; parts of one shape share the object. `progress` receives fraction and task.

    Faces without a type are fitted when surfaces are first needed; `keep` then receives the raw scene.
    """
    raw.shapes = [settled(s) for s in raw.shapes]

    def fit() -> None:
        if sum(fit_faces(s) for s in raw.shapes if s.segmented):
            keep(raw)

    def measured() -> None:
        measure(raw.shapes)
        keep(raw)

    shapes, done, total = [], 0, max(sum(len(s.faces) for s in raw.shapes), 1)
    for s, name in zip(raw.shapes, _shape_names(raw), strict=True):
        if progress is not None:
            progress(done / total, f"surfaces of {name}")
        shapes.append(shape(s, name, fit, measured))
        done += len(s.faces)
    made = Scene((_part(p, shapes[p.shape]) for p in raw.parts), source=source, notes=raw.notes)
    if raw.links:
        from vpframe.importers.mechanism import impose  # imports the solver

        impose(made, raw.links, raw.joints)
    return made


def _part(raw: RawPart, of: Shape) -> Part:
    made = Part(raw.name, of, pin.SE3(raw.rotation, raw.translation), density=raw.density)
    if raw.color is not None:
        made.color = raw.color
    if raw.mass is not None:
        made.inertia = pin.Inertia(*raw.mass)
    return made


def _shape_names(raw: RawScene) -> list[str]:
    first: dict[int, str] = {}
    for part in raw.parts:
        first.setdefault(part.shape, part.name)
    return [first.get(i, f"shape {i}") for i in range(len(raw.shapes))]


def tessellated(occ: Any, deflection: float, angular: float, name: str) -> Shape:
    """Return the shape of an OpenCascade shape; `deflection` (m) and `angular` (rad) as in `vpframe.load`."""
    from vpframe.importers import brep  # slow to import

    return shape(brep.measured(occ, deflection, angular), name)


def shape(
    raw: RawShape,
    name: str = "shape",
    fit: Callable[[], object] | None = None,
    measured: Callable[[], object] | None = None,
) -> Shape:
    """Return the shape of raw arrays, without triangles of zero area.

    fit: gives types to its faces when they are first needed (default `fit_faces`). measured: computes its mass
    properties likewise (default `measure`).
    """
    raw = settled(raw)

    def mass() -> Mass:
        if raw.volume is None:
            (measured or partial(measure, [raw]))()
        made.__dict__["notes"] = tuple(raw.notes)
        assert raw.volume is not None
        return raw.volume, raw.center, raw.inertia

    enclosed = signed_volume(raw.vertices, raw.triangles)
    if not raw.segmented:
        made: Shape = _BareShape.of(raw, name, mass, enclosed)
        return made
    mesh = SurfaceMesh(raw.vertices, raw.triangles, raw.face_of_triangle, name)

    def surfaces() -> tuple[Surface, ...]:
        (fit or partial(fit_faces, raw))()
        vectors = triangle_area_vectors(raw.vertices, raw.triangles)
        own = [mesh.triangles_of(i) for i in range(mesh.n_surfaces)]
        return tuple(_surface(i, face, mesh, vectors[own[i]], own[i]) for i, face in enumerate(raw.faces))

    closed = not len(open_edges(raw.triangles))
    made = Shape(mesh, surfaces, None, mass, enclosed, closed, tuple(raw.notes), raw.brep)
    return made


def measure(shapes: Sequence[RawShape]) -> None:
    """Compute the mass properties of shapes that have none: of their exact solids in the CAD kernel's process, where
    they have such, else of their triangles.
    """
    waiting = [each for each in shapes if each.volume is None]
    if exact := [each for each in waiting if each.bounds is not None]:
        from vpframe.importers import cad

        cad.measure(exact)
    for each in waiting:
        if each.volume is None:
            each.volume, each.center, each.inertia = mass_properties(each.vertices, each.triangles)


def fit_faces(raw: RawShape) -> bool:
    """Give a type to the faces of a settled shape that have none; whether there were any. Takes milliseconds a face."""
    free = [k for k, face in enumerate(raw.faces) if not face.typed]
    order = np.argsort(raw.face_of_triangle, kind="stable")
    starts = np.searchsorted(raw.face_of_triangle[order], np.arange(len(raw.faces) + 1))
    for k in free:
        face, corners = raw.faces[k], raw.triangles[order[starts[k] : starts[k + 1]]]
        points, middles = raw.vertices[np.unique(corners)], raw.vertices[corners].mean(axis=1)
        geometry, residual = recognised(face, points, middles, triangle_area_vectors(raw.vertices, corners))
        kind, numbers = raw_numbers(geometry)
        raw.faces[k] = replace(face, kind=kind, numbers=numbers, typed=True, residual=residual, samples=NO_SAMPLES)
    return bool(free)


class _BareShape(Shape):
    """Shape of a bare mesh. Its surfaces are found when `mesh`, `surfaces` or `features` is first needed."""

    @classmethod
    def of(cls, raw: RawShape, name: str, mass: Callable[[], Mass], enclosed: float) -> _BareShape:
        """Return the shape of a settled mesh that is not segmented; `mass` computes its mass properties."""
        made = object.__new__(cls)
        closed = not len(open_edges(raw.triangles))
        measured = {"_measure": mass, "enclosed": enclosed, "closed": closed}
        kept = {"notes": tuple(raw.notes), "brep": raw.brep, "_raw": raw, "_name": name}
        made.__setstate__(measured | kept)
        return made

    def __getstate__(self) -> dict[str, Any]:
        derived = ("_find", "_measure", "_segmented", "unsegmented")
        return {"_mass": self._mass, **{name: value for name, value in vars(self).items() if name not in derived}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        if "surfaces" not in state:
            self.__dict__["_find"] = lambda: self._segmented.surfaces

    @property
    def counts(self) -> tuple[int, int]:
        """Numbers of faces and triangles; no faces while none were needed."""
        return super().counts if "mesh" in vars(self) else (0, len(self.__dict__["_raw"].triangles))

    @cached_property
    def unsegmented(self) -> Shape:  # type: ignore[override]
        """The mesh as one freeform surface, without features."""
        raw = self.__dict__["_raw"]
        mesh = SurfaceMesh(raw.vertices, raw.triangles, name=self.__dict__["_name"])
        area = float(np.linalg.norm(triangle_area_vectors(raw.vertices, raw.triangles), axis=1).sum())
        surface = Surface(0, mesh.name, Freeform(), "free", 0.0, area)
        mass = self.__dict__.get("_measure", lambda: self._mass)
        return Shape(mesh, (surface,), (), mass, self.enclosed, self.closed, self.notes, faceted=True)

    @cached_property
    def _segmented(self) -> Shape:
        return shape(_surfaced(self.__dict__["_raw"]), self.__dict__["_name"])

    def __getattr__(self, name: str) -> Any:
        if name != "mesh":
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
        self.__dict__["mesh"] = self._segmented.mesh
        return self.__dict__["mesh"]


def _surfaced(raw: RawShape) -> RawShape:
    """Return a bare mesh with its surfaces, from the cache if possible."""
    from vpframe.importers import meshes

    key = cache.key_of_arrays(raw.vertices, raw.triangles)
    found = cache.find(key)
    if found is None:
        made = settled(replace(meshes.segmented(raw), settled=False, notes=[]))
        fit_faces(made)
        found = RawScene([made])
        cache.keep(key, found)
    return replace(found.shapes[0], notes=raw.notes)


@np.errstate(over="ignore", invalid="ignore")  # coordinates out of range are refused later, with one line
def settled(raw: RawShape) -> RawShape:
    """Drop faces without triangles, and note open edges.

    A settled shape is returned as it is. A shape whose triangles all have zero area has no faces.
    """
    if raw.settled:
        return raw
    notes = list(raw.notes)
    triangles, owners, kept = _drop_flat(raw, notes)
    if not kept:
        return RawShape(raw.vertices, triangles, owners, [], notes=notes, settled=True)
    border = open_edges(triangles)
    if len(border):
        x, y, z = 1e3 * raw.vertices[border[0]].mean(axis=0)
        why = "a face is missing or wound the wrong way"
        if raw.sheet and not any("lost" in note for note in notes):
            why = "where faces end that belong to no solid in the file"
        notes.append(
            f"open: at {len(border)} edges, the first near ({x:.6g}, {y:.6g}, {z:.6g}) mm, {why}; its volume, and what "
            "is inside it, are estimates"
        )
    faces = [raw.faces[k] for k in kept]
    return replace(raw, triangles=triangles, face_of_triangle=owners, faces=faces, notes=notes, settled=True)


def _drop_flat(raw: RawShape, notes: list[str]) -> tuple[NDArray[np.int32], NDArray[np.int32], list[int]]:
    """Return triangles of positive area, their surface numbers without gaps, and the raw face of each surface."""
    triangles, faces = without_flat(raw.vertices, raw.triangles, raw.face_of_triangle)
    flat = np.linalg.norm(triangle_area_vectors(raw.vertices, raw.triangles), axis=1) == 0.0
    if flat.any():
        notes.append(f"{flat.sum()} triangles of zero area dropped")
    kept, numbers = np.unique(faces, return_inverse=True)
    lost = np.setdiff1d(np.arange(len(raw.faces)), kept).tolist()
    notes.extend(f"{raw.faces[i].name} has no triangle of positive area: it is lost" for i in lost)
    return triangles, numbers.reshape(-1).astype(np.int32), kept.tolist()


def _surface(index: int, raw: RawFace, mesh: SurfaceMesh, vectors: Array, triangles: NDArray[np.int32]) -> Surface:
    corners = mesh.triangles[triangles]
    geometry = raw_geometry(raw, mesh.vertices[np.unique(corners)], vectors.sum(axis=0))
    facing = orientation(geometry, mesh.vertices[corners].mean(axis=1), vectors)
    area = float(np.linalg.norm(vectors, axis=1).sum())
    return Surface(index, raw.name, geometry, facing, raw.residual, area, raw.color, _stated_size(raw, facing))


def _stated_size(raw: RawFace, facing: str) -> Size | None:
    """Return the size of a face, with its class in the spelling of ISO 286: capitals for bores."""
    if raw.size is None:
        return None
    nominal, lower, upper, fit = raw.size
    return Size(nominal, lower, upper, fit.upper() if facing == "concave" else fit.lower())
