"""A feature at its present pose, and the limits within which a rule of recognition accepts a pair."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Generic, TypeVar, cast

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import Tolerance
from constraints.geometry.features import Feature
from constraints.geometry.metric_threads import DrawnThread
from constraints.geometry.overlap import height_spans, open_angle
from constraints.geometry.reach import deflection
from constraints.geometry.round_fit import RoundFit, round_fit
from constraints.geometry.surfaces import Cone, Cylinder, Geometry, Torus, Vector
from constraints.recognition.iso286 import fit_class, greatest_interference

CLEARANCE_HOLE = 4e-3
"""m: radial clearance of the widest hole of ISO 273, medium series (M150 in Ø158)"""
G = TypeVar("G", bound=Geometry, covariant=True)


@dataclass(frozen=True)
class Limits:
    """Limits within which a rule of recognition accepts a pair."""

    linear: float
    """m, on offsets and gaps"""
    angular: float
    """rad, on directions"""
    clearance: float
    """m, on the radius of a hollow surface over that of the solid one in it"""
    relative: float
    """1: share of its diameter by which a shaft may be looser than that in its bore"""
    overlap: float
    """m: the least shared length; negative while a part approaches"""
    strip: float
    """m: the least width of a shared area"""
    fit_class: str = ""
    """ISO 286 class of shafts in bores"""
    slack: float = 0.0
    """m: how exactly radii are known, and within which faces touch"""
    press_fit: str = Tolerance.press_fit
    """ISO 286 class of the tightest shaft in a hole H"""
    interference: float = 0.0
    """m, radial: by how much a solid surface may be larger than the hollow one whatever its diameter: of threads"""
    thread: DrawnThread | None = None
    """the metric thread that the two features of the pair stand for, drawn as plain cylinders"""

    @classmethod
    def offer(cls, tolerance: Tolerance) -> Limits:
        """Limits within which a candidate is offered."""
        return cls._at(tolerance, tolerance.reach, tolerance.reach_angular, max(tolerance.linear, tolerance.reach))

    @classmethod
    def keep(cls, tolerance: Tolerance) -> Limits:
        """Limits within which it stays: wider, so that small motions do not drop and offer it again and again."""
        r = tolerance.release
        return cls._at(tolerance, r * tolerance.reach, r * tolerance.reach_angular, tolerance.linear)

    @classmethod
    def _at(cls, tolerance: Tolerance, reach: float, angular: float, strip: float) -> Limits:
        return cls(
            linear=max(tolerance.linear, reach),
            angular=max(tolerance.angular, angular),
            clearance=tolerance.clearance,
            relative=tolerance.clearance_relative,
            overlap=tolerance.linear - reach,
            strip=strip,
            fit_class=tolerance.fit_class,
            slack=tolerance.linear,
            press_fit=tolerance.press_fit,
        )

    def fit(self, radius: float, clearance: float) -> bool:
        """Whether a shaft of `radius` fits a bore with this radial clearance (m; negative: interference)."""
        if self.fit_class and not fit_class(self.fit_class, 2.0 * radius).allows(2.0 * clearance, self.slack):
            return False
        loose = clearance > self.loosest(radius) + self.slack
        return not loose and self.round_fit(radius + clearance, clearance).kind != "clash"

    def snug(self, radius: float, clearance: float) -> bool:
        """Whether a ball or ring fits a hollow surface of `radius` with this radial clearance (m)."""
        return clearance <= self.clearance and self.round_fit(radius, clearance).kind != "clash"

    def round_fit(self, radius: float, clearance: float, offset: float = 0.0) -> RoundFit:
        """Classify a round surface in a hollow one of `radius`, with their axes or centres `offset` (m) apart."""
        return round_fit(clearance, offset, self.most_interference(radius), self.slack)

    def most_interference(self, radius: float) -> float:
        """Greatest radial interference (m) of a press fit in a bore of `radius`: of `fit_class`, if that is given."""
        if self.fit_class:
            most = max(0.0, -0.5 * fit_class(self.fit_class, 2.0 * radius).least)
        else:
            most = 0.5 * greatest_interference(self.press_fit, 2.0 * radius)
        return max(most, self.interference)

    def loosest(self, radius: float) -> float:
        """Greatest radial clearance (m) at which a shaft of `radius` fits a bore.

        At the tolerance's defaults that admits the medium clearance holes of ISO 273 from M1.6 to M150 (M6 in Ø6.6) and
        the coarse ones from M14 to M48.
        """
        return max(self.clearance, min(self.relative * 2.0 * radius, CLEARANCE_HOLE))


@dataclass(frozen=True, eq=False)
class Extent:
    """What is known of a feature once and for all, in its body's frame."""

    feature: Feature
    spans: NDArray[np.float64]
    """(k, 2) m: heights along its axis, from origin, apex or centre, that its faces cover; one (0, 0) without axis"""
    open: float
    """rad: the greatest angle about the axis that it does not cover"""
    center: Vector
    """(3,) mean of its samples"""

    @classmethod
    def of(cls, feature: Feature) -> Extent:
        g = feature.geometry
        center = feature.samples.mean(axis=0)
        if isinstance(g, Cylinder | Cone | Torus):
            origin = g.apex if isinstance(g, Cone) else g.origin if isinstance(g, Cylinder) else g.center
            spans = height_spans(feature.samples, feature.triangles, origin, g.axis)
            return cls(feature, spans, open_angle(feature.samples, origin, g.axis), center)
        return cls(feature, np.zeros((1, 2)), 0.0, center)

    @cached_property
    def sides(self) -> NDArray[np.float64]:
        """(k, 2, 3) its boundary: the sides of its triangles that belong to one of them alone."""
        t = self.feature.triangles
        sides = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
        _, first, counts = np.unique(np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True)
        return np.asarray(self.feature.samples[sides[first[counts == 1]]])

    @cached_property
    def radii(self) -> tuple[float, float]:
        """m: least and greatest distance of a cylinder's samples from its axis: a thread's roots and crests."""
        g = self.feature.geometry
        distance = g.distance(self.feature.samples)
        radius = g.radius if isinstance(g, Cylinder) else 0.0
        return radius + float(distance.min()), radius + float(distance.max())

    @cached_property
    def deflection(self) -> float:
        """m: how far its facets fall short of the surface they stand for."""
        return deflection(self.feature.geometry, self.feature.samples[self.feature.triangles])

    @cached_property
    def ball(self) -> tuple[Vector, float]:
        """Centre (3,) and radius (m) of a ball that holds the feature and, where it has one, its axis and origin."""
        g, points = self.feature.geometry, self.feature.samples
        if isinstance(g, Cylinder):
            points = np.concatenate([points, g.origin + np.append(self.spans.ravel(), 0.0)[:, None] * g.axis])
        return self.center, float(np.sqrt(((points - self.center) ** 2).sum(axis=1).max()))

    @property
    def length(self) -> float:
        """m: how much of its axis its faces cover."""
        return float((self.spans[:, 1] - self.spans[:, 0]).sum())


@dataclass(frozen=True, eq=False)
class FeatureView(Generic[G]):
    """A feature where it is now, of geometry G."""

    extent: Extent
    pose: pin.SE3

    @property
    def feature(self) -> Feature:
        return self.extent.feature

    @cached_property
    def geometry(self) -> G:
        """In world coordinates."""
        return cast(G, self.feature.geometry.transformed(self.pose))

    @cached_property
    def center(self) -> Vector:
        """(3,) world."""
        return np.asarray(self.pose.act(self.extent.center))

    @property
    def sides(self) -> NDArray[np.float64]:
        """(k, 2, 3) world: its boundary."""
        return np.asarray(self.extent.sides @ self.pose.rotation.T + self.pose.translation)

    @property
    def triangles(self) -> NDArray[np.float64]:
        """(t, 3, 3) world."""
        points = self.feature.samples @ self.pose.rotation.T + self.pose.translation
        return np.asarray(points[self.feature.triangles])
