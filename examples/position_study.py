"""A study: a cover on dowels is bolted down, and the holes of the cover are not quite where they should be.

A bolt goes in if its hole is off by no more than the radial clearance. Each is off by a normal error in x and y: the
distance follows Rayleigh's distribution, and the rate of four bolts has a closed form, `expected_rate()`.
"""

from functools import cache
from math import exp

import numpy as np
from parts import ALUMINIUM, BRASS, STEEL, at

import vpframe as vp
from vpframe.scene import modelling

HOLES = [(0.03, 0.03), (-0.03, -0.03), (-0.03, 0.03), (0.03, -0.03)]
BOLT, HOLE, DEVIATION = 0.006, 0.0064, 8e-5  # m: diameters, standard deviation of a hole's x and y
COVER = 0.006  # m thick
FINE = 2e-6  # m: facets stray from their cylinders by less than anything here that matters

VARIANTS = {f"{axis}{i}": vp.Normal(0.0, DEVIATION, unit="m") for i in range(1, 5) for axis in "xy"}

# a bolt is guided by its thread in the housing alone; the hole of the cover leaves it room, or stops it
NO_GUIDE = [vp.refuse_between("cover", f"bolt_{i}", "concentric") for i in range(1, 5)]
OPTIONS = {
    "rule": vp.first_of(*NO_GUIDE, vp.accept_kinds("concentric", "against")),
    "tolerance": vp.Tolerance(linear=1e-6),  # m: what is nearer touches; at the usual 10 um a bolt would jam that early
}


def expected_rate():
    """Probability that four independent errors stay within the radial clearance."""
    return (1.0 - exp(-0.5 * (0.5 * (HOLE - BOLT) / DEVIATION) ** 2)) ** 4


@cache
def unvaried():
    """Housing and bolt, the same in all variants: meshed once a process."""
    housing = modelling.box(0.09, 0.09, 0.02).translated(-0.045, -0.045, -0.02)
    for x, y in HOLES:
        housing = housing - modelling.cylinder(BOLT / 2, 0.016).translated(x, y, -0.016)
    r = BOLT / 2
    shank = modelling.revolve([(0.0, -0.018), (r - 5e-4, -0.018), (r, -0.0175), (r, 0.001), (0.0, 0.001)])
    bolt = shank + modelling.hexagon(0.010, 0.004)
    return modelling.shape(housing, FINE, name="housing"), modelling.shape(bolt, FINE, name="bolt")


def scene(v):
    cover = modelling.box(0.09, 0.09, COVER).translated(-0.045, -0.045, 0.0)
    for i, (x, y) in enumerate(HOLES, start=1):
        cover = cover - modelling.cylinder(HOLE / 2, COVER).translated(x + v[f"x{i}"], y + v[f"y{i}"], 0.0)
    housing, bolt = unvaried()
    parts = [
        vp.Part("housing", housing, at(), ALUMINIUM, fixed=True),
        vp.Part("cover", modelling.shape(cover, FINE, name="cover"), at(), STEEL, fixed=True),
    ]
    parts += [vp.Part(f"bolt_{i}", bolt, at(x, y, 0.06), BRASS) for i, (x, y) in enumerate(HOLES, start=1)]
    return vp.Scene(parts)


def task(session, v):
    hand = session.hand(at=(0.0, 0.0, 0.12))
    for i, (x, y) in enumerate(HOLES, start=1):
        name = f"bolt_{i}"
        hand.grab(name)
        hand.slide("down", until=vp.constraint("against", other="cover"))
        session.expect_constraint("concentric", name, "housing")
        session.expect_at(name, (x, y, COVER), within=1e-5)
        hand.release()
    session.expect_no_clash()
    return {"worst hole (mm)": max(1e3 * np.hypot(v[f"x{i}"], v[f"y{i}"]) for i in range(1, len(HOLES) + 1))}


if __name__ == "__main__":
    vp.main(__file__)
