"""A draft of the rules file of a model: what was found, instances of one pattern once, all of it commented out."""

from __future__ import annotations

import json
from collections.abc import Iterable

from vpframe.analysis.fits import BAD_KINDS
from vpframe.analysis.pairs import ClashRow, PartPair, by_parts
from vpframe.scene.overlap_rules import KEYS, MEANT, product
from vpframe.text import plain

HEAD = f"""\
# Rules of vpframe on overlaps, read beside the model. Nothing below counts until its # are removed.
# [[overlap]] has {", ".join(KEYS)}; means is one of {", ".join(MEANT)}, clash.
# parts: one or two names, ends of their paths, or products; * and ? stand for letters. The first rule that fits counts.
"""


def draft(rows: Iterable[ClashRow]) -> str:
    """Return the text of a rules file for the overlaps among the rows of `vpframe.analysis.clash.clash`.

    Those that were taken as meant are written as what they were taken for; clashes as what they would be if a person
    said so.
    """
    patterns: dict[tuple[str, tuple[str, str]], list[PartPair[ClashRow]]] = {}
    for pair in by_parts(rows):
        if pair.kind in (*MEANT, *BAD_KINDS):
            a, b = map(product, pair.worst.parts)
            patterns.setdefault((pair.kind, (a, b)), []).append(pair)
    return "\n".join([HEAD, *(_table(*key, alike) for key, alike in patterns.items())])


def _table(kind: str, names: tuple[str, str], alike: list[PartPair[ClashRow]]) -> str:
    rows = [pair.worst for pair in alike]
    low, high = min(row.depth for row in rows) * 1e3, max(row.depth for row in rows) * 1e3
    count = f"{len(alike)} x {kind}" if len(alike) > 1 else kind
    known = rows[0].meaning
    words = "" if known is None else f": {known.words}"
    lines = [f"{count}, {low:.3f} to {high:.3f} mm deep{words}"]
    if kind in BAD_KINDS:
        lines.append("if it is meant, say what it is instead of clash")
    lines += ["[[overlap]]", f"parts = [{', '.join(json.dumps(_literal(n), ensure_ascii=False) for n in names)}]"]
    lines.append(f'means = "{kind if kind in MEANT else "clash"}"')
    if known is not None and known.pitch is not None:
        lines.append(f"pitch = {1e3 * known.pitch:.4g}")
    return "".join(f"# {plain(line)}\n" for line in lines)


def _literal(name: str) -> str:
    """A name as a pattern that it alone matches."""
    return "".join(f"[{c}]" if c in "*?[" else c for c in name)
