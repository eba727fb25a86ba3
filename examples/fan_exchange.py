"""A fan is exchanged: four screws out, guard off, old fan out of its pocket, new fan in, guard and screws back.

The fan, a frame with its rotor, sits in a pocket without clearance. What goes out in a list comes back the way it came.
"""

import numpy as np
from parts import ALUMINIUM, BRASS, RUBBER, STEEL, WOOD, at, bench, bolt, plate

import vpframe as vp
from vpframe.scene import modelling

SIDE, DEEP = 0.030, 0.010  # m, of the fan
TOP, FOOT = 0.025, 0.014  # m: the top of the housing, the floor of its pocket
HOLES = [(x, y) for x in (-0.02, 0.02) for y in (-0.02, 0.02)]
SCREWS = [f"screw_{k}" for k in range(1, 5)]
PITCH = 0.0005  # m a turn, M3


def fan():
    """A frame, its foot at z = 0, and the rotor on its pivot."""
    frame = modelling.box(SIDE, SIDE, DEEP).translated(-SIDE / 2, -SIDE / 2, 0.0)
    frame = frame - modelling.cylinder(0.0135, DEEP).translated(z=0.002) + modelling.cylinder(0.0015, 0.007)
    rotor = modelling.cylinder(0.005, 0.005)
    for k in range(6):
        blade = modelling.box(0.012, 0.001, 0.005).translated(y=-0.0005)
        rotor = rotor + blade.rotated((0.0, 0.0, 1.0), np.pi * k / 3)
    return frame, (rotor - modelling.cylinder(0.0015, 0.0045)).translated(z=0.0025)


def scene():
    housing = modelling.box(0.06, 0.06, TOP).translated(-0.03, -0.03, 0.0)
    housing = housing - modelling.box(SIDE, SIDE, TOP - FOOT).translated(-SIDE / 2, -SIDE / 2, FOOT)
    housing = housing - modelling.cylinder(0.012, TOP)
    for x, y in HOLES:
        housing = housing - modelling.cylinder(0.0015, 0.010).translated(x, y, TOP - 0.010)
    guard = plate(0.05, 0.05, 0.002, HOLES, 0.0032) - modelling.cylinder(0.011, 0.002)
    frame, rotor = fan()
    parts = {
        "housing": (housing, at(), ALUMINIUM),
        "tray": (bench(0.12, 0.12), at(x=0.12), WOOD),
        "guard": (guard, at(z=TOP), STEEL),
        "fan/frame": (frame, at(z=FOOT), RUBBER),
        "fan/rotor": (rotor, at(z=FOOT), STEEL),
        "spare/frame": (frame, at(0.12), (0.1, 0.35, 0.2)),
        "spare/rotor": (rotor, at(0.12), STEEL),
    }
    m3 = bolt(0.003, 0.008, 0.0055, 0.002)
    for name, (x, y) in zip(SCREWS, HOLES, strict=True):
        parts[name] = (m3, at(x, y, TOP + 0.002), BRASS)
    made = modelling.scene(parts)
    made["housing"].fixed = made["tray"].fixed = True
    return made


def task(session):
    hand = session.hand(at=(0.0, 0.0, 0.1))
    for name in SCREWS:
        session.thread(name, PITCH)
    homes = {name: part.pose.copy() for name, part in session.scene.items()}
    hand.unscrew(parts=SCREWS)
    hand.remove("guard")
    hand.exchange("fan", "spare")
    session.expect_free("fan")
    for name in ("frame", "rotor"):
        session.expect_at(f"spare/{name}", homes[f"fan/{name}"], within=1e-6)
    hand.refit("guard")
    hand.screw(parts=SCREWS)
    for name in ("guard", *SCREWS):
        session.expect_at(name, homes[name], within=1e-6)
    session.expect_constraint("against", "guard", "housing")
    session.expect_no_clash()


if __name__ == "__main__":
    vp.main(__file__)
