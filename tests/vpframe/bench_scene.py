"""A small scene for tests of sessions: a block with a bore, a headed peg that fits it, a cube, all over a table."""

from functools import cache

import numpy as np
import pinocchio as pin

from vpframe.hands import Hand
from vpframe.scene import modelling as m
from vpframe.scene.scene import Part, Scene
from vpframe.session.session import Session

SEAT = np.array([0.0, 0.0, 0.020])


def at(x: float, y: float, z: float) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([x, y, z]))


@cache
def _shapes():
    peg = m.revolve(
        [(0.0, -0.015), (0.0042, -0.015), (0.005, -0.0142), (0.005, 0.0), (0.008, 0.0), (0.008, 0.005), (0.0, 0.005)]
    )
    block = m.box(0.04, 0.04, 0.02).translated(-0.02, -0.02, 0.0) - m.cylinder(0.00502, 0.02)
    table = m.box(0.3, 0.3, 0.01).translated(-0.15, -0.15, -0.01)
    solids = {"table": table, "block": block, "peg": peg, "cube": m.box(0.02, 0.02, 0.02)}
    return {name: m.shape(solid, name=name) for name, solid in solids.items()}


def scene() -> Scene:
    """Built anew each time (poses change), from the same shapes."""
    shapes = _shapes()
    made = Scene(
        [
            Part("table", shapes["table"], at(0.0, 0.0, 0.0), fixed=True),
            Part("block", shapes["block"], at(0.0, 0.0, 0.0), fixed=True),
            Part("peg", shapes["peg"], at(0.06, 0.0, 0.05)),
            Part("cube", shapes["cube"], at(0.08, 0.06, 0.02)),
        ]
    )
    return made


def holding(session: Session, part: str = "peg") -> Hand:
    """A hand that has grabbed a part from 30 mm above its origin."""
    hand = session.hand(at=session.scene[part].pose.translation + np.array([0.0, 0.0, 0.03]))
    hand.grab(part)
    return hand
