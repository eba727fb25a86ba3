"""One bolt with its nut out of a bolted joint, laid on the bench, and back in again.

Two hands: one keeps the bolt, the other runs the nut off. The nut's pitch is what the script says of the thread.
"""

import numpy as np
from parts import ALUMINIUM, BRASS, STEEL, WOOD, at, bench, bolt, nut, plate

import vpframe as vp
from vpframe.scene import modelling

HOLES = [(x, y) for y in (-0.02, 0.02) for x in (-0.035, 0.035)]
PITCH = 0.00125  # m a turn, M8


def scene():
    flange = plate(0.1, 0.07, 0.008, HOLES, 0.0084)
    m8, m8_nut = bolt(0.008, 0.028, 0.013, 0.0053), nut(0.008, 0.013, 0.0065)
    parts = {
        "lower": (flange, at(), ALUMINIUM),
        "upper": (flange, at(z=0.008), ALUMINIUM),
        "bench": (bench(0.2, 0.15), at(x=0.2, z=-0.04), WOOD),
    }
    for i, (x, y) in enumerate(HOLES, start=1):
        parts[f"bolt_{i}"] = (m8, at(x, y, 0.016), STEEL)
        parts[f"nut_{i}"] = (m8_nut, at(x, y, -0.0065), BRASS)
    made = modelling.scene(parts)
    for name in ("lower", "upper", "bench"):
        made[name].fixed = True
    return made


def task(session):
    left, right = session.hand("left", at=(-0.035, -0.02, 0.1)), session.hand("right", at=(-0.1, -0.1, -0.05))
    home, nut_home = session.scene["bolt_1"].pose.copy(), session.scene["nut_1"].pose.copy()
    session.thread("bolt_1", PITCH)
    session.thread("nut_1", PITCH)

    left.grab("bolt_1")
    right.grab("nut_1")
    session.expect_constraint("concentric", "bolt_1", "nut_1")
    session.expect_constraint("against", "nut_1", "lower")
    right.unscrew(until="free", rate=6.0)
    right.move_by((0.0, 0.0, -0.02))
    right.move_by((0.0, -0.06, 0.0))
    right.place("bench", at=(0.15, 0.0))
    session.expect_constraint("against", "nut_1", "bench")

    left.pull(along="axis", until="free")
    session.expect_freedom("bolt_1", 6)
    left.move_by((0.0, 0.0, 0.02))
    left.move_to((0.2, 0.0, 0.05))
    left.move_to(home.translation + np.array([0.0, 0.0, 0.05]))

    left.slide("down", until=vp.constraint("concentric", other="upper"))
    left.slide("down", until=vp.constraint("against", other="upper"))
    session.expect_at("bolt_1", home, within=1e-6, angle=4.0)

    right.approach("nut_1")
    right.grab("nut_1")
    right.move_by((0.0, 0.0, 0.03))
    right.move_to((-0.035, -0.1, 0.0))
    right.move_to((-0.035, -0.1, -0.04))
    right.move_to(nut_home.translation - np.array([0.0, 0.0, 0.03]))
    right.slide("up", until=vp.constraint("concentric", other="bolt_1"))
    right.screw(rate=6.0)
    session.expect_constraint("against", "nut_1", "lower")
    right.release()
    left.release()
    for part, kind in (("upper", "concentric"), ("upper", "against"), ("nut_1", "concentric")):
        session.expect_constraint(kind, "bolt_1", part)
    session.expect_no_clash()


if __name__ == "__main__":
    vp.main(__file__)
