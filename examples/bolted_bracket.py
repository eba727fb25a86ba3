"""An L-bracket on its plate, two bolts with nuts from below and a rod through its eye: apart and together again."""

import numpy as np
from parts import ALUMINIUM, BRASS, STEEL, WOOD, at, bench, bolt, nut, plate

import vpframe as vp
from vpframe.scene import modelling

HOLES = [(-0.02, 0.0), (0.02, 0.0)]
PITCH = 0.0015  # m a turn, M10


def scene():
    base = plate(0.18, 0.08, 0.020, HOLES, 0.0104)
    foot = plate(0.08, 0.06, 0.010, HOLES, 0.0104)
    web = modelling.box(0.08, 0.010, 0.07).translated(-0.04, 0.020, 0.0)
    eye = modelling.cylinder(0.00502, 0.010).rotated((1.0, 0.0, 0.0), -np.pi / 2).translated(0.0, 0.020, 0.05)
    bracket = foot + web - eye
    rod = modelling.revolve(
        [(0.0, -0.06), (0.0042, -0.06), (0.005, -0.0592), (0.005, 0.0), (0.009, 0.0), (0.009, 0.006), (0.0, 0.006)]
    ).rotated((1.0, 0.0, 0.0), np.pi / 2)
    m10, m10_nut = bolt(0.010, 0.042, 0.016, 0.0064), nut(0.010, 0.016, 0.008)
    parts = {
        "plate": (base, at(), ALUMINIUM),
        "bench": (bench(0.3, 0.3), at(x=0.35, z=-0.05), WOOD),
        "bracket": (bracket, at(z=0.020), STEEL),
        "rod": (rod, at(0.0, 0.020, 0.070), BRASS),
    }
    for i, (x, y) in enumerate(HOLES, start=1):
        parts[f"bolt_{i}"] = (m10, at(x, y, 0.030), STEEL)
        parts[f"nut_{i}"] = (m10_nut, at(x, y, -0.008), BRASS)
    made = modelling.scene(parts)
    made["plate"].fixed = made["bench"].fixed = True
    return made


def task(session):
    scene = session.scene
    top, below = session.hand("top", at=(0.0, -0.10, 0.15)), session.hand("below", at=(0.0, -0.10, -0.08))
    names = [p.name for p in scene.parts if not p.fixed]
    homes = {name: scene[name].pose.copy() for name in names}
    session.expect_constraint("concentric", "rod", "bracket")

    top.grab("rod")
    top.pull(along="axis", until="free")
    top.move_by((0.0, -0.03, 0.0))
    top.move_to((0.30, -0.05, 0.10))
    top.release()
    for i in (1, 2):
        below.grab(f"nut_{i}")
        below.unscrew(pitch=PITCH, until="free", rate=8.0)
        below.move_by((0.0, 0.0, -0.02))
        below.move_to((0.30 - 0.04 * i, -0.10, -0.10))
        below.release()
        top.grab(f"bolt_{i}")
        top.pull(along="axis", until="free")
        top.move_by((0.0, 0.0, 0.05))
        top.move_to((0.36 - 0.04 * i, 0.08, 0.20))
        top.release()
    top.grab("bracket")
    top.pull(along="up", until="free")
    top.move_by((0.0, 0.0, 0.04))
    session.expect_freedom("bracket", 6)
    session.expect_no_clash()

    top.slide("down", until=vp.constraint("against", other="plate"))
    top.move_to(homes["bracket"], duration=0.3)
    top.release()
    for i in (2, 1):
        top.grab(f"bolt_{i}")
        top.move_to(homes[f"bolt_{i}"].translation + np.array([0.0, 0.0, 0.06]))
        top.slide("down", until=vp.constraint("concentric", other="plate"))
        top.slide("down", until=vp.constraint("against", other="bracket"))
        below.grab(f"nut_{i}")
        below.move_to(homes[f"nut_{i}"].translation - np.array([0.0, 0.0, 0.05]))
        below.slide("up", until=vp.constraint("concentric", other=f"bolt_{i}"))
        below.screw(pitch=PITCH, until=vp.constraint("against", other="plate"), rate=8.0)
        below.release()
        top.release()
    top.grab("rod")
    top.move_to(homes["rod"].translation + np.array([0.0, -0.09, 0.0]))
    top.slide("y", until=vp.constraint("against", other="bracket"))
    top.release()
    for name in names:
        session.expect_at(name, homes[name], within=1e-4, angle=4.0)
    session.expect_no_clash()


if __name__ == "__main__":
    vp.main(__file__)
