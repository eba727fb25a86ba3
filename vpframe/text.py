"""Text for people and for what shows it: names from files are escaped for terminals, HTML pages, scripts and tables."""

from __future__ import annotations

import base64
import csv
import html
import io
import json
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

_MARKUP = {ord(c): f"\\u{ord(c):04x}" for c in "<>&\u2028\u2029"}
_FORMULA = re.compile(r"'*\s*[-=+@\uff0b\uff0d\uff1d\uff20]")
"""what spreadsheets take for a formula, and the same behind the quotes that mark text; also the full-width signs"""
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


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


def script_json(value: Any) -> str:
    """Return JSON that may stand in a `<script>` element: in it nothing can begin or end an element or a comment."""
    return json.dumps(value, separators=(",", ":")).translate(_MARKUP)


def rendered(template: str, **contents: Any) -> str:
    """Return a page from a template (Jinja), named by its path in this package, and its contents.

    Texts are escaped as by `escape`, except where the template says `safe`. Raises UndefinedError for a name without
    content.
    """
    return _templates().get_template(template).render(contents)


@cache
def _templates() -> Any:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    made = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True, keep_trailing_newline=True,
        finalize=lambda value: plain(value) if type(value) is str else value,
    )  # fmt: skip
    made.filters["base64"] = lambda data: base64.b64encode(data).decode("ascii")
    return made


def csv_text(rows: Iterable[Iterable[Any]]) -> str:
    """Return rows of cells as CSV, lines end in `\\n`: floats with all digits, None empty, texts by `cell`."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([cell(value) for value in row] for row in rows)
    return text.getvalue()


def cell(value: Any) -> Any:
    """Return the value of a cell of a table: texts by `plain`, quoted by `'` if a spreadsheet would compute them.

    Numbers, and texts that are numbers, stay what they are. `uncell` is the inverse for texts that `plain` keeps.
    """
    if not isinstance(value, str):
        return repr(value) if type(value) is float else value
    text = plain(value)
    return f"'{text}" if _FORMULA.match(text) and not _NUMBER.fullmatch(text) else text


def uncell(text: str) -> str:
    """Return the text that `cell` has written."""
    return text[1:] if text.startswith("'") and _FORMULA.match(text) else text
