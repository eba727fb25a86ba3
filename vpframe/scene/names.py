"""Names of faces in tables, messages and reports."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from constraints.geometry.metric_threads import designation
from constraints.geometry.surfaces import Cone, Cylinder, Geometry, Plane, Sphere, Torus
from vpframe.scene.scene import Part
from vpframe.scene.subassembly import listed

CYLINDERS = {"convex": "shaft", "concave": "bore"}
"""names of cylinders by `Surface.orientation`"""
NAMED = 6
"""maximum number of face numbers that are listed"""

THREADED = ("screw", "bolt", "nut", "stud", "thread", "threaded", "tapped", "schraube", "mutter", "gewinde")
"""ends of words, without a plural's "s", that name threads"""
SIZE = re.compile(r"(?<![A-Za-z0-9])M(\d+(?:\.\d+)?)(?:\s?[xX×*]\s?(\d+(?:\.\d+)?))?(?![A-Za-z0-9])")
"""size of a metric thread, with its pitch or the length of a screw"""


def thread_words(name: str) -> tuple[str, ...]:
    """Return the words of a part's name that speak of a thread: "screw", "nut", …, sizes as "M6" and "M8×1".

    Of a path in the product tree only the last name counts.
    """
    own = name.rsplit("/", 1)[-1]
    sizes = [designation(float(size), float(pitch) if pitch else None) for size, pitch in SIZE.findall(own)]
    words = [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", own)]
    return (*dict.fromkeys(sizes), *dict.fromkeys(w for w in words if w.removesuffix("s").endswith(THREADED)))


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
