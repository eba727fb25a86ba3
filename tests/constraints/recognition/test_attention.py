"""An update looks only at what may be other than before, and finds exactly what a look at everything finds."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from collision import CONTACT_DTYPE, CollisionManager, Tolerance
from constraints import ConstraintManager, ConstraintsError, Motion
from constraints.recognition.attention import Attention
from tests.constraints.shapes import box, flanged_shaft, housing

BODIES = (housing(0.0101), flanged_shaft(phase=0.05), housing(0.0101), flanged_shaft(phase=0.05), box(0.05, 0.05, 0.05))
WIDE = 0.02
"""m, more than any manager here needs"""
HOMES = ((0, 0, 0), (0, 0, 0.03), (0.1, 0, 0), (0.1, 0, 0.03), (0.2, 0, 0))


def poses_at_home():
    return [pin.SE3(np.eye(3), np.array(home, float)) for home in HOMES]


def world_of(poses):
    world = CollisionManager()
    for body, pose in zip(BODIES, poses, strict=True):
        world.add(body.mesh, pose)
    return world


def manager_of(rules):
    return ConstraintManager([body.features for body in BODIES], rules=rules, fixed=[0])


def told(changes):
    return [(c.kind, c.id, c.candidate.key, c.candidate.score, c.candidate.why, c.text) for c in changes]


def known(manager):
    return [
        {id: c.key for id, c in manager.candidates.items()},
        {id: (e.candidate.key, e.satisfied) for id, e in manager.accepted.items()},
        {id: c.key for id, c in manager.refused.items()},
        {id: c.key for id, c in manager._pulled.items()},
        manager._ids,
    ]


def decide(managers, rng):
    """The same random decision on both."""
    first = managers[0]
    verb, ids = [
        ("accept", [*first.candidates, *first.refused]),
        ("refuse", [*first.candidates]),
        ("remove", [*first.accepted]),
    ][rng.integers(3)]
    if ids and rng.random() < 0.4:
        id = ids[rng.integers(len(ids))]
        for manager in managers:
            getattr(manager, verb)(id)


@pytest.mark.parametrize("verdict", [True, None, False])
@pytest.mark.parametrize("seed", range(3))
def test_it_finds_what_a_look_at_everything_finds(verdict, seed):
    rng = np.random.default_rng(seed)
    managers = [manager_of([lambda candidate: verdict]) for _ in range(2)]
    poses = poses_at_home()
    world = world_of(poses)
    kinds = set()
    for _ in range(60):
        mover = int(rng.choice([1, 1, 3, 4]))
        if rng.random() < 0.7:
            x = HOMES[mover if mover != 4 or rng.random() < 0.5 else 0][0]
            place = np.array([x, 0.0, rng.choice([0.0, 0.01, 0.03, 0.0609, 0.2])]) + rng.normal(0, 5e-5, 3)
            pose = pin.SE3(pin.exp3(rng.normal(0, 1e-3, 3)), place)
            # now and then the very object given before is changed in place
            if rng.random() < 0.2:
                poses[mover].translation, poses[mover].rotation = pose.translation, pose.rotation
            else:
                poses[mover] = pose
            world.set_pose(mover, poses[mover])
        wanted = {mover: poses[mover] * pin.SE3(np.eye(3), rng.normal(0, 0.01, 3))} if rng.random() < 0.3 else {}
        force = {mover: rng.normal(0, 100.0, 3)} if rng.random() < 0.3 else {}
        if rng.random() < 0.1:
            tolerance = replace(Tolerance(), reach=float(rng.choice([0.0, 1e-3, 5e-3])))
            for manager in managers:
                manager.tolerance = tolerance
        decide(managers, rng)
        if rng.random() < 0.1:
            managers[0].snapshot = managers[0].snapshot
        rows = world.contacts(managers[0].within), world.contacts(WIDE)
        managers[1]._attention.forget()
        changes = [m.update(poses, near, wanted, force) for m, near in zip(managers, rows, strict=True)]
        kinds |= {change.kind for change in changes[0]}
        assert told(changes[0]) == told(changes[1])
        assert known(managers[0]) == known(managers[1])
    assert {"recognised", "withdrawn" if verdict is None else "removed" if verdict else "refused"} <= kinds


def test_what_stands_still_is_not_measured_again():
    manager = manager_of([lambda candidate: None])
    poses = poses_at_home()
    world = world_of(poses)
    manager.update(poses, world.contacts(manager.within))
    manager.update(poses, world.contacts(manager.within))
    asked = []
    matches = manager.recogniser.matches
    manager.recogniser.matches = lambda pair, *rest: asked.append(pair) or matches(pair, *rest)
    poses[1] = pin.SE3(np.eye(3), np.array([0, 0, 0.031]))
    world.set_pose(1, poses[1])
    manager.update(poses, world.contacts(manager.within))
    assert asked and {body for a, _, b, _ in asked for body in (a, b)} == {0, 1}


def test_an_update_that_failed_is_made_up_for():
    manager = manager_of([lambda candidate: None])
    poses = poses_at_home()
    world = world_of(poses)
    rows = world.contacts(manager.within)

    def failing(candidate):
        raise RuntimeError("a rule that fails")

    manager.rules.append(failing)
    with pytest.raises(RuntimeError):
        manager.update(poses, rows)
    manager.rules.clear()
    manager.update(poses, rows)
    assert {c.bodies for c in manager.candidates.values()} == {(0, 1), (2, 3)}


def test_rows_that_differ_name_their_bodies():
    rows = np.zeros(3, CONTACT_DTYPE)
    rows["object_a"], rows["object_b"] = [0, 2, 2], [1, 3, 4]
    poses = [pin.SE3.Identity()] * 6
    attention = Attention()
    assert attention.begin("asked", poses, rows) == set(range(6))
    attention.end()
    assert attention.begin("asked", poses, rows) == set()
    attention.end()
    moved = rows.copy()
    moved["distance"][1] = 1e-3
    assert attention.begin("asked", poses, moved) == {2, 3}
    attention.end()
    assert attention.begin("asked", poses, np.concatenate([moved, moved[:1]])) == {0, 1}
    attention.end()
    assert attention.begin("another", poses, rows) == set(range(6))


class Noting:
    """A collision manager that keeps what it was told to leave out."""

    def __init__(self, world):
        self.world, self.calls = world, 0
        self.mesh = world.mesh

    def ignore_surfaces(self, *pairing):
        self.calls += 1
        self.world.ignore_surfaces(*pairing)

    def enable_surfaces(self, *pairing):
        self.calls += 1
        self.world.enable_surfaces(*pairing)


def test_surfaces_left_out_are_those_of_a_fresh_start_whatever_came_and_went():
    rng = np.random.default_rng(5)
    manager = manager_of([lambda candidate: None])
    poses = [pin.SE3(np.eye(3), np.array([x, y, min(z, 0.01)])) for x, y, z in HOMES]  # the flanges sit on the housings
    worlds = [world_of(poses), world_of(poses)]
    noting = Noting(worlds[0])
    motion = Motion(noting, manager)
    manager.update(poses, worlds[0].contacts(manager.within))
    assert len(manager.candidates) >= 4
    pairs = [(0, 1), (2, 3)]
    for _ in range(30):
        decide([manager], rng)
        motion.sync()
        before = noting.calls
        motion.sync()
        assert noting.calls == before
        for world in worlds[1:]:
            for a, b in pairs:
                world.enable_surfaces(a, range(world.mesh(a).n_surfaces), b, range(world.mesh(b).n_surfaces))
            Motion(world, manager).sync()
            assert [world.ignored_surfaces(*pair) for pair in pairs] == [
                worlds[0].ignored_surfaces(*pair) for pair in pairs
            ]


def test_too_few_poses_are_refused():
    with pytest.raises(ConstraintsError, match="poses"):
        manager_of([]).update(poses_at_home()[:2], np.zeros(0, CONTACT_DTYPE))
