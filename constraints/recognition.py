"""Recognition: contacts between surfaces become candidates for constraints, one a pair of features.

Only what touches counts (Iacob, Mitrouchev and Léon: collisions between surfaces, not between their boxes): a pair
of features without a contact row is never looked at. Whether the two fit is then judged on their analytic
geometry, so faceting neither hides a clearance nor invents one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import Tolerance
from constraints.candidate import KINDS, Candidate, Key, Match, Pair, known_kinds
from constraints.edges import as_match, not_said_yet, touching
from constraints.features import Feature
from constraints.pairings import PAIRINGS, SLIGHT, STANDING, Pairing, matches
from constraints.threads import ALIKE
from constraints.views import Extent, Limits, View, millimetres

Pairs = dict[Pair, list[float]]
"""m: distances of the pairs of faces that are near each other, by pair of features"""


FLANK = 0.25
"""Of a pitch: how much the mean radii of two threads that fit each other may differ."""


class Recogniser:
    """Knows the features of every body; measures pairs of them at given poses.

    Parameters
    ----------
    features: one sequence of `Feature` a body, in the order of the object ids.
    threads: pitch (m a turn, positive for right-handed) of features that are threads, by (body, feature).
    """

    def __init__(
        self, features: Sequence[Sequence[Feature]], threads: Mapping[tuple[int, int], float] | None = None
    ) -> None:
        self.features: tuple[tuple[Feature, ...], ...] = tuple(tuple(f) for f in features)
        self.threads = dict(threads or {})
        self._of_surface = [{s: i for i, f in enumerate(fs) for s in f.surfaces} for fs in self.features]
        self._extents: dict[tuple[int, int], Extent] = {}
        self._shared: dict[int, Extent] = {}
        self._known: dict[tuple[Pair, Limits, int], tuple[tuple[bytes, bytes], tuple[Match, ...]]] = {}

    def feature_of(self, body: int, surface: int) -> int | None:
        """Place of the feature a face belongs to; None for faces without analytic geometry."""
        return self._of_surface[body].get(surface)

    def near(self, contacts: NDArray[Any], within: float = np.inf) -> Pairs:
        """The pairs of features with contact rows at a distance of at most `within`, and these distances."""
        pairs: Pairs = {}
        near = contacts[contacts["distance"] <= within]
        rows = zip(
            *(near[c].tolist() for c in ("object_a", "surface_a", "object_b", "surface_b", "distance")), strict=True
        )
        for a, sa, b, sb, distance in rows:
            if a >= len(self.features) or b >= len(self.features):
                continue
            fa, fb = self._of_surface[a].get(sa), self._of_surface[b].get(sb)
            if fa is not None and fb is not None:
                pairs.setdefault((a, fa, b, fb), []).append(distance)
        return pairs

    def view(self, body: int, feature: int, pose: pin.SE3) -> View:
        """A feature where it is when its body is at `pose`."""
        return View(self._extent(body, feature), pose)

    def matches(
        self, pair: Pair, poses: Sequence[pin.SE3], limits: Limits, rows: tuple[Pairing, ...] = PAIRINGS
    ) -> tuple[Match, ...]:
        """What two features mean to each other at `poses`: nothing, one kind, or a fit and its thread.

        rows: of the table of pairings; others are not looked at.
        """
        a, fa, b, fb = pair
        state = (_bytes(poses[a]), _bytes(poses[b]))
        asked = (pair, limits, len(rows))
        known = self._known.get(asked)
        if known is not None and known[0] == state:  # most pairs stand still from one step to the next
            return known[1]
        pitch = self.pitch(pair)
        both = pitch is not None and (a, fa) in self.threads and (b, fb) in self.threads
        if both and pitch is not None:  # their flanks meet though their mean radii differ, as crests are cut otherwise
            limits = replace(limits, clearance=max(limits.clearance, FLANK * abs(pitch)), fit_class="")
        found = matches(self.view(a, fa, poses[a]), self.view(b, fb, poses[b]), limits, rows)
        out: tuple[Match, ...] = () if found is None else (found,)
        if found is not None and pitch is not None and found.kind == "concentric":
            if both:
                words = f"threads on one axis over {found.overlap * 1e3:.4g} mm"
                found = replace(found, fit=None, words=words)
            out = (found, replace(found, kind="screw", parameters={"pitch": pitch}))
        self._known[asked] = (state, out)
        return out

    def match(self, key: Key, poses: Sequence[pin.SE3], limits: Limits) -> Match | None:
        """What the kind and the two features of `key` amount to at `poses`; None when they are out of limits."""
        return next((m for m in self.matches(key[:4], poses, limits) if m.kind == key[4]), None)

    def pitch(self, pair: Pair) -> float | None:
        """m a turn, where one of the two features is a thread, or both are of one pitch."""
        a, fa, b, fb = pair
        first, second = self.threads.get((a, fa)), self.threads.get((b, fb))
        if first is None or second is None:
            return second if first is None else first
        return first if abs(first - second) <= ALIKE * abs(first) else None

    def candidate(
        self, pair: Pair, match: Match, distances: Sequence[float], limits: Limits, poses: Sequence[pin.SE3]
    ) -> Candidate:
        """The candidate that `match` amounts to, with its score and its reasons."""
        a, fa, b, fb = pair
        first, second = self.features[a][fa], self.features[b][fb]
        closeness = max(0.0, 1.0 - match.residual / (limits.linear + max(match.fit or 0.0, 0.0)))
        faces = len(first.surfaces) * len(second.surfaces)
        touch = sum(distance <= limits.slack for distance in distances)
        if not touch:
            nearness = f"within reach, {millimetres(min(distances))} apart at the nearest"
        else:
            nearness = f"{touch} of {faces} pairs of faces touch" if faces > 1 else "their faces touch"
        pitch = self.pitch(pair) if match.kind in ("concentric", "screw") else None
        thread = ""
        if pitch is not None:
            thread = f"; {'left-hand ' if pitch < 0.0 else ''}thread of pitch {1e3 * abs(pitch):.4g} mm"
        constraint = KINDS[match.kind](
            (a, b),
            match.features or (first.geometry, second.geometry),
            (first.surfaces, second.surfaces),
            match.size,
            **match.parameters,
        )
        return Candidate(
            key=(*pair, match.kind),
            match=match,
            constraint=constraint,
            contacts=len(distances),
            score=0.5 * (closeness + match.share),
            why=f"{match.words}; {nearness}{thread}",
            pitch=pitch,
        ).engaged(poses)

    def _extent(self, body: int, feature: int) -> Extent:
        extent = self._extents.get((body, feature))
        if extent is None:
            f = self.features[body][feature]
            extent = self._shared.get(id(f))  # instances of one shape share their features
            if extent is None:
                extent = self._shared[id(f)] = Extent.of(f)
            self._extents[(body, feature)] = extent
        return extent


def _bytes(pose: pin.SE3) -> bytes:
    return np.asarray(pose.homogeneous).tobytes()


def recognise(
    features: Sequence[Sequence[Feature]],
    poses: Sequence[pin.SE3],
    contacts: NDArray[Any],
    tolerance: Tolerance | None = None,
    *,
    threads: Mapping[tuple[int, int], float] | None = None,
    kinds: Iterable[str] | None = None,
    tell: Callable[[float], None] = lambda fraction: None,
) -> tuple[Candidate, ...]:
    """Candidates for constraints between bodies that touch, best score first.

    Parameters
    ----------
    features: one sequence of `Feature` a body, body frame.
    poses: one `pin.SE3` a body, body to world.
    contacts: (n,) rows of `collision.CONTACT_DTYPE`, from `CollisionManager.contacts(within=…)`; ask for at least
        `tolerance.clearance`, so that the facets of a loose fit are near enough to be seen.
    tolerance: `reach` and `reach_angular` say how far from exact a mate may be; `replace(t, reach=0.0,
        reach_angular=0.0)` judges an assembly as it stands.
    threads: pitch in m a turn of threaded features, by (body, feature).
    kinds: only these kinds; None for all of `pairings.STANDING`. With "contact" or "coplanar" among them (`pairings.
        SLIGHT`) edges and vertices that touch within `tolerance.linear` are looked at too, and faces that lie flush:
        ranked below what fits, and left out where a fit of the same two bodies says as much.
    tell: hears the fraction done, before each pair of features.

    Returns
    -------
    One `Candidate` a pair of features (a thread's pair also gives a screw), sorted by falling score, then by key.
    """
    tolerance = tolerance or Tolerance()
    recogniser = Recogniser(features, threads)
    limits = Limits.offer(tolerance)
    wanted = known_kinds(STANDING if kinds is None else kinds)
    near = recogniser.near(contacts)
    found, slight = [], []
    for number, (pair, distances) in enumerate(sorted(near.items())):
        tell(number / len(near))
        offered = recogniser.matches(pair, poses, limits)
        found += [recogniser.candidate(pair, match, distances, limits, poses) for match in offered]
        if not offered and not wanted.isdisjoint(SLIGHT) and min(distances) <= limits.slack:
            a, fa, b, fb = pair
            touch = touching(recogniser.view(a, fa, poses[a]), recogniser.view(b, fb, poses[b]), limits)
            slight += [] if touch is None else [(pair, touch)]
    for pair, touch in not_said_yet(slight, found, lambda body, f: recogniser.view(body, f, poses[body])):
        a, fa, b, fb = pair
        match = as_match(touch, recogniser.view(a, fa, poses[a]), recogniser.view(b, fb, poses[b]), limits)
        found.append(recogniser.candidate(pair, match, near[pair], limits, poses))
    return tuple(sorted((c for c in found if c.kind in wanted), key=lambda c: (-c.score, c.key)))
