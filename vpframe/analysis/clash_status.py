"""What became of each clash between two runs of a task: new, accepted, persistent, resolved, as DMU users keep it.

The status lives in a JSON file beside the report, `clashes.json`, and clashes are known by name: the two parts and
their surfaces. A person marks them as accepted (`vpframe clash accept`), with a remark; the mark stays while the
clash does. Only a run that came to its end changes a status; one that was cut off adds the clashes that it saw first.
Pairs of parts that are meant to overlap, a press fit, stand in the same file and hold for the runs that follow.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from vpframe import files
from vpframe.errors import VpframeError
from vpframe.scene.names import is_of

STATUSES = ("new", "persistent", "accepted", "resolved")
FILE = "clashes.json"
"""in a report folder"""
WHOLE = -1
"""in place of a surface where the parts as a whole are meant: containment"""


@dataclass(frozen=True, order=True)
class ClashKey:
    """A clash by name: two part names in alphabetical order, and a surface of each."""

    part_a: str
    part_b: str
    surface_a: int
    surface_b: int

    @staticmethod
    def of(a: str, surface_a: int, b: str, surface_b: int) -> ClashKey:
        """The key of two surfaces that met, whichever comes first."""
        return ClashKey(a, b, surface_a, surface_b) if a <= b else ClashKey(b, a, surface_b, surface_a)


@dataclass(frozen=True)
class ClashRecord:
    """One clash over the runs of a task."""

    key: ClashKey
    status: str
    """one of STATUSES"""
    remark: str = ""
    runs: int = 1
    """in how many runs it was seen"""


def updated(known: Iterable[ClashRecord], seen: Iterable[ClashKey], complete: bool = True) -> tuple[ClashRecord, ...]:
    """The records after one more run in which the clashes `seen` occurred, sorted by key.

    A clash not known before is new; a known one is persistent, or stays accepted; one no longer seen is resolved, and
    new again if it comes back. A run that is not `complete` only adds: it did not come to see the others.
    """
    before = {record.key: record for record in known}
    now = set(seen)
    if not complete:
        return tuple(before.get(key) or ClashRecord(key, "new") for key in sorted(now | set(before)))
    after = []
    for key in sorted(now | set(before)):
        old = before.get(key)
        if key not in now:
            assert old is not None
            after.append(ClashRecord(key, "resolved", old.remark, old.runs))
        elif old is None:
            after.append(ClashRecord(key, "new"))
        else:
            status = {"accepted": "accepted", "resolved": "new"}.get(old.status, "persistent")
            after.append(ClashRecord(key, status, old.remark, old.runs + 1))
    return tuple(after)


def accept(records: Iterable[ClashRecord], keys: Iterable[ClashKey], remark: str = "") -> tuple[ClashRecord, ...]:
    """The records with those clashes marked as accepted.

    Raises
    ------
    VpframeError: one of `keys` is not among the records.
    """
    known = {record.key: record for record in records}
    for key in keys:
        if key not in known:
            raise VpframeError(
                f"no clash between {key.part_a} {key.surface_a} and {key.part_b} {key.surface_b} is known"
            )
        known[key] = ClashRecord(key, "accepted", remark or known[key].remark, known[key].runs)
    return tuple(known[key] for key in sorted(known))


def parse(text: str) -> tuple[str, str, tuple[int, int] | None]:
    """Two parts, and a surface of each if they are named, of `A:B` or `A:3:B:12`.

    Raises
    ------
    VpframeError: it is neither.
    """
    words = text.split(":")
    if len(words) == 2 and all(words):
        return words[0], words[1], None
    if len(words) == 4 and words[0] and words[2] and words[1].isdecimal() and words[3].isdecimal():
        return words[0], words[2], (int(words[1]), int(words[3]))
    raise VpframeError(f"{text!r}: write two part names as A:B, or with a surface of each as A:3:B:12")


def named(records: Iterable[ClashRecord], text: str) -> tuple[ClashKey, ...]:
    """The clashes that are there and that `text`, as `parse` reads it, names; a subassembly's name means all its parts.

    Raises
    ------
    VpframeError: there is none; the message names the pairs that there are.
    """
    a, b, surfaces = parse(text)
    there = [record.key for record in records if record.status != "resolved"]
    found = [
        key
        for key in there
        if (is_of(key.part_a, a) and is_of(key.part_b, b)) or (is_of(key.part_a, b) and is_of(key.part_b, a))
    ]
    if surfaces is not None:
        found = [key for key in found if key == ClashKey.of(a, surfaces[0], b, surfaces[1])]
    if not found:
        pairs = ", ".join(dict.fromkeys(f"{key.part_a}:{key.part_b}" for key in there)) or "none at all"
        raise VpframeError(f"no clash {text} is known; there is {pairs}")
    return tuple(found)


def accept_named(
    report: str | Path, texts: Iterable[str], remark: str = "", authorise: bool = False
) -> tuple[ClashKey, ...]:
    """Mark clashes of a report folder (or of a status file) as accepted, by name; returns which these are.

    Parameters
    ----------
    texts: as `parse` reads them; of two parts without surfaces all clashes are meant.
    remark: why, kept with the mark.
    authorise: the parts are meant to overlap: from the next run on they neither clash nor block each other.

    Raises
    ------
    VpframeError: there is no such report, or no such clash.
    """
    path = Path(report)
    file = path / FILE if path.is_dir() else path
    if not file.exists():
        raise VpframeError(f"{file}: no such file; name a folder that --report wrote")
    records, pairs = read(file), read_authorised(file)
    keys: list[ClashKey] = []
    for text in texts:
        found = named(records, text)
        keys += found
        if authorise:
            pairs = (*pairs, *dict.fromkeys((key.part_a, key.part_b) for key in found))
    write(file, accept(records, keys, remark), pairs)
    return tuple(keys)


def accepted_words(keys: Iterable[ClashKey]) -> list[str]:
    """A line a pair of parts: "bolt with plate, 3 pairs of surfaces"; of one pair of surfaces its faces."""
    pairs: dict[tuple[str, str], list[ClashKey]] = {}
    for key in keys:
        pairs.setdefault((key.part_a, key.part_b), []).append(key)
    lines = []
    for (a, b), of in pairs.items():
        faces = (of[0].surface_a, of[0].surface_b)
        if len(of) > 1:
            lines.append(f"{a} with {b}, {len(of)} pairs of surfaces")
        else:
            lines.append(f"{a} with {b}" if WHOLE in faces else f"{a} · face {faces[0]} with {b} · face {faces[1]}")
    return lines


def read_authorised(path: str | Path) -> tuple[tuple[str, str], ...]:
    """The pairs of parts that are authorised to overlap, by a status file; none if there is no such file.

    Raises
    ------
    VpframeError: naming the file, if it is not a clash status file.
    """
    try:
        return tuple((str(a), str(b)) for a, b in _content(Path(path)).get("authorised", ()))
    except (ValueError, TypeError) as error:
        raise _no_status(path, error) from None


def read(path: str | Path) -> tuple[ClashRecord, ...]:
    """The records in a file; none if there is no such file, or an empty one.

    Raises
    ------
    VpframeError: naming the file and the row, if it is not a clash status file.
    """
    file = Path(path)
    try:
        rows = list(_content(file)["clashes"])
    except (KeyError, TypeError) as error:
        raise _no_status(file, error) from None
    return tuple(_record(file, n, row) for n, row in enumerate(rows))


def _content(file: Path) -> dict[str, Any]:
    try:
        text = file.read_text(encoding="utf-8") if file.exists() else ""
        content = json.loads(text) if text else {"clashes": []}
    except (OSError, ValueError) as error:
        raise _no_status(file, error) from None
    if not isinstance(content, dict):
        raise _no_status(file, f"it holds a {type(content).__name__}")
    return content


def _no_status(file: str | Path, why: object) -> VpframeError:
    return VpframeError(f"{file}: not a clash status file ({why}); give another file")


def write(path: str | Path, records: Iterable[ClashRecord], authorised: Iterable[tuple[str, str]] = ()) -> None:
    """Write the records, sorted by key, one clash an entry, and the authorised pairs.

    Raises
    ------
    OutputError: it cannot be written; what there was is as before.
    """
    rows = [{**asdict(r.key), "status": r.status, "remark": r.remark, "runs": r.runs} for r in records]
    rows.sort(key=lambda row: (row["part_a"], row["part_b"], row["surface_a"], row["surface_b"]))
    pairs = sorted({(min(pair), max(pair)) for pair in authorised})
    lines = ",\n".join(f"    {json.dumps(row)}" for row in rows)
    clashes = f"[\n{lines}\n  ]" if rows else "[]"
    files.replace(path, f'{{\n  "clashes": {clashes},\n  "authorised": {json.dumps(pairs)}\n}}\n')


def _record(file: Path, n: int, row: Mapping[str, Any]) -> ClashRecord:
    try:
        key = ClashKey(str(row["part_a"]), str(row["part_b"]), int(row["surface_a"]), int(row["surface_b"]))
        record = ClashRecord(key, str(row["status"]), str(row.get("remark", "")), int(row.get("runs", 1)))
    except (KeyError, TypeError, ValueError) as error:
        raise VpframeError(
            f"{file}: clash {n} has no valid {error}; part_a, part_b, surface_a, surface_b, status"
        ) from None
    if record.status not in STATUSES:
        raise VpframeError(f"{file}: clash {n} has status {record.status!r}; one of {', '.join(STATUSES)}")
    return record
