"""Removal of matches that other matches imply.

- The matches of a thread's crests, roots and flanks on the axis of its screw.
- A fit looser than `Limits.clearance` (a screw's head in its counterbore), if the same two bodies have a closer fit on
  the same axis, or a third body is the sleeve between them.
- The tangency of a fillet to a plane that the two bodies share already.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from constraints.geometry.features import Feature
from constraints.geometry.surfaces import Plane, cross, norm
from constraints.geometry.views import Limits
from constraints.recognition.candidate import Match, Pair

Found = tuple[Pair, Match]


def without_implied(
    found: Sequence[Found],
    features: Sequence[Sequence[Feature]],
    threads: Mapping[tuple[int, int], float],
    limits: Limits,
) -> list[Found]:
    """Return the matches of `found` that no other implies, in the given order.

    found: matches of any bodies at one time. features: of every body. threads: pitches by (body, feature).
    """
    by_bodies: dict[tuple[int, int], list[Found]] = {}
    for pair, match in found:
        by_bodies.setdefault((pair[0], pair[2]), []).append((pair, match))
    screws = {bodies: _screws(group, threads, limits) for bodies, group in by_bodies.items()}

    def implied(pair: Pair, match: Match) -> bool:
        bodies = pair[0], pair[2]
        if match.kind == "screw":
            return (pair, match) not in screws[bodies]
        if match.kind == "concentric":
            if any(_coaxial(screw, match, limits) for _, screw in screws[bodies]):
                return True
            return _is_loose(match, limits) and (
                any(_is_tighter(other, match, limits) for _, other in by_bodies[bodies])
                or _in_a_sleeve(pair, match, by_bodies, features, limits)
            )
        if match.kind == "tangent" and _has_plane(pair, features):
            return any(_in_plane_of(other, match, limits) for _, other in by_bodies[bodies])
        return False

    return [(pair, match) for pair, match in found if not implied(pair, match)]


def _screws(group: Sequence[Found], threads: Mapping[tuple[int, int], float], limits: Limits) -> list[Found]:
    """One screw for each axis: that of two known threads, else the longest."""
    kept: list[Found] = []

    def rank(item: Found) -> tuple[int, float, Pair]:
        (a, fa, b, fb), match = item
        return -((a, fa) in threads) - ((b, fb) in threads), -match.overlap, item[0]

    for pair, match in sorted((x for x in group if x[1].kind == "screw"), key=rank):
        if not any(_coaxial(other, match, limits) for _, other in kept):
            kept.append((pair, match))
    return kept


def _is_loose(match: Match, limits: Limits) -> bool:
    return match.fit is not None and match.fit > limits.clearance + limits.slack


def _coaxial(m: Match, n: Match, limits: Limits) -> bool:
    """Whether two axes coincide within the clearance of their fits."""
    air = max(m.fit or 0.0, 0.0) + max(n.fit or 0.0, 0.0)
    aside = cross(n.origin - m.origin, m.direction)
    return norm(cross(m.direction, n.direction)) <= 2.0 * limits.angular and norm(aside) <= 2.0 * limits.linear + air


def _is_tighter(m: Match, n: Match, limits: Limits) -> bool:
    """Whether m is a closer fit than n, on the same axis."""
    return m.kind == "concentric" and (m.fit or 0.0) < (n.fit or 0.0) and _coaxial(m, n, limits)


def _in_a_sleeve(
    pair: Pair,
    match: Match,
    by_bodies: Mapping[tuple[int, int], Sequence[Found]],
    features: Sequence[Sequence[Feature]],
    limits: Limits,
) -> bool:
    """Whether a third body is a sleeve between shaft and bore: a closer fit with either where their lengths overlap."""

    def in_order(p: Pair) -> tuple[int, int]:
        """(body of the shaft, body of the bore)."""
        return (p[0], p[2]) if features[p[0]][p[1]].sense > 0 else (p[2], p[0])

    closer = {
        in_order(p)
        for group in by_bodies.values()
        for p, other in group
        if _is_tighter(other, match, limits) and _beside(other, match)
    }
    shaft, bore = in_order(pair)
    return any((sleeve, bore) in closer for body, sleeve in closer if body == shaft)


def _beside(m: Match, n: Match) -> bool:
    """Whether the lengths that two matches on one axis share overlap."""
    return abs(float((m.origin - n.origin) @ n.direction)) < 0.5 * (m.overlap + n.overlap)


def _has_plane(pair: Pair, features: Sequence[Sequence[Feature]]) -> bool:
    a, fa, b, fb = pair
    return any(isinstance(f.geometry, Plane) for f in (features[a][fa], features[b][fb]))


def _in_plane_of(m: Match, n: Match, limits: Limits) -> bool:
    """Whether m is an "against" in whose plane the tangency n lies."""
    return (
        m.kind == "against"
        and norm(cross(m.direction, n.direction)) <= 2.0 * limits.angular
        and abs(float((n.origin - m.origin) @ m.direction)) <= 2.0 * limits.linear
    )
