"""Constraints stated by kind, parts and surfaces: by a script, or by a file.

    session.constrain("gear", "driver", "driven", teeth=(20, 41))
    session.constrain("rack-and-pinion", "pinion", ("rack", 4), radius=0.012, teeth=24)
    session.constrain("distance", ("lid", 2), ("box", "rim"), at=0.004)

A part's name alone suffices if all its round surfaces share one axis, or if the kind applies to whole parts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from math import isfinite
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import Tolerance
from constraints import kinds
from constraints.errors import ConstraintsError
from constraints.geometry.features import Feature
from constraints.geometry.surfaces import Cone, Cylinder, Geometry, Plane, Torus
from constraints.kinds import Constraint, Line
from constraints.kinds.stated import parameter_names
from constraints.recognition.candidate import KINDS
from vpframe.errors import TaskError, near_names
from vpframe.scene.boxes import half_size, middle
from vpframe.scene.scene import Part, Scene

Place = str | tuple[str, int | str | Geometry]
"""a part; or a part and its surface (index or name) or a geometry in the part's frame"""

STATED: dict[str, type[Constraint]] = {
    kind.kind: kind
    for kind in (getattr(kinds, name) for name in kinds.__all__)
    if isinstance(kind, type) and issubclass(kind, Constraint) and kind is not Constraint
}
"""all constraint kinds, by name"""
NEEDED = {
    "angle": "at", "distance": "at", "offset": "at", "gear": "teeth", "belt": "teeth", "screw": "pitch",
    "rack-and-pinion": "radius",
}  # fmt: skip
"""required parameter of a kind"""
WHEELS = ("gear", "belt")
ABOUT_AXES = (*WHEELS, "screw", "concentric", "rack-and-pinion")
"""kinds for which a part's name suffices if all its round surfaces share one axis"""
HIDDEN = ("phase", "relative", "teeth_a", "teeth_b")
"""parameters computed from the present poses or from other arguments"""
ROUND = (Cylinder, Cone, Torus)


def statement(
    scene: Scene,
    features: Sequence[Sequence[Feature]],
    poses: Sequence[pin.SE3],
    kind: str,
    a: Place,
    b: Place,
    parameters: Mapping[str, Any],
    tolerance: Tolerance,
) -> Constraint:
    """Return the constraint that the arguments describe; threads, teeth and welds engage at `poses`.

    features: of every part, in scene order, from recognition.

    Raises
    ------
    UnknownPartError, or TaskError: unknown kind, surface or parameter.
    """
    name = str(kind).replace("_", "-").replace(" ", "-")
    if name not in STATED:
        like = near_names(name, STATED, 2)
        hint = f"did you mean {' or '.join(like)}?" if like else f"there are: {', '.join(sorted(STATED))}"
        raise TaskError(f"constrain: there is no constraint {kind!r}; {hint}")
    parts = [_part(scene, name, place) for place in (a, b)]
    if parts[0] is parts[1]:
        raise TaskError(f"constrain {name}: both ends are {parts[0].name}; name two parts")
    if all(part.fixed for part in parts):
        raise TaskError(f"constrain {name}: {parts[0].name} and {parts[1].name} are both fixed in the scene")
    bodies = (scene.index(parts[0].name), scene.index(parts[1].name))
    given = _parameters(name, parameters)
    try:
        if name == "fixed":
            if not (isinstance(a, str) and isinstance(b, str)):
                raise TaskError("constrain fixed: it holds whole parts; name no surfaces")
            return kinds.Fixed.between(bodies, poses[bodies[0]], poses[bodies[1]], min(map(_size, parts)))
        ends = [
            _end(name, part, place, features[i], which, tolerance)
            for part, place, i, which in zip(parts, (a, b), bodies, (0, 1), strict=True)
        ]
        if name in KINDS and bodies[0] > bodies[1]:  # the order of recognition, so that the same mate has the same key
            bodies, ends = (bodies[1], bodies[0]), ends[::-1]
        here = (poses[bodies[0]], poses[bodies[1]])
        (first, surfaces_a, size_a), (second, surfaces_b, size_b) = ends
        geometries = (first, second)
        if name in WHEELS:
            geometries = _same_way(geometries, here)
        elif name == "rack-and-pinion" and "sense" not in given:
            given["sense"] = _rack_side(geometries, here, scene.parts[bodies[1]])
        made = STATED[name](bodies, geometries, (surfaces_a, surfaces_b), min(size_a, size_b), **given)
        return made.engaged(*here) if isinstance(made, kinds.Screw | kinds.Gear | kinds.RackAndPinion) else made
    except ConstraintsError as error:
        raise TaskError(f"constrain {name} between {parts[0].name} and {parts[1].name}: {error}") from None


