"""A hinge pin goes into three knuckles; then the door swings about it, and falls shut by itself when let go.

The door hangs over a slope: its hinge axis leans, so that gravity closes it. Before the pin is in, the door is held.
"""

import numpy as np
import pinocchio as pin
from parts import BRASS, STEEL, WOOD, at

import vpframe as vp
from vpframe.scene import modelling

PIN, KNUCKLE = 0.0040, 0.00402


def knuckle(z, height):
    return modelling.cylinder(0.008, height).translated(0.0, 0.0, z)


def scene():
    # the hinge's axis is z through the origin, and leans by 8 degrees against the vertical
    frame = modelling.box(0.04, 0.03, 0.30).translated(-0.06, -0.015, 0.0)
    strap = modelling.box(0.045, 0.006, 0.024)
    for z in (0.050, 0.226):
        frame = frame + knuckle(z, 0.024) + strap.translated(-0.05, -0.003, z)
    door = modelling.box(0.20, 0.02, 0.29).translated(0.02, -0.01, 0.005)
    for z in (0.077, 0.199):
        door = door + knuckle(z, 0.024) + strap.translated(0.0, -0.003, z)
    bore = modelling.cylinder(KNUCKLE, 0.30)
    rod = modelling.revolve(
        [(0.0, -0.22), (0.003, -0.22), (PIN, -0.219), (PIN, 0.0), (0.007, 0.0), (0.007, 0.004), (0.0, 0.004)]
    )
    lean = pin.SE3(pin.exp3(np.radians([0.0, 8.0, 0.0])), np.zeros(3))
    made = modelling.scene(
        {
            "frame": (frame - bore, lean, (0.55, 0.57, 0.60)),
            "door": (door - bore, lean, WOOD, 700.0),
            "pin": (rod, lean * at(z=0.48), BRASS, 8500.0),
            "stop": (modelling.box(0.02, 0.05, 0.05), lean * at(0.17, 0.012, 0.12), STEEL),
        }
    )
    made["frame"].fixed = made["stop"].fixed = True
    return made


def task(session):
    lean = session.scene["frame"].pose.rotation
    hand = session.hand(at=(0.0, -0.05, 0.58))
    hand.grab("pin")
    hand.slide(lean @ np.array([0.0, 0.0, -1.0]), until=vp.constraint("against"))
    for part in ("frame", "door"):
        session.expect_constraint("concentric", "pin", part)
    hand.release()
    session.expect_freedom("pin", 1)

    hand.grab("door")
    session.expect(session.joint("door") in ("revolute", "cylindrical"), "the door hangs on its pin")
    hand.turn(np.radians(-70.0), about=(np.zeros(3), lean @ np.array([0.0, 0.0, 1.0])), duration=1.5)
    opened = session.scene["door"].pose.copy()
    session.expect_no_clash()
    session.behave("door", vp.Gravity(), vp.Friction(0.0))
    hand.release()
    session.run(3.0)
    shut = pin.log3(lean.T @ session.scene["door"].pose.rotation)
    swung = pin.log3(opened.rotation.T @ session.scene["door"].pose.rotation)
    session.expect(float(np.linalg.norm(swung)) > np.radians(65.0), "the door swings when it is let go")
    session.expect(float(np.linalg.norm(shut)) < np.radians(2.0), "it has fallen shut against its stop")
    residual = max(c.residual for c in session.constraints_of("door"))
    session.expect(residual < 1e-6, f"the pin holds the door while it swings (off by {residual:.1e} m)")


if __name__ == "__main__":
    vp.main(__file__)
