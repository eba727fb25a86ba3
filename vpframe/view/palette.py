"""One set of colours for the page, the recording and the pictures: sRGB values in 0 … 1, as parts have them."""

from __future__ import annotations

import colorsys

from vpframe.events import Event
from vpframe.scene.scene import GREY, Scene

Color = tuple[float, float, float]

COLLIDING: Color = (0.90, 0.16, 0.14)
"""colliding surface"""
CANDIDATE: Color = (0.96, 0.65, 0.14)
"""offered constraint"""
ACTIVE: Color = (0.10, 0.62, 0.34)
"""constraint in force"""
REFUSED: Color = (0.55, 0.55, 0.58)
"""refused constraint"""
FREEDOM: Color = (0.16, 0.42, 0.86)
"""remaining freedom"""
HAND: Color = (0.98, 0.80, 0.20)
"""hand, and the part it holds"""
TRAIL: Color = (0.45, 0.35, 0.75)
"""trail of the held part"""
GAP: Color = (0.75, 0.10, 0.62)
"""place of least clearance"""
EDGE: Color = (0.13, 0.15, 0.19)
BACKGROUND: tuple[Color, Color] = ((0.97, 0.98, 0.99), (0.80, 0.84, 0.89))
"""top and bottom"""

STATE: dict[str, Color] = {"candidate": CANDIDATE, "active": ACTIVE, "refused": REFUSED}

TONES: dict[str, Color] = {"bad": COLLIDING, "offer": CANDIDATE, "good": ACTIVE, "hand": FREEDOM, "plain": REFUSED}
"""colours of events, by tone"""

_TONE = {
    "collided": "bad",
    "blocked": "bad",
    "recognised": "offer",
    "accepted": "good",
    "satisfied": "good",
    "landed": "good",
    "grabbed": "hand",
    "released": "hand",
}


def tone(event: Event) -> str:
    """Return the tone of an event, one of TONES. An expectation that holds is good, one that fails is bad."""
    if event.kind == "expectation":
        return "good" if event.data.get("holds", False) else "bad"
    return _TONE.get(event.kind, "plain")


def part_colors(scene: Scene) -> dict[str, Color]:
    """Return the colour of each part: the file's hue if it states one, else hues a golden angle apart; all muted.

    CAD files like full red and green; muted, they leave vivid colours to what a viewer has to see (a collision is red).
    Instances of one shape share a hue, so that four equal bolts look like four equal bolts.
    """
    hue_of: dict[int, int] = {}
    colors: dict[str, Color] = {}
    for part in scene.parts:
        number = hue_of.setdefault(id(part.shape), len(hue_of))
        if tuple(part.color) != GREY:
            hue, lightness, saturation = colorsys.rgb_to_hls(*part.color[:3])
            colors[part.name] = colorsys.hls_to_rgb(hue, min(max(lightness, 0.42), 0.82), min(saturation, 0.42))
        else:
            colors[part.name] = colorsys.hls_to_rgb((0.58 + number * 0.381966) % 1.0, 0.66, 0.38)
    return colors


def hex_color(color: Color) -> str:
    """`#rrggbb`."""
    return "#" + "".join(f"{round(255 * min(max(c, 0.0), 1.0)):02x}" for c in color)
