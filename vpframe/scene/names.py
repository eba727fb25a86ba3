"""Names of parts and faces in tables, messages and reports."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Iterator, Sequence

from constraints.geometry.surfaces import Cone, Cylinder, Geometry, Plane, Sphere, Torus
from vpframe.scene.scene import Part, Scene
from vpframe.scene.subassembly import listed

CYLINDERS = {"convex": "shaft", "concave": "bore"}
"""names of cylinders by `Surface.orientation`"""
NAMED = 6
"""maximum number of face numbers that are listed"""
NUMBERED = re.compile(r"\b(?:objects?|bodies|body|part) (\d+)\b(?: and (\d+)\b)?")
"""numbers of objects in messages of the packages below"""
BELOW = ("collision", "constraints", "physics")


def face_name(part: Part, *surfaces: int) -> str:
    """Name faces of a part: "housing · face 12 · bore Ø20"; numbers are indices into `part.surfaces`."""
    return f"{part.name} · {face_words(part, *surfaces)}"


def face_words(part: Part, *surfaces: int) -> str:
    """Name faces of a part without the part's name: "face 12 · bore Ø20"."""
    known = [part.surfaces[s] for s in surfaces if 0 <= s < len(part.surfaces)]
    words = dict.fromkeys(geometry_words(face.geometry, face.orientation) for face in known)
    numbers = ", ".join(map(str, surfaces[:NAMED])) + (f" … ({len(surfaces)})" if len(surfaces) > NAMED else "")
    return " · ".join([f"face{'s' if len(surfaces) > 1 else ''} {numbers}", *([", ".join(words)] if words else [])])


def obstacles_words(met: Sequence[tuple[Part, str]]) -> str:
    """Say which parts stand in the way, each with a few words on where: "board stands in its way (face 3 · plane)"."""
    remove = "" if all(part.fixed for part, _ in met) else f"; remove {'it' if len(met) == 1 else 'them'} first"
    if len(met) == 1:
        return f"{met[0][0].name} stands in its way ({met[0][1]}){remove}"
    return f"{listed([f'{part.name} ({where})' for part, where in met])} stand in its way{remove}"


def geometry_words(geometry: Geometry, orientation: str = "") -> str:
    """Name a geometry with its size in mm: "plane", "bore Ø20", "cone 90°", …

    Parameters
    ----------
    orientation: `Surface.orientation`: "convex" for a shaft, "concave" for a bore.
    """
    match geometry:
        case Plane():
            return "plane"
        case Cylinder(radius=radius):
            return f"{CYLINDERS.get(orientation, 'cylinder')} {_diameter(radius)}"
        case Cone(half_angle=half):
            return f"cone {_round(math.degrees(2.0 * half))}°"
        case Sphere(radius=radius):
            return f"sphere {_diameter(radius)}"
        case Torus(major=major, minor=minor):
            return f"torus {_diameter(major)} × {_diameter(minor)}"
        case _:
            return "free form"


def is_of(part: str, name: str) -> bool:
    """Whether `name` is the part's name or that of a subassembly that contains it."""
    return part == name or part.startswith(f"{name}/")


def _diameter(radius: float) -> str:
    return f"Ø{_round(2e3 * radius)}"


def _round(value: float) -> str:
    """Format a number with three decimals, or three significant digits if small, without trailing zeros."""
    return f"{round(value, 3):.12g}" if value >= 0.1 else f"{value:.3g}"


@contextlib.contextmanager
def in_part_names(scene: Scene) -> Iterator[None]:
    """Put part names in place of object numbers into errors of the packages below that are raised inside."""
    try:
        yield
    except ValueError as error:  # the common base of the packages' errors
        if type(error).__module__.partition(".")[0] in BELOW:
            error.args = (with_part_names(str(error), scene),)
        raise


def with_part_names(text: str, scene: Scene) -> str:
    """Replace object numbers in a message by part names: "bolt_2" for "object 3 (bolt)"."""
    parts = scene.parts

    def names(match: re.Match[str]) -> str:
        places = [int(number) for number in match.groups() if number is not None]
        return " and ".join(parts[k].name for k in places) if max(places) < len(parts) else match[0]

    text = NUMBERED.sub(names, text)
    for part in parts:
        for called in (part.mesh.name, part.name):
            text = text.replace(f"{part.name} ({called})", part.name)
    return text
