"""Read MJCF with MuJoCo's own compiler, if installed; runs in the reading process."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from vpframe.importers.crew import Make, left_out
from vpframe.importers.raw import (
    Array,
    Axis,
    Color,
    Options,
    RawFace,
    RawJoint,
    RawPart,
    RawScene,
    RawShape,
    UnreadableError,
)
from vpframe.importers.solids import SOLIDS, part_of_mass

_WORLD = 0


def read_model(
    path: str, options: Options, crew: Callable[[Make, Sequence[float], Sequence[str]], dict[int, str]]
) -> RawScene:
    """Return the raw scene of an MJCF file at the reference pose of its joints; `crew` makes its shapes.

    Bodies with visual geometry (without collisions) are read from it, others from their collision geometry. Meshes have
    one face. Raises UnreadableError if MuJoCo is not installed or rejects the file.
    """
    try:
        import mujoco
    except ImportError:
        raise UnreadableError("is MJCF, which MuJoCo reads; it is not installed: pip install mujoco") from None
    if options.progress is not None:
        options.progress(0.15, "compiling the model")
    try:
        model = mujoco.MjModel.from_xml_path(path)
    except ValueError as error:
        line = " ".join(str(error).split())[:200]
        raise UnreadableError(f"MuJoCo does not read it: {line}") from None
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    reader = _Model(mujoco, model, data, options)
    raw = reader.raw
    lost = crew(
        lambda number, mesher, tell: reader.shapes[number](),
        [1.0] * len(reader.shapes),
        [f"shape {number}" for number in range(len(reader.shapes))],
    )
    left_out(raw, lost)
    present = {part.name for part in raw.parts}
    raw.links = [[name for name in names if name in present] for names in raw.links]
    if not raw.parts:
        raise UnreadableError("holds no geometry that can be read; bodies need meshes, boxes, cylinders or spheres")
    return raw


class _Model:
    """Parts, links and joints of a compiled model."""

    def __init__(self, mujoco: Any, model: Any, data: Any, options: Options) -> None:
        self.mujoco, self.model, self.data = mujoco, model, data
        self.options = options.deflection, options.angular
        self.raw = RawScene(links=[[] for _ in range(model.nbody)])
        self.shapes: list[Callable[[], RawShape]] = []
        self._numbers: dict[tuple[Any, ...], int] = {}
        unread: Counter[str] = Counter()
        for body in range(model.nbody):
            self.raw.links[body] = self._parts(body, unread)
            if body != _WORLD:
                self.raw.joints.append(self._joint(body))
        if model.neq:
            self._equalities(unread)
        limited = int(np.count_nonzero(model.jnt_limited))
        if limited:
            unread["joint limits"] = limited
        for what, count in (("actuators", model.nu), ("tendons", model.ntendon), ("sensors", model.nsensor)):
            if count:
                unread[what] = count
        if unread:
            counted = ", ".join(f"{what} ({n})" for what, n in sorted(unread.items()))
            self.raw.notes.append(f"left out: {counted}")

    def _name(self, kind: str, number: int) -> str:
        name = self.mujoco.mj_id2name(self.model, getattr(self.mujoco.mjtObj, f"mjOBJ_{kind}"), number)
        return str(name or f"{kind.lower()}_{number}")

    def _parts(self, body: int, unread: Counter[str]) -> list[str]:
        model = self.model
        own = np.flatnonzero(model.geom_bodyid == body).tolist()
        shown = [g for g in own if model.geom_contype[g] == 0 and model.geom_conaffinity[g] == 0]
        made: list[RawPart] = []
        for geom in shown or own:
            shape = self._shape(geom, unread)
            if shape is not None:
                rotation = self.data.geom_xmat[geom].reshape(3, 3).copy()
                color: Color = tuple(map(float, model.geom_rgba[geom]))  # type: ignore[assignment]
                made.append(RawPart(self._name("BODY", body), shape, rotation, self.data.geom_xpos[geom].copy(), color))
        if len(made) > 1:
            for i, part in enumerate(made):
                part.name = f"{part.name}/{i + 1}"
        if made and body != _WORLD and model.body_mass[body] > 0.0:
            import pinocchio as pin

            center = pin.SE3(self.data.ximat[body].reshape(3, 3).copy(), self.data.xipos[body].copy())
            inertia = np.diag(model.body_inertia[body])
            part_of_mass(made, center, float(model.body_mass[body]), inertia, self.raw)
        self.raw.parts += made
        return [part.name for part in made]

    def _shape(self, geom: int, unread: Counter[str]) -> int | None:
        kind = self.mujoco.mjtGeom(int(self.model.geom_type[geom])).name.removeprefix("mjGEOM_").lower()
        size = self.model.geom_size[geom].astype(np.float64)
        sizes = {
            "box": 2.0 * size,
            "sphere": size[:1],
            "cylinder": size[:2] * [1.0, 2.0],
            "capsule": size[:2] * [1.0, 2.0],
        }
        mesh = int(self.model.geom_dataid[geom])
        key: tuple[Any, ...] = ("mesh", mesh) if kind == "mesh" else (kind, *size.tolist())
        if kind not in (*sizes, "mesh"):
            unread[f"geometries of kind {kind}"] += 1
            return None
        if key not in self._numbers:
            self._numbers[key] = len(self.shapes)
            if kind == "mesh":
                self.shapes.append(lambda: self._mesh(mesh))
            else:
                self.shapes.append(lambda: SOLIDS[kind](sizes[kind], *self.options))
        return self._numbers[key]

    def _mesh(self, mesh: int) -> RawShape:
        model = self.model
        start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        points = model.mesh_vert[start : start + count].astype(np.float64)
        start, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        corners = model.mesh_face[start : start + count].astype(np.int32)
        return RawShape(points, corners, np.zeros(len(corners), np.int32), [RawFace("mesh")])

    def _joint(self, body: int) -> RawJoint:
        model, data = self.model, self.data
        types = self.mujoco.mjtJoint
        axes: list[Axis] = []
        names = []
        free = False
        first = int(model.body_jntadr[body])
        for joint in range(first, first + int(model.body_jntnum[body])):
            kind = int(model.jnt_type[joint])
            origin, axis = data.xanchor[joint].copy(), data.xaxis[joint].copy()
            names.append(self._name("JOINT", joint))
            if kind == types.mjJNT_FREE:
                free = True
            elif kind == types.mjJNT_BALL:
                axes += [("revolute", origin, direction) for direction in np.eye(3)]
            else:
                axes.append(("prismatic" if kind == types.mjJNT_SLIDE else "revolute", origin, axis))
        ends = (int(model.body_parentid[body]), body)
        return RawJoint(" ".join(names) or f"{self._name('BODY', body)} fixed", ends, axes, free)

    def _equalities(self, unread: Counter[str]) -> None:
        """Add welds and connects as joints; count other equalities."""
        model = self.model
        for number in range(model.neq):
            kind = self.mujoco.mjtEq(int(model.eq_type[number]))
            bodies = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
            of_bodies = int(model.eq_objtype[number]) == int(self.mujoco.mjtObj.mjOBJ_BODY)
            if kind == self.mujoco.mjtEq.mjEQ_WELD and of_bodies and model.eq_active0[number]:
                self.raw.joints.append(RawJoint(f"weld {number}", bodies, []))
            elif kind == self.mujoco.mjtEq.mjEQ_CONNECT and of_bodies and model.eq_active0[number]:
                anchor = model.eq_data[number][:3]
                place: Array = self.data.xpos[bodies[0]] + self.data.xmat[bodies[0]].reshape(3, 3) @ anchor
                axes: list[Axis] = [("revolute", place, direction) for direction in np.eye(3)]
                self.raw.joints.append(RawJoint(f"connect {number}", bodies, axes))
            else:
                unread[f"equalities of kind {kind.name.removeprefix('mjEQ_').lower()}"] += 1
