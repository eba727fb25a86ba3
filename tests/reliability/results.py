"""Results of reliability runs: a line of JSON a shard, so that a run can be continued, and the table of the docs.

python -m tests.reliability.results [FILE]       prints the table of a results file
"""

from __future__ import annotations

import argparse
import datetime
import json
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).with_name("results.jsonl")
"""those that the docs show"""
PAGE = Path(__file__).parents[2] / "docs" / "reliability.md"
Row = dict[str, Any]
_GOALS = {
    **dict.fromkeys(("step", "iges", "stl", "obj", "ply", "glb"), 10_000),
    **dict.fromkeys(("record", "checkpoint", "study", "accept"), 25),
    "steps": 10**6, "pages": 1000, "disk": 50, "full": 50,
}  # fmt: skip
_WHAT = {
    "step": "damaged STEP files, half of them still well-formed (references, cycles, units, faces, numbers, senses)",
    **{name: f"damaged {name.upper()} files" for name in ("iges", "stl", "obj", "ply", "glb")},
    "record": "recordings of runs killed (SIGKILL) at random moments: every step made 2.5 s before the kill is there",
    "checkpoint": "runs killed, and gone on from their checkpoint: the same report as of a run that nobody killed",
    "study": "studies killed, and resumed: nothing written is lost, the same answers",
    "accept": "`clash accept` killed: the file is the one before or the one after",
    "steps": "steps of a session with a part in hand",
    "pages": "pages that join a live session, take its first message and go, 50 at a time",
    "disk": "runs whose files may grow to a limit, and no further: one line each, no traceback",
    "full": "runs on a disk of 4 KiB to 2 MiB (a file system in memory) that they fill: one line each, no traceback",
}
_LARGEST = ("slowest", "memory", "growth", "milliseconds")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that `run` takes."""
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--jobs", type=int, default=1, help="shards at the same time")
    parser.add_argument("--results", type=Path, help="file to add shards to; those it has are not run again")


def run(
    row: Callable[[str, int, int], Row], names: Iterable[str], count: int, shard: int, given: argparse.Namespace
) -> None:
    """Run `count` seeds of each name in shards, add them to the results file as they end, and print the sums."""
    had = load(given.results)
    wanted = [(name, *each) for name in names for each in _missing(had, name, given.first, count, shard)]
    wanted.sort(key=lambda each: each[1])
    mark = {"date": datetime.date.today().isoformat(), "commit": _commit()}
    rows: list[Row] = []

    def one(name: str, first: int, seeds: int) -> None:
        found = row(name, seeds, first) | mark
        rows.append(found)
        if given.results is not None:
            with given.results.open("a", encoding="utf-8") as file:
                file.write(json.dumps(found) + "\n")
        for fault in found["faults"]:
            print(json.dumps({"what": name, **fault}), file=sys.stderr, flush=True)

    with ThreadPoolExecutor(given.jobs) as pool:
        for future in [pool.submit(one, *each) for each in wanted]:
            future.result()
    for total in totals(load(given.results) or rows):
        print(json.dumps(total), flush=True)


def _missing(had: Sequence[Row], name: str, first: int, count: int, shard: int) -> Iterator[tuple[int, int]]:
    """First seed and number of seeds of each shard that is not in a results file."""
    done = {seed for one in had if one["what"] == name for seed in range(one["first"], one["first"] + one["count"])}
    seed, end = first, first + count
    while seed < end:
        length = next((i for i in range(min(shard, end - seed)) if seed + i in done), min(shard, end - seed))
        if length:
            yield seed, length
        seed += length or 1


def load(path: Path | None) -> list[Row]:
    """All rows of a results file; none if there is no file."""
    if path is None or not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def totals(rows: Sequence[Row]) -> list[Row]:
    """The rows of each kind as one, by name: counts are added, of seconds and bytes the largest is kept."""
    summed: dict[str, Row] = {}
    for each in rows:
        total = summed.setdefault(each["what"], {})
        for name, value in each.items():
            if name in _LARGEST:
                total[name] = max(value, total.get(name, 0))
            elif isinstance(value, dict):
                total[name] = dict(Counter(total.get(name, {})) + Counter(value))
            elif isinstance(value, int | float | list) and name != "first":
                total[name] = total[name] + value if name in total else value
            elif isinstance(value, str):
                total[name] = max(value, total.get(name, "")) if name == "date" else value
    return [summed[name] for name in sorted(summed)]


def table(rows: Sequence[Row]) -> str:
    """The rows as a table of Markdown."""
    found = {total["what"]: total for total in totals(rows)}
    lines = ["| what | run | goal | found | date |", "| --- | --- | --- | --- | --- |"]
    for name, goal in _GOALS.items():
        if name in found:
            total = found[name]
            cells = [_WHAT[name], f"{total['count']:,}", f"{goal:,}", _found(total), total["date"]]
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _found(total: Row) -> str:
    """What a run found, in words."""
    faults = f"{len(total['faults'])} faults"
    if "read" in total:
        ends = f"{total['death']} deaths, {total['foreign']} foreign exceptions"
        most = f"{total['slowest']:.1f} s and {total['memory'] / 1e9:.2f} GB at most"
        silent = sum(total["silent"].values())
        by = ", ".join(f"{name} {count:,}" for name, count in sorted(total["silent"].items(), key=lambda one: -one[1]))
        changed = f"; {silent:,} read as another sound model without a note ({by})" if silent else ""
        return f"{total['read']:,} read, {total['refused']:,} refused in one line; {ends}; {most}{changed}"
    if "over" in total:
        return f"{faults}; {total['over']} were over before the kill" if total["over"] else faults
    if "refused" in total:
        return f"{total['refused']} refused; memory grew by {total['growth'] / 1e6:.1f} MB"
    if "growth" in total:
        grown = f"memory grew by {total['growth'] / 1e6:.1f} MB after the first tenth"
        return f"{grown}; {total['milliseconds']:.1f} ms a step"
    return f"{faults}; {total['stopped']} were stopped by it, the others had room" if "stopped" in total else faults


def _commit() -> str:
    done = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, cwd=RESULTS.parent)
    return done.stdout.strip()


if __name__ == "__main__":
    print(table(load(Path(sys.argv[1]) if len(sys.argv) > 1 else RESULTS)), end="")
