"""Text for people: names from files, with control characters escaped for terminals and HTML pages."""

from __future__ import annotations

import html


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
