"""A stepped shaft goes into its housing until the flange sits, is turned, and comes out again.

The shortest tour of the verbs: grab, insert, turn, pull, place. `insert` finds the bore that the shaft fits by itself.
"""

import numpy as np
from parts import BRASS, STEEL, WOOD, at, bench

import vpframe as vp
from vpframe.scene import modelling

OPTIONS = {"rule": vp.accept_kinds("concentric", "against"), "clearance": True}


def scene():
    housing = modelling.box(0.08, 0.08, 0.045).translated(-0.04, -0.04, 0.0) - modelling.cylinder(0.01002, 0.045)
    shaft = modelling.revolve(
        [(0.0, -0.040), (0.0085, -0.040), (0.010, -0.0385), (0.010, 0.0), (0.022, 0.0), (0.022, 0.006),
         (0.014, 0.006), (0.014, 0.022), (0.008, 0.022), (0.008, 0.045), (0.0, 0.045)]
    )  # fmt: skip
    made = modelling.scene(
        {
            "bench": (bench(0.4, 0.2), at(), WOOD),
            "housing": (housing, at(), STEEL),
            "shaft": (shaft, at(x=0.12, z=0.0401), BRASS),
        }
    )
    made["bench"].fixed = made["housing"].fixed = True
    return made


def task(session):
    hand = session.hand(at=(0.12, 0.0, 0.15))
    session.sweep("shaft")
    hand.grab("shaft")
    hand.move_by((0.0, 0.0, 0.06))
    hand.insert("housing")
    session.expect_constraint("concentric", "shaft", "housing")
    session.expect_freedom("shaft", 1)
    session.expect_at("shaft", (0.0, 0.0, 0.045), within=1e-6)

    hand.turn(np.pi / 2, about="axis")
    hand.pull(along="axis", until=~vp.constraint("against"))
    session.expect_freedom("shaft", 2)
    hand.pull(along="axis", until="free")
    session.expect_freedom("shaft", 6)
    hand.move_by((0.0, 0.0, 0.01))
    hand.place("bench", at=(0.12, 0.0))
    session.expect_constraint("against", "shaft", "bench")
    session.expect_no_clash()


if __name__ == "__main__":
    vp.main(__file__)
