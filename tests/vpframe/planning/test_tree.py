"""The tree of sampled displacements."""

import numpy as np
import pytest

from collision import CollisionManager
from tests.vpframe.planning import cases
from tests.vpframe.planning.measured import angle_of, deepest_beyond, is_clear, sampled
from vpframe.planning import tree, ways
from vpframe.planning.assembly import Assembly, Budget, BudgetError
from vpframe.planning.pushes import Pushes
from vpframe.planning.verdict import Removal
from vpframe.scene.modelling import box
from vpframe.scene.modelling import scene as scene_of

PRESSED = 1e-11


@pytest.mark.parametrize(
    ("scene", "part", "least"),
    [
        (cases.c_clip, "clip", cases.clip_angle()),
        (cases.bayonet, "plug", cases.BAYONET),
        (cases.l_hook, "hook", np.radians(20.0)),
        (cases.peg, "peg", 0.0),
        (cases.latched_box, "latch", 0.0),
    ],
)
def test_the_tree_alone_finds_ways_that_deepen_nothing(scene, part, least):
    scene = scene()
    found = sampled(scene, part)
    removal = Removal((part,), "removable", found.way)
    assert angle_of(removal) >= least
    assert deepest_beyond(scene, removal) <= PRESSED
    assert is_clear(scene, removal)


def test_walls_thinner_than_the_steps_of_the_tree_are_never_passed():
    wall, thin = 2e-5, 2e-5
    shell = box(0.03, 0.03, 0.01) - box(0.03 - 2 * wall, 0.03 - 2 * wall, 0.01 - 2 * wall).translated(wall, wall, wall)
    scene = scene_of({"shell": shell, "plate": box(0.02, 0.02, thin).translated(0.005, 0.005, 0.005)})
    assert wall + thin < tree.STEP * 0.01
    found = sampled(scene, "plate", seconds=4.0)
    assert found.way is None and found.reached > 0.0


def test_the_displacements_of_the_tree_intersect_nothing_and_its_random_numbers_are_its_seed():
    scene = cases.linked_rings()
    assembly = Assembly(scene)
    cone, _ = ways.cone_of(assembly, (1,), (0,))

    def grown(seed):
        pushes = Pushes(assembly, (1,), (0,), Budget(1.0, clock=lambda: 0.0))
        search = tree._Search(pushes, cone, seed)
        with pytest.raises(BudgetError):
            search.run()
        return search

    search = grown(3)
    n = int(search.tree.count[tree.NODES])
    assert n > 100
    world = CollisionManager()
    for part, pose in zip(scene.parts, assembly.poses, strict=True):
        world.add(part.mesh, pose)
    for k in range(0, n, 7):
        world.set_pose(1, search._displacement(search._at(k)) * assembly.poses[1])
        assert not len(world.colliding_surfaces())
        assert search.tree.parent[k] < k
    again, other = grown(3), grown(4)
    assert np.array_equal(again.tree.pose[:n], search.tree.pose[:n])
    assert not np.array_equal(other.tree.pose[:n], search.tree.pose[:n])
