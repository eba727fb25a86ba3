"""Surface pairs grouped by pair of parts, for clash tables and reports."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vpframe.scene.scene import Part

OPEN_FIRST = ("new", "persistent", "accepted", "resolved")
"""order of precedence for the status of a pair of parts"""


def by_parts(
    rows: Iterable[dict[str, Any]],
    kinds: Sequence[str],
    apart: Callable[[dict[str, Any]], Any] = lambda row: None,
) -> list[dict[str, Any]]:
    """Return one row for each pair of parts, gravest and deepest first.

    Parameters
    ----------
    rows: of surface pairs: "kind", "parts" [a, b], "surfaces", "depth" (m, or None), and further fields.
    kinds: in descending gravity.
    apart: rows of the same two parts with different values of this function are not grouped.

    Returns
    -------
    The row of the worst surface pair ("kind", "surfaces", "faces", "depth", "point", …) with the gravest "status" of
    all, their "count", and all rows as "surface_pairs", worst first.
    """
    groups: dict[Any, list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault((*row["parts"], apart(row)), []).append(row)
    out = []
    for members in groups.values():
        members.sort(key=lambda row: worst_first(row, kinds))
        statuses = {row["status"] for row in members if "status" in row}
        status = {"status": min(statuses, key=OPEN_FIRST.index)} if statuses else {}
        remark = next((row["remark"] for row in members if row.get("remark")), "")
        out.append(
            {
                **members[0],
                **status,
                **({"remark": remark} if statuses else {}),
                "count": len(members),
                "surface_pairs": members,
            }
        )
    return sorted(out, key=lambda row: worst_first(row, kinds))


def worst_first(row: Mapping[str, Any], kinds: Sequence[str]) -> tuple[int, float, float, int]:
    """Sort key: kind, depth, distance (to a nanometre), and curved faces before planes."""
    planes = sum(face.endswith("plane") for face in row.get("faces", ()))
    return kinds.index(row["kind"]), -round(row["depth"] or 0.0, 9), round(row.get("distance") or 0.0, 9), planes


def meeting_box(
    parts: Sequence[Part], poses: Sequence[pin.SE3], surfaces: Sequence[int]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Corners (3,), (3,) of the intersection of two surfaces' bounding boxes, or of the gap between them, world, m."""
    lows, highs = [], []
    for part, pose, surface in zip(parts, poses, surfaces, strict=True):
        corners = part.mesh.vertices[part.mesh.triangles[part.mesh.triangles_of(surface)]].reshape(-1, 3)
        points = corners @ pose.rotation.T + pose.translation
        lows.append(points.min(axis=0))
        highs.append(points.max(axis=0))
    low, high = np.max(lows, axis=0), np.min(highs, axis=0)
    return np.minimum(low, high), np.maximum(low, high)


def place_words(point: Sequence[float] | None) -> str:
    """Format a point (3,), m, as "(1.25, 0, -3.1) mm"; empty for None."""
    if point is None:
        return ""
    return "({}) mm".format(", ".join(f"{round(1e3 * x, 2) + 0.0:g}" for x in point))


def count_words(count: int, what: str) -> str:
    """Format a count: "1 pair of parts", "3 pairs of parts"."""
    return f"{count} pair{'s' if count != 1 else ''} of {what}"
