"""Notes on data of a scene that a format cannot contain."""

from __future__ import annotations

from vpframe.scene.scene import Scene


def losses(scene: Scene, *kinds: str) -> list[str]:
    """Return notes on data of these kinds in the scene: "colours" (of faces), "sizes" (PMI), "joints" (of the file)."""
    surfaces = [surface for part in scene.parts for surface in part.surfaces]
    left: list[str] = []
    if "colours" in kinds and any(surface.color for surface in surfaces):
        left.append("colours of single faces")
    if "sizes" in kinds and any(surface.size for surface in surfaces):
        left.append("sizes of PMI")
    if "joints" in kinds:
        left += [f"joint of {s.parts[0]} and {s.parts[1]} ({s.kind})" for s in scene.statements]
    return left
