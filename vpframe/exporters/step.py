"""STEP export: the exact B-rep of every part at its pose, with names, tree, colours and densities."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from vpframe import files
from vpframe.codec import Codec
from vpframe.errors import OutputError, VpframeError
from vpframe.exporters.losses import losses
from vpframe.importers import cad
from vpframe.scene.scene import Part, Scene, Shape

TIMEOUT = 600.0
"""time limit of the kernel, s"""


def write_step(scene: Scene, path: Path) -> list[str]:
    """Write a scene with its parts at their poses; return what was left out.

    Parts of the same shape and density are instances of one product. Meshes have no B-rep and are left out.

    Raises
    ------
    VpframeError: no part has a B-rep. OutputError: the kernel or the disk fails.
    """
    solid = [part for part in scene.parts if part.shape.brep]
    left = [f"{p.name}: it is a mesh, of which STEP has no B-rep; export GLB" for p in scene.parts if not p.shape.brep]
    left += [f"{part.name}: inertia that the model states; STEP has density only" for part in solid if part.inertia]
    firsts: dict[Shape, Part] = {}
    for part in solid:
        firsts.setdefault(part.shape, part)
    left += [f"{part.name} {s.size}: sizes of PMI" for part in firsts.values() for s in part.surfaces if s.size]
    left += losses(scene, "joints")
    if not solid:
        raise VpframeError(f"{path}: no part has a B-rep, all are meshes; STEP carries none: export GLB")
    shapes = list(firsts)
    numbers = {shape: i for i, shape in enumerate(shapes)}
    content = {
        "name": Path(scene.source or path.name).stem or "assembly",
        "shapes": [np.frombuffer(shape.brep, np.uint8) for shape in shapes],
        "parts": [_part(part, numbers[part.shape]) for part in solid],
    }
    with tempfile.TemporaryDirectory(prefix="vpframe-") as folder:
        encoded, written = Path(folder, "content"), Path(folder, "out.step")
        encoded.write_bytes(Codec().encode(content))
        request = {"format": "write", "content": str(encoded), "out": str(written)}
        failure = cad.in_kernel(request, folder, TIMEOUT, encoded.stat().st_size)
        if failure:
            raise OutputError(f"{path}: {failure}", str(path))
        files.replace(path, written.read_bytes())
    return left


def _part(part: Part, shape: int) -> list[Any]:
    steps = part.name.split("/")
    rows = np.column_stack([part.pose.rotation, part.pose.translation * 1e3])
    faces = [(int(s.name[5:]), s.color) for s in part.surfaces if s.color and re.fullmatch(r"face_\d+", s.name)]
    # a number counts as no name, and readers use the product's: it must be the same
    product = steps[-1] if steps[-1].isdigit() else re.sub(r"_\d+$", "", part.shape.mesh.name.split("/")[-1])
    return [steps, shape, product, rows.ravel().tolist(), list(map(float, part.color)), part.density, faces]
