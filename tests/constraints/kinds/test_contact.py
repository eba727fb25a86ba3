"""`Contact`: edges and vertices that lie on something."""

from constraints.kinds import Contact
from tests.constraints.kinds.properties import (
    AB,
    CIRCLES,
    CONES,
    CYLINDERS,
    LINES,
    PLANES,
    POINTS,
    SPHERES,
    TORI,
    KindProperties,
)


class TestContact(KindProperties):
    cases = (
        ("contact plane line", Contact(AB, (PLANES[0], LINES[1])), 4),
        ("contact plane circle", Contact(AB, (PLANES[0], CIRCLES[1])), 5),
        ("contact point plane", Contact(AB, (POINTS[0], PLANES[1])), 5),
        ("contact cylinder point", Contact(AB, (CYLINDERS[0], POINTS[1])), 5),
        ("contact cone point", Contact(AB, (CONES[0], POINTS[1])), 5),
        ("contact sphere point", Contact(AB, (SPHERES[0], POINTS[1])), 5),
        ("contact torus point", Contact(AB, (TORI[0], POINTS[1])), 5),
        ("contact cylinder line", Contact(AB, (CYLINDERS[0], LINES[1])), 5),
        ("contact line line", Contact(AB, LINES), 5),
        ("contact point on line", Contact(AB, (POINTS[0], LINES[1])), 4),
        ("contact points", Contact(AB, POINTS), 3),
    )
