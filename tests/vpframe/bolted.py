"""A bolted lid."""

import pinocchio as pin

from tests.vpframe.bench_scene import at
from vpframe.scene import modelling as m
from vpframe.scene.scene import Part, Scene
from vpframe.session.session import Session


def poses(session: Session) -> dict[str, pin.SE3]:
    return {name: part.pose.copy() for name, part in session.scene.items()}


FINE = (5e-6, 0.1)


def bolted(spare: bool = False) -> Scene:
    """A cover on a base, two headed bolts through the cover into the base."""
    holes = [(0.0, 0.0), (0.05, 0.0)]
    base, cover = (
        m.box(0.09, 0.04, 0.02).translated(-0.02, -0.02, -0.02),
        m.box(0.09, 0.04, 0.005).translated(-0.02, -0.02),
    )
    for x, y in holes:
        base = base - m.cylinder(0.00302, 0.015).translated(x, y, -0.015)
        cover = cover - m.cylinder(0.0034, 0.005).translated(x, y)
    bolt = m.shape(m.cylinder(0.003, 0.015) + m.cylinder(0.006, 0.004).translated(0, 0, 0.015), *FINE)
    parts = [
        Part("base", m.shape(base, *FINE), at(0, 0, 0), fixed=True),
        Part("lid/cover", m.shape(cover, *FINE), at(0, 0, 0)),
    ]
    parts += [Part(f"lid/bolt_{k + 1}", bolt, at(x, y, -0.01)) for k, (x, y) in enumerate(holes)]
    if spare:
        parts.append(Part("spare", bolt, at(-0.1, 0.0, 0.0)))
    return Scene(parts)
