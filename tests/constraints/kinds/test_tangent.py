"""`Tangent`: surfaces that touch along a line or in a point."""

from math import pi

import numpy as np
import pinocchio as pin
import pytest

from constraints.geometry.surfaces import Cone, Cylinder, Geometry, Plane, Sphere, Torus
from constraints.kinds import Tangent
from constraints.solve.solver import solve
from tests.constraints.kinds.properties import AB, CONES, CYLINDERS, PLANES, SPHERES, TORI, KindProperties, random_pose


class TestTangent(KindProperties):
    cases = (
        ("tangent plane cylinder", Tangent(AB, (PLANES[0], CYLINDERS[1])), 4),
        ("tangent cylinder plane", Tangent(AB, (CYLINDERS[0], PLANES[1])), 4),
        ("tangent plane sphere", Tangent(AB, (PLANES[0], SPHERES[1])), 5),
        ("tangent sphere plane", Tangent(AB, (SPHERES[0], PLANES[1])), 5),
        ("tangent plane cone", Tangent(AB, (PLANES[0], CONES[1])), 4),
        ("tangent plane torus", Tangent(AB, (PLANES[0], TORI[1])), 5),
        ("tangent torus plane", Tangent(AB, (TORI[0], PLANES[1])), 5),
        ("tangent cylinders outside", Tangent(AB, CYLINDERS), 3),
        ("tangent cylinders inside", Tangent(AB, CYLINDERS, mode="inside"), 3),
        ("tangent cylinders crossed", Tangent(AB, CYLINDERS, mode="crossed"), 5),
        ("tangent cylinder sphere", Tangent(AB, (CYLINDERS[0], SPHERES[1])), 5),
        ("tangent sphere in cylinder", Tangent(AB, (SPHERES[0], CYLINDERS[1]), mode="inside"), 5),
        ("tangent spheres", Tangent(AB, SPHERES), 5),
        ("tangent spheres inside", Tangent(AB, SPHERES, mode="inside"), 5),
        ("tangent cone sphere", Tangent(AB, (CONES[0], SPHERES[1])), 5),
        ("tangent sphere in cone", Tangent(AB, (SPHERES[0], CONES[1]), mode="inside"), 5),
        ("tangent torus sphere", Tangent(AB, (TORI[0], SPHERES[1])), 5),
    )


def points_on(surface: Geometry) -> np.ndarray:
    """A dense sample of a surface about its middle."""
    s, t = (g.ravel() for g in np.meshgrid(np.linspace(0, 2 * pi, 721), np.linspace(-1, 1, 401)))
    if isinstance(surface, Sphere):
        z = np.stack([np.cos(s) * np.sqrt(1 - t**2), np.sin(s) * np.sqrt(1 - t**2), t], axis=1)
        return surface.center + surface.radius * z
    frame = np.linalg.svd(surface.axis[None])[2]
    e1, e2 = frame[1], frame[2]
    ring = np.cos(s)[:, None] * e1 + np.sin(s)[:, None] * e2
    if isinstance(surface, Cylinder):
        return surface.origin + 0.5 * t[:, None] * surface.axis + surface.radius * ring
    if isinstance(surface, Cone):
        h = 0.25 * (t[:, None] + 1)
        return surface.apex + h * surface.axis + h * np.tan(surface.half_angle) * ring
    assert isinstance(surface, Torus)
    up = np.cos(pi * t)[:, None] * ring + np.sin(pi * t)[:, None] * surface.axis
    return surface.center + surface.major * ring + surface.minor * up


@pytest.mark.parametrize(("name", "constraint", "freedom"), TestTangent.cases)
def test_tangent_surfaces_touch_and_do_not_cross(name: str, constraint: Tangent, freedom: int) -> None:
    """Against samples of the surfaces themselves: the least distance is nought and all others lie on one side."""
    rng = np.random.default_rng(17)
    poses = [pin.SE3.Identity(), random_pose(rng)]
    pose = solve([constraint], poses, movable=[1]).poses[1]
    a, b = constraint.features[0], constraint.features[1].transformed(pose)
    if isinstance(b, Plane) or (isinstance(a, Sphere) and not isinstance(b, Sphere)):
        a, b = b, a
    if isinstance(a, Sphere) and isinstance(b, Sphere) and a.radius < b.radius:
        a, b = b, a
    if isinstance(a, Cylinder) and isinstance(b, Cylinder):
        if a.radius < b.radius:
            a, b = b, a
        foot = np.linalg.lstsq(np.stack([a.axis, -b.axis], axis=1), b.origin - a.origin, rcond=None)[0]
        b = Cylinder(b.origin + (foot[1] if "crossed" in name else 0.0) * b.axis, b.axis, b.radius)
    distance = a.distance(points_on(b))
    assert np.abs(distance).min() < 2e-5
    inside = "inside" in name or " in " in name
    assert (distance.max() < 2e-5) if inside else (distance.min() > -2e-5)
