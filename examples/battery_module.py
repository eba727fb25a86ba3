"""A module of a battery pack is swapped: lid off, busbar off, module out with two hands at once, the spare in.

Clearance is watched all the way: the module must not come nearer than half a millimetre to its neighbours' cells.
"""

import numpy as np
from parts import ALUMINIUM, BRASS, WOOD, at, bench

import vpframe as vp
from vpframe.scene import modelling

SIZE = np.array([0.060, 0.100, 0.050])  # m, of a module
OPTIONS = {"rule": vp.accept_kinds("against"), "clearance": True}


def scene():
    tray = modelling.box(0.22, 0.13, 0.08).translated(-0.11, -0.065, 0.0)
    tray = tray - modelling.box(0.20, 0.11, 0.075).translated(-0.10, -0.055, 0.005)
    block = modelling.box(*SIZE).translated(-SIZE[0] / 2, -SIZE[1] / 2, 0.0)
    handle = modelling.box(0.03, 0.008, 0.012).translated(-0.015, 0.0, SIZE[2])
    module = block + handle.translated(0.0, 0.035, 0.0) + handle.translated(0.0, -0.043, 0.0)
    busbar = modelling.box(0.16, 0.012, 0.003).translated(-0.08, -0.006, 0.0)
    lid = modelling.box(0.22, 0.13, 0.004).translated(-0.11, -0.065, 0.0)
    made = modelling.scene(
        {
            "tray": (tray, at(), ALUMINIUM),
            "bench": (bench(0.4, 0.3), at(x=0.40), WOOD),
            "left": (module, at(-0.0645, 0.0, 0.005), (0.2, 0.3, 0.5)),
            "old": (module, at(0.0, 0.0, 0.005), (0.5, 0.2, 0.2)),
            "right": (module, at(0.0645, 0.0, 0.005), (0.2, 0.3, 0.5)),
            "spare": (module, at(0.42, 0.05, 0.0), (0.2, 0.5, 0.3)),
            "busbar": (busbar, at(0.0, 0.0, 0.055), BRASS),
            "lid": (lid, at(z=0.080), (0.3, 0.3, 0.32)),
        }
    )
    for name in ("tray", "bench", "left", "right"):
        made[name].fixed = True
    return made


def task(session):
    one, two = session.hand("one", at=(-0.1, 0.0, 0.15)), session.hand("two", at=(0.1, 0.0, 0.20))
    home = session.scene["old"].pose.copy()
    bar = session.scene["busbar"].pose.copy()

    one.grab("lid")
    one.pull(along="up", until="free")
    one.move_by((0.0, 0.0, 0.15))
    one.move_to((0.0, 0.40, 0.10))
    one.release()
    one.grab("busbar")
    one.pull(along="up", until="free")
    one.move_by((0.0, 0.0, 0.10))

    one.move_by((0.0, 0.0, 0.05))
    two.grab("old")
    two.pull(along="up", until="free")
    session.expect(session.clearance("old", "left") > 5e-4, "room to the cells on the left")
    one.move_by((0.0, -0.25, 0.0))
    with session.together():  # one hand lowers the busbar while the other lifts the module
        one.move_by((0.0, 0.0, -0.05))
        two.move_by((0.0, 0.0, 0.12))
    two.place("bench", at=(0.42, -0.08))
    session.expect_constraint("against", "old", "bench")

    two.grab("spare")
    two.pull(along="up", until="free")
    two.move_by((0.0, 0.0, 0.15))
    two.move_to(home.translation + np.array([0.0, 0.0, 0.15]))
    two.slide("down", until=vp.constraint("against", other="tray"))
    session.expect_at("spare", home, within=1e-5)
    session.expect(session.clearance("spare", "right") > 5e-4, "room to the cells on the right")
    two.release()
    one.move_by((0.0, 0.0, 0.05))
    one.move_by((0.0, 0.25, 0.0))
    one.slide("down", until=vp.constraint("against", other="spare"))
    session.expect_at("busbar", bar, within=1e-4)
    one.release()
    session.expect_no_clash()


if __name__ == "__main__":
    vp.main(__file__)
