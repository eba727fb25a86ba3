"""Bodies that are held, carried and fixed as the unknowns of a motion."""

import numpy as np
import pinocchio as pin
import pytest

from constraints import ConstraintsError
from tests.constraints.motion.room import Room
from tests.constraints.shapes import at, box, flanged_shaft, housing


def test_the_subassembly_comes_along():
    """A ring sits on a shaft's flange: held by the shaft, the ring follows; held by the ring, the shaft does."""
    ring = housing(0.01, 0.01, 0.02)
    room = Room([box(0.1, 0.1, 0.1), flanged_shaft(), ring], [at(x=1.0), at(), at(z=0.04)])
    room.update()
    assert sorted(c.kind for c in room.manager.constraints) == ["against", "concentric"]
    start = room.poses[1].actInv(room.poses[2])
    for held, target in ((1, at(x=0.1, y=0.2, rpy=(0.3, 0.2, 0.1))), (2, at(y=-0.1, z=0.3, rpy=(1.0, -0.4, 0.2)))):
        result = room.move(target, held)
        assert result.residual < 1e-9 and set(result.poses) == {1, 2}
        assert np.abs(room.poses[held].homogeneous - target.homogeneous).max() < 1e-6
        now = room.poses[1].actInv(room.poses[2])
        assert now.translation == pytest.approx(start.translation, abs=1e-9)


def test_a_body_is_carried_once_and_by_a_held_one():
    room = Room([box(1, 1, 0.01), box(0.1, 0.1, 0.1), box(0.1, 0.1, 0.1)], [at(), at(z=0.2), at(z=0.4)], accept=False)
    for wanted, carried in (({1: at()}, {1: (1,)}), ({1: at()}, {1: (2, 2)}), ({1: at()}, {2: (1,)})):
        with pytest.raises(ConstraintsError, match="carried"):
            room.motion.step(wanted, room.poses, [1, 2], carried)


def test_parts_that_may_not_move_hold_the_others():
    room = Room([box(0.1, 0.1, 0.1), flanged_shaft(), housing(0.01, 0.01, 0.02)], [at(x=1.0), at(), at(z=0.04)])
    room.update()
    room.move(at(x=0.1, z=0.5, rpy=(0, 0, 1.0)), held=2, movable=[2])
    assert room.poses[1] == at()
    assert room.poses[2].translation == pytest.approx([0, 0, 0.04], abs=1e-9)
    assert abs(pin.log3(room.poses[2].rotation)[2]) == pytest.approx(1.0, abs=1e-6)


def test_two_hands_on_two_parts():
    """One hand holds the ring, the other the shaft it sits on; what both want together cannot be, so they share it."""
    room = Room([box(0.1, 0.1, 0.1), flanged_shaft(), housing(0.01, 0.01, 0.02)], [at(x=1.0), at(), at(z=0.04)])
    room.update()
    result = room.motion.step({1: at(x=0.01), 2: at(x=-0.01, z=0.04)}, room.poses, room.movable)
    assert result.residual < 1e-9
    assert all(0.001 < shift < 0.019 for shift, _ in result.remaining.values())
    turned = {1: at(rpy=(0, 0, 0.3)), 2: at(z=0.04, rpy=(0, 0, -0.4))}
    result = room.motion.step(turned, [room.poses[0], result.poses[1], result.poses[2]], room.movable)
    for body, pose in turned.items():
        assert np.abs(pin.log3(result.poses[body].rotation.T @ pose.rotation)).max() < 1e-6
