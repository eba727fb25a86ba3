"""A digger's pin goes through fork and arm until its plate sits: the paper's case, and its figure 3.

The fork has a second eye of the same size beside the first, and the machine leans, so its boxes are wide. Over the
bridge between both eyes the box of the pin overlaps boxes of bores that the pin does not touch: a recogniser that looks
at boxes offers constraints there; one that looks at surfaces must not. The task counts what boxes would have offered,
and expects that nothing was offered there, and only the eye and the seat when the pin is in.
"""

import numpy as np
import pinocchio as pin
from parts import ALUMINIUM, STEEL, at

import vpframe as vp
from vpframe.scene import modelling

PIN, EYE = 0.0250, 0.0253
LEAN = pin.SE3(pin.exp3(np.array([0.5, 0.4, 0.0])), np.zeros(3))  # machines seldom stand along the axes
OPTIONS = {"tolerance": vp.Tolerance(clearance=5e-4)}


def scene():
    lug = modelling.box(0.22, 0.10, 0.025).translated(-0.05, -0.05, 0.0)
    for x in (0.0, 0.085):  # the eye, and one beside it for a longer stroke
        lug = lug - modelling.cylinder(EYE, 0.025).translated(x, 0.0, 0.0)
    web = modelling.box(0.05, 0.10, 0.131).translated(0.17, -0.05, -0.106)
    fork = lug.translated(0.0, 0.0, 0.0) + lug.translated(0.0, 0.0, -0.106) + web
    arm = modelling.cylinder(0.05, 0.078) + modelling.box(0.4, 0.06, 0.06).translated(-0.4, -0.03, 0.009)
    arm = arm - modelling.cylinder(EYE, 0.078)
    bolt = modelling.revolve([(0.0, -0.115), (0.021, -0.115), (PIN, -0.109), (PIN, 0.0), (0.0, 0.0)]) + modelling.box(
        0.11, 0.07, 0.01
    ).translated(-0.035, -0.035, 0.0)
    made = modelling.scene(
        {
            "fork": (fork, LEAN, (0.85, 0.62, 0.15)),
            "arm": (arm, LEAN * at(z=-0.08), ALUMINIUM),
            "pin": (bolt, LEAN * at(x=-0.15, z=0.30), STEEL),
        }
    )
    made["fork"].fixed = made["arm"].fixed = True
    return made


def boxes_overlap(session, a, b):
    """Pairs of cylinders of two parts that fit and whose axis-aligned boxes overlap, as faces of either."""
    found = set()
    for i, j in np.ndindex(len(a.features), len(b.features)):
        f, g = a.features[i], b.features[j]
        if not (isinstance(f.geometry, vp.Cylinder) and isinstance(g.geometry, vp.Cylinder)):
            continue
        if f.sense * g.sense > 0 or abs(f.geometry.radius - g.geometry.radius) > session.tolerance.clearance:
            continue
        p, q = (x.samples @ part.pose.rotation.T + part.pose.translation for x, part in ((f, a), (g, b)))
        if (p.min(0) <= q.max(0)).all() and (q.min(0) <= p.max(0)).all():
            found.add((f.surfaces, g.surfaces))
    return found


def task(session):
    pin_part = session.scene["pin"]
    hand = session.hand(at=LEAN * at(-0.15, 0.0, 0.35))
    hand.grab("pin")
    # over the bridge between both eyes: the boxes of the pin and of both eyes overlap, the surfaces are far apart
    hand.move_to(LEAN * at(0.042, 0.0, 0.150))
    false = boxes_overlap(session, pin_part, session.scene["fork"])
    session.note(f"boxes would offer {len(false)} concentric fits here; surfaces offer {len(session.candidates)}")
    session.expect(len(false) >= 1, "boxes of pin and eyes overlap")
    session.expect(not session.candidates and not session.constraints, "no constraint is offered there")

    hand.move_to(LEAN * at(0.0, 0.0, 0.150))
    hand.insert("fork")
    for other, kind in (("fork", "concentric"), ("arm", "concentric"), ("fork", "against")):
        session.expect_constraint(kind, "pin", other)
    session.expect_freedom("pin", 1)
    offered = {e.surfaces for e in session.events if e.kind == "recognised" and set(e.parts) == {"fork", "pin"}}
    session.expect(len(offered) == 2, f"the fork offered the eye and the seat, nothing else ({len(offered)} offers)")

    hand.pull(along="axis", until="free")
    session.expect_free("pin")
    hand.release()


if __name__ == "__main__":
    vp.main(__file__)
