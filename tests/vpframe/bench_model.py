"""The peg over its bore as a STEP file: the block's top is at z = 0.020, the peg's tip above it."""

from pathlib import Path

import numpy as np
import pinocchio as pin

from vpframe.scene import modelling as m

ABOVE = 0.0005
"""m: of the peg's tip over the block's top"""


def write_bench(path: Path) -> Path:
    """The bench of `bench_scene` without its cube; the peg stands over the bore."""
    peg = m.revolve(
        [(0.0, -0.015), (0.0042, -0.015), (0.005, -0.0142), (0.005, 0.0), (0.008, 0.0), (0.008, 0.005), (0.0, 0.005)]
    )
    block = m.box(0.04, 0.04, 0.02).translated(-0.02, -0.02, 0.0) - m.cylinder(0.00502, 0.02)
    over = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.035 + ABOVE]))
    return m.write_step(path, {"block": (block, pin.SE3.Identity()), "peg": (peg, over)})
