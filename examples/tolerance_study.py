"""A study: a shaft under ISO 286 tolerances goes into its bore, in a hand that is not exact.

Fits from clearance to interference; shaft and bore vary within their zones. It goes in if there is clearance left, so
that the rate has a closed form: `expected_rate(fit)`. Run alone, the script takes the nominal variant.
"""

from functools import cache
from math import erf, hypot, radians

import numpy as np
import pinocchio as pin
from parts import BRASS, STEEL, at

import vpframe as vp
from vpframe.scene import modelling

DIAMETER = 0.020  # m
BORE = (0.0, 21.0)  # um, H7 at 18 to 30 mm (ISO 286-2)
SHAFTS = {"h6": (-13.0, 0.0), "js6": (-6.5, 6.5), "k6": (2.0, 15.0), "m6": (8.0, 21.0), "p6": (22.0, 35.0)}  # um

VARIANTS = {
    "fit": vp.Choice(*SHAFTS),
    "bore": vp.Normal(0.0, 1 / 6),  # place in the zone, from -1/2 to 1/2: a process of Cp = 1
    "shaft": vp.Normal(0.0, 1 / 6),
    "offset": vp.Normal(0.0, 1e-4, unit="m"),  # of the hand from the axis
    "tilt": vp.Normal(0.0, radians(0.1), unit="rad"),
}


def refuse_interference(candidate):
    """A hand has no press."""
    return "refuse" if "interference" in candidate.why else None


OPTIONS = {"rule": vp.first_of(refuse_interference, vp.accept_kinds("concentric", "against"))}


def size(zone, place):
    """Diameter (m) at a place in a zone (um)."""
    low, high = zone
    return DIAMETER + 1e-6 * (0.5 * (low + high) + place * (high - low))


def expected_rate(fit):
    """Probability that the bore is wider than the shaft: both are normal, and so is their difference."""
    clearance = 1e6 * (size(BORE, 0.0) - size(SHAFTS[fit], 0.0))
    spread = hypot(*(np.ptp(zone) / 6 for zone in (BORE, SHAFTS[fit])))
    return 0.5 * (1.0 + erf(clearance / spread / np.sqrt(2.0)))


@cache
def block():
    return modelling.box(0.05, 0.05, 0.03).translated(-0.025, -0.025, 0.0)


def scene(v):
    r = size(SHAFTS[v["fit"]], v["shaft"]) / 2
    shaft = modelling.revolve(
        [(0.0, -0.025), (r - 0.0015, -0.025), (r, -0.0235), (r, 0.0), (0.016, 0.0), (0.016, 0.006), (0.0, 0.006)]
    )
    housing = block() - modelling.cylinder(size(BORE, v["bore"]) / 2, 0.03)
    made = modelling.scene({"housing": (housing, at(), STEEL), "shaft": (shaft, at(z=0.07), BRASS)})
    made["housing"].fixed = True
    return made


def task(session, v):
    hand = session.hand(at=(0.0, 0.0, 0.12))
    hand.grab("shaft")
    tilt = pin.exp3(np.array([v["tilt"], 0.0, 0.0]))
    hand.move_to(pin.SE3(tilt, np.array([v["offset"], 0.0, 0.058])))
    hand.slide("down", until=vp.constraint("against", other="housing"))
    session.expect_constraint("concentric", "shaft", "housing")
    session.expect_at("shaft", (0.0, 0.0, 0.03), within=1e-6)
    return {"radial clearance (um)": 5e5 * (size(BORE, v["bore"]) - size(SHAFTS[v["fit"]], v["shaft"]))}


if __name__ == "__main__":
    vp.main(__file__)
