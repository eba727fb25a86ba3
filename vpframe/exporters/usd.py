"""USD export with usd-core, if installed: parts as meshes in their tree and colours, motion as time samples."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from vpframe import files
from vpframe.errors import VpframeError
from vpframe.exporters.losses import losses
from vpframe.outputs import GENERATOR
from vpframe.scene.motion import Motion
from vpframe.scene.scene import Scene

FRAMES = 60.0
"""time codes per second"""


def write_usd(scene: Scene, path: Path, motion: Motion | None = None) -> list[str]:
    """Write a scene with its parts at their poses (.usd, .usda, .usdc); return what is left out. motion: time samples.

    Metres, z up; each shape is a prototype and its parts are instances; densities use `UsdPhysics.MassAPI`.

    Raises VpframeError if usd-core is not installed.
    """
    try:
        from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics
    except ImportError:
        raise VpframeError(f"{path}: USD needs usd-core, which is not installed; pip install usd-core") from None
    with tempfile.TemporaryDirectory(prefix="vpframe-") as folder:
        written = Path(folder, f"out{path.suffix}")
        stage = Usd.Stage.CreateNew(str(written))
        stage.SetMetadata("comment", GENERATOR)
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        stage.SetTimeCodesPerSecond(FRAMES)
        if motion is not None and motion.moving:
            stage.SetStartTimeCode(0.0)
            stage.SetEndTimeCode(motion.duration * FRAMES)
        root = UsdGeom.Xform.Define(stage, "/" + _identifier(Path(scene.source or "scene").stem, set()))
        stage.SetDefaultPrim(root.GetPrim())
        tree = _Tree(root.GetPath())
        shapes: dict[int, Any] = {}
        for part in scene.parts:
            if id(part.shape) not in shapes:
                shapes[id(part.shape)] = _prototype(stage, root.GetPath(), len(shapes), part.shape.mesh)
            place = tree.path(part.name)
            for above in place.GetPrefixes()[1:-1]:
                if not stage.GetPrimAtPath(above):
                    _named(UsdGeom.Xform.Define(stage, above).GetPrim(), tree.names[above])
            xform = UsdGeom.Xform.Define(stage, place)
            prim = xform.GetPrim()
            _named(prim, part.name.split("/")[-1])
            prim.SetCustomDataByKey("path", part.name)
            operation = xform.AddTransformOp(UsdGeom.XformOp.PrecisionDouble)
            operation.Set(_matrix(Gf, part.pose))
            if motion is not None and part.name in motion.moving:
                for time in motion.keys[part.name][0].tolist():
                    operation.Set(_matrix(Gf, motion.at(time)[part.name]), Usd.TimeCode(time * FRAMES))
            red, green, blue, alpha = part.color
            variables = UsdGeom.PrimvarsAPI(prim)
            for name, kind, value in (
                ("displayColor", Sdf.ValueTypeNames.Color3fArray, [Gf.Vec3f(red, green, blue)]),
                ("displayOpacity", Sdf.ValueTypeNames.FloatArray, [alpha]),
            ):
                variables.CreatePrimvar(name, kind, UsdGeom.Tokens.constant).Set(value)
            if part.density is not None:
                UsdPhysics.MassAPI.Apply(prim).CreateDensityAttr(part.density)
            instance = stage.DefinePrim(place.AppendChild("shape"))
            instance.GetReferences().AddInternalReference(shapes[id(part.shape)])
            instance.SetInstanceable(True)
        stage.GetRootLayer().Save()
        del stage
        files.replace(path, written.read_bytes())
    left = ["exact surfaces: USD has triangles only"]
    if any(part.inertia for part in scene.parts):
        left.append("inertias that the model states")
    return left + losses(scene, "colours", "sizes", "joints")


class _Tree:
    """Paths of prims with unique identifiers among siblings."""

    def __init__(self, root: Any) -> None:
        self._paths = {"": root}
        self._taken: dict[Any, set[str]] = {root: {"shapes"}}
        self.names: dict[Any, str] = {}

    def path(self, name: str) -> Any:
        """Return the path of a part or subassembly, adding those above it."""
        if name not in self._paths:
            above, _, last = name.rpartition("/")
            parent = self.path(above)
            taken = self._taken.setdefault(parent, {"shape"})
            path = self._paths[name] = parent.AppendChild(_identifier(last, taken))
            self.names[path] = last
        return self._paths[name]


def _identifier(name: str, taken: set[str]) -> str:
    from pxr import Tf

    made = chosen = Tf.MakeValidIdentifier(name or "part")
    number = 1
    while chosen in taken:
        number += 1
        chosen = f"{made}_{number}"
    taken.add(chosen)
    return str(chosen)


def _named(prim: Any, name: str) -> None:
    if prim.GetName() != name:
        prim.SetDisplayName(name)


def _prototype(stage: Any, root: Any, number: int, mesh: Any) -> Any:
    from pxr import Sdf, UsdGeom, Vt

    shapes = root.AppendChild("shapes")
    if not stage.GetPrimAtPath(shapes):
        stage.CreateClassPrim(shapes)
    made = UsdGeom.Mesh.Define(stage, shapes.AppendChild(f"shape_{number}"))
    made.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(mesh.vertices.astype(np.float32)))
    made.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.triangles.astype(np.int32).reshape(-1)))
    made.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(mesh.triangles), 3, np.int32)))
    made.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    made.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.array([low, high], np.float32)))
    return Sdf.Path(made.GetPath())


def _matrix(gf: Any, pose: pin.SE3) -> Any:
    return gf.Matrix4d(*pose.homogeneous.T.ravel().tolist())  # USD uses row vectors
