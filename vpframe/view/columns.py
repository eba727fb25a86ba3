"""Data of a recording in rerun's form: geometry as archetypes, values over time as columns, names as paths."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pinocchio as pin
import rerun as rr
from numpy.typing import NDArray

from vpframe.events import Event
from vpframe.scene.scene import Part
from vpframe.view import palette
from vpframe.view.display import display_mesh
from vpframe.view.symbols import SceneSymbol

LEVEL = {"bad": "WARN", "plain": "DEBUG"}
"""rerun's level of an event by its tone; INFO for all others"""


def geometry(part: Part) -> Iterator[tuple[str, Any]]:
    """Return the drawn geometry of a part, by entity: its surfaces, and the lines between its features."""
    mesh = display_mesh(part.shape)
    for surface in range(mesh.n_surfaces):
        v0, v1 = mesh.vertex_start[surface : surface + 2]
        t0, t1 = mesh.triangle_start[surface : surface + 2]
        yield (
            surface_path(part.name, surface),
            rr.Mesh3D(
                vertex_positions=mesh.positions[v0:v1],
                vertex_normals=mesh.normals[v0:v1],
                triangle_indices=mesh.triangles[t0:t1] - np.uint32(v0),
            ),
        )
    if len(mesh.lines):
        lines = rr.LineStrips3D(mesh.lines, colors=[rgba(palette.EDGE)], radii=rr.Radius.ui_points(0.6))
        yield f"{entity('parts', part.name)}/lines", lines


def _logged_once(values: list[Any]) -> Any:
    """Return the columns of one archetype."""
    (archetype,) = values
    return [batch.partition([len(batch.as_arrow_array())]) for batch in archetype.as_component_batches()]


def _instances(values: list[list[pin.SE3]]) -> Any:
    all_poses = [pose for poses in values for pose in poses]
    quaternions = [pin.Quaternion(pose.rotation).coeffs() for pose in all_poses]
    columns = rr.InstancePoses3D.columns(translations=[p.translation for p in all_poses], quaternions=quaternions)
    return columns.partition([len(poses) for poses in values])


def _transforms(values: list[pin.SE3]) -> Any:
    quaternions = [pin.Quaternion(pose.rotation).coeffs() for pose in values]
    return rr.Transform3D.columns(translation=[pose.translation for pose in values], quaternion=quaternions)


def _strips(values: list[SceneSymbol | None]) -> Any:
    drawn = [symbol for symbol in values if symbol]
    each = [1 if symbol else 0 for symbol in values]  # without strips and colour the symbol disappears
    strips = rr.LineStrips3D.columns(strips=[strip for symbol in drawn for strip in symbol.strips])
    style = rr.LineStrips3D.columns(
        colors=rgbas([symbol.color for symbol in drawn]),
        radii=_ui_radii([0.5 * symbol.width for symbol in drawn]),
        labels=[symbol.label for symbol in drawn],
        show_labels=[False] * len(drawn),
    )
    return [*strips.partition([len(symbol.strips) if symbol else 0 for symbol in values]), *style.partition(each)]


def _segments(values: list[NDArray[np.float64]]) -> Any:
    colors = rgbas([palette.TRAIL] * len(values))
    return rr.LineStrips3D.columns(strips=values, colors=colors, radii=_ui_radii([1.0] * len(values)))


def _texts(events: list[Event]) -> Any:
    tones = [palette.tone(event) for event in events]
    return rr.TextLog.columns(
        text=[f"{event.kind}: {event.text or ' – '.join(event.parts)}" for event in events],
        level=[LEVEL.get(tone, "INFO") for tone in tones],
        color=rgbas([palette.TONES[tone] for tone in tones]),
    )


COLUMNS: dict[str, Callable[[list[Any]], Any]] = {
    "geometry": _logged_once,
    "cleared": lambda values: rr.Clear.columns(is_recursive=values),
    "transform": _transforms,
    "instances": _instances,
    "strips": _strips,
    "segment": _segments,
    "text": _texts,
    "albedo": lambda values: rr.Mesh3D.columns(albedo_factor=rgbas(values)),
    "scalar": lambda values: rr.Scalars.columns(scalars=values),
    "state": lambda values: rr.StateChange.columns(state=values),
    "document": lambda values: rr.TextDocument.columns(text=values),
}
"""values over time as rerun's columns, by kind of value"""


def surface_path(part: str, surface: int) -> str:
    """Return the entity of a surface of a part."""
    return f"{entity('parts', part)}/surfaces/{surface}"


def rgba(color: palette.Color) -> int:
    """Return an opaque colour as rerun packs it."""
    r, g, b = (round(255 * min(max(c, 0.0), 1.0)) for c in color)
    return (r << 24) | (g << 16) | (b << 8) | 0xFF


def _ui_radii(points: list[float]) -> NDArray[np.float32]:
    """Return radii that do not shrink with distance, in screen points: rerun's negative numbers."""
    return -np.array(points, dtype=np.float32)


def rgbas(colors: list[palette.Color]) -> NDArray[np.uint32]:
    """Return (n,) colours as rerun packs them."""
    return np.array([rgba(color) for color in colors], dtype=np.uint32)


def entity(root: str, name: str) -> str:
    """Return `root/name` with the name as one step of the path, whatever characters it contains."""
    return f"{root}/{rr.escape_entity_path_part(name)}"
