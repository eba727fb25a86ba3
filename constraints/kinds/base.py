"""`Constraint`: base of all kinds. A kind states its equations; residual, Jacobian and freedom follow from them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from operator import index
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from constraints.errors import GeometryError
from constraints.geometry.surfaces import LARGEST, Geometry, _positive
from constraints.kinds.equations import Array, Equation
from constraints.solve import jacobians


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
    """A geometric relation between a feature of body a and one of body b. A frozen value; compared by identity.

    Subclasses state `kind` and `equations()`, and add their parameters as fields. No kind states an equation twice:
    rows are independent in general position, and `freedom` is what they leave.
    """

    kind: ClassVar[str]
    symbol: ClassVar[str] = "axis"
    subgroup: ClassVar[bool] = False
    """whether the motions it allows form a subgroup of SE(3); then so do those of several of its like"""

    bodies: tuple[int, int]
    """ids of body a and body b"""
    features: tuple[Geometry, Geometry]
    """the feature of each, in its body's frame"""
    surfaces: tuple[tuple[int, ...], tuple[int, ...]] = ((), ())
    """faces of body a and of body b that the features are made of"""
    size: float = 0.01
    """m, half width of the smaller feature: to draw it, and to weigh radians against metres"""

    def __post_init__(self) -> None:
        try:
            a, b = map(index, self.bodies)
        except (TypeError, ValueError):
            a = b = -1
        if min(a, b) < 0:
            raise GeometryError(
                f"{self.kind}: bodies are {self.bodies!r}; give two ids, whole numbers from 0", "bodies"
            )
        if a == b:
            raise GeometryError(f"{self.kind} of body {a} with itself; a constraint needs two bodies", "bodies")
        object.__setattr__(self, "bodies", (a, b))
        if not (isinstance(self.features, tuple | list) and len(self.features) == 2):
            raise GeometryError(f"{self.kind}: features are {self.features!r}; give one of each body", "features")
        object.__setattr__(self, "size", _positive(self.size, "size"))
        try:  # compiled here, so that what is wrong is an error now, not later
            param, code = self.compiled.param.astype(np.float64), self.compiled.code
        except GeometryError:
            raise
        except (TypeError, ValueError, OverflowError) as error:
            raise GeometryError(
                f"{self.kind}: a parameter is not a number ({error}); give finite ones", "parameters"
            ) from None
        unbounded = np.isinf(param) & ~((code < jacobians.HELIX)[:, None] & (param[:, :1] < param[:, 1:2]))
        if (np.isnan(param) | unbounded).any():
            raise GeometryError(f"{self.kind}: a parameter is not a finite number; give one", "parameters")
        large = np.abs(param[np.isfinite(param)]).max(initial=0.0)
        if large > LARGEST:
            raise GeometryError(f"{self.kind}: a parameter is {large:g}; give one of at most {LARGEST:g}", "parameters")

    @abstractmethod
    def equations(self) -> tuple[Equation, ...]:
        """The equations of the constraint."""

    def feature(self, body: int, *types: type[Geometry]) -> Any:
        """The feature of a (0) or b (1), of one of `types`, else GeometryError."""
        feature = self.features[body]
        if not isinstance(feature, types):
            wanted = " or ".join(t.__name__.lower() for t in types)
            given = f"a {feature.kind}" if isinstance(feature, Geometry) else repr(feature)
            raise GeometryError(f"{self.kind}: feature {'ab'[body]} is {given}; give a {wanted}", f"features[{body}]")
        return feature

    @cached_property
    def compiled(self) -> Compiled:
        """The equations as arrays for the kernels."""
        return Compiled.of(self.equations())

    @cached_property
    def equalities(self) -> Compiled:
        """The equations without limits."""
        return Compiled.of(tuple(e for e in self.equations() if e.holds))

    @property
    def rows(self) -> int:
        """Number of rows of `residual`."""
        return self.compiled.rows

    @property
    def freedom(self) -> int:
        """Degrees of freedom that it leaves between its two bodies in general position; limits remove none."""
        return 6 - self.equalities.rows

    @property
    def angular(self) -> NDArray[np.bool_]:
        """(rows,) True where the row is in radians, False where in metres."""
        return self.compiled.angular

    @cached_property
    def periodic(self) -> bool:
        """Whether it holds again a turn or a tooth farther, with other poses in between where it does not."""
        return bool((self.compiled.code >= jacobians.HELIX).any())

    @property
    def reach(self) -> float:
        """m: lever arm of rotations, the greater of `size` and the features' radius."""
        radii = (getattr(f, name, 0.0) for f in self.features for name in ("radius", "major"))
        return max(self.size, *radii)

    def residual(self, pose_a: pin.SE3, pose_b: pin.SE3) -> Array:
        """(rows,) residual at these poses, m and rad (see `angular`); 0 where the constraint holds."""
        return self.compiled.evaluate(pose_a, pose_b)[0]

    def jacobian(self, pose_a: pin.SE3, pose_b: pin.SE3) -> tuple[Array, Array]:
        """Derivatives (rows, 6) of `residual` by the local twists (linear first) of body a and of body b."""
        _, ja, jb = self.compiled.evaluate(pose_a, pose_b)
        return ja, jb

    def drawing(self, pose_a: pin.SE3) -> Symbol:
        """Where and how to draw it: at body a's element of the first equation."""
        x = self.compiled.element[0]
        x = x[12:] if self.compiled.side[0, 0] else x[:12]
        return Symbol(self.symbol, pose_a.act(x[0:3]), pose_a.rotation @ x[9:12], self.size)

    def __repr__(self) -> str:
        return f"{type(self).__name__}(bodies={self.bodies}, surfaces={self.surfaces})"


