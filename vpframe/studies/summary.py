"""The contents of `study.json`, computed from a study's records."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

from vpframe import __version__
from vpframe.scene.units import name_and_unit, quantity_text
from vpframe.studies import statistics
from vpframe.studies.distributions import Choice, Distribution, is_number
from vpframe.studies.results import STATUSES, UNANSWERED, Record, answer
from vpframe.studies.variants import sequence_of

WORST = 10
"""maximum number of worst variants with a script"""
TEXTS = 30
"""maximum number of counted values of a text measure; the most frequent ones are kept"""
SOBOL = "Sobol' sequences"
"""sampling method"""
SUCCESS = "can be done"
CLEARANCE = "least clearance (m)"


def summary(
    variables: Mapping[str, Distribution],
    sampling: Mapping[str, Any],
    records: Sequence[Record],
    repeats: Sequence[Record],
    total: int,
) -> dict[str, Any]:
    """Return the document of a study of `total` variants; `records`: finished ones by index, `repeats`: second runs.

    The rate is that of "ok" over all finished: a variant without an answer was not shown to be possible.
    """
    counts = Counter(one["status"] for one in records)
    low, high = interval(records, sampling)
    values = outcomes(records)
    by_key = {one["key"]: one for one in records}
    twice = [one for one in repeats if one["key"] in by_key]
    compared = [one for one in twice if one["status"] not in UNANSWERED]
    return {
        "version": __version__,
        "sampling": dict(sampling),
        "variables": {name: _words(name, distribution) for name, distribution in variables.items()},
        "variants": total,
        "finished": len(records),
        "statuses": {status: counts[status] for status in STATUSES},
        "rate": {
            "ok": counts["ok"],
            "of": len(records),
            "value": counts["ok"] / len(records) if records else None,
            "low": low,
            "high": high,
            "confidence": statistics.CONFIDENCE,
        },
        "outcomes": {name: _distribution(column) for name, column in values.items() if name != SUCCESS},
        "importance": _importance(variables, records, values),
        "importance_from": {name: _basis(records, column) for name, column in values.items()},
        "reasons": [{"status": s, "reason": r, "count": n} for (s, r), n in _reasons(records).most_common()],
        "worst": [one["index"] for one in worst(records)],
        "repeated": {
            "variants": len(compared),
            "different": sorted(one["index"] for one in compared if answer(one) != answer(by_key[one["key"]])),
            "unanswered": sorted(one["index"] for one in twice if one["status"] in UNANSWERED),
        },
        "seconds": statistics.percentiles([one["seconds"] for one in records if one["seconds"] is not None]),
        "memory": max((one["memory"] for one in records if one.get("memory")), default=None),
    }


def interval(records: Sequence[Record], sampling: Mapping[str, Any]) -> tuple[float, float]:
    """Return the interval of the rate of "ok" among records of a study that was sampled so."""
    good = [one["status"] == "ok" for one in records]
    if sampling["method"] == SOBOL:
        return statistics.replicated(good, [sequence_of(one["index"]) for one in records])
    return statistics.wilson(sum(good), len(good))


def _basis(records: Sequence[Record], column: Sequence[Any]) -> dict[str, int]:
    """Count the finished variants that have an outcome: the figures of importance rest on them alone."""
    there = [one["status"] == "ok" for one, value in zip(records, column, strict=True) if value is not None]
    return {"variants": len(there), "ok": sum(there), "finished": len(records)}


def basis_text(basis: Mapping[str, int]) -> str:
    """`93 of 120 variants, all of which succeeded`."""
    if basis["variants"] == basis["finished"]:
        return f"all {basis['finished']} variants"
    which = "those that succeeded" if basis["ok"] == basis["variants"] else f"{basis['ok']} of which succeeded"
    return f"{basis['variants']} of {basis['finished']} variants, {which}"


def _words(name: str, distribution: Distribution) -> str:
    """`Normal(mean=8.02 mm, deviation=5 µm)`; infinite limits are omitted."""
    words, unit = [], unit_of(name, distribution)
    for field in fields(distribution):
        value = getattr(distribution, field.name)
        if field.name == "unit" or value in (math.inf, -math.inf):
            continue
        values = value if isinstance(value, tuple) else (value,)
        own = "" if field.metadata.get("ratio") else unit
        texts = [quantity_text(x, own) if is_number(x) and not isinstance(x, bool) else repr(x) for x in values]
        text = ", ".join(texts)
        words.append(f"{field.name}=({text})" if isinstance(value, tuple) else f"{field.name}={text}")
    return f"{type(distribution).__name__}({', '.join(words)})"


def unit_of(name: str, distribution: Distribution) -> str:
    """Return the unit of a variable: its own, or that in its name, as in "gap (m)"."""
    return distribution.unit or name_and_unit(name)[1]


def outcomes(records: Sequence[Record]) -> dict[str, list[Any]]:
    """Return the columns of outcomes by name: success (1 or 0), least clearance, every measure; None if missing."""
    columns: dict[str, list[Any]] = {SUCCESS: [float(one["status"] == "ok") for one in records]}
    if any(one["clearance"] is not None for one in records):
        columns[CLEARANCE] = [one["clearance"] for one in records]
    for name in sorted({name for one in records for name in one["measures"]}):
        columns[name] = [one["measures"].get(name) for one in records]
    return columns


def worst(records: Sequence[Record], count: int = WORST) -> list[Record]:
    """Return the worst variants: failures, new reasons first, then by least clearance; then the tightest successes."""
    seen: Counter[str] = Counter()
    ranked: list[tuple[bool, int, int, Record]] = []
    for one in sorted(records, key=lambda r: (r["status"] == "ok", _or_inf(r["clearance"]), r["index"])):
        kind = _kind(one)
        ranked.append((one["status"] == "ok", seen[kind] if kind else 0, len(ranked), one))
        seen[kind] += 1
    return [one for *_, one in sorted(ranked, key=lambda r: r[:3])[:count]]


def _or_inf(value: float | None) -> float:
    return math.inf if value is None else value


def _kind(one: Record) -> str:
    """Return the reason without its numbers, so that like failures count as one kind."""
    reason = str(one["reason"])
    return re.sub(r"\d+", "0", reason) if one["status"] != "ok" else ""


def _reasons(records: Sequence[Record]) -> Counter[tuple[str, str]]:
    """Count the reasons that ended tasks and what done ones ignore; the first reason of a kind represents all."""
    named: dict[tuple[str, str], str] = {}
    counted: Counter[tuple[str, str]] = Counter()
    for one in records:
        if one["status"] != "ok" or one["reason"]:
            kind = _kind(one) or str(one["reason"])
            text = named.setdefault((one["status"], kind), str(one["reason"]))
            counted[one["status"], text] += 1
    return counted


def _distribution(column: Sequence[Any]) -> dict[str, Any]:
    there = [value for value in column if value is not None]
    if any(isinstance(value, str | bool) for value in there):
        return {"count": len(there), "values": dict(Counter(map(str, there)).most_common(TEXTS))}
    made = statistics.classes(there)
    return {
        "count": len(there),
        "percentiles": statistics.percentiles(there),
        "histogram": {"edges": list(made.edges), "counts": list(made.counts)},
    }


def _importance(
    variables: Mapping[str, Distribution], records: Sequence[Record], columns: Mapping[str, Sequence[Any]]
) -> dict[str, dict[str, dict[str, float | None]]]:
    """Return, by outcome and variable, the first-order Sobol' index, and the rank correlation of numeric variables."""
    found: dict[str, dict[str, dict[str, float | None]]] = {}
    for name, column in columns.items():
        there = [i for i, value in enumerate(column) if value is not None and not isinstance(value, str)]
        y = [float(column[i]) for i in there]
        found[name] = {}
        for variable, distribution in variables.items():
            x = [records[i]["parameters"][variable] for i in there]
            is_number = all(isinstance(value, int | float) for value in x)
            grouped = [str(value) for value in x] if isinstance(distribution, Choice) else x
            found[name][variable] = {
                "first_order": statistics.first_order(grouped, y) if x else None,
                "rank_correlation": statistics.rank_correlation(x, y) if x and is_number else None,
            }
    return found


def ranking(document: Mapping[str, Any], outcome: str) -> list[str]:
    """Return the variables, sorted by the share of an outcome's variance that they explain, greatest first."""
    of = document["importance"].get(outcome, {})

    def weight(name: str) -> float:
        row = of[name]
        return max(row["first_order"] or 0.0, (row["rank_correlation"] or 0.0) ** 2)

    return sorted(of, key=lambda name: -weight(name))
