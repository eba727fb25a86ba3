"""`Mates`: the fits and threads between the parts of a scene as they stand, and what of them a motion keeps.

What a motion may do to overlaps that are meant is decided here, for plans and sessions alike: the surfaces of a fit or
thread are left out of the sweeps while a motion keeps the two parts on their common axis. A shaft that clashes with its
bore is such a fit if the overlap of its pair is authorised, or means something (`vpframe.analysis.meanings`): then it
moves along its screw or its axis, between the heights at which all common material stays in the rim that is meant. Else
the two do not move against each other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CollisionManager, SurfacePairs, Tolerance
from constraints import Candidate
from constraints.geometry.sleeve import sleeve
from constraints.geometry.surfaces import Cylinder, Sphere
from constraints.geometry.views import Extent
from constraints.recognition.mated import adjacent_surfaces
from constraints.recognition.misfits import Misfit
from vpframe.analysis.fits import PressFit, fit_of, press_fits
from vpframe.analysis.meanings import Meaning, meanings_of
from vpframe.analysis.static import StaticAnalysis, analysis_of
from vpframe.errors import VpframeError
from vpframe.scene.scene import Scene

Array = NDArray[np.float64]
Progress = Callable[[float | None, str], None]
"""receives the fraction done, and the results so far"""

LINEAR: Final = 1e-6
"""m: how near planned motions let surfaces come that are apart, and how near surfaces count as touching"""
ON_AXIS: Final = 1e-6
"""m: how far an axis may leave its own line before its fit is excused no longer"""


@dataclass(frozen=True, eq=False)
class MateMotion:
    """A fit or thread between two parts as they stand: the motions of a against b that keep it, and its surfaces."""

    parts: tuple[int, int]
    kind: str
    """"concentric", "screw" or "spherical\""""
    origin: Array
    """(3,) world, m: a point of the axis, or the centre"""
    axis: Array
    """(3,) unit, world"""
    pitch: float | None
    """m a turn, of a thread"""
    drawn: bool
    """whether it is a thread that is drawn as two cylinders"""
    apart: tuple[float, float]
    """m: how far a goes along the axis, and against it, until the two surfaces share no length"""
    excused: tuple[SurfacePairs, ...]
    """surfaces of a, surfaces of b"""
    press: float = 0.0
    """m, radial: interference of a press fit; 0 for any other mate"""
    travel: tuple[float, float] = (-np.inf, np.inf)
    """m along the axis: between which a may be displaced"""
    unturned: bool = False
    """whether a thread may slip along its axis without turning"""
    meaning: Meaning | None = None
    """of an overlap that is meant"""

    def keeps(self, start: pin.SE3, end: pin.SE3) -> bool:
        """Whether the motion of a against b from one displacement to another, along a screw, keeps the mate."""
        if not all(self._holds(d) and self._is_within(d) for d in (start, end)):
            return False
        return self.pitch is None or self.unturned or self._engages(start, end)

    def _holds(self, d: pin.SE3) -> bool:
        shift = d.act(self.origin) - self.origin
        if self.kind == "spherical":
            return bool(np.linalg.norm(shift) <= ON_AXIS)
        arm = max(1.0, float(np.linalg.norm(d.translation)))
        aside = shift - (shift @ self.axis) * self.axis
        tilt = np.linalg.norm(d.rotation @ self.axis - self.axis)
        return bool(np.linalg.norm(aside) <= ON_AXIS and tilt * arm <= ON_AXIS)

    def _is_within(self, d: pin.SE3) -> bool:
        along = float((d.act(self.origin) - self.origin) @ self.axis)
        return self.travel[0] - ON_AXIS <= along <= self.travel[1] + ON_AXIS

    def _engages(self, start: pin.SE3, end: pin.SE3) -> bool:
        assert self.pitch is not None
        advance = (end.act(self.origin) - start.act(self.origin)) @ self.axis
        turn = pin.log3(end.rotation @ start.rotation.T) @ self.axis
        return bool(abs(advance - self.pitch * turn / (2.0 * np.pi)) <= ON_AXIS)

    def engaged(self, d: pin.SE3) -> bool:
        """Whether the two share some length at a displacement of a against b."""
        along = float((d.act(self.origin) - self.origin) @ self.axis)
        return -self.apart[1] + ON_AXIS < along < self.apart[0] - ON_AXIS


