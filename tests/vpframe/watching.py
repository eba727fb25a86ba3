"""Scenes and frames made without a CAD kernel, for the tests of what watches a session."""

from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin

from collision import SurfaceMesh
from constraints.geometry.features import Feature
from constraints.geometry.surfaces import Cylinder, Geometry, Plane
from vpframe.events import ConstraintView, Event, Frame
from vpframe.scene.scene import Part, Scene, Shape, Surface


def shape(vertices, triangles, surface_of_triangle, geometries: list[Geometry], name: str = "mesh") -> Shape:
    """A `Shape` around a mesh, with one feature a surface."""
    mesh = SurfaceMesh(vertices, triangles, surface_of_triangle, name)
    surfaces = tuple(
        Surface(i, f"{name}.{i}", g, "flat" if isinstance(g, Plane) else "convex", 0.0, 1.0)
        for i, g in enumerate(geometries)
    )
    features = tuple(
        Feature(g, (i,), 1, mesh.vertices, mesh.triangles[mesh.triangles_of(i)], 0.0, 1.0)
        for i, g in enumerate(geometries)
    )
    return Shape(mesh, surfaces, features)


def box(size=(1.0, 1.0, 1.0), name: str = "box") -> Shape:
    """A box about the origin; surfaces 0 … 5 are -x, +x, -y, +y, -z, +z."""
    half = np.asarray(size, dtype=float) / 2
    corner = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    normals = [s * np.eye(3)[i] for i in range(3) for s in (-1.0, 1.0)]
    planes = [Plane(n * half, n) for n in normals]
    return shape(corner, triangles, np.repeat(range(6), 2), list(planes), name)


def rod(radius=0.1, length=1.0, sections=32, name: str = "rod") -> Shape:
    """A cylinder along z about the origin; surfaces 0 side, 1 bottom, 2 top."""
    angle = 2 * np.pi * np.arange(sections) / sections
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(sections)], axis=1)
    up = np.array([0.0, 0.0, length / 2])
    low, high = ring - up, ring + up
    vertices = np.concatenate([low, high, [[0, 0, -length / 2], [0, 0, length / 2]]])
    i, j = np.arange(sections), (np.arange(sections) + 1) % sections
    n = sections
    side = np.concatenate([np.stack([i, j, j + n], 1), np.stack([i, j + n, i + n], 1)])
    bottom = np.stack([np.full(n, 2 * n), j, i], 1)
    top = np.stack([np.full(n, 2 * n + 1), i + n, j + n], 1)
    surface = np.repeat([0, 1, 2], [2 * n, n, n])
    geometries = [
        Cylinder([0, 0, 0], [0, 0, 1], radius),
        Plane([0, 0, -length / 2], [0, 0, -1]),
        Plane([0, 0, length / 2], [0, 0, 1]),
    ]
    return shape(vertices, np.concatenate([side, bottom, top]), surface, geometries, name)


def place(x=0.0, y=0.0, z=0.0) -> pin.SE3:
    """A pure translation."""
    return pin.SE3(np.eye(3), np.array([x, y, z], dtype=float))


def pressing_scene() -> Scene:
    """A fixed plate and a rod above it, centimetres in size."""
    return Scene(
        [
            Part("plate", box((0.08, 0.06, 0.01)), place(), fixed=True),
            Part("rod", rod(0.01, 0.05), place(z=0.05)),
        ]
    )


def pressing_frames(count: int = 60, dt: float = 1 / 60) -> list[Frame]:
    """The rod comes down, its end touches the plate, against is recognised and accepted, and the rod goes up again."""
    frames = []
    for step in range(count):
        s = step / (count - 1)
        z = 0.05 - 0.021 * min(s, 1 - s) / 0.45 if min(s, 1 - s) < 0.45 else 0.029
        touching = z < 0.03  # the rod's end is below the plate's top
        colliding = np.array([[0, 5, 1, 0]] if touching else np.empty((0, 4)), dtype=np.int32).reshape(-1, 4)
        views = ()
        if touching:
            views = (
                ConstraintView(
                    0, "against", ("plate", "rod"), ((5,), (1,)), 1e-7,
                    "active" if s > 0.5 else "candidate",
                    np.array([0, 0, 0.005]), np.array([0, 0, 1.0]), 0.01, "planes opposed, 0.0 mm apart",
                ),
            )  # fmt: skip
        previous = frames[-1] if frames else None
        events = []
        if previous is not None:
            if touching and not len(previous.colliding):
                events.append(
                    Event(step, step * dt, "collided", ("plate", "rod"), ((5,), (0,)), "plate and rod collide")
                )
                events.append(Event(step, step * dt, "recognised", ("plate", "rod"), ((5,), (1,)), "against offered"))
            if not touching and len(previous.colliding):
                events.append(Event(step, step * dt, "parted", ("plate", "rod"), ((5,), (0,)), "plate and rod part"))
        frames.append(
            Frame(
                step, step * dt, {"plate": place(), "rod": place(z=z)}, colliding, views,
                {"rod": 3 if touching else 6}, {"rod": "planar" if touching else "free"},
                max(z - 0.03, 0.0), {"collision": 1e-4, "constraints": 2e-4, "motion": 5e-5},
                ("rod",), {"hand": place(z=z + 0.025)}, f"hand.move_to(z={z:.3f})", tuple(events),
            )
        )  # fmt: skip
    return frames


def hostile_scene(name: str) -> Scene:
    """`pressing_scene` with that name for the rod, its surfaces and the model."""
    plate, rod = pressing_scene().parts
    surfaces = tuple(replace(surface, name=f"{name} {surface.index}") for surface in rod.surfaces)
    shape = Shape(rod.mesh, surfaces, rod.features)
    return Scene([plate, Part(name, shape, rod.pose)], source=f"{name}.step", notes=[f"{name} is odd"])


def hostile_frames(name: str) -> list[Frame]:
    """`pressing_frames` of `hostile_scene`."""

    def renamed(value: Any) -> Any:
        if isinstance(value, str):
            return value.replace("rod", name)
        if isinstance(value, tuple):
            return tuple(map(renamed, value))
        if isinstance(value, dict):
            return {renamed(key): renamed(item) for key, item in value.items()}
        if isinstance(value, ConstraintView | Event):
            return replace(value, **{f.name: renamed(getattr(value, f.name)) for f in fields(value)})
        return value

    return [
        replace(frame, **{f.name: renamed(getattr(frame, f.name)) for f in fields(frame)})
        for frame in pressing_frames()
    ]


def fake_session(scene: Scene | None = None) -> SimpleNamespace:
    """What observers may read of a session before its first step."""
    return SimpleNamespace(scene=scene or pressing_scene())
