"""Recognition: from contacts between surfaces to candidates for constraints, one for each pair of features.

Only contact counts (Iacob, Mitrouchev and Léon: collisions between surfaces, not between their boxes): a pair of
features without a contact row is never examined. Whether the two fit is decided on their analytic geometry, so that
facets neither hide a clearance nor create one.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import Tolerance
from constraints.geometry.features import Feature
from constraints.geometry.metric_threads import DrawnThread, metric_threads
from constraints.geometry.surfaces import Cylinder
from constraints.geometry.threads import ALIKE
from constraints.geometry.views import Extent, FeatureView, Limits
from constraints.geometry.words import millimetres
from constraints.recognition.candidate import KINDS, Candidate, Key, Match, Pair, known_kinds
from constraints.recognition.edge_contacts import as_match, edge_contact, without_implied_contacts
from constraints.recognition.implied import Found, without_implied
from constraints.recognition.pairings import DEFAULT_KINDS, PAIRINGS, SLIGHT, Pairing, matches, over
from constraints.recognition.prefilter import Placed, may_match
from constraints.recognition.thread_evidence import drawn_thread
from constraints.recognition.verdicts import Verdicts

Near = tuple[int, int, float]
"""a face of body a, one of body b, and their distance (m)"""
Pairs = dict[Pair, list[Near]]
"""the faces that are near each other, by pair of features"""

FLANK = 0.25
"""1: greatest difference of the mean radii of two threads that fit each other, as a fraction of the pitch"""


class Recogniser:
    """Measures pairs of features of bodies at given poses.

    Parameters
    ----------
    features: one sequence of `Feature` for each body, in the order of the object ids.
    threads: pitch (m per turn, positive for right-handed) of features that are threads, by (body, feature).
    named: by body, the words of its name that indicate threads (`constraints.recognition.thread_evidence`).
    """

    def __init__(
        self,
        features: Sequence[Sequence[Feature]],
        threads: Mapping[tuple[int, int], float] | None = None,
        named: Mapping[int, Collection[str]] | None = None,
    ) -> None:
        self.features: tuple[tuple[Feature, ...], ...] = tuple(tuple(f) for f in features)
        self.threads = dict(threads or {})
        self.named = dict(named or {})
        self._drawn: dict[Pair, DrawnThread | None] = {}
        self._of_surface = [{s: i for i, f in enumerate(fs) for s in f.surfaces} for fs in self.features]
        self._extents: dict[tuple[int, int], Extent] = {}
        self._views: dict[tuple[int, int], tuple[bytes, FeatureView]] = {}
        self._shared: dict[int, Extent] = {}
        self._known: dict[tuple[Pair, Limits, int], tuple[tuple[bytes, bytes], Match | None]] = {}
        self.verdicts = Verdicts(self)
        self._first_feature = np.cumsum([0, *(len(fs) for fs in self.features)])
        self._n_surfaces = np.array([max(table, default=-1) + 1 for table in self._of_surface], np.int64)
        self._first_surface = np.cumsum(np.append(0, self._n_surfaces))
        self._numbers = np.full(self._first_surface[-1] + 1, -1)  # of the surfaces' features; the last stays -1
        for body, table in enumerate(self._of_surface):
            for surface, feature in table.items():
                self._numbers[self._first_surface[body] + surface] = self._first_feature[body] + feature

    def feature_of(self, body: int, surface: int) -> int | None:
        """Return the index of the feature to which a face belongs; None for faces without analytic geometry."""
        return self._of_surface[body].get(surface)

    def near(self, contacts: NDArray[Any], within: float = np.inf) -> Pairs:
        """Return the near faces, at most `within` (m) apart, of each pair of features with contact rows."""
        codes = self.codes(contacts)
        chosen = (codes >= 0) & (contacts["distance"] <= within)
        found: dict[int, list[Near]] = {}
        rows = (contacts[name][chosen].tolist() for name in ("surface_a", "surface_b", "distance"))
        for code, *row in zip(codes[chosen].tolist(), *rows, strict=True):
            found.setdefault(code, []).append(tuple(row))
        return {self.pair(code): near for code, near in found.items()}

    def codes(self, contacts: NDArray[Any]) -> NDArray[np.int64]:
        """Return (n,): a number for the pair of features of each contact row, in the order of `Pair`; -1 for none."""
        if not len(contacts):
            return np.zeros(0, np.int64)
        sides = []
        for name in ("a", "b"):
            body, surface = contacts["object_" + name].astype(np.int64), contacts["surface_" + name]
            known = body < len(self.features)
            body = np.where(known, body, 0)
            known &= surface < self._n_surfaces[body]
            sides.append(self._numbers[np.where(known, self._first_surface[body] + surface, -1)])
        return np.where((sides[0] >= 0) & (sides[1] >= 0), sides[0] << 32 | sides[1], -1)

    def code(self, pair: Pair) -> int:
        """Return the number of a pair of features in `codes`."""
        a, fa, b, fb = pair
        return int(self._first_feature[a] + fa) << 32 | int(self._first_feature[b] + fb)

    def pair(self, code: int) -> Pair:
        """Return the pair of features of a number from `codes`."""
        a, b = (int(np.searchsorted(self._first_feature, k, "right")) - 1 for k in (code >> 32, code & 0xFFFFFFFF))
        return a, (code >> 32) - int(self._first_feature[a]), b, (code & 0xFFFFFFFF) - int(self._first_feature[b])

    def likely(self, codes: NDArray[np.int64], poses: Sequence[pin.SE3], limits: Limits) -> NDArray[np.int64]:
        """Return the numbers from `codes` whose features may match at `poses`; most neighbours cannot."""
        used, places = np.unique(np.stack([codes >> 32, codes & 0xFFFFFFFF]), return_inverse=True)
        bodies = np.searchsorted(self._first_feature, used, "right") - 1
        own = used - self._first_feature[bodies]
        extents = [self._extent(body, feature) for body, feature in zip(bodies.tolist(), own.tolist(), strict=True)]
        at = np.array([pose.homogeneous for pose in poses]).reshape(-1, 4, 4)[bodies]
        placed = Placed.of(extents).moved(at[:, :3, :3], at[:, :3, 3])
        first, second = (placed.at(side) for side in places.reshape(2, -1))
        loosest = FLANK * max(map(abs, self.threads.values()), default=0.0)
        return codes[may_match(first, second, limits, loosest)]

    def widest(self, limits: Limits) -> float:
        """Return the greatest difference of radii (m) of a shaft and a bore that fit each other or are a thread.

        Their faces may be that far apart: contacts are needed up to this distance.
        """
        radii: dict[int, set[float]] = {1: set(), -1: set()}
        for feature in (feature for own in self.features for feature in own):
            if isinstance(feature.geometry, Cylinder):
                radii[feature.sense].add(feature.geometry.radius)
        shafts, bores = (np.array(sorted(radii[sense])) for sense in (1, -1))
        most = np.array([limits.loosest(radius) + limits.slack for radius in shafts])
        clearance = bores[None, :] - shafts[:, None]
        fits = (clearance >= 0.0) & (clearance <= most[:, None])
        for i, j in np.argwhere((clearance < 0.0) & (clearance > -0.25 * shafts[:, None])).tolist():
            fits[i, j] = bool(metric_threads(2.0 * shafts[i], 2.0 * bores[j]))
        return float(np.abs(clearance[fits]).max(initial=0.0))

    def within(self, limits: Limits) -> float:
        """Return the distance, m, up to which recognition needs contacts under these limits."""
        return max(limits.clearance, float(np.hypot(self.widest(limits), limits.linear)))

    def view(self, body: int, feature: int, pose: pin.SE3) -> FeatureView:
        """Return a feature with its body at `pose`."""
        at, known = _bytes(pose), self._views.get((body, feature))
        if known is None or known[0] != at:  # kept, since a feature is compared with many others
            known = self._views[body, feature] = at, FeatureView(self._extent(body, feature), pin.SE3(pose))
        return known[1]

    def matches(
        self, pair: Pair, poses: Sequence[pin.SE3], limits: Limits, rows: tuple[Pairing[Any, Any], ...] = PAIRINGS
    ) -> Match | None:
        """Return the match of two features at `poses`, a screw for a thread and its nut; None without one.

        rows: the rows of the pairing table that apply.
        """
        a, fa, b, fb = pair
        state = (_bytes(poses[a]), _bytes(poses[b]))
        key = (pair, limits, len(rows))
        known = self._known.get(key)
        if known is not None and known[0] == state:  # most pairs do not move in a step
            return known[1]
        pitch = self.pitch(pair)
        limits = self.limits_of(pair, limits)
        found = matches(self.view(a, fa, poses[a]), self.view(b, fb, poses[b]), limits, rows)
        if found is not None and pitch is not None and found.kind == "concentric":
            words = f"threads on one axis{over(found.overlap)}"
            found = replace(found, kind="screw", fit=None, press=0.0, words=words, parameters={"pitch": pitch})
        self._known[key] = (state, found)
        return found

    def match(self, key: Key, poses: Sequence[pin.SE3], limits: Limits) -> Match | None:
        """Return the match of the kind and the two features of `key` at `poses`; None if it is out of limits."""
        found = self.matches(key[:4], poses, limits)
        return found if found is not None and found.kind == key[4] else None

    def limits_of(self, pair: Pair, limits: Limits) -> Limits:
        """Return the limits for a pair: the mean radii of two threads may differ by more, since crests are cut off."""
        pitch = self.pitch(pair)
        if pitch is None:
            thread = self.drawn_thread(pair)
            return limits if thread is None else replace(limits, thread=thread)
        depth = FLANK * abs(pitch)
        return replace(limits, clearance=max(limits.clearance, depth), interference=depth, fit_class="")

    def drawn_thread(self, pair: Pair) -> DrawnThread | None:
        """Return the metric thread that two features, drawn as plain cylinders, represent; None without evidence."""
        if pair not in self._drawn:
            a, fa, b, fb = pair
            first, second = self.features[a], self.features[b]
            found = None
            if first[fa].sense != second[fb].sense:
                words = (*self.named.get(a, ()), *self.named.get(b, ()))
                sides = ((first, fa), (second, fb)) if first[fa].sense > 0 else ((second, fb), (first, fa))
                found = drawn_thread(*sides[0], *sides[1], words)
            self._drawn[pair] = found
        return self._drawn[pair]

    def pitch(self, pair: Pair) -> float | None:
        """Return the pitch, m per turn, of two threads of equal pitch, or of a thread that reaches into a cylinder."""
        a, fa, b, fb = pair
        first, second = self.threads.get((a, fa)), self.threads.get((b, fb))
        if first is not None and second is not None:
            return first if abs(first - second) <= ALIKE * abs(first) else None
        pitch = second if first is None else first
        if pitch is None:
            return None
        shaft, bore = sorted((self._extent(a, fa), self._extent(b, fb)), key=lambda e: -e.feature.sense)
        return pitch if shaft.radii[1] >= bore.radii[0] * (1.0 - ALIKE) else None

    def candidate(
        self, pair: Pair, match: Match, near: Sequence[Near], limits: Limits, poses: Sequence[pin.SE3]
    ) -> Candidate:
        """Return the candidate for a match, with its score and reasons. near: contacts of the pair."""
        a, fa, b, fb = pair
        first, second = self.features[a][fa], self.features[b][fb]
        closeness = max(0.0, 1.0 - match.residual / (limits.linear + max(match.fit or 0.0, 0.0)))
        faces = len(first.surfaces) * len(second.surfaces)
        touch = sum(distance <= limits.slack for _, _, distance in near)
        least = min(distance for _, _, distance in near)
        deflections = self._extent(a, fa).deflection + self._extent(b, fb).deflection
        together = max(least, match.residual + max(match.fit or 0.0, 0.0)) + limits.slack + 2.0 * deflections
        if match.kind == "screw" and not touch:
            nearness = "their threads overlap as drawn"
        elif not touch:
            nearness = f"within reach, {millimetres(least)} apart at the nearest"
        else:
            nearness = f"{touch} of {faces} pairs of faces touch" if faces > 1 else "their faces touch"
        pitch = match.parameters.get("pitch")
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
            near=tuple(sorted(x for x in near if x[2] <= together)),
            score=0.5 * (closeness + match.share),
            why=f"{match.words}; {nearness}{thread}",
            pitch=pitch,
        ).engaged(poses)

    def candidates(
        self,
        poses: Sequence[pin.SE3],
        contacts: NDArray[Any],
        tolerance: Tolerance,
        *,
        kinds: Iterable[str] | None = None,
        implied: bool = False,
        tell: Callable[[float], None] = lambda fraction: None,
    ) -> tuple[Candidate, ...]:
        """Return candidates for constraints between bodies in contact, one for each pair of features, best score first.

        Parameters
        ----------
        poses: `pin.SE3` of each body, body to world.
        contacts: (n,) rows of `collision.CONTACT_DTYPE`, from `CollisionManager.contacts(within=…)`, up to `within` at
            least, so that they include the faces of a loose fit.
        tolerance: `reach` and `reach_angular` are the greatest deviation of a mate; `replace(t, reach=0.0,
            reach_angular=0.0)` assesses an assembly as drawn.
        kinds: only these kinds; None for all of `pairings.DEFAULT_KINDS`. With "contact" or "coplanar" among them
            (`pairings.SLIGHT`) also edges and vertices that touch within `tolerance.linear`, and flush faces: ranked
            below fits, and left out if a fit of the same two bodies implies them.
        implied: whether candidates that others imply are returned (see `constraints.recognition.implied`).
        tell: callback(fraction done), before each pair of features.
        """
        limits = Limits.offer(tolerance)
        wanted = known_kinds(DEFAULT_KINDS if kinds is None else kinds)
        every = self.codes(contacts)
        if wanted.isdisjoint(SLIGHT):
            contacts = contacts[np.isin(every, self.likely(np.unique(every[every >= 0]), poses, limits))]
        near = self.near(contacts)
        found: list[Found] = []
        slight = []

        def views(pair: Pair) -> tuple[FeatureView, FeatureView]:
            a, fa, b, fb = pair
            return self.view(a, fa, poses[a]), self.view(b, fb, poses[b])

        for number, (pair, rows) in enumerate(sorted(near.items())):
            tell(number / len(near))
            match = self.matches(pair, poses, limits)
            if match is not None:
                found.append((pair, match))
            elif not wanted.isdisjoint(SLIGHT) and min(x[2] for x in rows) <= limits.slack:
                touch = edge_contact(*views(pair), limits)
                slight += [] if touch is None else [(pair, touch)]
        fits = [(pair, match.fit) for pair, match in found]
        kept = found if implied else without_implied(found, self.features, self.threads, limits)
        beside = without_implied_contacts(slight, fits, lambda body, f: self.view(body, f, poses[body]))
        kept = [*kept, *((pair, as_match(touch, *views(pair), limits)) for pair, touch in beside)]
        out = (self.candidate(pair, match, near[pair], limits, poses) for pair, match in kept if match.kind in wanted)
        return tuple(sorted(out, key=lambda c: (-c.score, c.key)))

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


def contacts_within(features: Sequence[Sequence[Feature]], tolerance: Tolerance) -> float:
    """Return the distance, m, up to which `recognise` needs contacts of these features under this tolerance."""
    return Recogniser(features).within(Limits.offer(tolerance))


def recognise(
    features: Sequence[Sequence[Feature]],
    poses: Sequence[pin.SE3],
    contacts: NDArray[Any],
    tolerance: Tolerance | None = None,
    *,
    threads: Mapping[tuple[int, int], float] | None = None,
    named: Mapping[int, Collection[str]] | None = None,
    kinds: Iterable[str] | None = None,
    implied: bool = False,
) -> tuple[Candidate, ...]:
    """Return candidates for constraints between bodies in contact, best score first.

    features, threads, named: see `Recogniser`; poses, contacts, tolerance, kinds, implied: see `Recogniser.candidates`.
    """
    recogniser = Recogniser(features, threads, named)
    return recogniser.candidates(poses, contacts, tolerance or Tolerance(), kinds=kinds, implied=implied)
