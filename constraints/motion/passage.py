"""Whether bodies may go straight to their targets, sliding along surfaces to which they have no clearance.

Planned motion keeps a margin between solids, and the sweep stops where surfaces come into contact: neither enters a
pocket without clearance. A passage does. It allows the poses in which no pair of surfaces reaches deeper into each
other than rounding makes them, or than they did as drawn (`Drawn`). This depends on the poses alone, so that a way that
was travelled is open in both directions.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import Tolerance
from collision.contact import surfaces_of
from constraints.motion.walls import Near, Surfaces, Walls
from constraints.recognition.mated import adjacent_surfaces

MOST_CONTACTS = 64
"""Sweeps of a passage for each `STRIDE` of it: each continues past the surfaces that came into contact before."""
STRIDE = 5e-4
"""m that bodies go between two measurements of surfaces that overlap as drawn, which no sweep stops at"""


class Sweeping(Near, Protocol):
    """The queries of `collision.CollisionManager` that a passage needs."""

    def set_poses(self, ids: Sequence[int], poses: Sequence[pin.SE3]) -> None: ...
    def time_of_impact(self, moves: Mapping[int, pin.SE3], deflection: float = 0.0) -> Any: ...
    def signed_distances(self, i: int, j: int, pairs: Any, within: float, at: Any = None) -> NDArray[np.float64]: ...
    def ignore_surfaces(self, i: int, surfaces_i: Iterable[int], j: int, surfaces_j: Iterable[int]) -> None: ...
    def enable_surfaces(self, i: int, surfaces_i: Iterable[int], j: int, surfaces_j: Iterable[int]) -> None: ...


class Drawn:
    """How deep pairs of surfaces reach into each other in the assembly as drawn: press fits, facets of a bore."""

    def __init__(self, collision: Sweeping, walls: Walls, poses: Sequence[pin.SE3]) -> None:
        self.collision, self.walls, self.poses = collision, walls, tuple(poses)
        self._depth: dict[Surfaces, float] = {}
        self._allowed: dict[Surfaces, float] = {}
        self._strip: dict[Surfaces, float] = {}

    def corners(self, body: int) -> NDArray[np.float64]:
        """(8, 3) of a body's box, in its frame, m."""
        low, high = self.collision.mesh(body).bounds
        return np.where(np.indices((2, 2, 2)).reshape(3, 8).T, high, low)

    def allowed(self, pair: Surfaces) -> float:
        """m, at least 0: how deep a pair may reach into each other.

        It is the depth of the pair as drawn, or that of a pair beside it: the rim of a bore is met by the facets that
        reach into the bore, wherever the shaft ends. Facets that overlap as drawn may do so by their deflections more:
        how deep they are depends on where the surfaces end.
        """
        known = self._allowed.get(pair)
        if known is None:
            a, s, b, t = pair
            beside_a, beside_b = self._beside(pair)
            pairs = [pair, *((a, i, b, t) for i in beside_a), *((a, s, b, i) for i in beside_b)]
            known = self._allowed[pair] = max(map(self._fit, pairs))
        return known

    def strip(self, pair: Surfaces) -> float:
        """m, at least 0: how wide a strip along their borders two faces may share: as deep as faces beside them fit."""
        known = self._strip.get(pair)
        if known is None:
            beside_a, beside_b = self._beside(pair)
            pairs = ((pair[0], i, pair[2], j) for i in beside_a for j in beside_b)
            known = self._strip[pair] = max(map(self._fit, pairs), default=0.0)
        return known

    def _beside(self, pair: Surfaces) -> tuple[tuple[int, ...], tuple[int, ...]]:
        a, s, b, t = pair
        mesh = self.collision.mesh
        return adjacent_surfaces(mesh(a), (s,)), adjacent_surfaces(mesh(b), (t,))

    def _fit(self, pair: Surfaces) -> float:
        a, s, b, t = pair
        depth = self.depth(pair)
        facets = depth + self.walls.deflection(a, s) + self.walls.deflection(b, t) if depth > 0.0 else 0.0
        return max(facets, self.walls.interference(pair, self.poses))

    def depth(self, pair: Surfaces) -> float:
        """m, at least 0: as drawn."""
        known = self._depth.get(pair)
        if known is None:
            a, s, b, t = pair
            at = self.poses[a].actInv(self.poses[b])
            known = self._depth[pair] = -float(self.collision.signed_distances(a, b, [(s, t)], 0.0, at)[0])
        return known


