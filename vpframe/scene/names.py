"""Names of parts and faces in tables, messages and reports."""

from __future__ import annotations

import contextlib
import math
import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import TypeVar

from constraints.geometry.metric_threads import designation
from constraints.geometry.surfaces import Cone, Cylinder, Geometry, Plane, Sphere, Torus
from vpframe.scene.scene import Part, Scene
from vpframe.scene.subassembly import listed

Name = TypeVar("Name", str, int)
"""name or number of a part"""
CYLINDERS = {"convex": "shaft", "concave": "bore"}
"""names of cylinders by `Surface.orientation`"""
NAMED = 6
"""maximum number of face numbers, and of obstacles, that are listed"""
NUMBERED = re.compile(r"\b(?:objects?|bodies|body|part) (\d+)\b(?: and (\d+)\b)?")
"""numbers of objects in messages of the packages below"""
BELOW = ("collision", "constraints", "physics")

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


def ignored_words(pairs: Iterable[tuple[str, str]], count: int) -> str:
    """Name the pairs of parts that may pass through each other: "ignores hose–bracket, nut–all"; empty without pairs.

    count: parts of the scene; a part that is paired with all others is named once.
    """
    pairs = list(pairs)
    times = Counter(name for pair in pairs for name in pair)
    whole = {name for name, n in times.items() if n == count - 1 and count > 2}
    words = dict.fromkeys(f"{name}–all" for name in times if name in whole)
    words |= dict.fromkeys(f"{a}–{b}" for a, b in pairs if not {a, b} & whole)
    return f"ignores {', '.join(words)}" if words else ""


def holders(met: Iterable[Name], group: Collection[Name], pairs: Iterable[tuple[Name, Name]]) -> frozenset[Name]:
    """Return the parts of `met` that fasten a group: a mate joins them to a part behind the group.

    group: the parts that move as one. met: parts ahead of it. pairs: parts that a mate joins, in either order. A part
    is behind the group if a mate joins it to the group and it is not in `met`: the housing under a cover, to which the
    screws through the cover are mated.
    """
    ahead = frozenset(met)
    joined = [pair for a, b in pairs for pair in ((a, b), (b, a))]
    behind = {b for a, b in joined if a in group} - ahead - set(group)
    return frozenset(a for a, b in joined if a in ahead and b in behind)


def obstacles_words(met: Sequence[tuple[Part, str]], holding: Collection[str] = ()) -> str:
    """Say which parts stop a motion, each with a few words on where; those that hold the moving part come first.

    "screw_1 (face 3 · plane) and screw_2 (face 3 · plane) hold it; remove them first". A fixed part is never to be
    removed, nor is any other where a fixed one stands in the way as well.

    holding: names of those parts of `met` that hold it (see `holders`).
    """
    hold = [(part, where) for part, where in met if part.name in holding and not part.fixed]
    others = [pair for pair in met if pair not in hold]
    clauses = [
        f"{of[0][0].name} {verb}s {how} ({of[0][1]})"
        if len(of) == 1
        else f"{_joined([f'{part.name} ({where})' for part, where in of])} {verb} {how}"
        for of, verb, how in ((hold, "hold", "it"), (others, "stand", "in its way"))
        if of
    ]
    first = [part for part, _ in hold or others]
    fixed = [part.name for part in first if part.fixed]  # of those that hold it none is
    if fixed:
        mend = f"{_joined(fixed)} {'is' if len(fixed) == 1 else 'are'} fixed"
    elif hold and others:
        mend = f"remove {_joined([part.name for part in first])} first"
    else:
        mend = f"remove {'it' if len(first) == 1 else 'them'} first"
    return f"{', '.join(clauses)}; {mend}"


def holding_words(mates: Iterable[tuple[str, str, str]], sizes: Mapping[str, str]) -> str:
    """Say which constraints forbid a motion: "held by against: cover – screw_1, screw_2 (2 × M5); angle: cover – pin".

    mates: (kind, own part, other part) of each. sizes: of fasteners, by name.
    """
    by: dict[tuple[str, str], dict[str, None]] = {}
    for kind, own, other in mates:
        by.setdefault((kind, own), {})[other] = None
    clauses = []
    for (kind, own), others in by.items():
        counts = Counter(sizes[name] for name in others if name in sizes)
        many = ", ".join(f"{n} × {size}" if n > 1 else size for size, n in counts.items())
        names = [*others][:NAMED] + ([f"{len(others) - NAMED} more"] if len(others) > NAMED else [])
        clauses.append(f"{kind}: {own} – {', '.join(names)}{f' ({many})' if many else ''}")
    return f"held by {'; '.join(clauses)}" if clauses else ""


def mates_words(mates: Iterable[tuple[str, str]]) -> str:
    """Say which constraints hold a part, of (kind, other part): "held by its constraints: concentric (housing)"."""
    named = dict.fromkeys(f"{kind} ({other})" for kind, other in mates)
    return f"held by its constraints: {listed(list(named))}" if named else ""


def _joined(words: Sequence[str]) -> str:
    """Join words: "a", "a and b", "a, b and c", at most `NAMED` of them."""
    if len(words) > NAMED:
        return f"{', '.join(words[:NAMED])} and {len(words) - NAMED} more"
    return " and ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


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
