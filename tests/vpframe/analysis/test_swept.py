"""Swept volumes against volumes known in closed form."""

import numpy as np
import pinocchio as pin
import pytest

from collision import SurfaceMesh
from vpframe.analysis.swept import swept_volume
from vpframe.scene.scene import Part, Shape

FACES = np.array([[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], [0, 1, 5], [0, 5, 4], [1, 2, 6], [1, 6, 5],
                  [2, 3, 7], [2, 7, 6], [3, 0, 4], [3, 4, 7]])  # fmt: skip


def block(name: str, x: float, y: float, z: float, at=(0.0, 0.0, 0.0)) -> Part:
    corners = [[0, 0, 0], [x, 0, 0], [x, y, 0], [0, y, 0], [0, 0, z], [x, 0, z], [x, y, z], [0, y, z]]
    mesh = SurfaceMesh(corners, FACES, np.arange(12) // 2)
    return Part(name, Shape(mesh, (), ()), pin.SE3(np.eye(3), np.array(at, dtype=float)))


def volume(v, t) -> float:
    a, b, c = (v[t[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def closed(t) -> bool:
    edges = np.sort(np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]]), axis=1)
    return bool((np.unique(edges, axis=0, return_counts=True)[1] % 2 == 0).all())


def test_a_straight_sweep_of_a_block_is_a_longer_block() -> None:
    part = block("slab", 0.04, 0.03, 0.02)
    poses = [pin.SE3.Identity(), pin.SE3(np.eye(3), np.array([0.10, 0.0, 0.0]))]
    swept = swept_volume(part, poses, resolution=0.001)
    assert closed(swept.triangles)
    true = 0.14 * 0.03 * 0.02
    found = volume(swept.vertices, swept.triangles)
    assert true <= found <= (0.14 + 0.004) * (0.03 + 0.004) * (0.02 + 0.004)
    low, high = swept.vertices.min(0), swept.vertices.max(0)
    assert (low <= 0.0).all() and (low >= -swept.error).all()
    assert (high >= [0.14, 0.03, 0.02]).all() and (high <= np.array([0.14, 0.03, 0.02]) + swept.error).all()


def test_a_full_turn_sweeps_a_ring_that_holds_every_place_of_the_part() -> None:
    part = block("arm", 0.05, 0.01, 0.01, at=(0.02, -0.005, 0.0))
    start = part.pose
    poses = [pin.SE3(pin.exp3(np.array([0.0, 0.0, a])), np.zeros(3)) * start for a in np.linspace(0, 2 * np.pi, 9)]
    swept = swept_volume(part, poses, resolution=0.0015)
    inner, outer = 0.02, np.hypot(0.07, 0.005)
    true = np.pi * (outer**2 - inner**2) * 0.01
    found = volume(swept.vertices, swept.triangles)
    skin = swept.error
    most = np.pi * ((outer + skin) ** 2 - (inner - skin) ** 2) * (0.01 + 2 * skin)
    assert true <= found <= most
    radius = np.linalg.norm(swept.vertices[:, :2], axis=1)
    assert radius.min() > inner - 2 * skin
    assert radius.max() < outer + skin


@pytest.mark.parametrize(
    ("where", "hit"), [((0.15, 0.0, 0.0), False), ((0.05, 0.025, 0.0), True), ((0.06, 0.01, 0.005), True)]
)
def test_it_names_what_stands_in_the_way(where, hit: bool) -> None:
    part = block("slab", 0.04, 0.03, 0.02)
    small = block("post", 0.005, 0.02 if where[1] else 0.005, 0.005, at=where)
    poses = [pin.SE3.Identity(), pin.SE3(np.eye(3), np.array([0.10, 0.0, 0.0]))]
    assert swept_volume(part, poses, [small]).clashes == (("post",) if hit else ())
