"""What became of each clash between two runs of a task: new, accepted, persistent, resolved, as DMU users keep it.

The status lives in a JSON file beside the report, `clashes.json`, and clashes are known by name: the two parts and
their surfaces. A person marks one as accepted there (or by `accept`), with a remark; the mark stays while the clash
does.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from vpframe.errors import VpframeError

STATUSES = ("new", "persistent", "accepted", "resolved")


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


def updated(known: Iterable[ClashRecord], seen: Iterable[ClashKey]) -> tuple[ClashRecord, ...]:
    """The records after one more run in which the clashes `seen` occurred, sorted by key.

    A clash not known before is new; a known one is persistent, or stays accepted; one no longer seen is resolved, and
    new again if it comes back.
    """
    before = {record.key: record for record in known}
    now = set(seen)
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


def read(path: str | Path) -> tuple[ClashRecord, ...]:
    """The records in a file; none if there is no such file.

    Raises
    ------
    VpframeError: naming the file and the row, if it is not a clash status file.
    """
    file = Path(path)
    if not file.exists():
        return ()
    try:
        rows = json.loads(file.read_text())["clashes"]
    except (OSError, json.JSONDecodeError, KeyError, TypeError) as error:
        raise VpframeError(f"{file}: not a clash status file ({error}); delete it to start anew") from None
    return tuple(_record(file, n, row) for n, row in enumerate(rows))


def write(path: str | Path, records: Iterable[ClashRecord]) -> None:
    """Write the records, sorted by key, one clash an entry."""
    rows = [{**asdict(r.key), "status": r.status, "remark": r.remark, "runs": r.runs} for r in records]
    rows.sort(key=lambda row: (row["part_a"], row["part_b"], row["surface_a"], row["surface_b"]))
    Path(path).write_text(json.dumps({"clashes": rows}, indent=2) + "\n")


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
