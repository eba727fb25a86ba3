"""Compile the kernels of a command in two more processes while the first process reads its file.

Each process runs small examples of the command's queries: one for `collision`, the other mostly for the packages after
it. Kernels are kept on disk, and a process that needs a kernel under compilation waits for it
(`collision.numeric.kernel_cache`). The processes do not communicate otherwise, may fail without loss, and end with the
first one.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import collision
import constraints
from collision.numeric import kernel_cache
from collision.numeric.kernel import compilation
from vpframe import processes

_helpers: list[subprocess.Popen[bytes]] = []


def start(use: str) -> None:
    """Start a process for each share of a use in USES, except for shares that are done."""
    folder = kernel_cache.folder("vpframe")
    if folder is None or kernel_cache.config.DISABLE_JIT or (os.cpu_count() or 1) < 2:
        return
    for share in range(len(USES[use])):
        if not _done(folder, use, share).exists():
            _helpers.append(processes.start(__name__, use, str(share)))


def wait() -> None:
    """Wait until the processes started by `start` have ended."""
    for helper in _helpers:
        helper.wait()


def note_enough(use: str) -> None:
    """Mark all shares of a use as done if this process compiled nothing."""
    folder = kernel_cache.folder("vpframe")
    if folder is not None and not compilation.kernels:
        for share in range(len(USES[use])):
            _done(folder, use, share).touch()


def main(use: str, share: int) -> None:
    """Run one share of a use and mark it as done."""
    for example in USES[use][share]:
        example()
    folder = kernel_cache.folder("vpframe")
    if folder is not None:
        _done(folder, use, share).touch()


def _done(folder: Path, use: str, share: int) -> Path:
    return folder / f"{use}-{share}.done"


def _box(size: float) -> collision.SurfaceMesh:
    corners = np.array([[x, y, z] for x in (0.0, size) for y in (0.0, size) for z in (0.0, size)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return collision.SurfaceMesh(corners, triangles, np.repeat(np.arange(6), 2))


def _boxes(gap: float) -> collision.CollisionManager:
    """Return a world with a box of 10 mm and one of 4 mm at a distance (m)."""
    world = collision.CollisionManager()
    world.add(_box(0.010), np.eye(4))
    world.add(_box(0.004), _shifted(0.010 + gap))
    return world


def _shifted(x: float) -> Any:
    import pinocchio as pin

    return pin.SE3(np.eye(3), np.array([x, 0.003, 0.003]))


def _contacts() -> None:
    world = _boxes(0.0005)
    world.object_pairs([0], within=0.001)
    world.contacts(0.001)
    world.clearance(0, 1)


def _collisions() -> None:
    world = _boxes(-0.001)
    world.colliding_surfaces()
    world.set_pose(1, _shifted(0.02))
    world.colliding_surfaces([1])


def _motions() -> None:
    _boxes(0.005).time_of_impact({1: _shifted(0.005)})


def _surfaces() -> None:
    collision.colliding_surfaces(_box(0.010), _box(0.004), np.eye(4))


def _grips() -> None:
    import pinocchio as pin

    from vpframe.hands.reach import surface_distances

    surface_distances(_box(0.010), pin.SE3.Identity(), np.zeros(3))


def _depths() -> None:
    _boxes(-0.001).penetration(0, 1)


def _classes() -> None:
    from collision.classify import classify

    classify(_boxes(-0.001))
    classify(_boxes(-0.007))


def _solutions() -> None:
    import pinocchio as pin

    from constraints.freedom.mobility import mobility
    from constraints.geometry.surfaces import Cylinder, Plane
    from constraints.motion.unknowns import Unknowns

    z = np.array([0.0, 0.0, 1.0])
    on, bore = Plane(np.zeros(3), z), Cylinder(np.zeros(3), z, 0.01)
    mated = (
        constraints.Concentric((0, 1), (bore, bore)),
        constraints.Against((0, 1), (on, Plane(np.zeros(3), -z))),
    )
    poses = [pin.SE3.Identity(), pin.SE3(np.eye(3), np.full(3, 1e-3))]
    mobility(mated, poses, [0])
    unknowns = Unknowns.of(mated, frozenset({1}), frozenset({1}), lambda body: (np.zeros(3), 0.01))
    unknowns.linearised(poses, collision.Tolerance().rigid)
    rows = np.zeros(1, [("object_a", int), ("object_b", int), ("point_a", float, 3), ("point_b", float, 3)])
    rows["object_b"] = 1
    unknowns.gap_rows(rows, np.zeros((1, 3)), poses)


def _programs() -> None:
    from constraints.motion.quadratic_program import quadratic_program

    quadratic_program(np.eye(2), np.ones(2), np.ones((1, 2)), np.ones(1))


def _overlaps() -> None:
    from constraints.geometry.overlap import facing_area

    z, triangle = np.array([0.0, 0.0, 1.0]), np.eye(3)[None]
    facing_area(np.zeros(3), z, triangle, triangle, np.zeros(3), -z)


def _pictures() -> None:
    from vpframe.view import raster

    depth, image = np.full((2, 2), -np.inf), np.zeros((2, 2, 3), np.float32)
    face, weight = np.full((2, 2), -1, np.int32), np.zeros((2, 2, 2), np.float32)
    raster.fill_triangles(np.zeros((1, 3, 2)), np.zeros((1, 3)), np.zeros((1, 3)), depth, face, weight)
    window, one = np.zeros(4, np.int64), np.ones(1)
    corners, labels, filled = np.zeros((1, 3, 3)), np.zeros(1, np.int64), np.zeros(1, np.bool_)
    raster.shade_faces(window, face, weight, corners, corners[0], labels, filled, corners[0], 1.0, image)
    ends = np.zeros((1, 2, 2))
    raster.draw_segments(ends, np.zeros((1, 2)), np.zeros((1, 3)), one, one, depth, image)


def _ways() -> None:
    import pinocchio as pin

    from vpframe.planning import tree, ways
    from vpframe.planning.assembly import Assembly, Budget
    from vpframe.scene.scene import Part, Scene, Shape

    small, large = Shape(_box(0.004), (), ()), Shape(_box(0.010), (), ())
    scene = Scene([Part("small", small, _shifted(0.0105)), Part("large", large, pin.SE3.Identity())])
    assembly = Assembly(scene)
    cone, _ = ways.cone_of(assembly, (0,), (1,))
    tree.search(assembly, (0,), (1,), cone, Budget(60.0), 0)


USES: dict[str, tuple[tuple[Callable[[], None], ...], ...]] = {
    "session": ((_contacts, _collisions, _motions), (_grips, _solutions, _programs, _overlaps, _pictures)),
    "disassemble": ((_contacts, _collisions, _motions), (_solutions, _programs, _overlaps, _depths, _ways)),
    "clash": ((_contacts, _surfaces, _overlaps), (_depths, _classes)),
    "mates": ((_contacts,), (_overlaps, _solutions)),
}
"""examples of each process, by use, in the order in which the command needs their kernels"""

if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
