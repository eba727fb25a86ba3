"""`export`: write a scene in the format of the file name; returns notes on data that the format cannot contain."""

from __future__ import annotations

import os
from pathlib import Path

import pinocchio as pin

from collision import Tolerance
from vpframe import outputs
from vpframe.errors import VpframeError
from vpframe.exporters.losses import losses
from vpframe.outputs import Kind, Output, claimed
from vpframe.scene.motion import Motion
from vpframe.scene.scene import Scene

KINDS: dict[str, Kind] = {
    ".step": outputs.MODEL, ".stp": outputs.MODEL, ".glb": outputs.GLB, ".urdf": outputs.URDF, ".mjcf": outputs.MJCF,
    ".xml": outputs.MJCF, ".usd": outputs.USD, ".usda": outputs.USD, ".usdc": outputs.USD,
    ".csv": outputs.POSES, ".parquet": outputs.PARQUET,
}  # fmt: skip
"""kind of output by suffix"""
MOVING = (".glb", ".usd", ".usda", ".usdc", ".csv", ".parquet")
"""formats that can contain motion"""


def export(
    scene: Scene,
    path: str | os.PathLike[str],
    motion: Motion | None = None,
    time: float | None = None,
    tolerance: Tolerance | None = None,
) -> tuple[str, ...]:
    """Write a scene at its present poses, in the format of the suffix.

    .step (exact B-rep), .glb (triangles, animation), .urdf and .mjcf or .xml (the recognised mechanism, meshes in a
    folder beside it), .usd, .usda, .usdc (triangles, time samples; needs usd-core), .csv, .parquet (a table of poses).

    Parameters
    ----------
    motion: poses of parts over time. Formats without motion get its last state, with a note.
    time: write the state of `motion` at this time only, s.
    tolerance: for the recognition of the mechanism (URDF, MJCF).

    Returns
    -------
    One line for each kind of data that was left out or changed.

    Raises
    ------
    OutputError: the file cannot be written, or exists and was not written by vpframe. VpframeError: unknown suffix,
        missing library, or nothing that the format can contain.
    """
    kind, suffix = kind_of(path), Path(path).suffix.lower()
    if not len(scene):
        raise VpframeError(f"{path}: the scene has no parts; there is nothing to write")
    left: list[str] = []
    if motion is not None:
        strange = [name for name in motion.keys if name not in scene]
        if len(strange) == len(motion.keys):
            raise VpframeError(f"{path}: the motion is of {strange[0]!r} and others, of which the scene has none")
        left += [f"{name}: moves in the recording, and is no part of the scene" for name in strange]
        if time is not None and not 0.0 <= time <= motion.duration:
            raise VpframeError(f"{path}: the motion ends at {motion.duration:g} s; there is no state at {time:g} s")
        if time is None and suffix in MOVING:
            poses = motion.at(0.0)  # for viewers that do not play it
        else:
            if time is None:
                left.append(f"motion: the state at its end, {motion.duration:g} s, is written")
            at = motion.duration if time is None else time
            poses, motion = motion.placed({part.name: part.pose for part in scene.parts}, at), None
        scene = scene.copy()
        for name in poses.keys() & set(scene.names):
            scene[name].pose = pin.SE3(poses[name])
    elif time is not None:
        raise VpframeError(f"{path}: a time without a motion; give motion= too")
    with claimed(path, kind) as output:
        left += _written(scene, output, motion, tolerance)
    return tuple(dict.fromkeys(left))


def kind_of(path: str | os.PathLike[str]) -> Kind:
    """Return the kind of output for a file name; VpframeError for an unknown suffix."""
    suffix = Path(path).suffix
    if suffix.lower() not in KINDS:
        known = ", ".join(KINDS)
        raise VpframeError(f"{path}: scenes are not written as {suffix or 'files without ending'}; {known} are")
    return KINDS[suffix.lower()]


def _written(scene: Scene, output: Output, motion: Motion | None, tolerance: Tolerance | None) -> list[str]:
    """Write a scene at its present poses, and the motion; return what was left out."""
    suffix = output.path.suffix.lower()
    if suffix in (".step", ".stp"):
        from vpframe.exporters.step import write_step

        return write_step(scene, output.path)
    if suffix == ".glb":
        from vpframe.exporters.glb import write_glb

        return write_glb(scene, output.path, motion)
    if suffix in (".usd", ".usda", ".usdc"):
        from vpframe.exporters.usd import write_usd

        return write_usd(scene, output.path, motion)
    if suffix in (".csv", ".parquet"):
        from vpframe.exporters.tables import pose_rows, write_table

        write_table(output, pose_rows(scene, motion))
        return ["geometry: a table has poses, colours, densities and volumes only", *losses(scene, "sizes", "joints")]
    from vpframe.analysis import mates

    write = mates.write_urdf if suffix == ".urdf" else mates.write_mjcf
    left = ["exact surfaces: meshes have triangles only", *write(scene, output, tolerance)]
    left += losses(scene, "colours", "sizes")
    if write is mates.write_mjcf:
        left.append("contacts: MuJoCo would collide convex hulls, which fitted parts share; geometries are for the eye")
    return left
