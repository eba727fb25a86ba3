"""`Candidate`: a constraint that two touching features could mean, with the reasons for it."""

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
"""body a, feature of a, body b, feature of b; a < b (of what is stated, as the caller has it)"""
Key = tuple[int, int, int, int, str]
"""the same, and the kind: what a candidate is known by"""


@dataclass(frozen=True, eq=False)
class Match:
    """What one rule of the pairing table found out about two features."""

    kind: str
    """"against", "concentric", …: the name of the constraint kind"""
    residual: float
    """m: how far the two surfaces are from coinciding as the kind asks, over the region they share"""
    angle: float
    """rad: the same for directions"""
    fit: float | None
    """m: radius of the hollow surface minus that of the solid one (negative: interference); None where none exists"""
    overlap: float
    """m² for planes, m along the axis for round surfaces: what the two share now"""
    share: float
    """1: `overlap` over the smaller of the two features, at most 1"""
    closed: bool
    """whether the hollow feature holds the other on all sides, so that only sliding out parts them"""
    approach: Vector
    """(3,) world, unit: the way body a moves to come deeper into the mate"""
    origin: Vector
    """(3,) world: where the mate is"""
    local: Vector
    """(3,) the same place in the frame of body a"""
    direction: Vector
    """(3,) world, unit: normal or axis"""
    size: float
    """m: radius, or half the width of the shared area"""
    words: str
    """what was found, in a few words"""
    parameters: dict[str, Any] = field(default_factory=dict)
    """what the constraint kind needs to know besides the two features"""
    features: tuple[Geometry, Geometry] | None = None
    """what the constraint is between, in the bodies' frames, where it is not the two features but edges of theirs"""
    press: float = 0.0
    """m, radial: interference of a press fit; 0 for anything else"""


KINDS: dict[str, type[Constraint]] = {
    kind.kind: kind
    for kind in (Against, Concentric, Conical, Contact, Coplanar, Groove, Screw, Spherical, Tangent, Toroidal)
}
"""The constraint class of each kind that recognition offers."""


def known_kinds(kinds: Iterable[str]) -> frozenset[str]:
    """The names as a set; ConstraintsError for one that recognition does not offer."""
    wanted = frozenset(kinds)
    if not wanted <= KINDS.keys():
        raise ConstraintsError(
            f"recognition offers no kind {min(wanted - KINDS.keys())!r}; give some of {', '.join(sorted(KINDS))}"
        )
    return wanted


@dataclass(frozen=True, eq=False)
class Candidate:
    """A constraint offered for one pair of features. Bodies are object ids, features are places in the body's list."""

    key: Key
    match: Match
    constraint: Constraint
    """what accepting the candidate sets up"""
    near: tuple[tuple[int, int, float], ...]
    """pairs of their faces that are as near as the match has the features: of a, of b, and the distance (m)"""
    score: float
    """0 … 1: mean of closeness (1 - residual / limit) and `match.share`; ranks candidates"""
    why: str
    """one line: what touches, what fits, how exactly"""
    pitch: float | None = None
    """m a turn, where the pair is a thread"""
    stated: bool = False
    """whether the caller stated it (see `constraints.kinds.stated`), rather than contact"""

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
        """How many pairs of their faces are near each other."""
        return len(self.near)

    @property
    def geometries(self) -> tuple[Geometry, Geometry]:
        """Of the two features, each in its body's frame."""
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
        """The same with a thread's phase taken as it is at `poses`; other kinds have none."""
        c = self.constraint
        if not isinstance(c, Screw):
            return self
        return replace(self, constraint=c.engaged(poses[c.bodies[0]], poses[c.bodies[1]]))