def passable(
    collision: Sweeping,
    walls: Walls,
    drawn: Drawn,
    poses: Sequence[pin.SE3],
    target: Mapping[int, pin.SE3],
    tolerance: Tolerance,
) -> bool:
    """Whether bodies may go from `poses`, where collision has them, along one screw each, to `target`.

    A pair of surfaces that comes into contact again within `Tolerance.linear` of travel ends the way: it is pressed.
    Afterwards collision has them where they ended: at `target`, or anywhere on the way. The caller puts them back.
    """
    slop = tolerance.slop * tolerance.linear
    far = _farthest(drawn, poses, target)
    travelled = 0.0
    met: dict[Surfaces, float] = {}  # travel (m) at the last contact
    deep: set[Surfaces] = set()
    at = list(poses)

    def fits(pairs: Iterable[Surfaces]) -> set[Surfaces]:
        """Those that overlap as drawn: left out of the sweep from now on, and measured at the target."""
        found = {pair for pair in pairs if drawn.allowed(pair) > slop} - deep
        for a, s, b, t in sorted(found):
            collision.ignore_surfaces(a, (s,), b, (t,))
        deep.update(found)
        return found

    collision.set_poses(list(target), list(target.values()))
    if _stuck_at(collision, drawn, target, tolerance.linear):
        return False  # no way leads there; most that do not pass do not for this reason, which is soon found
    collision.set_poses(list(target), [poses[body] for body in target])
    near = collision.contacts(tolerance.linear, target)
    if walls.pressed(near, at, target, slop, drawn.strip, drawn.allowed):
        return False
    try:
        fits(_pairs(near[near["distance"] <= slop]))
        for _ in range(MOST_CONTACTS * max(1, int(np.ceil(far / STRIDE)))):
            found = collision.time_of_impact(target, slop)
            if found.t >= 1.0:
                return _fits_all_the_way(collision, drawn, poses, target, far, sorted(deep), slop)
            pairs = _pairs(found.contacts)
            pairs -= fits(pairs)
            travelled += found.t * (far - travelled)
            if any(travelled - met[pair] <= tolerance.linear for pair in pairs & met.keys()):
                return False
            met |= dict.fromkeys(pairs, travelled)
            collision.set_poses(list(found.poses), list(found.poses.values()))
            for body, pose in found.poses.items():
                at[body] = pose
            if walls.pressed(found.contacts, at, target, slop, drawn.strip, drawn.allowed):
                return False
        return False
    finally:
        for a, s, b, t in deep:
            collision.enable_surfaces(a, (s,), b, (t,))


def _stuck_at(collision: Sweeping, drawn: Drawn, bodies: Iterable[int], beyond: float) -> bool:
    """Whether a pair of surfaces reaches deeper into each other, where collision has the bodies, by more than `beyond`
    (m) than it is allowed to: no way may press it there.
    """
    for (a, b), mine in _by_bodies(sorted(_pairs(collision.contacts(0.0, bodies)))).items():
        depth = -collision.signed_distances(a, b, [(s, t) for _, s, _, t in mine], 0.0)
        if any(deep > beyond and deep > drawn.allowed(pair) + beyond for deep, pair in zip(depth, mine, strict=True)):
            return True
    return False


def _by_bodies(pairs: Iterable[Surfaces]) -> dict[tuple[int, int], list[Surfaces]]:
    of_bodies: dict[tuple[int, int], list[Surfaces]] = {}
    for pair in pairs:
        of_bodies.setdefault((pair[0], pair[2]), []).append(pair)
    return of_bodies


def _fits_all_the_way(
    collision: Sweeping,
    drawn: Drawn,
    poses: Sequence[pin.SE3],
    target: Mapping[int, pin.SE3],
    far: float,
    pairs: Sequence[Surfaces],
    slop: float,
) -> bool:
    """Whether pairs that overlap as drawn reach no deeper into each other than they may at the target, and on the way
    there nowhere deeper than two overlaps of the same bodies together: while they slide, other corners are deepest.
    """
    of_bodies = _by_bodies(pairs)
    between = {
        bodies: 2.0 * max(max(drawn.allowed(pair), drawn.strip(pair)) for pair in mine)
        for bodies, mine in of_bodies.items()
    }
    ways = {body: pin.log6(poses[body].actInv(pose)) for body, pose in target.items()}
    count = max(1, int(np.ceil(far / STRIDE))) if pairs else 0
    for k in (count, *range(1, count)):  # most that do not fit do not fit at the end
        at = target if k == count else {body: poses[body] * pin.exp6(way * (k / count)) for body, way in ways.items()}
        collision.set_poses(list(at), list(at.values()))
        for (a, b), mine in of_bodies.items():
            depth = -collision.signed_distances(a, b, [(s, t) for _, s, _, t in mine], 0.0)
            most = [drawn.allowed(pair) for pair in mine] if k == count else between[a, b]
            if (depth > np.array(most) + slop).any():
                return False
    return True


def _farthest(drawn: Drawn, poses: Sequence[pin.SE3], target: Mapping[int, pin.SE3]) -> float:
    """Greatest distance (m) of a corner of the bodies' boxes between `poses` and `target`."""
    return max(
        float(np.linalg.norm(drawn.corners(body) @ (pose.rotation - poses[body].rotation).T
              + pose.translation - poses[body].translation, axis=1).max())
        for body, pose in target.items()
    )  # fmt: skip


def _pairs(rows: NDArray[Any]) -> set[Surfaces]:
    return set(map(tuple, surfaces_of(rows).tolist()))
