"""Text for people: names out of files shown as they are, and never as orders to a terminal or a page."""

from __future__ import annotations

import contextlib
import html
import re
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vpframe.scene.scene import Scene

NUMBERED = re.compile(r"\b(?:objects?|bodies|body|part) (\d+)\b(?: and (\d+)\b)?")
"""how messages of the packages below call what they know by number only"""
BELOW = ("collision", "constraints", "physics")


def plain(text: str) -> str:
    """One line in which what cannot be printed stands as in a `repr`: control codes (`\\x1b`), line breaks, marks that
    turn the direction of writing, half characters. Names on their way to people go through here."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def plain_lines(text: str) -> str:
    """The same of a text of several lines, which stay lines."""
    return "\n".join(plain(line.expandtabs(4)) for line in text.split("\n"))


def escape(text: str) -> str:
    """`plain`, for the content of an HTML or SVG element, or an attribute in quotes."""
    return html.escape(plain(text))


@contextlib.contextmanager
def in_part_names(scene: Scene) -> Iterator[None]:
    """Errors raised inside by the packages below, which know the places of the scene's parts only, get their names."""
    try:
        yield
    except ValueError as error:  # the base of the roots of all three
        if type(error).__module__.partition(".")[0] in BELOW:
            error.args = (with_part_names(str(error), scene),)
        raise


def with_part_names(text: str, scene: Scene) -> str:
    """A message with the names of parts instead of their places: "bolt_2" for "object 3 (bolt)"."""
    parts = scene.parts

    def names(match: re.Match[str]) -> str:
        places = [int(number) for number in match.groups() if number is not None]
        return " and ".join(parts[k].name for k in places) if max(places) < len(parts) else match[0]

    text = NUMBERED.sub(names, text)
    for part in parts:
        for called in (part.mesh.name, part.name):
            text = text.replace(f"{part.name} ({called})", part.name)
    return text