def words(constraint: Constraint, by: str = "script") -> str:
    """Describe a stated constraint in a few words. by: what states it, "script" or "model"."""
    shown = [n for n in parameter_names(type(constraint)) if n not in ("phase", "relative")]
    values = ", ".join(f"{n} {getattr(constraint, n)}" for n in shown)
    return f"stated by the {by}" + (f": {values}" if values else "")


def _part(scene: Scene, kind: str, place: Place) -> Part:
    if isinstance(place, str):
        return scene[place]
    if isinstance(place, tuple | list) and len(place) == 2 and isinstance(place[0], str):
        return scene[place[0]]
    raise TaskError(f'constrain {kind}: {place!r} names no part; give "part" or ("part", surface)')


def _size(part: Part) -> float:
    return half_size(part.mesh)


def _parameters(kind: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Convert a script's parameters to those of the constraint class."""
    out = dict(given)
    known = [n for n in parameter_names(STATED[kind]) if n not in HIDDEN]
    if kind in WHEELS:
        known += ["teeth", "ratio"]
    unknown = sorted(set(out) - set(known))
    if unknown:
        raise TaskError(f"constrain {kind}: it has no {unknown[0]!r}; it takes {', '.join(known) or 'no parameters'}")
    needed = NEEDED.get(kind)
    if needed is not None and needed not in out and "ratio" not in out:
        also = "=(of a, of b), or ratio" if kind in WHEELS else ""
        raise TaskError(f"constrain {kind}: {needed} is missing; give {needed}{also}")
    if kind in WHEELS:
        if "teeth" in out and "ratio" in out:
            raise TaskError(f"constrain {kind}: teeth and ratio say the same; give one of them")
        out["teeth_a"], out["teeth_b"] = _teeth(kind, out.pop("teeth", None), out.pop("ratio", None))
    elif kind == "rack-and-pinion":
        out.setdefault("teeth", 1)  # a wheel that rolls
    return out


def _teeth(kind: str, teeth: Any, ratio: Any) -> tuple[int, int]:
    """Return the numbers of teeth, from `teeth` or from `ratio`, the turns of a for one turn of b."""
    if ratio is not None:
        try:
            value = float(ratio)
        except (TypeError, ValueError):
            value = 0.0
        if not (isfinite(value) and value > 0.0):
            raise TaskError(f"constrain {kind}: ratio is {ratio!r}; give the turns of a for one turn of b, above 0")
        exact = Fraction(value).limit_denominator(1000)
        if float(exact) != value:
            raise TaskError(f"constrain {kind}: ratio is {ratio!r}, no ratio of whole numbers; give teeth=(of a, of b)")
        return exact.denominator, exact.numerator
    try:
        of_a, of_b = teeth
        if not (int(of_a) == of_a and int(of_b) == of_b and min(of_a, of_b) >= 1):
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        raise TaskError(f"constrain {kind}: teeth is {teeth!r}; give two whole numbers, (of a, of b)") from None
    return int(of_a), int(of_b)


def _end(
    kind: str, part: Part, place: Place, features: Sequence[Feature], which: int, tolerance: Tolerance
) -> tuple[Geometry, tuple[int, ...], float]:
    """Return geometry in the part's frame, its surfaces, and its half width (m)."""
    if isinstance(place, str):
        if kind not in ABOUT_AXES or (kind == "rack-and-pinion" and which == 1):
            raise TaskError(f'constrain {kind}: which surface of {part.name}? give ("{part.name}", index or name)')
        feature = _only_axis(kind, part, features, tolerance)
    elif isinstance(place[1], Geometry):
        return place[1], (), _size(part)
    else:
        index = _surface(kind, part, place[1])
        found = next((f for f in features if index in f.surfaces), None)
        if found is None:
            raise TaskError(f"constrain {kind}: surface {index} of {part.name} is freeform; name one that is analytic")
        feature = found
    extent = feature.samples - feature.samples.mean(axis=0)
    size = getattr(feature.geometry, "radius", float(np.sqrt((extent**2).sum(axis=1).max())))
    if kind in WHEELS and isinstance(feature.geometry, ROUND):
        return _axis(feature), feature.surfaces, size
    return feature.geometry, feature.surfaces, size


def _surface(kind: str, part: Part, which: int | str) -> int:
    """Return the index of a surface given by index or name."""
    n = len(part.surfaces)
    if isinstance(which, int | np.integer) and not isinstance(which, bool) and 0 <= which < n:
        return int(which)
    named = [s.index for s in part.surfaces if s.name == which] if isinstance(which, str) else []
    if len(named) != 1:
        what = f"{len(named)} surfaces {which!r}; give one's index" if named else f"no surface {which!r}"
        names = sorted({s.name for s in part.surfaces if s.name})[:8]
        there = f"it has 0 to {n - 1}" + (f", among them {', '.join(names)}" if names else "")
        raise TaskError(f"constrain {kind}: {part.name} has {what}; {there}")
    return named[0]


def _only_axis(kind: str, part: Part, features: Sequence[Feature], tolerance: Tolerance) -> Feature:
    """Return the largest round feature of a part whose round features all share one axis."""
    found = [f for f in features if isinstance(f.geometry, ROUND)]
    if not found:
        raise TaskError(f"constrain {kind}: {part.name} has no round surface, so no axis; name a surface or a Line")
    first = _axis(found[0])
    for feature in found[1:]:
        axis = _axis(feature)
        away = np.linalg.norm(np.cross(axis.origin - first.origin, first.axis))
        turned = np.linalg.norm(np.cross(axis.axis, first.axis))
        if turned > tolerance.angular or away > tolerance.linear:
            which = ", ".join(str(f.surfaces[0]) for f in found[:8])
            raise TaskError(
                f'constrain {kind}: {part.name} has several axes (surfaces {which}); give ("{part.name}", surface)'
            )
    return max(found, key=lambda f: (f.area, -f.surfaces[0]))


def _axis(feature: Feature) -> Line:
    """Return the axis of a round feature, with its origin at the middle of the feature."""
    g: Any = feature.geometry
    origin = g.origin if isinstance(g, Cylinder) else g.apex if isinstance(g, Cone) else g.center
    along = (feature.samples - origin) @ g.axis
    return Line(origin + 0.5 * (along.min() + along.max()) * g.axis, g.axis)


def _same_way(geometries: tuple[Geometry, Geometry], poses: tuple[pin.SE3, pin.SE3]) -> tuple[Geometry, Geometry]:
    """Direct both axes into one half space of the world, so that `sense` +1 is an external mesh."""
    a, b = geometries
    if not (isinstance(a, Line) and isinstance(b, Line)):
        return geometries
    facing = float((poses[0].rotation @ a.axis) @ (poses[1].rotation @ b.axis))
    return (a, Line(b.origin, -b.axis)) if facing < 0.0 else geometries


def _rack_side(geometries: tuple[Geometry, Geometry], poses: tuple[pin.SE3, pin.SE3], rack: Part) -> int:
    """Return the sign with which a rack on its side of the pinion moves along its direction as the pinion turns."""
    a, b = geometries
    axis, direction = _directed(a, poses[0]), _directed(b, poses[1])
    arm = poses[1].act(middle(rack.mesh)) - poses[0].act(_origin(a))
    return 1 if np.cross(axis, arm) @ direction >= 0.0 else -1


def _directed(geometry: Geometry, pose: pin.SE3) -> NDArray[np.float64]:
    vector = geometry.normal if isinstance(geometry, Plane) else getattr(geometry, "axis", np.zeros(3))
    return np.asarray(pose.rotation @ vector)


def _origin(geometry: Any) -> NDArray[np.float64]:
    return np.asarray(next(getattr(geometry, n) for n in ("origin", "apex", "center") if hasattr(geometry, n)))
