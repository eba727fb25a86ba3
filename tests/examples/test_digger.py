"""The parts that the benchmark measures on are what they are said to be, and so is their truth."""

import numpy as np
import pytest

from collision import colliding_surfaces
from collision.solid import is_closed
from examples import digger


@pytest.mark.parametrize(
    ("part", "surfaces", "triangles"),
    [(digger.link, 14, 3521), (digger.arm, 25, 6205), (digger.shaft, 14, 3656), (digger.housing, 25, 6400)],
)
def test_sizes(part, surfaces: int, triangles: int) -> None:
    mesh = part()
    assert (mesh.n_surfaces, mesh.n_triangles) == (surfaces, triangles)
    # an odd number of triangles cannot close
    assert is_closed(mesh) == (triangles % 2 == 0)
    corners = mesh.vertices[mesh.triangles]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume > 0.0
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    assert area.min() > 0.0


def test_several_surfaces_meet_along_the_digger_trajectory() -> None:
    link, arm = digger.link(), digger.arm()
    found = [len(colliding_surfaces(link, arm, pose)) for pose in digger.digger_trajectory(60)]
    assert found[0] == 0 and found[-1] == 0
    assert max(found) >= 5
    assert sum(k > 1 for k in found) > 20


@pytest.mark.slow
def test_truth_of_the_shaft_agrees_with_a_fine_tessellation() -> None:
    shaft, housing = digger.shaft(384, None), digger.housing(384, None)
    for pose in digger.shaft_trajectory(40)[::3]:
        assert digger.true_pairs(pose).tolist() == colliding_surfaces(shaft, housing, pose).tolist()


def test_unrelated_poses_overlap_and_repeat() -> None:
    shaft, housing = digger.shaft(16, None), digger.housing(16, None)
    poses = digger.unrelated_poses(shaft, housing, 30, seed=3)
    again = digger.unrelated_poses(shaft, housing, 30, seed=3)
    assert all(np.array_equal(p.homogeneous, q.homogeneous) for p, q in zip(poses, again, strict=True))
    assert any(len(colliding_surfaces(shaft, housing, pose)) for pose in poses)
