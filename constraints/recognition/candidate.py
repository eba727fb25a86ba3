"""`Candidate`: a constraint offered for two features in contact, with the reasons for it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import pinocchio as pin

from constraints.errors import ConstraintsError
from constraints.geometry.surfaces import Geometry, Vector
from constraints.kinds import (
    Against,
    Concentric,
    Conical,
    Constraint,
    Contact,
    Coplanar,
    Groove,
    Screw,
    Spherical,
    Tangent,
    Toroidal,
)

Pair = tuple[int, int, int, int]
"""body a, feature of a, body b, feature of b; a < b, or in the caller's order for stated candidates"""
Key = tuple[int, int, int, int, str]
"""a pair and the kind: the identity of a candidate"""


@dataclass(frozen=True, eq=False)
class Match:
    """Result of a rule of the pairing table for two features."""

    kind: str
    """"against", "concentric", …: the name of the constraint kind"""
    residual: float
    """m: greatest deviation from the constraint over the region that the surfaces share"""
    angle: float
    """rad: deviation of the directions"""
    fit: float | None
    """m: radius of the hollow surface minus that of the solid one (negative: interference); None for other surfaces"""
    overlap: float
    """m² for planes, m along the axis for round surfaces: the shared region"""
    share: float
    """1: `overlap` over the smaller of the two features, at most 1"""
    closed: bool
    """whether the hollow feature encloses the solid one on all sides, so that they separate only along the axis"""
    approach: Vector
    """(3,) world, unit: direction in which body a moves deeper into the mate"""
    origin: Vector
    """(3,) world, m: place of the mate"""
    local: Vector
    """(3,) m: the same place in the frame of body a"""
    direction: Vector
    """(3,) world, unit: normal or axis"""
    size: float
    """m: radius, or half the width of the shared area"""
    words: str
    """description of the match"""
    parameters: dict[str, Any] = field(default_factory=dict)
    """parameters of the constraint kind"""
    features: tuple[Geometry, Geometry] | None = None
    """elements that are constrained, in the bodies' frames, if they are edges or vertices instead of the features"""
    press: float = 0.0
    """m, radial: interference of a press fit; 0 for anything else"""


KINDS: dict[str, type[Constraint]] = {
    kind.kind: kind
    for kind in (Against, Concentric, Conical, Contact, Coplanar, Groove, Screw, Spherical, Tangent, Toroidal)
}
"""constraint class of each kind that recognition offers"""


def known_kinds(kinds: Iterable[str]) -> frozenset[str]:
    """Return the names as a set; raises ConstraintsError for a kind that recognition does not offer."""
    wanted = frozenset(kinds)
    if not wanted <= KINDS.keys():
        raise ConstraintsError(
            f"recognition offers no kind {min(wanted - KINDS.keys())!r}; give some of {', '.join(sorted(KINDS))}"
        )
    return wanted


@dataclass(frozen=True, eq=False)
class Candidate:
    """A constraint offered for one pair of features. Bodies are object ids, features indices in the body's list."""

    key: Key
    match: Match
    constraint: Constraint
    """the constraint that is in force once the candidate is accepted"""
    near: tuple[tuple[int, int, float], ...]
    """pairs of faces that are near according to the match: face of a, face of b, distance (m)"""
    score: float
    """0 … 1: mean of closeness (1 - residual / limit) and `match.share`; ranks candidates"""
    why: str
    """one line: contact, fit and accuracy"""
    pitch: float | None = None
    """m per turn, for a thread"""
    stated: bool = False
    """whether it was stated by the caller (see `constraints.kinds.stated`) and not recognised from contact"""

    @property
    def kind(self) -> str:
        """Name of the constraint kind."""
        return self.match.kind

    @property
    def bodies(self) -> tuple[int, int]:
        """The two object ids, in the order of the key."""
        return self.key[0], self.key[2]

    @property
    def contacts(self) -> int:
        """Number of pairs of faces that are near each other."""
        return len(self.near)

    @property
    def geometries(self) -> tuple[Geometry, Geometry]:
        """The two analytic surfaces, each in its body's frame."""
        return self.constraint.features

    @property
    def surfaces(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """All faces of the two features."""
        return self.constraint.surfaces

    @property
    def residual(self) -> float:
        """m: measured when the candidate was found."""
        return self.match.residual

    def engaged(self, poses: Sequence[pin.SE3]) -> Candidate:
        """Return the candidate with a thread's phase set to that at `poses`; other kinds are unchanged."""
        c = self.constraint
        if not isinstance(c, Screw):
            return self
        return replace(self, constraint=c.engaged(poses[c.bodies[0]], poses[c.bodies[1]]))
