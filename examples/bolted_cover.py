"""A seal is exchanged: four bolts out, cover off, old seal out, new seal in, cover and bolts back.

The bolts are undone crosswise, as a fitter does it; each is laid on the tray by name.
"""

import numpy as np
from parts import ALUMINIUM, BRASS, RUBBER, STEEL, WOOD, at, bench, bolt, plate

import vpframe as vp
from vpframe.scene import modelling

HOLES = [(0.03, 0.03), (-0.03, -0.03), (-0.03, 0.03), (0.03, -0.03)]  # crosswise
PITCH = 0.001  # m a turn, M6
TOP = 0.040  # m, of the housing


def scene():
    housing = modelling.box(0.09, 0.09, TOP).translated(-0.045, -0.045, 0.0)
    housing = housing - modelling.box(0.03, 0.03, 0.03).translated(-0.015, -0.015, 0.01)
    groove = modelling.cylinder(0.0250, 0.0015) - modelling.cylinder(0.0225, 0.0015)
    housing = housing - groove.translated(0.0, 0.0, TOP - 0.0015)
    for x, y in HOLES:
        housing = housing - modelling.cylinder(0.003, 0.016).translated(x, y, TOP - 0.016)
    cover = plate(0.09, 0.09, 0.006, HOLES, 0.0064)
    seal = (modelling.cylinder(0.02495, 0.0015) - modelling.cylinder(0.02255, 0.0015)).translated(0.0, 0.0, -0.0015)
    m6 = bolt(0.006, 0.018, 0.010, 0.004)
    parts = {
        "housing": (housing, at(), ALUMINIUM),
        "tray": (bench(0.25, 0.2), at(x=0.25), WOOD),
        "cover": (cover, at(z=TOP), STEEL),
        "old_seal": (seal, at(z=TOP), RUBBER),
        "new_seal": (seal, at(0.32, 0.0, 0.0015), (0.1, 0.35, 0.2)),
    }
    for i, (x, y) in enumerate(HOLES, start=1):
        parts[f"bolt_{i}"] = (m6, at(x, y, TOP + 0.006), BRASS)
    made = modelling.scene(parts)
    made["housing"].fixed = made["tray"].fixed = True
    return made


def task(session):
    hand = session.hand(at=(0.0, 0.0, 0.12))
    bolts = [f"bolt_{i}" for i in range(1, 5)]
    homes = {name: session.scene[name].pose.copy() for name in (*bolts, "cover", "old_seal")}
    for i, name in enumerate(bolts):
        session.thread(name, PITCH)
        hand.grab(name)
        hand.unscrew(until="free", rate=8.0)
        hand.move_by((0.0, 0.0, 0.03))
        hand.move_to((0.29 - 0.03 * i, -0.07, 0.10))
        hand.release()

    hand.grab("cover")
    hand.pull(along="up", until="free")
    hand.move_by((0.0, 0.0, 0.03))
    hand.move_to((0.0, 0.2, 0.10))
    hand.release()

    hand.grab("old_seal")
    hand.pull(along="up", until="free")
    hand.move_by((0.0, 0.0, 0.02))
    hand.place("tray", at=(0.25, 0.05))

    hand.grab("new_seal")
    hand.move_by((0.0, 0.0, 0.06))
    hand.move_to(homes["old_seal"].translation + np.array([0.0, 0.0, 0.01]))
    hand.slide("down", until=vp.constraint("against", other="housing"))
    session.expect_constraint("concentric", "new_seal", "housing")
    session.expect_at("new_seal", homes["old_seal"].translation, within=1e-5)
    hand.release()

    hand.grab("cover")
    hand.move_to(homes["cover"].translation + np.array([0.0, 0.0, 0.02]))
    hand.slide("down", until=vp.constraint("against", other="housing"))
    hand.release()
    for name in reversed(bolts):  # the nearest first, so that none is in the way of another
        hand.grab(name)
        hand.move_to(homes[name].translation + np.array([0.0, 0.0, 0.025]))
        hand.slide("down", until=vp.constraint("concentric", other="housing"))
        hand.screw(until=vp.constraint("against", other="cover"), rate=8.0)
        session.expect_at(name, homes[name], within=1e-5, angle=4.0)
        hand.release()
    session.expect_no_clash()


if __name__ == "__main__":
    vp.main(__file__)
