"""Geometry of a face from its numbers in a file, or fitted to its points, and back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from collision import Tolerance
from constraints.errors import GeometryError
from constraints.geometry.surfaces import Cone, Cylinder, Freeform, Geometry, Plane, Sphere, Torus
from constraints.recognition.fits import allowed, fit_surface
from vpframe.importers.raw import RawFace

Array = NDArray[np.float64]


def raw_geometry(raw: RawFace, points: Array, outward: Array) -> Geometry:
    """Return the analytic geometry of a typed face; planes point out of the material, cones open towards the face."""
    n = np.array(raw.numbers)
    match raw.kind:
        case "plane":
            return Plane(n[:3], n[3:6] if n[3:6] @ outward >= 0 else -n[3:6])
        case "cylinder":
            return Cylinder(n[:3], n[3:6], n[6])
        case "cone":
            axis = n[3:6] if ((points - n[:3]) @ n[3:6]).mean() >= 0 else -n[3:6]
            return Cone(n[:3], axis, n[6])
        case "sphere":
            return Sphere(n[:3], n[3])
        case "torus":
            ring = Torus(n[:3], n[3:6], n[6], n[7])
            inner = ring.major <= ring.minor and np.abs(ring.distance(points)).max() > ring.minor * 1e-3
            return Freeform() if inner else ring  # the inner sheet of a spindle torus is not supported
        case _:
            return Freeform()


def raw_numbers(geometry: Geometry) -> tuple[str, tuple[float, ...]]:
    """Return kind and numbers in the form of `RawFace`: the inverse of `raw_geometry`."""
    if isinstance(geometry, Freeform):
        return "", ()
    values = (np.atleast_1d(np.asarray(v, dtype=np.float64)) for v in vars(geometry).values())
    return geometry.kind, tuple(float(x) for v in values for x in v)


def recognised(raw: RawFace, points: Array, middles: Array, vectors: Array) -> tuple[Geometry, float]:
    """Return geometry and residual of a face: type of the file, recognition of the kernel if it fits the face's points,
    a least-squares fit, or freeform."""
    try:
        geometry = raw_geometry(raw, points, vectors.sum(axis=0))
    except GeometryError:  # a torus of zero minor radius
        geometry = Freeform()
    if raw.typed:
        return geometry, raw.residual
    tolerance = Tolerance()
    on_surface = np.concatenate([points, raw.samples])
    if not isinstance(geometry, Freeform):
        residual = float(np.abs(geometry.distance(on_surface)).max())
        if residual <= allowed(on_surface, tolerance):
            return geometry, residual
    fit = fit_surface(on_surface, middles, vectors, tolerance)
    return (Freeform(), 0.0) if fit is None else (fit.geometry, fit.residual)


def orientation(geometry: Geometry, middles: Array, vectors: Array) -> str:
    """ "flat" for planes, "convex" or "concave" by the outward area vectors, "free" for freeform."""
    if isinstance(geometry, Freeform):
        return "free"
    if isinstance(geometry, Plane):
        return "flat"
    along = np.einsum("ij,ij->", geometry.normals(middles), vectors)
    return "convex" if along >= 0 else "concave"