@dataclass(frozen=True, eq=False)
class Jam:
    """A shaft and a bore that clash."""

    origin: Array
    """(3,) world, m: middle of the length they share"""
    axis: Array
    """(3,) unit, world"""
    length: float
    """m"""

    def engaged(self, d: pin.SE3) -> bool:
        """Whether the two share some length at a displacement of the first against the second."""
        return abs(float((d.act(self.origin) - self.origin) @ self.axis)) < self.length - ON_AXIS


def silent(fraction: float | None, text: str) -> None:
    """Receive progress and do nothing."""


class Mates:
    """The fits and threads of a scene as it stands, and the pairs of parts whose overlap is meant.

    Parameters
    ----------
    authorised: pairs of part names whose overlap as drawn is meant.
    threads: m a turn by part name: its snug fits are threads, drawn without them.
    recognition: tolerance by which fits are recognised; its reach does not count.
    unturned: whether screws whose overlap means a thread may slip along their axes without turning.
    """

    def __init__(
        self,
        scene: Scene,
        authorised: Iterable[tuple[str, str]] = (),
        threads: Mapping[str, float] | None = None,
        recognition: Tolerance | None = None,
        progress: Progress = silent,
        unturned: bool = False,
    ) -> None:
        self.scene, self.recognition = scene, recognition
        self.names = scene.names
        self.poses = tuple(pin.SE3(part.pose) for part in scene.parts)
        self.meshes = tuple(part.mesh for part in scene.parts)
        self.authorised, self.unturned = pairs_of(scene, authorised), unturned
        self._threads = {scene.index(name): pitch for name, pitch in (threads or {}).items()}
        for name, pitch in (threads or {}).items():
            if not (np.isfinite(pitch) and pitch != 0.0):
                raise VpframeError(f"the thread of {name} has a pitch of {pitch!r}; give metres a turn, not zero")
        self._progress = progress

    @property
    def world(self) -> CollisionManager:
        """The parts where they stand, under the tolerance of recognition."""
        return self._analysis.world

    @cached_property
    def _analysis(self) -> StaticAnalysis:
        return analysis_of(self.scene, self.recognition)

    @cached_property
    def candidates(self) -> tuple[Candidate, ...]:
        """What the features of parts that touch are to each other, best first."""
        return self._analysis.candidates(lambda done: self._progress(done, "mates"), implied=True)

    @cached_property
    def mates(self) -> dict[tuple[int, int], tuple[MateMotion, ...]]:
        """Fits and threads by pair of parts (a, b), a < b."""
        features, sags = self._analysis.features, self._analysis.deflection
        out: dict[tuple[int, int], list[MateMotion]] = {}
        for candidate in self.candidates:
            mate = self._mate(candidate, features, sags)
            if mate is not None:
                out.setdefault(mate.parts, []).append(mate)
        for found in self._misfits:
            a, fa, b, fb = found.pair
            if frozenset((a, b)) in self.authorised:
                ends = ((a, features[a][fa]), (b, features[b][fb]))
                out.setdefault((a, b), []).append(self._authorised_fit(found, ends))
        for meaning in self.meanings:
            if not any(_same_line(mate, meaning) for mate in out.get(meaning.parts, ())):
                out.setdefault(meaning.parts, []).append(self._meant(meaning))
        return {pair: tuple(mates) for pair, mates in sorted(out.items())}

    @cached_property
    def meanings(self) -> tuple[Meaning, ...]:
        """What the overlaps as drawn mean, of pairs of parts with an axis."""
        rows = self._analysis.contacts(self._analysis.within_deflection)
        pairs = np.unique(np.stack([rows["object_a"], rows["object_b"]], axis=1), axis=0).tolist()
        return meanings_of(self.scene, self._analysis).between(map(tuple, pairs))

    def _meant(self, meaning: Meaning) -> MateMotion:
        """The motions that an overlap with a meaning allows."""
        fit = meaning.fit
        assert fit is not None
        first = meaning.solid == meaning.parts[0]
        hollow = meaning.parts[1 if first else 0]
        everything = tuple(range(self.meshes[hollow].n_surfaces))
        ahead, behind = max(fit.mated[1] - fit.span[0], 0.0), max(fit.span[1] - fit.mated[0], 0.0)
        travel = fit.free[0] - fit.span[0], fit.free[1] - fit.span[1]  # of the solid; the hollow goes the other way
        thread = meaning.kind == "thread"
        return MateMotion(
            meaning.parts, "screw" if thread else "concentric", *fit.line, meaning.pitch, thread,
            (ahead, behind) if first else (behind, ahead),
            ((fit.surfaces, everything) if first else (everything, fit.surfaces),),
            fit.depth if meaning.kind == "press fit" else 0.0,
            travel if first else (-travel[1], -travel[0]),
            self.unturned or frozenset(meaning.parts) in self.authorised, meaning,
        )  # fmt: skip

    @property
    def press_fits(self) -> tuple[PressFit, ...]:
        """The press fits among the mates, the tightest of each pair of parts."""
        mates = (mate for mates in self.mates.values() for mate in mates)
        return press_fits(((self.names[m.parts[0]], self.names[m.parts[1]]), m.press) for m in mates)

    def _mate(self, candidate: Candidate, features: Sequence[Any], sags: Sequence[float]) -> MateMotion | None:
        a, fa, b, fb, kind = candidate.key
        first, second = features[a][fa].geometry, features[b][fb].geometry
        t = self.world.tolerance
        if kind == "spherical" and isinstance(first, Sphere):
            origin, axis = self.poses[a].act(first.center), np.zeros(3)
        elif kind in ("concentric", "screw") and isinstance(first, Cylinder) and isinstance(second, Cylinder):
            origin, axis = self.poses[a].act(first.origin), self.poses[a].rotation @ first.axis
        else:
            return None
        stated = self._threads.get(a, self._threads.get(b)) if kind == "concentric" else None
        pitch = candidate.pitch if stated is None else stated
        thread = kind == "screw" or stated is not None
        found = fit_of(candidate, t)
        # what fits loosely needs no excuse; what overlaps and is neither a press fit nor authorised has none
        meant = found is not None and (found.kind != "clash" or frozenset((a, b)) in self.authorised)
        excusable = meant and found is not None and found.gap <= sags[a] + sags[b] + t.linear
        if not (thread or excusable):
            return None
        apart = np.inf, np.inf
        if isinstance(first, Cylinder):
            apart = self._until_apart(((a, features[a][fa]), (b, features[b][fb])), origin, axis)
        excused = self._with_faces_beside((a, b), candidate.surfaces)
        inside = sleeve(candidate, features, (self.meshes[a], self.meshes[b]), t.fit)
        if inside is not None:
            excused.append(inside)
        return MateMotion(
            (a, b), "screw" if thread else kind, np.asarray(origin), np.asarray(axis), pitch if thread else None,
            thread and candidate.match.fit is not None, apart, tuple(excused), 0.0 if thread else candidate.match.press,
        )  # fmt: skip

    def _authorised_fit(self, found: Misfit, ends: tuple[tuple[int, Any], tuple[int, Any]]) -> MateMotion:
        """A shaft in a bore that is too small for it, whose overlap is authorised: along the axis it is excused."""
        (a, one), (b, other) = ends
        excused = self._with_faces_beside((a, b), (one.surfaces, other.surfaces))
        return MateMotion(
            (a, b), "concentric", *found.line, None, False, self._until_apart(ends, *found.line), tuple(excused)
        )

    def _with_faces_beside(self, parts: tuple[int, int], surfaces: Sequence[tuple[int, ...]]) -> list[SurfacePairs]:
        """Each surface of a fit paired with the mated surface, and with the faces beside that."""
        mine, theirs = (adjacent_surfaces(self.meshes[i], s) for i, s in zip(parts, surfaces, strict=True))
        return [(surfaces[0], surfaces[1] + theirs), (mine, surfaces[1])]

    def _until_apart(
        self, ends: tuple[tuple[int, Any], tuple[int, Any]], origin: Array, axis: Array
    ) -> tuple[float, float]:
        """m: how far the first part goes along a world line, and against it, until two cylinders share no length."""
        heights = [self._heights(i, f.geometry, Extent.of(f).spans, origin, axis) for i, f in ends]
        (low_a, high_a), (low_b, high_b) = heights
        return max(high_b - low_a, 0.0), max(high_a - low_b, 0.0)

    def _heights(self, i: int, cylinder: Any, spans: Array, origin: Array, axis: Array) -> tuple[float, float]:
        """Least and greatest height (m) of a cylinder of part i along a world line, from its spans along its own."""
        own = self.poses[i].rotation @ cylinder.axis
        base = (self.poses[i].act(cylinder.origin) - origin) @ axis
        ends = base + (own @ axis) * np.array([spans[0, 0], spans[-1, 1]])
        return float(ends.min()), float(ends.max())

    def mates_of(self, i: int, j: int) -> tuple[MateMotion, ...]:
        """Fits and threads of two parts."""
        return self.mates.get((min(i, j), max(i, j)), ())

    def excused(self, i: int, j: int) -> tuple[SurfacePairs, ...]:
        """Surfaces of i, surfaces of j that some motions leave out."""
        pairs = [(m.parts[0] == i, pairing) for m in self.mates_of(i, j) for pairing in m.excused]
        return tuple(pairing if first else (pairing[1], pairing[0]) for first, pairing in pairs)

    def left_out(self, i: int, j: int, start: pin.SE3, end: pin.SE3) -> Iterable[SurfacePairs] | None:
        """The surfaces of fits and threads that a leg of part i keeps with part j; None: a drawn thread, or another
        overlap that is meant, lets none pass, or a shaft and a bore clash.

        `Sweeps` asks it of each leg.
        """
        out: list[SurfacePairs] = []
        for mate in self.mates_of(i, j):
            first = mate.parts[0] == i
            one, other = (start, end) if first else (start.inverse(), end.inverse())
            if mate.keeps(one, other):
                out += mate.excused if first else [(b, a) for a, b in mate.excused]
            elif (mate.drawn or mate.meaning) and mate.engaged(one) and mate.axis @ mate.axis > 0.0:
                return None
        if i > j:
            start = start.inverse()
        return None if any(jam.engaged(start) for jam in self.jams(i, j)) else out

    def jams(self, i: int, j: int) -> tuple[Jam, ...]:
        """The shafts and bores of two parts that clash where the parts stand; none if the pair is authorised."""
        return () if frozenset((i, j)) in self.authorised else self._jams.get((min(i, j), max(i, j)), ())

    @cached_property
    def _misfits(self) -> tuple[Misfit, ...]:
        """The shafts in bores that clash where the parts stand."""
        return self._analysis.misfits(self._analysis.within_deflection)

    @cached_property
    def _jams(self) -> dict[tuple[int, int], tuple[Jam, ...]]:
        out: dict[tuple[int, int], list[Jam]] = {}
        meant = {meaning.parts: meaning for meaning in self.meanings}
        for found in self._misfits:
            meaning = meant.get((found.pair[0], found.pair[2]))
            if meaning is not None and meaning.on(found.line):
                continue
            out.setdefault((found.pair[0], found.pair[2]), []).append(Jam(*found.line, found.length))
        return {pair: tuple(jams) for pair, jams in out.items()}


def _same_line(mate: MateMotion, meaning: Meaning) -> bool:
    """Whether a mate is a thread or a press fit on the axis of a meaning."""
    return (mate.kind == "screw" or mate.press > 0.0) and meaning.on((mate.origin, mate.axis))


def pairs_of(scene: Scene, names: Iterable[tuple[str, str]]) -> frozenset[frozenset[int]]:
    """Return pairs of parts, given by name, as pairs of their places; VpframeError if a part is on both sides."""
    out = set()
    for a, b in names:
        if a == b:
            raise VpframeError(f"{a}:{b}: a part is on both sides; name two different ones")
        out.add(frozenset((scene.index(a), scene.index(b))))
    return frozenset(out)
