"""Classification of pairs of parts as digital mock-up tools report them: clash, contact, clearance, containment.

With the tolerance tol = `Tolerance.linear` + the deflections of the two tessellations, two surfaces are in

- clash, if their penetration depth (see `collision.query.penetration`) is above tol;
- contact, if they meet less deeply, or are at most `Tolerance.linear` apart: flush faces, a faceted bolt in its bore;
- clearance, if they are farther apart, but the distance of the triangles minus the two deflections is less than the
  wanted clearance.

Two parts are in containment if one lies wholly inside the other. Two parts whose surfaces only touch, but which have
material in common, clash as a whole, as two identical parts in one place. The winding number decides what lies inside a
mesh that is not closed, such as a part that lost a face; `open` of such a row names the open mesh.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from types import MappingProxyType
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from collision.errors import CollisionError
from collision.manager import CollisionManager
from collision.mesh import SurfaceMesh

Kind = Literal["clash", "containment", "contact", "clearance", "authorised"]
KINDS: tuple[Kind, ...] = ("clash", "containment", "authorised", "contact", "clearance")
"""from the most severe to the least"""

INSIDE: Final = ("clash", "containment", "authorised")
"""kinds that depend on the interior of the parts"""
SAMPLES: Final = 512
"""largest triangles of a part, behind whose centroids the search for common material takes its points"""


class Reason(StrEnum):
    """Reason of the classification of two objects as a whole."""

    NONE = ""
    INSIDE = "inside"
    """one lies wholly inside the other"""
    COMMON = "common material"
    """their surfaces only touch, but they have material in common"""


@dataclass(frozen=True, slots=True, eq=False)
class PairClass:
    """The relation of two surfaces, or of two parts as a whole."""

    kind: Kind
    objects: tuple[int, int]
    """the lower id first"""
    surfaces: tuple[int, int] | None
    """one surface of each object; None if the row is for the parts as a whole: containment, coincident parts"""
    distance: float
    """m; 0 if the surfaces intersect"""
    depth: float
    """m, the penetration depth; 0 without penetration"""
    witness: NDArray[np.float64]
    """(3,) m, world frame: the deepest point, or the middle between the nearest points"""
    reason: Reason = Reason.NONE
    inner: int | None = None
    """the object that lies inside the other"""
    bound: float = 0.0
    """m: upper bound of the penetration depth, up to the precision of depths"""
    open: tuple[int, ...] = ()
    """objects that are not closed, if the kind of a row of the two depends on their interior"""

    def words(self, names: Sequence[str] | None = None) -> str:
        """Return the reason as a sentence; empty if there is none. names: of all objects, by id."""
        if self.reason is Reason.NONE:
            return ""
        first, second = (f"object {i}" if names is None else names[i] for i in self.objects)
        if self.reason is Reason.INSIDE:
            inner, outer = (first, second) if self.inner == self.objects[0] else (second, first)
            return f"{inner} lies wholly inside {outer}"
        return f"{first} and {second} have material in common though their surfaces only touch"


def classify(
    manager: CollisionManager,
    clearance: float = 0.0,
    deflection: float | Sequence[ArrayLike] = 0.0,
    authorised: Iterable[Sequence[int]] = (),
    objects: Iterable[int] | None = None,
) -> list[PairClass]:
    """Return every pair of surfaces, and of parts, that clashes, touches or comes within the clearance.

    Parameters
    ----------
    clearance: wanted distance of parts, m.
    deflection: m, sum of the deflections of the tessellations of two surfaces; or for each object those of its
        surfaces.
    authorised: pairs of objects (i, j), or of surfaces (i, surface of i, j, surface of j), whose clash is intended,
        such as a press fit: their kind is "authorised".
    objects: only pairs with at least one of these; None for all.

    Returns
    -------
    Rows sorted by objects; the row of the parts as a whole (surfaces None) precedes those of their surfaces.

    Raises
    ------
    CollisionError: a clearance or deflection that is negative or not finite; an authorised pair that is neither.
    """
    near = near_pairs(manager, clearance, deflection, objects)
    return [pair for pairs in near.classified(authorised) for pair in pairs]


@dataclass(frozen=True, eq=False)
class NearPairs:
    """Pairs of objects that are near one another, with what is known before depths are."""

    manager: CollisionManager
    wanted: float
    """m"""
    slack: dict[int, NDArray[np.float64]]
    """deflection of each surface, m, by object"""
    pairs: list[tuple[int, int]]
    """sorted"""
    contacts: list[NDArray[Any]]
    """CONTACT_DTYPE rows, of each pair"""

    def classified(
        self,
        authorised: Iterable[Sequence[int]] = (),
        settled: Mapping[tuple[int, int], Sequence[tuple[Sequence[int], Sequence[int]]]] = MappingProxyType({}),
    ) -> Iterator[list[PairClass]]:
        """Yield the rows of `classify` of each pair of objects, in order, as soon as depths up to it are known.

        settled: of two objects (i, j) surfaces of i, and surfaces of j that are known not to clash with them: how deep
            they are is not searched.
        """
        from collision.solid import solid_of

        manager, wanted, tolerance = self.manager, self.wanted, self.manager.tolerance.linear
        meant = _authorised(authorised)

        def nearness(i: int, j: int) -> NDArray[np.float64]:
            return np.asarray(tolerance + self.slack[i][:, None] + self.slack[j][None, :])

        def limit(i: int, j: int) -> NDArray[np.float64]:
            limits = nearness(i, j)
            for first, second in settled.get((i, j), ()):
                limits[np.ix_(np.array(first, np.int64), np.array(second, np.int64))] = np.inf
            return limits

        meets = [bool((rows["distance"] == 0.0).any()) for rows in self.contacts]
        penetrations = manager.penetrations([pair for pair, met in zip(self.pairs, meets, strict=True) if met], limit)
        for (i, j), rows, met in zip(self.pairs, self.contacts, meets, strict=True):
            limits = nearness(i, j)
            found = next(penetrations) if met else ()
            depths = {(int(p["surface_a"]), int(p["surface_b"])): p for p in found}
            pairs: list[PairClass] = []
            for row in rows:
                surfaces = int(row["surface_a"]), int(row["surface_b"])
                distance, near = float(row["distance"]), float(limits[surfaces])
                if distance > wanted + near - tolerance:
                    continue
                deep = depths.get(surfaces)
                depth, bound = (0.0, 0.0) if deep is None else (float(deep["depth"]), float(deep["bound"]))
                kind: Kind = "clash" if depth > near else "contact" if distance <= tolerance else "clearance"
                if kind == "clash" and ((i, j) in meant or (i, surfaces[0], j, surfaces[1]) in meant):
                    kind = "authorised"
                witness = deep["point"] if deep is not None else (row["point_a"] + row["point_b"]) / 2
                pairs.append(PairClass(kind, (i, j), surfaces, distance, depth, np.array(witness), bound=bound))
            if not any(pair.kind in INSIDE for pair in pairs):
                whole = _as_a_whole(manager, i, j, met, float(limits.max()), (i, j) in meant)
                if whole is not None:
                    pairs.insert(0, whole)
            if any(pair.kind in INSIDE for pair in pairs):
                gaps = tuple(k for k in (i, j) if not solid_of(manager.mesh(k)).closed)
                pairs = [replace(pair, open=gaps) if pair.kind in INSIDE else pair for pair in pairs]
            yield pairs


def near_pairs(
    manager: CollisionManager,
    clearance: float = 0.0,
    deflection: float | Sequence[ArrayLike] = 0.0,
    objects: Iterable[int] | None = None,
) -> NearPairs:
    """Return the pairs of objects that `classify` judges; its arguments and errors."""
    if not 0.0 <= clearance < np.inf:
        raise CollisionError(f"clearance is {clearance!r}; give a finite length of at least 0 m")
    slack, wanted = _deflections(manager, deflection), max(manager.tolerance.linear, clearance)
    most = {i: float(given.max(initial=0.0)) for i, given in slack.items()}
    pairs = manager.object_pairs(objects, wanted + 2.0 * max(most.values(), default=0.0)).tolist()
    contacts = [manager.pair_contacts(i, j, wanted + most[i] + most[j]) for i, j in pairs]
    return NearPairs(manager, wanted, slack, [(i, j) for i, j in pairs], contacts)


def _deflections(manager: CollisionManager, deflection: float | Sequence[ArrayLike]) -> dict[int, NDArray[np.float64]]:
    """The deflections of the surfaces of each object, m; half of one number given for both surfaces of a pair."""
    out = {}
    for i in manager.objects:
        given = deflection / 2.0 if isinstance(deflection, (int, float)) else deflection[i]
        surfaces = manager.mesh(i).n_surfaces
        out[i] = np.broadcast_to(np.asarray(given, dtype=np.float64), (surfaces,))
        if not (np.isfinite(out[i]).all() and (out[i] >= 0.0).all()):
            raise CollisionError(f"deflection of object {i} is {given!r}; give finite lengths of at least 0 m")
    return out


def _authorised(pairs: Iterable[Sequence[int]]) -> set[tuple[int, ...]]:
    out: set[tuple[int, ...]] = set()
    for pair in pairs:
        p = tuple(int(k) for k in pair)
        if len(p) not in (2, 4):
            raise CollisionError(f"authorised pair {p}; give (i, j) or (i, surface of i, j, surface of j)")
        half = len(p) // 2
        out.add(p if p[0] < p[half] else p[half:] + p[:half])
    return out


def _as_a_whole(
    manager: CollisionManager, i: int, j: int, touching: bool, near: float, meant: bool
) -> PairClass | None:
    """Containment, or common material of parts whose surfaces only touch."""
    from collision.query.containment import inside
    from collision.query.signed_distance import signed_distances

    mesh_i, mesh_j = manager.mesh(i), manager.mesh(j)
    world, pose = manager.pose(i), manager.relative_pose(i, j)
    if not touching:
        for outer, inner, mesh, other, move in (
            (i, j, mesh_i, mesh_j, pose),
            (j, i, mesh_j, mesh_i, pose.inverse()),
        ):
            if manager.contains(outer, inner):
                points = other.vertices @ move.rotation.T + move.translation
                depths = -signed_distances(mesh, points)
                deepest = int(np.argmax(depths))
                row = manager.clearance(i, j)[0]
                return PairClass(
                    "authorised" if meant else "containment",
                    (i, j), None, float(row["distance"]), float(depths[deepest]),
                    manager.pose(outer).act(points[deepest]), Reason.INSIDE, inner,
                )  # fmt: skip
        return None
    below_j = _below_the_surface(mesh_j, near) @ pose.rotation.T + pose.translation
    points = np.concatenate([_below_the_surface(mesh_i, near), below_j])
    there = (points - pose.translation) @ pose.rotation
    deep = _may_be_deeper(mesh_i, points, near) & _may_be_deeper(mesh_j, there, near)
    points, there = points[deep], there[deep]
    depth = -signed_distances(mesh_i, points)
    deep = depth > near
    points, there = points[deep], there[deep]
    depth = np.minimum(depth[deep], -signed_distances(mesh_j, there))
    for k in np.argsort(-depth, kind="stable").tolist():
        if depth[k] <= near:
            return None
        if inside(mesh_i, points[k])[0] and inside(mesh_j, there[k])[0]:
            break
    else:
        return None
    kind: Kind = "authorised" if meant else "clash"
    return PairClass(kind, (i, j), None, 0.0, float(depth[k]), world.act(points[k]), Reason.COMMON)


def _may_be_deeper(mesh: SurfaceMesh, points: NDArray[np.float64], near: float) -> NDArray[np.bool_]:
    """Whether points (n, 3), m, may be deeper than `near` (m) behind a mesh: not if the mesh is closed and a point is
    nearer to a side of its bounding box."""
    from collision.solid import solid_of

    if not solid_of(mesh).closed:
        return np.ones(len(points), np.bool_)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    rounding = 1e-12 * max(float(np.abs(low).max()), float(np.abs(high).max()))
    within = near - rounding
    return np.asarray(((points >= low + within) & (points <= high - within)).all(axis=1))


def _below_the_surface(mesh: SurfaceMesh, near: float) -> NDArray[np.float64]:
    """(n, 3) points behind the centroids of the largest triangles, m, at depths from 2·near to half the mesh's size."""
    corners = mesh.vertices[mesh.triangles]
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(n, axis=1)
    chosen = np.sort(np.argsort(-area, kind="stable")[:SAMPLES])
    chosen = chosen[area[chosen] > 0.0]
    normal, middle = n[chosen] / area[chosen, None], corners[chosen].mean(axis=1)
    size = float(np.ptp(mesh.vertices, axis=0).max())
    depths = [2.0 * near]
    while depths[-1] * 4.0 < size:
        depths.append(depths[-1] * 4.0)
    return np.concatenate([middle - depth * normal for depth in depths])
