"""A gear is put on its shaft beside its mate: tooth on tooth it does not go in, half a pitch further it does.

The teeth are straight-sided and have play; what stops the gear is collision alone. Then the driven gear is tried.
"""

import numpy as np
import pinocchio as pin
from parts import BRASS, STEEL, at

import vpframe.study
from vpframe import modelling
from vpframe.interaction import constraint
from vpframe.rules import accept_kinds

TEETH, MODULE, WIDTH = 20, 0.002, 0.010
DISTANCE = TEETH * MODULE + 0.0004  # m between the axes, 0.4 mm more than the pitch circles
OPTIONS = {"rule": accept_kinds("concentric")}


def gear():
    pitch, tip, root = TEETH * MODULE / 2, TEETH * MODULE / 2 + MODULE, TEETH * MODULE / 2 - 1.25 * MODULE
    outline = []
    for k in range(TEETH):
        middle = 2.0 * np.pi * k / TEETH
        for radius, half in ((root, 0.105), (pitch, 0.070), (tip, 0.030)):
            outline.append((radius, middle - half))
        for radius, half in ((tip, 0.030), (pitch, 0.070), (root, 0.105)):
            outline.append((radius, middle + half))
    solid = modelling.extrude([(r * np.cos(a), r * np.sin(a)) for r, a in outline], WIDTH)
    return solid - modelling.cylinder(0.00502, WIDTH)


def scene():
    base = modelling.box(0.10, 0.05, 0.01).translated(-0.03, -0.025, -0.0121)
    shaft = modelling.revolve([(0.0, 0.0), (0.005, 0.0), (0.005, 0.029), (0.004, 0.030), (0.0, 0.030)])
    for x in (0.0, DISTANCE):
        base = base + shaft.translated(x, 0.0, -0.0021) + modelling.cylinder(0.007, 0.002).translated(x, 0.0, -0.0021)
    wheel = gear()
    turned = pin.SE3(pin.exp3(np.array([0.0, 0.0, np.pi / TEETH])), np.array([DISTANCE, 0.0, 0.060]))
    made = modelling.scene(
        {"base": (base, at(), (0.5, 0.52, 0.55)), "driver": (wheel, at(), STEEL), "driven": (wheel, turned, BRASS)}
    )
    made["base"].fixed = True
    return made


def task(session):
    hand = session.hand(at=(DISTANCE, 0.0, 0.10))
    hand.grab("driven")
    # a tooth points at a tooth: the gear goes onto the shaft, but not down between the driver's teeth
    hand.turn(np.pi / TEETH, about="up")
    hand.slide("down", until=constraint("concentric", other="base"))
    outcome = hand.slide("down", distance=0.050, required=False)
    session.expect(not outcome and "driver" in outcome.reason, "tooth meets tooth, and the gear is stopped")
    session.expect_at("driven", (DISTANCE, 0.0, WIDTH), within=1e-4, angle=4.0)
    # half a pitch further it goes in
    hand.move_by((0.0, 0.0, 0.002))
    hand.turn(np.pi / TEETH, about="axis")
    hand.slide("down", distance=WIDTH + 0.002, required=False)
    session.expect_at("driven", (DISTANCE, 0.0, 0.0), within=1e-3, angle=4.0)
    session.expect_freedom("driven", 2)
    outcome = hand.turn(np.pi / 2, about="axis", required=False)
    session.expect(not outcome and "driver" in outcome.reason, "in mesh it does not turn while the driver stands")
    session.expect_no_clash()
    hand.release()


if __name__ == "__main__":
    vpframe.study.main(__file__)
