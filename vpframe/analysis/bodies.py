"""Bodies of one part: a product of several solids is one rigid part, whose solids may overlap."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from collision import CollisionManager, SurfaceMesh, Tolerance
from collision.mesh import welded
from physics.model.body import polyhedron
from vpframe.analysis.pairs import count_words
from vpframe.scene.deflection import deflections
from vpframe.scene.scene import Scene, Shape


def shells(mesh: SurfaceMesh) -> list[SurfaceMesh]:
    """The pieces of a mesh that share no vertex position, each a mesh of one surface."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    positions, at = welded(mesh.vertices)
    triangles = at[mesh.triangles]
    n = len(positions)
    rows = np.concatenate([triangles[:, 0], triangles[:, 1]])
    columns = np.concatenate([triangles[:, 1], triangles[:, 2]])
    count, label = connected_components(coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(n, n)), directed=False)
    of = label[triangles[:, 0]]
    return [
        SurfaceMesh(positions, triangles[of == k], np.zeros(int((of == k).sum()), np.int64))
        for k in range(count)
        if (of == k).any()
    ]


def overlap_notes(scene: Scene, tolerance: Tolerance | None = None) -> tuple[str, ...]:
    """Return a line on the shapes whose bodies overlap by more than `tolerance.linear` and their facets' deflections.

    Such overlaps are no clashes: a library screw of thirty solids is one rigid part. A body is a shell of positive
    volume; a cavity is none.
    """
    limits = tolerance or Tolerance()
    parts: dict[Shape, list[str]] = {}
    for part in scene.parts:
        parts.setdefault(part.shape, []).append(part.name)
    notes = []
    for shape, names in parts.items():
        bodies = [s for s in shells(shape.mesh) if polyhedron(s.vertices[s.triangles])[0] > 0.0]
        if len(bodies) < 2:
            continue
        world = CollisionManager(limits)
        for body in bodies:
            world.add(body, pin.SE3.Identity())
        pairs = np.unique(world.colliding_surfaces()[:, [0, 2]], axis=0).tolist()
        hidden = limits.linear + 2.0 * float(deflections(shape).max(initial=0.0))
        found = world.penetrations(pairs, lambda *_, hidden=hidden: hidden)
        depths = [float(rows["depth"].max(initial=0.0)) for rows in found]
        deep = [depth for depth in depths if depth > hidden]
        if deep:
            others = f" and {len(names) - 1} more of its shape" if len(names) > 1 else ""
            overlaps = f"{count_words(len(deep), f'its {len(bodies)} bodies')} by at most {1e3 * max(deep):.3g} mm"
            notes.append(f"{names[0]}{others} ({overlaps})")
    if not notes:
        return ()
    return (f"bodies of one rigid part overlap (--bodies split takes them apart): {', '.join(notes)}",)
