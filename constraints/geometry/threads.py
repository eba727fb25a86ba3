"""Modelled threads: found among freeform faces by the screw motion that their surface is invariant under.

A surface slips along a twist (v, ω) when every normal is at right angles to the velocity there: n·(v + ω × p) = 0
(Gelfand and Guibas, Shape segmentation using local slippage analysis, SGP 2004). A cylinder has two such twists, a
general surface none; a thread has one, a screw, whose axis and pitch it tells.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from collision import SurfaceMesh
from constraints.geometry.features import Feature
from constraints.geometry.surfaces import Cone, Cylinder, Vector
from constraints.geometry.views import Extent

Array = NDArray[np.float64]

SLIP = 1e-3
"""1: greatest mean square of normal speed over speed at which facets still count as slipping"""
LONE = 0.2
"""1: least over next least mean square: a shallow flank by itself is nearly a plane, which slips three ways"""
NONE = 1e-12
"""1: a mean square that is zero but for rounding"""
PITCHES = (0.02, 2.0)
"""1: least and greatest advance a turn, over the diameter"""
ALIKE = 0.02
"""1: within it two faces' axes (rad, and over the diameter) and pitches (relative) are those of one thread"""


@dataclass(frozen=True, eq=False)
class Thread:
    """The faces of a body that slip along one screw."""

    origin: Vector
    """(3,) m, body frame, on the axis beside the faces' middle"""
    axis: Vector
    """(3,) unit"""
    pitch: float
    """m a turn, positive for a right-hand thread"""
    radius: float
    """m: mean radius of the flanks by area, the pitch radius of a symmetric profile"""
    sense: int
    """+1 on a bolt, -1 in a nut"""
    surfaces: tuple[int, ...]
    slip: float
    """1: mean square of normal speed over speed: how well it is a screw"""


@dataclass(frozen=True, eq=False)
class _Facets:
    center: Array
    normal: Array
    area: Array

    @classmethod
    def of(cls, mesh: SurfaceMesh, surfaces: Iterable[int]) -> _Facets:
        corners = mesh.vertices[mesh.triangles[np.concatenate([mesh.triangles_of(s) for s in surfaces])]]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        double = np.linalg.norm(normal, axis=1)
        real = double > 0.0
        return cls(corners[real].mean(axis=1), normal[real] / double[real, None], 0.5 * double[real])


def thread_of(mesh: SurfaceMesh, surfaces: Sequence[int]) -> Thread | None:
    """The thread that some faces together are, or None."""
    f = _Facets.of(mesh, surfaces)
    if len(f.area) < 12:  # six unknowns; fewer facets slip along something by accident
        return None
    weight = f.area / f.area.sum()
    middle = weight @ f.center
    arm = f.center - middle
    size = float(np.sqrt(weight @ (arm**2).sum(axis=1)))
    rows = np.hstack([f.normal, np.cross(arm / size, f.normal)])
    values, vectors = np.linalg.eigh((rows * weight[:, None]).T @ rows)
    v, w = vectors[:3, 0] * size, vectors[3:, 0]
    speed = float(np.linalg.norm(w))
    if values[0] > SLIP or values[0] > LONE * values[1] or values[1] < NONE or speed < ALIKE:
        return None
    axis = w / speed
    if axis[int(np.argmax(np.abs(axis)))] < 0.0:
        axis, v, w = -axis, -v, -w
    origin = middle + np.cross(w, v) / speed**2
    out = f.center - origin
    out = out - (out @ axis)[:, None] * axis
    distance = np.linalg.norm(out, axis=1)
    radius = float(weight @ distance)
    pitch = 2.0 * np.pi * float(axis @ v) / speed
    if not PITCHES[0] * 2.0 * radius <= abs(pitch) <= PITCHES[1] * 2.0 * radius:
        return None
    outward = float(weight @ (np.einsum("ij,ij->i", f.normal, out) / np.maximum(distance, 1e-12 * size)))
    return Thread(origin, axis, pitch, radius, 1 if outward > 0 else -1, tuple(sorted(surfaces)), float(values[0]))


def find_threads(mesh: SurfaceMesh, surfaces: Iterable[int]) -> tuple[Thread, ...]:
    """The threads among some faces of a mesh (give those of no analytic type), by their first face.

    Faces (flanks, crests, roots) that slip along the same screw are one thread.
    """
    found: list[Thread] = []
    for s in sorted(surfaces):
        thread = thread_of(mesh, [s])
        if thread is None:
            continue
        for k, other in enumerate(found):
            joined = thread_of(mesh, [*other.surfaces, s]) if _alike(thread, other) else None
            if joined is not None:
                found[k] = joined
                break
        else:
            found.append(thread)
    return tuple(found)


def _alike(a: Thread, b: Thread) -> bool:
    """Whether two faces are of one thread."""
    shift = b.origin - a.origin
    aside = float(np.linalg.norm(shift - (shift @ a.axis) * a.axis))
    return (
        float(np.linalg.norm(np.cross(a.axis, b.axis))) <= ALIKE
        and aside <= ALIKE * 2.0 * a.radius
        and abs(a.pitch - b.pitch) <= ALIKE * abs(a.pitch)
    )


def faces_of_thread(features: Sequence[Feature], place: int) -> tuple[int, ...]:
    """Faces of the thread at a place among a part's features: flanks, crests and roots, and the cones at its ends."""
    thread = Extent.of(features[place])
    g, found = thread.feature.geometry, list(thread.feature.surfaces)
    if not isinstance(g, Cylinder):
        return tuple(found)
    low, high = thread.radii
    slack = ALIKE * high
    for feature in features:
        if feature is thread.feature or not isinstance(feature.geometry, Cylinder | Cone):
            continue
        radii = g.radius + g.distance(feature.samples)
        heights = (feature.samples - g.origin) @ g.axis
        beside = thread.spans[0, 0] - high <= heights.min() and heights.max() <= thread.spans[-1, 1] + high
        if low - slack <= radii.min() and radii.max() <= high + slack and beside:
            found += feature.surfaces
    return tuple(sorted(found))


def threaded(mesh: SurfaceMesh, features: Sequence[Feature]) -> tuple[tuple[Feature, ...], dict[int, float]]:
    """The features of a body with its threads among them, as cylinders, and the pitch of each by its place.

    Looks at the faces that belong to no feature.
    """
    taken = {s for f in features for s in f.surfaces}
    out = list(features)
    pitches: dict[int, float] = {}
    for thread in find_threads(mesh, set(range(mesh.n_surfaces)) - taken):
        corners = mesh.triangles[np.concatenate([mesh.triangles_of(s) for s in thread.surfaces])]
        used, triangles = np.unique(corners, return_inverse=True)
        samples = mesh.vertices[used]
        geometry = Cylinder(thread.origin, thread.axis, thread.radius)
        pitches[len(out)] = thread.pitch
        out.append(
            Feature(
                geometry=geometry,
                surfaces=thread.surfaces,
                sense=thread.sense,
                samples=samples,
                triangles=triangles.reshape(-1, 3).astype(np.int32),
                residual=float(np.abs(geometry.distance(samples)).max()),
                area=float(_Facets.of(mesh, thread.surfaces).area.sum()),
            )
        )
    return tuple(out), pitches
