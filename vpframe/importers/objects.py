"""Scenes from objects: bytes, trimesh meshes, build123d shapes, Pinocchio geometry models."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from vpframe import services
from vpframe.errors import LoadError
from vpframe.importers import build, wrapped
from vpframe.importers.checks import FORMATS, content_of, far_check
from vpframe.importers.names import numbered
from vpframe.importers.raw import Array, Axis, Options, RawJoint, RawPart, RawScene, RawShape
from vpframe.scene.scene import Scene

RECIPE = "write it with `.exportStep` or `exporters.export(shape, 'part.step')` there, and load that file"
_STEP = 1e-7
"""threshold for joint axes, m or rad"""


def load(source: Any, options: Options) -> Scene:
    """Load an object as `vpframe.load` does. Raises LoadError for unsupported types."""
    kind = type(source).__module__.partition(".")[0]
    if isinstance(source, bytes | bytearray | memoryview):
        return _of_bytes(bytes(source), options)
    if kind == "trimesh":
        import trimesh

        from vpframe.importers import meshes

        if isinstance(source, trimesh.Trimesh | trimesh.Scene):
            return build.scene(meshes.read_object(source, options.unit), None, options.progress)
    if options.unit is not None:
        raise LoadError(f"{type(source).__name__}: names its unit itself; leave unit= out", type(source).__name__)
    if wrapped.is_wrapped(source):
        raw, join = wrapped.read(source, options)
        scene = build.scene(raw, None, options.progress)
        join(scene)
        return scene
    if isinstance(source, pin.GeometryModel | tuple):
        return _of_pinocchio(source, options)
    if kind == "cadquery":
        raise LoadError(f"a CadQuery {type(source).__name__} is of another build of OpenCascade; {RECIPE}", "cadquery")
    known = "a path, bytes, a trimesh mesh or scene, a build123d shape, a Pinocchio geometry model"
    raise LoadError(f"a {type(source).__module__}.{type(source).__name__} cannot be loaded; give {known}", "")


def _of_bytes(data: bytes, options: Options) -> Scene:
    form = options.format
    found = form or content_of(data)
    suffix = next((s for s, f in FORMATS.items() if found in (f, s, s[1:])), None)
    if suffix is None:
        what = f"format is {form!r}" if form else "what format they are in does not show"
        raise LoadError(f"bytes: {what}; give format=, one of {', '.join(dict.fromkeys(FORMATS.values()))}", "bytes")
    with tempfile.TemporaryDirectory(prefix="vpframe-") as folder:
        path = Path(folder, f"model{suffix}")
        path.write_bytes(data)
        try:
            scene: Scene = services.call("load", path, **options._replace(format=None)._asdict())
        except LoadError as error:
            raise LoadError(str(error).replace(str(path), "bytes"), "bytes") from None
    scene.source = None
    return scene


def _of_pinocchio(source: Any, options: Options) -> Scene:
    """Return the geometry objects of a Pinocchio model at the configuration `q` (default neutral)."""
    given = source if isinstance(source, tuple) else (None, source)
    model = given[0] if len(given) > 1 else None
    geometry = given[1] if len(given) > 1 else None
    if not isinstance(geometry, pin.GeometryModel) or not (model is None or isinstance(model, pin.Model)):
        what = ", ".join(type(item).__name__ for item in given)
        raise LoadError(f"({what}) cannot be loaded; give a GeometryModel, or (Model, GeometryModel[, q])", "")
    if model is None:
        if any(item.parentJoint for item in geometry.geometryObjects):
            raise LoadError("the GeometryModel hangs on joints, of which it has no poses; give (model, geometry)", "")
        model = pin.Model()
    q = pin.neutral(model) if len(given) < 3 else np.asarray(given[2], dtype=np.float64)
    if q.shape != (model.nq,) or not np.isfinite(q).all():
        raise LoadError(f"q has shape {q.shape}; the model takes {model.nq} finite numbers", "")
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    raw = RawScene(links=[[] for _ in range(model.njoints)])
    names = numbered(item.name for item in geometry.geometryObjects)
    for item, name in zip(geometry.geometryObjects, names, strict=True):
        try:
            shape = _shape(item, options.deflection, options.angular)
        except LoadError as error:
            raw.notes.append(f"{name}: left out: {error}")
            continue
        raw.shapes.append(shape)
        pose = data.oMi[item.parentJoint] * item.placement
        color = tuple(float(c) for c in item.meshColor)
        part = RawPart(name, len(raw.shapes) - 1, pose.rotation, pose.translation)
        part.color = (color[0], color[1], color[2], color[3])
        far_check(Path(name), name, shape.vertices, part.translation)
        raw.parts.append(part)
        raw.links[item.parentJoint].append(name)
    if not raw.parts:
        raise LoadError(
            f"the GeometryModel has no geometry that can be read{': ' + raw.notes[0] if raw.notes else ''}", ""
        )
    _joints(model, q, data, raw)
    _masses(model, data, raw)
    return build.scene(raw, None)


def _shape(item: Any, deflection: float, angular: float) -> RawShape:
    """Convert the coal geometry of a geometry object, in its frame."""
    import coal

    from vpframe.importers.meshes import bare
    from vpframe.importers.raw import RawFace
    from vpframe.importers.solids import SOLIDS

    geometry = item.geometry
    match geometry:
        case coal.Box():
            return SOLIDS["box"](2.0 * np.asarray(geometry.halfSide), deflection, angular)
        case coal.Sphere():
            return SOLIDS["sphere"](np.array([geometry.radius]), deflection, angular)
        case coal.Cylinder():
            return SOLIDS["cylinder"](np.array([geometry.radius, 2.0 * geometry.halfLength]), deflection, angular)
        case coal.Capsule():
            return SOLIDS["capsule"](np.array([geometry.radius, 2.0 * geometry.halfLength]), deflection, angular)
        case coal.BVHModelBase():
            points = np.array([geometry.vertex(i) for i in range(geometry.num_vertices)]).reshape(-1, 3)
            triangles = (geometry.tri_indices(i) for i in range(geometry.num_tris))
            corners = np.array([[t[0], t[1], t[2]] for t in triangles], dtype=np.int32).reshape(-1, 3)
            if not len(corners):
                raise LoadError("it has no triangles", item.name)
            mesh = RawShape(points, corners, np.zeros(len(corners), np.int32), [RawFace("mesh")])
            return bare(mesh)
    raise LoadError(f"{type(geometry).__name__} is no geometry that is read", item.name)


def _joints(model: pin.Model, q: Array, data: Any, raw: RawScene) -> None:
    """Add a raw joint for each joint of the model, with axes from its motion, independent of Pinocchio's type names."""
    pin.computeJointJacobians(model, data, q)
    for number in range(1, model.njoints):
        joint = model.joints[number]
        twists = pin.getJointJacobian(model, data, number, pin.WORLD)[:, joint.idx_v : joint.idx_v + joint.nv]
        axes: list[Axis] = []
        note = ""
        for v, w in ((column[:3], column[3:]) for column in twists.T):
            turn = float(np.linalg.norm(w))
            if turn < _STEP:
                axes.append(("prismatic", data.oMi[number].translation.copy(), v / np.linalg.norm(v)))
                continue
            if abs(v @ w) > _STEP * turn:
                note = "its screw's slide is left out"
            axes.append(("revolute", np.cross(w, v) / turn**2, w / turn))
        free = joint.nv == 6
        ends = (int(model.parents[number]), number)
        raw.joints.append(RawJoint(str(model.names[number]), ends, [] if free else axes, free, note))


def _masses(model: pin.Model, data: Any, raw: RawScene) -> None:
    from vpframe.importers.solids import part_of_mass

    parts = {part.name: part for part in raw.parts}
    for number in range(1, model.njoints):
        own = [parts[name] for name in raw.links[number]]
        inertia = model.inertias[number]
        if own and inertia.mass > 0.0:
            center = data.oMi[number] * pin.SE3(np.eye(3), inertia.lever)
            part_of_mass(own, center, float(inertia.mass), np.asarray(inertia.inertia), raw)
