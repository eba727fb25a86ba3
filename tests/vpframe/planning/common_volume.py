"""An independent check of plans: the common volume of parts, by manifold3d, at poses of each way.

    python -m tests.vpframe.planning.common_volume MODEL.step [poses [budget]]

plans the disassembly of a model and prints each pair of parts whose common volume grows on a way, other than pairs with
fits and threads, whose surfaces the ways leave out.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from itertools import pairwise

import manifold3d
import numpy as np
import pinocchio as pin

import vpframe as vp
from vpframe.planning import Disassembly
from vpframe.report.plan_page import gone

DEEPER = 1e-6
"""m: growth of the common volume over the smaller surface that counts: rounding of facets stays far below"""


def solid(mesh, pose):
    """A part in the world; None if manifold3d takes its mesh for no solid."""
    corners = np.round(mesh.vertices @ pose.rotation.T + pose.translation, 12)
    vertices, place = np.unique(corners, axis=0, return_inverse=True)
    triangles = place.ravel()[mesh.triangles]
    triangles = triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]
    out = manifold3d.Manifold(manifold3d.Mesh64(vertices, triangles.astype(np.uint64)))
    return out if out.status() == manifold3d.Error.NoError and out.volume() > 0.0 else None


def poses_of(knots, count: int) -> Iterator[pin.SE3]:
    """About `count` displacements along a way, every knot among them."""
    each = max(1, count // (len(knots) - 1))
    for start, end in pairwise(knots):
        way = pin.log6(start.actInv(end))
        for k in range(1, each + 1):
            yield start * pin.exp6(way * (k / each))


def grown(scene: vp.Scene, plan: Disassembly, count: int = 50) -> tuple[list[str], int, int]:
    """(words for each pair whose common volume grows on a way, pairs that were looked at, parts that are no solids)."""
    solids = {name: solid(part.mesh, part.pose) for name, part in scene.items()}
    left_out = {frozenset((a, b)) for a, b, _ in plan.mates} | {frozenset(pair) for pair in plan.ignored}
    boxes = {name: np.array(s.bounding_box()).reshape(2, 3) for name, s in solids.items() if s is not None}
    words, looked = [], 0
    for n, step in enumerate(plan.steps):
        whole = next(
            (set(s.parts) for s in plan.steps[n - 1 :: -1] if n and set(step.parts) < set(s.parts)), set(solids)
        )
        standing = whole - gone(plan, n) - set(step.parts)  # a group is taken apart by itself
        displacements = list(poses_of(step.way.knots, count))
        for part in step.parts:
            if solids[part] is None:
                continue
            moved = [solids[part].transform(d.homogeneous[:3]) for d in displacements]
            swept = np.array([each.bounding_box() for each in moved]).reshape(-1, 2, 3)
            for other in sorted(standing & boxes.keys()):
                low, high = boxes[other]
                meets = ((swept[:, 0] <= high) & (low <= swept[:, 1])).all(axis=1)
                if frozenset((part, other)) in left_out or not meets.any():
                    continue
                looked += 1
                drawn = (solids[part] ^ solids[other]).volume()
                volumes = [(moved[k] ^ solids[other]).volume() for k in np.flatnonzero(meets)]
                area = min(solids[part].surface_area(), solids[other].surface_area())
                if max(volumes) - drawn > DEEPER * area:
                    words.append(f"step {n + 1}, {part} in {other}: {drawn:.3g} to {max(volumes):.3g} m³")
    return words, looked, sum(each is None for each in solids.values())


if __name__ == "__main__":
    model = vp.load(sys.argv[1])
    found = vp.planning.disassembly(model, budget=float(sys.argv[3]) if len(sys.argv) > 3 else 300.0)
    lines, pairs, none = grown(model, found, int(sys.argv[2]) if len(sys.argv) > 2 else 50)
    print("\n".join(lines))
    print(f"{len(found.steps)} ways, {pairs} pairs of parts near them, {len(lines)} grow; {none} parts are no solids")
