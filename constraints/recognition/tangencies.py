"""Tangency rules of the pairing table: contact of two analytic surfaces along a line or in a point.

Each rule returns the nearest points of the two surfaces, their signed gap (negative is interference) and the points of
the contact. A tangency counts only if the triangles of both features reach one of these points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from constraints.geometry.surfaces import Cone, Cylinder, Geometry, Plane, Sphere, Torus, Vector, perpendicular

Array = NDArray[np.float64]
SAMPLES = 17
"""points tested along a line contact"""


@dataclass(frozen=True, eq=False)
class NearestPoints:
    """Nearest points of two analytic surfaces."""

    gap: float
    """m: distance along the common normal, negative where they interfere"""
    angle: float
    """rad: deviation from the direction in which the surfaces are tangent"""
    points: Array
    """(k, 3) world: a point contact, or points along the line"""
    normal: Vector
    """(3,) world, common normal, towards the second surface"""
    mode: str
    """"outside", "inside" or "crossed\""""


def plane_cylinder(p: Plane, c: Cylinder, span: tuple[float, float], hollow: bool) -> NearestPoints:
    """Nearest line of a plane and a cylinder, parallel to the cylinder's axis."""
    angle = abs(float(np.arcsin(np.clip(c.axis @ p.normal, -1.0, 1.0))))
    heights = np.linspace(*span, SAMPLES)
    line = c.origin + heights[:, None] * c.axis - c.radius * p.normal
    middle = c.origin + 0.5 * (span[0] + span[1]) * c.axis
    return NearestPoints(float((middle - p.origin) @ p.normal) - c.radius, angle, line, p.normal, "outside")


def plane_sphere(p: Plane, s: Sphere, span: tuple[float, float], hollow: bool) -> NearestPoints:
    """Nearest point of a plane and a sphere."""
    gap = float((s.center - p.origin) @ p.normal) - s.radius
    return NearestPoints(gap, 0.0, (s.center - s.radius * p.normal)[None], p.normal, "outside")


def plane_cone(p: Plane, c: Cone, span: tuple[float, float], hollow: bool) -> NearestPoints:
    """Nearest line of a plane and a cone that lies on its side, through the apex."""
    lean = float(np.arcsin(np.clip(c.axis @ p.normal, -1.0, 1.0)))
    flat = c.axis - (c.axis @ p.normal) * p.normal
    length = float(np.linalg.norm(flat))
    along = flat / length if length > 0 else perpendicular(p.normal)
    run = np.linspace(*span, SAMPLES) / np.cos(c.half_angle)
    gap = float((c.apex - p.origin) @ p.normal)
    return NearestPoints(gap, abs(lean - c.half_angle), c.apex + run[:, None] * along, p.normal, "outside")


def plane_torus(p: Plane, t: Torus, span: tuple[float, float], hollow: bool) -> NearestPoints:
    """Nearest point of a plane and a torus, or the nearest circle if the ring lies flat."""
    out = p.normal - (p.normal @ t.axis) * t.axis
    length = float(np.linalg.norm(out))
    if length > 1e-6:
        ring = t.center[None] - t.major * (out / length)
    else:
        u = perpendicular(t.axis)
        v = np.cross(t.axis, u)
        a = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
        ring = t.center + t.major * (np.cos(a)[:, None] * u + np.sin(a)[:, None] * v)
    points = ring - t.minor * p.normal
    return NearestPoints(float((points[0] - p.origin) @ p.normal), 0.0, points, p.normal, "outside")


def cylinder_cylinder(a: Cylinder, b: Cylinder, span: tuple[float, float], hollow: bool) -> NearestPoints | None:
    """Nearest line of two cylinders with parallel axes, nearest point of two with crossed axes."""
    cross = np.cross(a.axis, b.axis)
    sine = float(np.linalg.norm(cross))
    shift = b.origin - a.origin
    if sine < 0.1:  # parallel within any angular limit; `span` belongs to the solid one, b
        middle = shift + 0.5 * (span[0] + span[1]) * b.axis
        out = middle - (middle @ a.axis) * a.axis
        distance = float(np.linalg.norm(out))
        if distance == 0.0:
            return None
        normal = out / distance
        gap = a.radius - b.radius - distance if hollow else distance - a.radius - b.radius
        side = b.radius if hollow else -b.radius
        line = b.origin + np.linspace(*span, SAMPLES)[:, None] * b.axis + side * normal
        return NearestPoints(gap, float(np.arcsin(sine)), line, normal, "inside" if hollow else "outside")
    if hollow:
        return None
    normal = cross / sine
    distance = float(shift @ normal)
    if distance < 0.0:
        normal, distance = -normal, -distance
    t = float(np.cross(shift, b.axis) @ cross) / sine**2
    point = a.origin + t * a.axis + a.radius * normal
    return NearestPoints(distance - a.radius - b.radius, 0.0, point[None], normal, "crossed")


def ball(
    nearest: Callable[[Geometry, Vector], tuple[float, Vector]],
) -> Callable[[Geometry, Sphere, tuple[float, float], bool], NearestPoints | None]:
    """Return the rule for a ball on or in a surface; nearest: callback(surface, point), signed distance and normal."""

    def rule(a: Geometry, s: Sphere, span: tuple[float, float], hollow: bool) -> NearestPoints | None:
        distance, out = nearest(a, s.center)
        if not np.isfinite(out).all():
            return None
        gap = -distance - s.radius if hollow else distance - s.radius
        side = s.radius if hollow else -s.radius
        return NearestPoints(gap, 0.0, (s.center + side * out)[None], out, "inside" if hollow else "outside")

    return rule


def _wall(surface: Geometry, point: Vector) -> tuple[float, Vector]:
    """Signed distance of a point from a surface, and the surface's outward normal towards it."""
    return float(surface.distance(point)[0]), np.asarray(surface.normals(point)[0])


Rule = Callable[..., NearestPoints | None]
TANGENCIES: dict[tuple[type[Geometry], type[Geometry]], Rule] = {
    (Plane, Cylinder): plane_cylinder,
    (Plane, Sphere): plane_sphere,
    (Plane, Cone): plane_cone,
    (Plane, Torus): plane_torus,
    (Cylinder, Cylinder): cylinder_cylinder,
    (Cylinder, Sphere): ball(_wall),
    (Cone, Sphere): ball(_wall),
    (Torus, Sphere): ball(_wall),
    (Sphere, Sphere): ball(_wall),
}
"""by the types of the larger or simpler surface and of the solid surface that touches it"""
