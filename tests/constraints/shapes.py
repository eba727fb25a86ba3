"""Small bodies of known geometry for the tests: turned parts from a profile, and boxes."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from collision import SurfaceMesh
from constraints.geometry.features import Feature
from constraints.geometry.surfaces import Cone, Cylinder, Plane, Sphere, Torus


def at(x=0.0, y=0.0, z=0.0, rpy=(0.0, 0.0, 0.0)):
    return pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array([x, y, z], float))


@dataclass(frozen=True, eq=False)
class Body:
    mesh: SurfaceMesh
    features: tuple[Feature, ...]


class Builder:
    """Collects faces; vertices of one face are its own, as a CAD kernel gives them."""

    def __init__(self):
        self.v, self.t, self.s, self.features = [], [], [], []

    def face(self, vertices, triangles, geometry, sense):
        vertices, triangles = np.asarray(vertices, float), np.asarray(triangles, np.int32)
        start, index = sum(map(len, self.v)), len(self.v)
        self.v.append(vertices)
        self.t.append(triangles + start)
        self.s.append(np.full(len(triangles), index, np.int32))
        if geometry is None:
            return index
        c = vertices[triangles]
        area = 0.5 * np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1).sum()
        residual = float(np.abs(geometry.distance(vertices)).max())
        self.features.append(Feature(geometry, (index,), sense, vertices, triangles, residual, float(area)))
        return index

    def body(self, name="body"):
        return Body(
            SurfaceMesh(np.vstack(self.v), np.vstack(self.t), np.concatenate(self.s), name), tuple(self.features)
        )


def turned(profile, n=32, phase=0.0, name="turned"):
    """Revolve a closed profile [(r, z), …] about z, counter-clockwise in the (r, z) half plane (material on its left).

    A third item makes the edge that starts there an arc: ("ball", center_z) of a sphere on the axis, or
    ("ring", major, center_z) of a torus. A face an edge.
    """
    builder = Builder()
    angles = phase + 2 * np.pi * np.arange(n) / n
    z = np.array([0.0, 0.0, 1.0])
    for k, point in enumerate(profile):
        (r0, z0), (r1, z1) = point[:2], profile[(k + 1) % len(profile)][:2]
        arc = point[2] if len(point) > 2 else None
        if arc is None and r0 == r1 == 0.0:
            continue
        if arc is None:
            rows = [(r0, z0), (r1, z1)]
            if z0 == z1:
                geometry, sense = Plane([0, 0, z0], z * (1.0 if r1 < r0 else -1.0)), 1
            elif r0 == r1:
                geometry, sense = Cylinder([0, 0, 0], z, r0), (1 if z1 > z0 else -1)
            else:
                apex = z0 - r0 * (z1 - z0) / (r1 - r0)
                up = 1.0 if (z1 - z0) / (r1 - r0) > 0 else -1.0
                geometry = Cone([0, 0, apex], z * up, np.arctan(abs((r1 - r0) / (z1 - z0))))
                sense = 1 if z1 > z0 else -1
        elif arc[0] == "ball":
            c, radius = arc[1], np.hypot(r0, z0 - arc[1])
            a0, a1 = np.arctan2(z0 - c, r0), np.arctan2(z1 - c, r1)
            rows = [(radius * np.cos(a), c + radius * np.sin(a)) for a in np.linspace(a0, a1, 12)]
            geometry, sense = Sphere([0, 0, c], radius), (1 if a1 > a0 else -1)
        else:
            major, c = arc[1:]
            radius = np.hypot(r0 - major, z0 - c)
            a0, a1 = np.arctan2(z0 - c, r0 - major), np.arctan2(z1 - c, r1 - major)
            rows = [(major + radius * np.cos(a), c + radius * np.sin(a)) for a in np.linspace(a0, a1, 12)]
            geometry, sense = Torus([0, 0, c], z, major, radius), (1 if a1 > a0 else -1)
        vertices = np.array([[r * np.cos(a), r * np.sin(a), h] for r, h in rows for a in angles])
        triangles = []
        for i in range(len(rows) - 1):
            for j in range(n):
                p, q = i * n + j, i * n + (j + 1) % n
                if rows[i][0] > 1e-12:
                    triangles.append([p, q, q + n])
                if rows[i + 1][0] > 1e-12:
                    triangles.append([p, q + n, p + n])
        builder.face(vertices, triangles, geometry, sense)
    return builder.body(name)


def shaft(radius=0.01, length=0.05, n=32, phase=0.0):
    """Faces: bottom plane, cylinder, top plane; z from 0 to `length`."""
    return turned([(0, 0), (radius, 0), (radius, length), (0, length)], n, phase, "shaft")


def flanged_shaft(radius=0.01, length=0.05, flange=0.02, thickness=0.005, n=32, phase=0.0):
    """A shaft from z = 0 up to `length` under a flange. Faces: end, cylinder, seat (looks down), rim, top."""
    top = length + thickness
    profile = [(0, 0), (radius, 0), (radius, length), (flange, length), (flange, top), (0, top)]
    return turned(profile, n, phase, "flanged shaft")


def housing(radius=0.01, depth=0.06, outer=0.03, n=32, phase=0.0):
    """A tube, z from 0 to `depth`. Faces: bottom, outside, top, bore."""
    return turned([(radius, 0), (outer, 0), (outer, depth), (radius, depth)], n, phase, "housing")


def box(lx, ly, lz, name="box"):
    """Centred at the origin. Faces: -x, +x, -y, +y, -z, +z."""
    builder = Builder()
    half = 0.5 * np.array([lx, ly, lz])
    for axis in range(3):
        for side in (-1.0, 1.0):
            normal = np.zeros(3)
            normal[axis] = side
            u, v = np.roll([1.0, 0, 0], axis + 1), np.roll([1.0, 0, 0], axis + 2)
            corners = [normal + a * u + b * v for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            triangles = [[0, 1, 2], [0, 2, 3]] if side > 0 else [[0, 2, 1], [0, 3, 2]]
            builder.face(np.array(corners) * half, triangles, Plane(normal * half, normal), 1)
    return builder.body(name)


def arc_face(builder, radius, start, stop, z0, z1, sense, n=12):
    """Part of a cylinder about z, between two angles, as one face."""
    angles = np.linspace(start, stop, n)
    vertices = np.array([[radius * np.cos(a), radius * np.sin(a), h] for h in (z0, z1) for a in angles])
    triangles = [t for j in range(n - 1) for t in ([j, j + 1, j + 1 + n], [j, j + 1 + n, j + n])]
    return builder.face(vertices, triangles, Cylinder([0, 0, 0], [0, 0, 1], radius), sense)


def rectangles(builder, cells, z, up, geometry=True):
    """Rectangles [(x0, y0, x1, y1), …] in one plane at height z, as one face."""
    vertices, triangles = [], []
    for x0, y0, x1, y1 in cells:
        k = len(vertices)
        vertices += [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)]
        triangles += [[k, k + 1, k + 2], [k, k + 2, k + 3]] if up else [[k, k + 2, k + 1], [k, k + 3, k + 2]]
    normal = [0, 0, 1.0 if up else -1.0]
    return builder.face(vertices, triangles, Plane([0, 0, z], normal) if geometry else None, 1)


def joined(bodies, poses, name="joined"):
    """Several bodies as one: their faces and features side by side."""
    builder = Builder()
    for body, pose in zip(bodies, poses, strict=True):
        for f in body.features:
            points = f.samples @ pose.rotation.T + pose.translation
            builder.face(points, f.triangles, f.geometry.transformed(pose), f.sense)
    return builder.body(name)
