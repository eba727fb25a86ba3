"""`Constraint`: what a kind is. A kind states its equations; residual, Jacobian and freedom follow from them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from constraints import jacobians
from constraints.errors import GeometryError
from constraints.geometry import Geometry, perpendicular

Array = NDArray[np.float64]


def element(point: ArrayLike, direction: ArrayLike | None = None, reference: ArrayLike | None = None) -> Array:
    """A point and an orthonormal frame (E1, E2, D) by rows, (12,): what an equation needs of one body.

    `direction` is D; `reference`, where given, lies on the E1 side of it.
    """
    d = np.array([0.0, 0.0, 1.0]) if direction is None else np.asarray(direction, dtype=np.float64)
    d = d / np.linalg.norm(d)
    e1 = perpendicular(d) if reference is None else np.asarray(reference, dtype=np.float64)
    e1 = e1 - (e1 @ d) * d
    length = float(np.linalg.norm(e1))
    if length < 1e-9:
        raise GeometryError("reference is along the axis; give a direction at an angle to it", "reference")
    e1 = e1 / length
    return np.concatenate([np.asarray(point, dtype=np.float64), e1, np.cross(d, e1), d])


@dataclass(frozen=True, eq=False)
class Equation:
    """One equation of `constraints.jacobians` between two elements; `limits` bound equations of one row."""

    code: int
    a: Array
    """(12,) element on body a"""
    b: Array
    """(12,) element on body b"""
    limits: tuple[float, float] = (0.0, 0.0)
    extra: tuple[float, float] = (0.0, 0.0)
    """the equation's own numbers (a radius, a sense); for couplings `limits` and `extra` are its four"""


@dataclass(frozen=True)
class Symbol:
    """How a constraint is drawn, in the world frame."""

    shape: str
    """"plane", "axis", "point" or "rigid\""""
    origin: Array
    direction: Array
    size: float
    """m, radius or half width"""


@dataclass(frozen=True, eq=False)
class Constraint(ABC):
    """What a feature of body a and a feature of body b mean to each other. A frozen value; compare by identity.

    Subclasses state `kind`, `freedom` and `equations()`, and add their parameters as fields.
    """

    kind: ClassVar[str]
    freedom: ClassVar[int]
    """degrees of freedom it leaves between its two bodies, in general position"""
    symbol: ClassVar[str] = "axis"

    bodies: tuple[int, int]
    """ids of body a and body b"""
    features: tuple[Geometry, Geometry]
    """the feature of each, in its body's frame"""
    surfaces: tuple[tuple[int, ...], tuple[int, ...]] = ((), ())
    """faces of body a and of body b that the features are made of"""
    size: float = 0.01
    """m, half width of the smaller feature: to draw it, and to weigh radians against metres"""

    def __post_init__(self) -> None:
        a, b = self.bodies
        if a == b:
            raise GeometryError(f"{self.kind} of body {a} with itself; a constraint needs two bodies", "bodies")
        if not (np.isfinite(self.size) and self.size > 0.0):
            raise GeometryError(f"size is {self.size!r}; give a positive number of metres", "size")
        self.compiled  # noqa: B018 - wrong features are an error here, not in the solver

    @abstractmethod
    def equations(self) -> tuple[Equation, ...]:
        """The equations that hold when the constraint does."""

    def _feature(self, body: int, *types: type[Geometry]) -> Any:
        """The feature of a (0) or b (1), of one of `types`, else GeometryError."""
        feature = self.features[body]
        if not isinstance(feature, types):
            wanted = " or ".join(t.__name__.lower() for t in types)
            side = "ab"[body]
            raise GeometryError(
                f"{self.kind}: feature {side} is a {feature.kind}; give a {wanted}", f"features[{body}]"
            )
        return feature

    @cached_property
    def compiled(self) -> Compiled:
        """The equations as arrays for the kernels."""
        return Compiled.of(self.equations())

    @property
    def rows(self) -> int:
        """Number of equations' rows (their rank may be less: `6 - freedom`)."""
        return self.compiled.rows

    @property
    def angular(self) -> NDArray[np.bool_]:
        """(rows,) True where the row is in radians, False where in metres."""
        return self.compiled.angular

    def residual(self, pose_a: pin.SE3, pose_b: pin.SE3) -> Array:
        """How far from true it is at these poses: (rows,), metres and radians (see `angular`)."""
        return self.compiled.evaluate(pose_a, pose_b)[0]

    def jacobian(self, pose_a: pin.SE3, pose_b: pin.SE3) -> tuple[Array, Array]:
        """Derivatives (rows, 6) of `residual` by the local twists (linear first) of body a and of body b."""
        _, ja, jb = self.compiled.evaluate(pose_a, pose_b)
        return ja, jb

    def drawing(self, pose_a: pin.SE3) -> Symbol:
        """Where and how to draw it, from body a's pose."""
        x = self.compiled.element[0]
        return Symbol(self.symbol, pose_a.act(x[0:3]), pose_a.rotation @ x[9:12], self.size)

    def __repr__(self) -> str:
        return f"{type(self).__name__}(bodies={self.bodies}, surfaces={self.surfaces})"


_PAIR = np.array([[0, 1]], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Compiled:
    """Equations as flat arrays: see `constraints.jacobians.evaluate`."""

    code: NDArray[np.int64]
    element: Array
    param: Array
    start: NDArray[np.int64]
    rows: int
    angular: NDArray[np.bool_]

    @classmethod
    def of(cls, equations: tuple[Equation, ...]) -> Compiled:
        """Pack equations."""
        counts = [jacobians.ROWS[e.code] for e in equations]
        angular = [jacobians.ANGULAR[e.code] for e in equations for _ in range(jacobians.ROWS[e.code])]
        return cls(
            np.array([e.code for e in equations], dtype=np.int64),
            np.array([np.concatenate([e.a, e.b]) for e in equations]),
            np.array([(*e.limits, *e.extra) for e in equations], dtype=np.float64),
            np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64),
            sum(counts),
            np.array(angular, dtype=bool),
        )

    def evaluate(self, pose_a: pin.SE3, pose_b: pin.SE3) -> tuple[Array, Array, Array]:
        """Residual (rows,) and Jacobians (rows, 6) of both bodies."""
        rotation = np.stack([pose_a.rotation, pose_b.rotation])
        translation = np.stack([pose_a.translation, pose_b.translation])
        r = np.empty(self.rows)
        ja = np.empty((self.rows, 6))
        jb = np.empty((self.rows, 6))
        body = np.repeat(_PAIR, len(self.code), axis=0)
        jacobians.evaluate(self.code, body, self.element, self.param, self.start, rotation, translation, r, ja, jb)
        return r, ja, jb
