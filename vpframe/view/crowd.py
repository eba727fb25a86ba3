"""Parts of a large scene that stand still, drawn as instances of their shape.

Rerun's memory and files grow with the number of entities, hardly with that of instances: thousands of parts with an
entity for each surface take tens of megabytes before anything has moved, and are slow to view.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from vpframe.scene.scene import Part, Shape
from vpframe.view import palette
from vpframe.view.columns import rgba
from vpframe.view.display import display_mesh

SEPARATE = 200
"""maximum number of parts that are drawn one by one from the beginning"""


@dataclass(frozen=True, eq=False)
class Crowd:
    """Parts that look alike: of one shape and colour, with the same colliding surfaces."""

    entity: str
    shape: Shape
    color: palette.Color
    red: frozenset[int]
    """surfaces that collide"""
    members: tuple[str, ...]
    """the parts, by name"""

    def mesh(self) -> rr.Mesh3D:
        """Return the shape in its colours."""
        mesh = display_mesh(self.shape)
        colors: dict[str, Any] = {"albedo_factor": rgba(self.color)}
        if self.red:
            tints = [palette.COLLIDING if s in self.red else self.color for s in range(mesh.n_surfaces)]
            table = np.array([rgba(tint) for tint in tints], np.uint32)
            colors = {"vertex_colors": np.repeat(table, np.diff(mesh.vertex_start))}
        return rr.Mesh3D(
            vertex_positions=mesh.positions, vertex_normals=mesh.normals, triangle_indices=mesh.triangles, **colors
        )


def crowds(
    parts: Iterable[Part], colors: Mapping[str, palette.Color], red: Mapping[str, frozenset[int]]
) -> list[Crowd]:
    """Return the crowds of parts that stand still, by entity, in the order of their first parts.

    colors: of the parts by name. red: the surfaces that collide, of parts that have such.
    """
    alike: dict[tuple[Shape, palette.Color, frozenset[int]], list[str]] = {}
    for part in parts:
        look = (part.shape, colors[part.name], red.get(part.name, frozenset()))
        alike.setdefault(look, []).append(part.name)
    return [
        Crowd(f"still/{number}_{re.sub(r'[^A-Za-z0-9.-]', '_', shape.mesh.name)}", shape, color, marked, tuple(names))
        for number, ((shape, color, marked), names) in enumerate(alike.items())
    ]
