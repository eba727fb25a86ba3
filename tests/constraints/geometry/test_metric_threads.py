"""ISO metric threads told from the diameters that models draw them with."""

import numpy as np
import pinocchio as pin
import pytest

from collision import CollisionManager, Tolerance
from constraints import recognise
from constraints.geometry.metric_threads import PITCHES, designation, metric_threads
from tests.constraints.shapes import housing, shaft


@pytest.mark.parametrize(
    ("screw", "hole", "name", "pitch"),
    [
        (6, 5, "M6", 1.0),  # tap drill
        (6, 4.917, "M6", 1.0),  # basic minor diameter
        (5.9, 5, "M6", 1.0),  # drawn at its mean size
        (3, 2.5, "M3", 0.5),
        (8, 6.8, "M8", 1.25),
        (8, 7, "M8×1", 1.0),
        (10, 8.5, "M10", 1.5),
        (12, 10.2, "M12", 1.75),
        (16, 14, "M16", 2.0),
    ],
)
def test_a_screw_in_its_tapped_hole(screw, hole, name, pitch):
    thread = metric_threads(screw * 1e-3, hole * 1e-3)[0]
    assert thread.name == name and thread.pitch == pytest.approx(pitch * 1e-3)
    assert thread.coarse == ("×" not in name) and designation(float(screw + 0.1) // 1, thread.pitch * 1e3) == name


@pytest.mark.parametrize(
    ("screw", "hole"),
    [(6, 6), (6, 6.6), (6, 5.98), (6, 5.5), (6, 4.5), (6.3, 5), (90, 84), (1, 0.8), (6, 0.1)],
)
def test_what_is_no_thread(screw, hole):
    assert metric_threads(screw * 1e-3, hole * 1e-3) == ()


def test_every_size_is_known_by_its_tap_drill_and_by_no_clearance():
    for nominal, pitches in PITCHES.items():
        for pitch in pitches:
            assert metric_threads(nominal * 1e-3, (nominal - pitch) * 1e-3)[0].pitch == pytest.approx(pitch * 1e-3)
        assert metric_threads(nominal * 1e-3, nominal * 1e-3) == ()


@pytest.mark.parametrize("swap", [False, True])
def test_a_tapped_hole_and_its_screw_are_one_mate(swap):
    bodies, poses = [housing(0.0025, 0.02), shaft(0.003, 0.03)], [pin.SE3.Identity()] * 2
    poses[1] = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.002]))  # both ends of the screw stand in the hole's way
    if swap:
        bodies, poses = bodies[::-1], poses[::-1]
    world = CollisionManager()
    for body, pose in zip(bodies, poses, strict=True):
        world.add(body.mesh, pose)
    known = [b.features for b in bodies], poses, world.contacts(1e-3), Tolerance(reach=0.0)
    (screw,) = recognise(*known, named={bodies.index(bodies[swap]): ["screw"]})
    assert screw.kind == "screw" and screw.pitch == pytest.approx(1e-3)
    assert 'thread M6: Ø6 in Ø5 mm tapping hole, name "screw" over 18 mm' in screw.why
    assert recognise(*known) == ()
