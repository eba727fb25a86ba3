"""Text for people: names from files, with control characters escaped for terminals and HTML pages."""

from __future__ import annotations

import contextlib
import html
import re
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vpframe.scene.scene import Scene

NUMBERED = re.compile(r"\b(?:objects?|bodies|body|part) (\d+)\b(?: and (\d+)\b)?")
"""numbers of objects in messages of the packages below"""
BELOW = ("collision", "constraints", "physics")


def plain(text: str) -> str:
    """Return one line with non-printable characters escaped as in `repr`: control codes (`\\x1b`), line breaks, marks
    of writing direction, lone surrogates. Every name from a file passes through this function."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def plain_lines(text: str) -> str:
    """Apply `plain` to each line of a text."""
    return "\n".join(plain(line.expandtabs(4)) for line in text.split("\n"))


def escape(text: str) -> str:
    """Apply `plain` and escape HTML, for the content of an element or a quoted attribute."""
    return html.escape(plain(text))


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
