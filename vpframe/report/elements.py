"""Pieces of HTML that the pages of runs and of plans share."""

from __future__ import annotations

import base64
from collections.abc import Container, Iterable, Sequence
from pathlib import Path

from vpframe.text import escape, filled

TEMPLATE = Path(__file__).parent / "page.html"


def whole(title: str, sections: Iterable[str]) -> str:
    """Return the page of non-empty sections."""
    return filled(TEMPLATE, title=escape(title), body="\n".join(filter(None, sections)))


def head(title: str, line: str, verdict: str, good: bool, facts: Iterable[tuple[str, str]]) -> str:
    """Return the head of a page: title, a line (HTML) below it, the verdict, and facts by name."""
    cells = "".join(f'<div class="fact"><span class="dim">{name}</span><b>{escape(v)}</b></div>' for name, v in facts)
    return (
        f"<h1>{escape(title)}</h1><div class='dim'>{line}</div>"
        f"<div class='verdict{'' if good else ' no'}'>{escape(verdict)}</div><div class='facts'>{cells}</div>"
    )


def section(title: str, content: str) -> str:
    """Return a section; empty without content."""
    return f"<h2>{title}</h2>\n{content}" if content else ""


def table(names: Sequence[str], rows: Sequence[Sequence[str]], numbers: Container[int] = ()) -> str:
    """Return a table of cells (HTML); empty without rows. numbers: columns that hold numbers."""

    def cells(row: Sequence[str], tag: str) -> str:
        return "".join(f"<{tag}{' class=n' if i in numbers else ''}>{cell}</{tag}>" for i, cell in enumerate(row))

    body = "".join(f"<tr>{cells(row, 'td')}</tr>" for row in rows)
    return f"<table><tr>{cells(names, 'th')}</tr>{body}</table>" if rows else ""


def figure(picture: bytes | None, caption: str, style: str = "") -> str:
    """Return a PNG with its caption (HTML); empty without a picture."""
    if picture is None:
        return ""
    shown = f" class='{style}'" if style else ""
    return f"<figure{shown}>{image(picture, caption)}<figcaption>{caption}</figcaption></figure>"


def image(picture: bytes, caption: str) -> str:
    """Return a PNG as an element; `caption` must be escaped."""
    data = base64.b64encode(picture).decode("ascii")
    return f"<img alt='{caption}' src='data:image/png;base64,{data}'>"
