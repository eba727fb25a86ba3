"""Straight passages along surfaces to which there is no clearance."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from constraints.motion import god_object, passage
from constraints.motion.passage import Drawn, passable
from tests.vpframe.session.fits import tight_fit
from vpframe import Part, Scene, Session
from vpframe.scene import modelling
from vpframe.session import rules

HERE = pin.SE3.Identity()


@pytest.mark.parametrize("back", [False, True])
def test_ends_of_fingers_pass_the_tops_beside_them(back: bool) -> None:
    """They share strips along their edges, 10 nm wide, and are 10 µm below the tops."""
    way = [(1.292296, 9.987412, -4.008e-5), (1.292984, 9.989387, 5.868e-5)]
    there, end = (pin.SE3(pin.exp3(np.array([t, 0.0, 0.0])), np.array([1e-8, 1e-3 * y, 1e-3 * z])) for y, z, t in way)
    if back:
        there, end = end, there
    housing, key = (modelling.shape(solid) for solid in tight_fit("fingers", 0.0))
    scene = Scene([Part("housing", housing, HERE), Part("key", key, HERE)])
    with Session(scene, rule=rules.leave_all) as session:
        session.step()
        motion = session.engine.motion
        drawn = Drawn(motion.collision, motion.walls, [HERE, HERE])
        motion.collision.set_poses([1], [there])
        assert passable(motion.collision, motion.walls, drawn, [HERE, there], {1: end}, motion.tolerance)


@pytest.mark.parametrize("kind", ["pocket", "bore", "dovetail", "fingers"])
def test_what_is_refused_at_its_end_no_sweep_would_pass(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The poses in which surfaces would be pressed are found before the way is swept, and are the same."""
    found: list[tuple[bool, bool]] = []

    def swept(
        collision: Any, walls: Any, drawn: Any, poses: Any, target: Mapping[int, pin.SE3], tolerance: Any
    ) -> bool:
        stuck = passage._stuck_at
        with monkeypatch.context() as slow:
            slow.setattr(passage, "_stuck_at", lambda *given: found.append((stuck(*given), False)))
            passed = passage.passable(collision, walls, drawn, poses, target, tolerance)
        found[-1] = found[-1][0], passed
        return passed

    monkeypatch.setattr(god_object, "passable", swept)
    rng = np.random.default_rng(7)
    for clearance in (0.0, 1e-5):
        housing, key = (modelling.shape(solid) for solid in tight_fit(kind, clearance))
        parts = [Part("housing", housing, HERE), Part("key", key, HERE)]
        parts[0].fixed = True
        with Session(Scene(parts), rule=rules.leave_all) as session:
            hand = session.hand()
            hand.grab("key")
            for way in [(0.0, 0.0, 0.004), *rng.normal(scale=2e-3, size=(8, 3)), (0.0, 0.0, 0.002)]:
                hand.move_by(way, duration=3 * session.dt, required=False)
    assert not any(stuck and passed for stuck, passed in found)
    assert sum(stuck for stuck, _ in found) > 5
    assert kind == "bore" or any(passed for _, passed in found)  # the margin of a bore's facets is passage enough
