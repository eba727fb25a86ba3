"""Each object its own behaviour: in one room a ball falls and bounces, a box falls and stays, a balloon rises.

The paper's example: what is dropped falls until it stops on the floor, a balloon rises until it reaches the ceiling.
"""

import numpy as np
from parts import STEEL, WOOD, at

import vpframe as vp
from vpframe.scene import modelling

ROOM = 2.4  # m high
RADIUS = 0.15  # m, of the balloon


def scene():
    slab = modelling.box(2.0, 2.0, 0.1).translated(-1.0, -1.0, 0.0)
    made = modelling.scene(
        {
            "floor": (slab, at(z=-0.1), WOOD),
            "ceiling": (slab, at(z=ROOM), (0.9, 0.9, 0.9)),
            "ball": (modelling.sphere(0.05), at(-0.5, 0.0, 1.0), (0.8, 0.3, 0.2), 1100.0),
            "box": (modelling.box(0.2, 0.2, 0.2).translated(-0.1, -0.1, 0.0), at(0.5, 0.0, 0.8), STEEL, 300.0),
            "balloon": (modelling.sphere(RADIUS), at(0.0, 0.4, 0.3), (0.3, 0.5, 0.9)),
        },
        deflection=2e-3,
    )
    made["floor"].fixed = made["ceiling"].fixed = True
    return made


def task(session):
    hand = session.hand(at=(0.5, 0.0, 1.2))
    hand.grab("box")
    session.behave("ball", vp.Gravity(), vp.Elastic(0.7), vp.Friction(0.4))
    session.behave("box", vp.Gravity(), vp.Friction(0.6))
    mass = 0.1664 * 4.0 / 3.0 * np.pi * RADIUS**3 + 0.003  # helium and 3 g of rubber, kg
    session.behave("balloon", vp.Gravity(), vp.Buoyancy(1.204), vp.Drag(area=np.pi * RADIUS**2), mass=mass)

    hand.move_by((0.0, 0.0, 0.3))
    hand.release()
    height = []
    for _ in range(300):
        frame = session.step()
        height.append(frame.poses["ball"].translation[2])
    session.run(3.0)

    def place(name):
        return session.scene[name].pose.translation

    session.expect(min(height) > 0.05 - 2e-3, f"the ball bounces on the floor (lowest {min(height) * 1e3:.1f} mm)")
    session.expect(place("ball")[2] < 0.06, "the ball ends on the floor")
    session.expect(abs(place("box")[2]) < 1e-3, f"the box stands on the floor ({place('box')[2] * 1e3:.3f} mm)")
    gap = ROOM - place("balloon")[2] - RADIUS
    session.expect(abs(gap) < 3e-3, f"the balloon rests at the ceiling ({gap * 1e3:.2f} mm)")
    session.expect({"box"} <= {e.parts[0] for e in session.events if e.kind == "landed"}, "the box has landed")


if __name__ == "__main__":
    vp.main(__file__)
