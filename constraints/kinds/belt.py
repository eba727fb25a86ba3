"""Two pulleys joined by a toothed belt or a chain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from constraints.kinds.gear import Gear


@dataclass(frozen=True, eq=False)
class Belt(Gear):
    """Pulleys or sprockets of `teeth_a` and `teeth_b` that turn the same way (`sense` -1), or crossed (+1).

    For a smooth belt give teeth in proportion to the radii.
    """

    kind: ClassVar[str] = "belt"

    sense: int = -1
