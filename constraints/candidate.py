"""`Candidate`: a constraint that two touching features could mean, with the reasons for it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from constraints.geometry import Geometry, Vector
from constraints.kinds import Against, Concentric, Constraint

Key = tuple[int, int, int, int]
"""body a, feature of a, body b, feature of b; a < b. The same pair of features always has the same key."""


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


KINDS: dict[str, type[Constraint]] = {kind.kind: kind for kind in (Against, Concentric)}
"""The constraint class of each kind that recognition offers."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A constraint offered for one pair of features. Bodies are object ids, features are places in the body's list."""

    key: Key
    match: Match
    geometries: tuple[Geometry, Geometry]
    """of the two features, each in its body's frame"""
    surfaces: tuple[tuple[int, ...], tuple[int, ...]]
    """all faces of the two features"""
    contacts: int
    """how many pairs of their faces touch"""
    score: float
    """0 … 1: mean of closeness (1 - residual / limit) and `match.share`; ranks candidates"""
    why: str
    """one line: what touches, what fits, how exactly"""
    pitch: float | None = None
    """m a turn, where the pair is a thread"""

    @property
    def kind(self) -> str:
        """Name of the constraint kind."""
        return self.match.kind

    @property
    def bodies(self) -> tuple[int, int]:
        """The two object ids, ascending."""
        return self.key[0], self.key[2]

    @property
    def residual(self) -> float:
        """m: measured when the candidate was found."""
        return self.match.residual

    @cached_property
    def constraint(self) -> Constraint:
        """The constraint that accepting this candidate sets up."""
        return KINDS[self.kind](self.bodies, self.geometries, self.surfaces, self.match.size)
