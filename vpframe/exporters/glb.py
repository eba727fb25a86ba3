"""GLB (glTF 2.0) export: parts as triangles in their tree and colours, motion as an animation.

glTF has y up; the root node rotates the scene from z up. Node poses have full precision (JSON numbers); vertices and
animations have single precision.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vpframe import files
from vpframe.exporters.losses import losses
from vpframe.outputs import GENERATOR
from vpframe.scene.motion import Motion
from vpframe.scene.scene import Part, Scene
from vpframe.view.display import display_mesh

_FLOAT, _UINT = 5126, 5125
_ARRAY, _ELEMENTS = 34962, 34963
_UP = [-(0.5**0.5), 0.0, 0.0, 0.5**0.5]
"""quaternion x y z w that rotates z up to y up"""


def write_glb(scene: Scene, path: Path, motion: Motion | None = None) -> list[str]:
    """Write a scene with its parts at their poses, and `motion` as an animation; return what was left out.

    One primitive for each colour of a part; nodes carry the part's name, and its whole path as `extras.path`.
    """
    file = _File(scene.source or "scene")
    for part in scene.parts:
        file.add(part)
    if motion is not None:
        file.animate(motion)
    files.replace(path, file.bytes())
    left = ["exact surfaces: GLB has triangles only"]
    if any(part.density is not None or part.inertia is not None for part in scene.parts):
        left.append("densities and inertias")
    return left + losses(scene, "sizes", "joints")


class _File:
    """JSON and binary chunk (glTF 2.0, section 4.4) under construction."""

    def __init__(self, name: str) -> None:
        root = {"name": Path(name).stem or "scene", "rotation": _UP, "children": []}
        self.json: dict[str, Any] = {
            "asset": {"generator": GENERATOR, "version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [root],
            "meshes": [],
            "materials": [],
            "accessors": [],
            "bufferViews": [],
        }
        self._binary: list[bytes] = []
        self._length = 0
        self._groups: dict[tuple[str, ...], int] = {(): 0}
        self._nodes: dict[str, int] = {}
        self._shapes: dict[int, tuple[int, int, NDArray[np.uint32]]] = {}
        self._meshes: dict[tuple[Any, ...], int] = {}
        self._materials: dict[tuple[float, ...], int] = {}

    def add(self, part: Part) -> None:
        """Add a node for a part below its subassemblies."""
        *above, name = part.name.split("/")
        node = {"name": name, "mesh": self._mesh(part), "extras": {"path": part.name}}
        self._nodes[part.name] = self._child(tuple(above), {**node, **_placed(pin.SE3ToXYZQUAT(part.pose))})

    def _child(self, above: tuple[str, ...], node: dict[str, Any]) -> int:
        if above not in self._groups:
            self._groups[above] = self._child(above[:-1], {"name": above[-1], "children": []})
        self.json["nodes"].append(node)
        self.json["nodes"][self._groups[above]]["children"].append(len(self.json["nodes"]) - 1)
        return len(self.json["nodes"]) - 1

    def _mesh(self, part: Part) -> int:
        colors = [surface.color or part.color for surface in part.surfaces]
        key = (id(part.shape), *colors) if any(s.color for s in part.surfaces) else (id(part.shape), part.color)
        if key not in self._meshes:
            shown = display_mesh(part.shape)
            if id(part.shape) not in self._shapes:
                position = self._accessor(shown.positions, "VEC3", _ARRAY, bounds=True)
                self._shapes[id(part.shape)] = position, self._accessor(shown.normals, "VEC3", _ARRAY), shown.triangles
            position, normal, triangles = self._shapes[id(part.shape)]
            primitives = []
            for color in dict.fromkeys(colors):
                own = np.isin(shown.surface_of_triangle, [i for i, c in enumerate(colors) if c == color])
                if own.any():
                    primitives.append(
                        {
                            "attributes": {"POSITION": position, "NORMAL": normal},
                            "indices": self._accessor(triangles[own].reshape(-1), "SCALAR", _ELEMENTS),
                            "material": self._material(color),
                        }
                    )
            self.json["meshes"].append({"name": part.shape.mesh.name, "primitives": primitives})
            self._meshes[key] = len(self.json["meshes"]) - 1
        return self._meshes[key]

    def _material(self, color: tuple[float, float, float, float]) -> int:
        if color not in self._materials:
            *rgb, alpha = color
            surface = {"baseColorFactor": [*map(_linear, rgb), alpha], "metallicFactor": 0.1, "roughnessFactor": 0.6}
            blend = {"alphaMode": "BLEND"} if alpha < 1.0 else {}
            self.json["materials"].append({"pbrMetallicRoughness": surface, "doubleSided": True, **blend})
            self._materials[color] = len(self.json["materials"]) - 1
        return self._materials[color]

    def animate(self, motion: Motion) -> None:
        """Add an animation of the moving parts, linear between keys."""
        samplers: list[dict[str, Any]] = []
        channels: list[dict[str, Any]] = []
        for name in motion.moving:
            if name not in self._nodes:
                continue
            times, rows = motion.keys[name]
            at = self._accessor(times.astype(np.float32), "SCALAR", None, bounds=True)
            for path, values, kind in (("translation", rows[:, :3], "VEC3"), ("rotation", rows[:, 3:], "VEC4")):
                output = self._accessor(values.astype(np.float32), kind, None)
                samplers.append({"input": at, "output": output, "interpolation": "LINEAR"})
                channels.append({"sampler": len(samplers) - 1, "target": {"node": self._nodes[name], "path": path}})
        if channels:
            self.json["animations"] = [{"name": "motion", "channels": channels, "samplers": samplers}]

    def _accessor(self, values: NDArray[Any], kind: str, target: int | None, bounds: bool = False) -> int:
        data = np.ascontiguousarray(values).astype("<u4" if values.dtype == np.uint32 else "<f4").tobytes()
        view = {"buffer": 0, "byteOffset": self._length, "byteLength": len(data)}
        self.json["bufferViews"].append(view if target is None else {**view, "target": target})
        self._binary.append(data)
        self._length += len(data)
        accessor = {
            "bufferView": len(self.json["bufferViews"]) - 1,
            "componentType": _UINT if values.dtype == np.uint32 else _FLOAT,
            "count": len(values),
            "type": kind,
        }
        if bounds:
            low, high = values.min(axis=0), values.max(axis=0)
            accessor |= {"min": np.atleast_1d(low).tolist(), "max": np.atleast_1d(high).tolist()}
        self.json["accessors"].append(accessor)
        return len(self.json["accessors"]) - 1

    def bytes(self) -> bytes:
        """Return the content of the file."""
        for node in self.json["nodes"]:
            if node.get("children") == []:
                del node["children"]
        self.json["buffers"] = [{"byteLength": self._length}]
        text = json.dumps(self.json, ensure_ascii=False, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        binary = b"".join(self._binary)
        binary += b"\0" * (-len(binary) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _placed(row: NDArray[np.float64]) -> dict[str, list[float]]:
    return {"translation": row[:3].tolist(), "rotation": row[3:].tolist()}


def _linear(srgb: float) -> float:
    """Convert an sRGB value to linear, both in 0 … 1 (IEC 61966-2-1)."""
    return srgb / 12.92 if srgb <= 0.04045 else ((srgb + 0.055) / 1.055) ** 2.4