class EitherWay(Constraint):
    """A kind that means the same with its features in either order: `pair` states it once, for the order `types`."""

    types: ClassVar[tuple[type[Geometry], ...]]

    def equations(self) -> tuple[Equation, ...]:
        a, b = (self.feature(i, *self.types) for i in (0, 1))
        if self.types.index(type(a)) <= self.types.index(type(b)):
            return self.pair(a, b)
        return tuple(e.swap() for e in self.pair(b, a))

    @abstractmethod
    def pair(self, a: Any, b: Any) -> tuple[Equation, ...]:
        """Equations of two features of which a's type comes no later in `types`; GeometryError if they have none."""


@dataclass(frozen=True, eq=False)
class Compiled:
    """Equations as flat arrays: see `constraints.solve.jacobians.evaluate`."""

    code: NDArray[np.int64]
    side: NDArray[np.int64]
    """(e, 2) which of the two bodies carries element a, and which element b"""
    element: Array
    param: Array
    start: NDArray[np.int64]
    rows: int
    angular: NDArray[np.bool_]

    @classmethod
    def of(cls, equations: tuple[Equation, ...]) -> Compiled:
        """Pack equations."""
        counts = [e.rows for e in equations]
        angular = [jacobians.ANGULAR[e.code] for e in equations for _ in range(e.rows)]
        return cls(
            np.array([e.code for e in equations], dtype=np.int64),
            np.array([(1, 0) if e.swapped else (0, 1) for e in equations], dtype=np.int64),
            np.array([np.concatenate([e.a, e.b]) for e in equations]),
            np.array([(*e.params, 0.0, 0.0, 0.0, 0.0)[:4] for e in equations]),
            (np.cumsum(counts) - counts).astype(np.int64),
            sum(counts),
            np.array(angular, dtype=bool),
        )

    def evaluate(self, pose_a: pin.SE3, pose_b: pin.SE3) -> tuple[Array, Array, Array]:
        """Residual (rows,) and Jacobians (rows, 6) of both bodies."""
        rotation = np.array([pose_a.rotation, pose_b.rotation])
        translation = np.array([pose_a.translation, pose_b.translation])
        r = np.empty(self.rows)
        first = np.empty((self.rows, 6))
        second = np.empty((self.rows, 6))
        jacobians.evaluate(
            self.code, self.side, self.element, self.param, self.start, rotation, translation, r, first, second
        )
        swapped = np.repeat(self.side[:, 0] == 1, np.diff(np.append(self.start, self.rows)))[:, None]
        return r, np.where(swapped, second, first), np.where(swapped, first, second)
