"""Scenes of fits, piles and curved faces."""

import numpy as np
import pinocchio as pin

from vpframe.analysis.clash import clash
from vpframe.analysis.pairs import by_parts
from vpframe.scene import modelling as m
from vpframe.scene.modelling import box, cylinder


def kinds(rows):
    return {row.kind for row in rows}


AT_HOME = pin.SE3.Identity()


def at(x=0.0, y=0.0, z=0.0):
    return pin.SE3(np.eye(3), np.array([x, y, z], dtype=float))


def heap():
    """A cube that a plate cuts and a post touches; two further plates that only touch."""
    cube, slab = m.box(0.02, 0.02, 0.02), m.box(0.02, 0.02, 0.005)
    poses = {"cube": (cube, AT_HOME), "stack/plate": (slab, at(z=0.019)), "post": (cube, at(x=0.02))}
    return m.scene({**poses, "stack/top": (slab, at(z=0.024)), "lid": (slab, at(z=0.029))})


# --- the gap of curved faces is that of their surfaces ----------------------------------------------------------------


def worst(parts, clearance=1e-3, **options):
    """The gravest row of the two parts of a scene."""
    (pair,) = by_parts(clash(m.scene(parts, **options), clearance))
    return pair.worst


def pin_in_bore(interference=1e-4):
    """A pin, too large all round, in a blind bore."""
    block = box(0.04, 0.04, 0.02).translated(-0.02, -0.02) - cylinder(0.005, 0.015).translated(z=0.005)
    return {"block": block, "pin": cylinder(0.005 + interference, 0.03).translated(z=0.005)}


def key_in_slot():
    """A key, 0.1 mm too wide on either side and at its bottom, in an open slot."""
    block = box(0.04, 0.03, 0.02) - box(0.02, 0.008, 0.02).translated(0.01, 0.011, 0.01)
    return {"block": block, "key": box(0.0204, 0.0084, 0.0101).translated(0.0098, 0.0108, 0.0099)}


def wedge_in_plate():
    """A plug whose square shank is driven 0.05 mm into the plate around it."""
    plate = box(0.04, 0.04, 0.01).translated(-0.02, -0.02) - box(0.01, 0.01, 0.01).translated(-0.005, -0.005)
    return {"plate": plate, "plug": box(0.0101, 0.0101, 0.02).translated(-0.00505, -0.00505, -0.005)}


def moved(session, part, way):
    hand = session.hand()
    hand.grab(part)
    outcome = hand.move_by(way, required=False)
    hand.release()
    return outcome
