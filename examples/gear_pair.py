"""A gear is put on its shaft beside its mate: tooth on tooth it does not go in, half a pitch further it does.

The teeth are straight-sided and have play; what stops the gear is collision alone. Then the script states the coupling:
the hand turns one gear, the other follows at the ratio of their teeth, and no tooth meets another. Without the coupling
the turn ends at the first flank.
"""

from itertools import pairwise

import numpy as np
import pinocchio as pin
from parts import BRASS, STEEL, at

import vpframe as vp
from vpframe.scene import modelling

DRIVER, DRIVEN, MODULE, WIDTH = 20, 30, 0.002, 0.010  # teeth, teeth, m, m
DISTANCE = (DRIVER + DRIVEN) * MODULE / 2 + 0.0004  # m between the axes, 0.4 mm more than the pitch circles
OPTIONS = {"rule": vp.accept_kinds("concentric")}


def gear(teeth):
    pitch = teeth * MODULE / 2
    flank = ((pitch - 1.25 * MODULE, 0.33), (pitch, 0.22), (pitch + MODULE, 0.095))  # radius, half width in pitches
    step = 2.0 * np.pi / teeth
    outline = []
    for k in range(teeth):
        outline += [(radius, (k - half) * step) for radius, half in flank]
        outline += [(radius, (k + half) * step) for radius, half in reversed(flank)]
    solid = modelling.extrude([(r * np.cos(a), r * np.sin(a)) for r, a in outline], WIDTH)
    return solid - modelling.cylinder(0.00502, WIDTH)


def scene():
    base = modelling.box(0.12, 0.05, 0.01).translated(-0.03, -0.025, -0.0121)
    shaft = modelling.revolve([(0.0, 0.0), (0.005, 0.0), (0.005, 0.029), (0.004, 0.030), (0.0, 0.030)])
    for x in (0.0, DISTANCE):
        base = base + shaft.translated(x, 0.0, -0.0021) + modelling.cylinder(0.007, 0.002).translated(x, 0.0, -0.0021)
    turned = pin.SE3(pin.exp3(np.array([0.0, 0.0, np.pi / DRIVEN])), np.array([DISTANCE, 0.0, 0.060]))
    made = modelling.scene(
        {
            "base": (base, at(), (0.5, 0.52, 0.55)),
            "driver": (gear(DRIVER), at(), STEEL),
            "driven": (gear(DRIVEN), turned, BRASS),
        }
    )
    made["base"].fixed = True
    return made


def turned(session, part, since):
    """rad that a part has turned about its shaft since a step."""
    trail = session.trail(part)  # a row for each step in which the part moved
    poses = [pose for step, pose in trail if step <= since][-1:] + [pose for step, pose in trail if step > since]
    return sum(pin.log3(a.rotation.T @ b.rotation)[2] for a, b in pairwise(poses))


def task(session):
    hand = session.hand(at=(DISTANCE, 0.0, 0.10))
    hand.grab("driven")
    # a tooth points at a tooth: the gear goes onto the shaft, but not down between the driver's teeth
    hand.turn(np.pi / DRIVEN, about="up")
    hand.slide("down", until=vp.constraint("concentric", other="base"))
    outcome = hand.slide("down", distance=0.050, required=False)
    session.expect(not outcome and "driver" in outcome.reason, "tooth meets tooth, and the gear is stopped")
    session.expect_at("driven", (DISTANCE, 0.0, WIDTH), within=1e-4, angle=4.0)
    # half a pitch further it goes in
    hand.move_by((0.0, 0.0, 0.002))
    hand.turn(np.pi / DRIVEN, about="axis")
    hand.slide("down", distance=WIDTH + 0.002, required=False)
    session.expect_at("driven", (DISTANCE, 0.0, 0.0), within=1e-3, angle=4.0)
    session.expect_freedom("driven", 2)
    hand.release()
    # coupled, one turn of the driver turns the driven gear by the ratio of their teeth
    hand.grab("driver")
    coupling = session.constrain("gear", "driver", "driven", teeth=(DRIVER, DRIVEN))
    session.step()
    session.expect_constraint("gear", "driver", "driven")
    since, heard = session.step_count, len(session.events)
    hand.turn(2.0 * np.pi, about="axis")
    here, there = turned(session, "driver", since), turned(session, "driven", since)
    session.expect(abs(here - 2.0 * np.pi) < 1e-9, "the driver has made one turn")
    session.expect(abs(there + here * DRIVER / DRIVEN) < 1e-9, f"the driven gear has made {-there / here:.9f} of it")
    met = [e.text for e in session.events[heard:] if e.kind in ("collided", "blocked")]
    session.expect(not met, f"no tooth met another on the way ({len(met)} clashes)")
    session.expect_no_clash()
    # without the coupling the driven gear stands, and the next flank stops the hand
    session.remove(coupling)
    outcome = hand.turn(np.pi / 2, about="axis", required=False)
    session.expect(not outcome and "driven" in outcome.reason, "uncoupled, the driver is stopped by the teeth")
    session.expect_no_clash()
    hand.release()


if __name__ == "__main__":
    vp.main(__file__)
