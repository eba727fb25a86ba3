"""What a person says of overlaps: a rules file beside the model, or options of a command. It holds data, no code.

    # gearbox.vpframe.toml, beside gearbox.step
    [[overlap]]
    parts = ["M2x10*", "housing"]  # two parts, or one with any other: names, ends of their paths, * and ?
    means = "thread"               # thread, press fit, soft, glue, clash
    pitch = 0.8                    # mm a turn, of a thread
    depth = 0.35                   # mm: the most, radial

    [[overlap]]
    kind = "press fit"             # all that were recognised as this
    means = "clash"

The first rule that names a pair decides; then the first that names the kind.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from vpframe.errors import VpframeError

SUFFIX = ".vpframe.toml"
CLASH = "clash"
MEANT = ("thread", "press fit", "soft", "glue")
"""kinds of overlaps that are meant"""
INSTANCE = re.compile(r"(?:[:_ ]\d+| \(\d+\))+$")
"""number of an instance at the end of a part's name"""
KEYS = ("parts", "kind", "means", "pitch", "depth")


@dataclass(frozen=True)
class OverlapRule:
    """What the overlaps of some pairs of parts, or those recognised as some kind, mean."""

    means: str
    """one of MEANT, or CLASH"""
    parts: tuple[str, ...] = ()
    """one or two names with * and ?"""
    kind: str = ""
    """one of MEANT; empty where parts are named"""
    pitch: float = 0.0
    """m a turn; 0 where none is stated"""
    depth: float = 0.0
    """m, radial: the most; 0 where none is stated"""
    source: str = ""
    """where it is stated"""
    scope: str = ""
    """name of the model among several of a scene; empty for the whole scene"""

    def names(self, a: str, b: str) -> bool:
        """Whether it is about this pair of parts."""
        inside = f"{self.scope}/" if self.scope else ""
        if not (self.parts and a.startswith(inside) and b.startswith(inside)):
            return False
        a, b = a.removeprefix(inside), b.removeprefix(inside)
        first, second = self.parts[0], self.parts[-1] if len(self.parts) > 1 else "*"
        return (_named(a, first) and _named(b, second)) or (_named(b, first) and _named(a, second))


def product(name: str) -> str:
    """Return the name of a part's product: the last of its path, without the number of the instance."""
    return INSTANCE.sub("", name.rsplit("/", 1)[-1]) or name


def _named(name: str, pattern: str) -> bool:
    """Whether a pattern is a part's name, the end of its path, its product, or a subassembly above it."""
    texts = (name, name.rsplit("/", 1)[-1], product(name))
    return any(fnmatchcase(text, pattern) for text in texts) or fnmatchcase(name, f"{pattern}/*")


def rule_of(rules: Iterable[OverlapRule], a: str, b: str) -> OverlapRule | None:
    """Return the first rule that names a pair of parts."""
    return next((rule for rule in rules if rule.names(a, b)), None)


def rule_for(rules: Iterable[OverlapRule], kind: str) -> OverlapRule | None:
    """Return the first rule about a kind."""
    return next((rule for rule in rules if rule.kind == kind), None)


def file_beside(model: str | Path) -> Path:
    """Return the path of a model's rules file: gearbox.vpframe.toml for gearbox.step."""
    path = Path(model)
    return path.with_name(path.stem + SUFFIX)


def read_beside(model: str | Path) -> tuple[OverlapRule, ...]:
    """Return the rules beside a model; none where there is no file.

    Raises
    ------
    VpframeError: the file is no rules file; names the place.
    """
    path = file_beside(model)
    return read(path) if path.is_file() else ()


def read(path: Path) -> tuple[OverlapRule, ...]:
    """Return the rules of a file; raises VpframeError if it is none."""
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise VpframeError(f"{path}: not a rules file ({error}); write TOML with tables [[overlap]]") from None
    for key in content:
        if key != "overlap":
            raise VpframeError(f"{path}: unknown key {key!r}; only tables [[overlap]] are known")
    tables = content.get("overlap", [])
    if not isinstance(tables, list):
        raise VpframeError(f"{path}: [overlap] is one table; write [[overlap]]")
    return tuple(_rule(table, f"{path}: overlap {n + 1}") for n, table in enumerate(tables))


def _rule(table: Any, place: str) -> OverlapRule:
    if not isinstance(table, dict):
        raise VpframeError(f"{place}: a {type(table).__name__}; write a table [[overlap]]")
    for key in table:
        if key not in KEYS:
            raise VpframeError(f"{place}: unknown key {key!r}; one of {', '.join(KEYS)}")
    parts, kind, means = table.get("parts", []), table.get("kind", ""), table.get("means", "")
    pitch, depth = (_length(table, key, place) for key in ("pitch", "depth"))
    if depth < 0.0:
        raise VpframeError(f"{place}: depth is {table['depth']!r}; write a positive number of millimetres")
    if not isinstance(parts, list) or len(parts) > 2 or not all(isinstance(name, str) and name for name in parts):
        raise VpframeError(f'{place}: parts is {parts!r}; write one or two names, as ["screw*", "housing"]')
    return _checked(OverlapRule(str(means), tuple(parts), str(kind), pitch, depth, place), place)


def _length(table: dict[str, Any], key: str, place: str) -> float:
    """A length of a table in mm, as m; 0 where there is none."""
    value = table.get(key, 0.0)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e3:
        raise VpframeError(f"{place}: {key} is {value!r}; write millimetres")
    return 1e-3 * float(value)


def _checked(rule: OverlapRule, place: str) -> OverlapRule:
    if rule.means not in (*MEANT, CLASH):
        raise VpframeError(f"{place}: means is {rule.means!r}; one of {', '.join((*MEANT, CLASH))}")
    if bool(rule.parts) == bool(rule.kind):
        raise VpframeError(f"{place}: write either parts or kind")
    if rule.kind and (rule.kind not in MEANT or rule.means != CLASH):
        raise VpframeError(f'{place}: kind is {rule.kind!r}; one of {", ".join(MEANT)}, with means = "{CLASH}"')
    if rule.pitch and rule.means != "thread":
        raise VpframeError(f"{place}: only a thread has a pitch")
    return rule


def parsed(texts: Sequence[str]) -> tuple[OverlapRule, ...]:
    """Return the rules of a command's options: `A:B=thread`, `A=clash`, or for a kind `thread=clash`.

    Raises
    ------
    VpframeError: another format.
    """
    out = []
    for text in texts:
        about, equals, means = text.rpartition("=")
        place = f"rule {text!r}"
        names = tuple(filter(None, about.split(":")))
        if not equals or not names or len(names) > 2:
            raise VpframeError(f"{place}: write A:B=thread, A=clash or thread=clash")
        kind = about if about in MEANT else ""
        out.append(_checked(OverlapRule(means, () if kind else names, kind, source=place), place))
    return tuple(out)
