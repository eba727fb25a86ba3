"""Status of clashes over the runs of a task: new, accepted, persistent, resolved, as in digital mock-up.

The JSON file `clashes.json` beside the report identifies a clash by the names of its parts and surfaces. A user accepts
clashes (`vpframe clash accept`) with a remark; the mark lasts as long as the clash. Only complete runs change a status;
an incomplete run only adds new clashes. The file also lists authorised pairs of parts (press fits) for later runs.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from vpframe import __version__, files
from vpframe.errors import VpframeError
from vpframe.scene.names import is_of

STATUSES = ("new", "persistent", "accepted", "resolved")
FILE = "clashes.json"
"""file name in a report folder"""
WHOLE = -1
"""stands for a surface where a part as a whole is meant: containment"""


@dataclass(frozen=True, order=True)
class ClashKey:
    """Identity of a clash: two part names in alphabetical order, and a surface of each."""

    part_a: str
    part_b: str
    surface_a: int
    surface_b: int

    @staticmethod
    def of(a: str, surface_a: int, b: str, surface_b: int) -> ClashKey:
        """Return the key of two surfaces given in any order."""
        return ClashKey(a, b, surface_a, surface_b) if a <= b else ClashKey(b, a, surface_b, surface_a)


@dataclass(frozen=True)
class ClashRecord:
    """Status of one clash."""

    key: ClashKey
    status: str
    """one of STATUSES"""
    remark: str = ""
    runs: int = 1
    """number of runs in which it was found"""


def updated(known: Iterable[ClashRecord], seen: Iterable[ClashKey], complete: bool = True) -> tuple[ClashRecord, ...]:
    """Return the records after a run that found the clashes `seen`, sorted by key.

    An unknown clash becomes new; a known one persistent, unless accepted; a missing one resolved, and new again if it
    returns. An incomplete run only adds records, because it did not check everything.
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
    """Return the records with the given clashes accepted.

    Raises
    ------
    VpframeError: a key is not among the records.
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
    """Parse `A:B` or `A:3:B:12`: two parts, and a surface of each or None.

    Raises
    ------
    VpframeError: neither format.
    """
    words = text.split(":")
    if len(words) == 2 and all(words):
        return words[0], words[1], None
    if len(words) == 4 and words[0] and words[2] and words[1].isdecimal() and words[3].isdecimal():
        return words[0], words[2], (int(words[1]), int(words[3]))
    raise VpframeError(f"{text!r}: write two part names as A:B, or with a surface of each as A:3:B:12")


def named(records: Iterable[ClashRecord], text: str) -> tuple[ClashKey, ...]:
    """Return the present clashes that `text` names (see `parse`); the name of a subassembly means all its parts.

    Raises
    ------
    VpframeError: there is none; the message lists the known pairs.
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
    """Accept clashes of a report folder (or a status file) by name; return their keys.

    Parameters
    ----------
    texts: in the format of `parse`; without surfaces, all clashes of the two parts.
    remark: reason, stored with the mark.
    authorise: the overlap as drawn is meant: in later runs it is no clash, and blocks only what would deepen it.

    Raises
    ------
    VpframeError: no such report or clash.
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
    """Format one line for each pair of parts: "bolt with plate, 3 pairs of surfaces", or the faces of a single pair."""
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
    """Return the authorised pairs in a status file; none if it does not exist.

    Raises
    ------
    VpframeError: not a clash status file; names the file.
    """
    try:
        return tuple((str(a), str(b)) for a, b in _content(Path(path)).get("authorised", ()))
    except (ValueError, TypeError) as error:
        raise _no_status(path, error) from None


def read(path: str | Path) -> tuple[ClashRecord, ...]:
    """Return the records in a status file; none if it does not exist or is empty.

    Raises
    ------
    VpframeError: not a clash status file; names file and row.
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
    """Write the records, sorted by key, and the authorised pairs.

    Raises
    ------
    OutputError: it cannot be written; the old file is unchanged.
    """
    rows = [{**asdict(r.key), "status": r.status, "remark": r.remark, "runs": r.runs} for r in records]
    rows.sort(key=lambda row: (row["part_a"], row["part_b"], row["surface_a"], row["surface_b"]))
    pairs = sorted({(min(pair), max(pair)) for pair in authorised})
    lines = ",\n".join(f"    {json.dumps(row)}" for row in rows)
    clashes = f"[\n{lines}\n  ]" if rows else "[]"
    rest = f'"authorised": {json.dumps(pairs)},\n  "version": {json.dumps(__version__)}'
    files.replace(path, f'{{\n  "clashes": {clashes},\n  {rest}\n}}\n')


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
