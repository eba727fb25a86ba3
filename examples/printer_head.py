"""The part cooling fan of a real printer's head is exchanged for another of its kind; its pocket has no clearance.

Needs `step/um2_head.step` (Ultimaker 2) in the folder that VPFRAME_DATA names.
"""

import os
from pathlib import Path

import numpy as np
import pinocchio as pin

import vpframe as vp

FAN, BASE, ROTOR = "1330-Z1P-B", "1330 Fan Base 25x25", "1330 Fan Rotor 25x25"


def scene():
    folder = os.environ.get("VPFRAME_DATA")
    if not folder:
        raise vp.VpframeError("printer_head.py: set VPFRAME_DATA to the folder that has step/um2_head.step")
    head = vp.load(Path(folder) / "step" / "um2_head.step")
    aside = pin.SE3(np.eye(3), np.array([0.1, 0.0, 0.0]))
    for name in (BASE, ROTOR):
        old = head[f"{FAN}/{name}"]
        head.add(vp.Part(f"spare/{name}", old.shape, aside * old.pose))
    return head


def task(session):
    hand = session.hand()
    homes = {name: session.scene[f"{FAN}/{name}"].pose.copy() for name in (BASE, ROTOR)}
    hand.exchange(FAN, "spare", along="-z")
    session.expect_free(FAN)
    for name, home in homes.items():
        session.expect_at(f"spare/{name}", home, within=1e-6)


if __name__ == "__main__":
    vp.main(__file__)
