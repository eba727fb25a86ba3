"""What motions may do to parts whose overlap is authorised: the overlap as drawn, along the fit's axis, and no deeper.

Their collision is off in the session. Instead each leg of a motion is swept as a plan sweeps it
(`vpframe.analysis.mate_motions`, `collision.Sweeps`): the surfaces of a fit are left out while the two stay on
its axis, any other overlap as drawn only shrinks.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import Sweeps, Tolerance
from vpframe.analysis.mate_motions import LINEAR, Mates
from vpframe.scene.scene import Scene

STILL = 1e-12
"""greatest change of a pair's relative pose, m and 1, that is rounding"""


class AuthorisedPairs:
    """Sweeps of the authorised pairs of a scene, and of those whose overlap is meant, from where its parts are drawn.

    Parameters
    ----------
    drawn: poses of all parts in the assembly as drawn. tolerance: of recognition, and by its `slop` of the sweeps.
    threads: pitch (m a turn) by object. meant: pairs whose overlap is meant without being authorised.
    """

    def __init__(
        self,
        scene: Scene,
        drawn: Sequence[pin.SE3],
        tolerance: Tolerance,
        threads: Mapping[int, float],
        meant: frozenset[tuple[int, int]] = frozenset(),
    ) -> None:
        self.scene, self.drawn, self.tolerance, self.threads = scene, drawn, tolerance, dict(threads)
        self.meant = meant
        self._sweeps: dict[tuple[int, int], Sweeps] = {}

    def stop(
        self,
        pairs: Iterable[tuple[int, int]],
        poses: Sequence[pin.SE3],
        target: Mapping[int, pin.SE3],
    ) -> tuple[float, NDArray[Any]] | None:
        """Return how far, in [0, 1), objects get from `poses` along one screw each to `target` before a pair is deeper
        than drawn, and the contact rows of what stops them; None if nothing does."""
        first: tuple[float, NDArray[Any]] | None = None
        for a, b in pairs:
            if a not in target and b not in target:
                continue
            start, end = (self._displaced(a, b, target.get(a, poses[a]) if k else poses[a],
                          target.get(b, poses[b]) if k else poses[b]) for k in (0, 1))  # fmt: skip
            if np.abs(start.homogeneous - end.homogeneous).max() <= STILL:
                continue
            found = self._of(a, b).stop(0, 1, (start, end))
            if found is not None and (first is None or found.t < first[0]):
                first = found.t, self._rows(a, b, found.contacts, poses[b])
        return first

    def _displaced(self, a: int, b: int, at: pin.SE3, by: pin.SE3) -> pin.SE3:
        """Displacement of a from where it is drawn, as seen from b."""
        return self.drawn[b] * by.inverse() * at * self.drawn[a].inverse()

    def _of(self, a: int, b: int) -> Sweeps:
        if (a, b) not in self._sweeps:
            parts = [self.scene.parts[i] for i in (a, b)]
            placed = (part.copy(pose=pin.SE3(self.drawn[i])) for part, i in zip(parts, (a, b), strict=True))
            pair = Scene(placed, rules=self.scene.rules)
            threads = {self.scene.names[i]: self.threads[i] for i in (a, b) if i in self.threads}
            authorised = [] if (a, b) in self.meant else [(parts[0].name, parts[1].name)]
            # as of a thread that is drawn as a plain cylinder: a hand that goes straight skips its turns
            mates = Mates(pair, authorised, threads, self.tolerance, unturned=True)
            swept = replace(self.tolerance, linear=LINEAR)
            self._sweeps[a, b] = Sweeps(mates.meshes, mates.poses, swept, mates.left_out)
        return self._sweeps[a, b]

    def _rows(self, a: int, b: int, rows: NDArray[Any], by: pin.SE3) -> NDArray[Any]:
        """Rows of a pair, seen from where b is drawn, in the world."""
        out = rows.copy()
        out["object_a"], out["object_b"] = a, b
        back = by * self.drawn[b].inverse()
        for point in ("point_a", "point_b"):
            out[point] = out[point] @ back.rotation.T + back.translation
        return out
