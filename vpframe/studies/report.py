"""The report of a study: `study.json`, `results.csv`, `index.html`, and the worst variants as task scripts."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vpframe.files import replace
from vpframe.outputs import STUDY_FILES, VARIANT, OutputFolder
from vpframe.report import plots
from vpframe.scene.units import Scale, name_and_unit, quantity_text, scale_of
from vpframe.studies import statistics
from vpframe.studies.distributions import Distribution
from vpframe.studies.results import ANSWER, Record
from vpframe.studies.summary import CLEARANCE, SUCCESS, basis_text, interval, outcomes, ranking, unit_of, worst
from vpframe.text import csv_text, plain, rendered

WORST_FOLDER = "worst"
FAILURES = 40
"""maximum number of failures on the page; the CSV file lists all"""
DRAWN = 3
"""maximum number of variables with a chart of the rate"""
WORDS = {
    "ok": "can be done",
    "no": "cannot be done",
    "error": "script error",
    "crashed": "crashed",
    "timeout": "timeout",
}


def write(
    folder: OutputFolder,
    script: Path,
    variables: Mapping[str, Distribution],
    document: Mapping[str, Any],
    records: Sequence[Record],
) -> None:
    """Write the report of `records` (by index) and their `summary` into a folder.

    Raises
    ------
    OutputError: a file cannot be written, or vpframe did not write what is there.
    """
    worst_folder = folder.path / WORST_FOLDER
    for old in worst_folder.glob("variant_*.py"):
        if VARIANT.recognise(old):
            old.unlink()
    contents = {"results.csv": table(variables, records), "index.html": page(script, variables, document, records)}
    contents["study.json"] = json.dumps(document, indent=2, allow_nan=False) + "\n"
    for one in worst(records):
        worst_folder.mkdir(exist_ok=True)
        contents[_replay_name(one)] = replay_script(one, script, worst_folder, document["sampling"]["seed"])
    for name, content in contents.items():
        kind = None if name in STUDY_FILES else VARIANT
        replace(folder.file(name, kind), content.encode(errors="backslashreplace"))


def rate_text(document: Mapping[str, Any]) -> str:
    """`4987 of 5000 variants can be done: 99.74 % (95 % interval 99.55 to 99.85 %)`."""
    rate = document["rate"]
    if not rate["of"]:
        return "No variant has finished."
    interval = f"{100 * rate['low']:.2f} to {100 * rate['high']:.2f} %"
    ignoring = [f"; {r['count']} of them: {r['reason']}" for r in document["reasons"] if r["status"] == "ok"]
    return (
        f"{rate['ok']} of {rate['of']} variants can be done: {100 * rate['value']:.2f} % "
        f"({100 * rate['confidence']:.0f} % interval {interval}){''.join(ignoring)}"
    )


def rest_text(document: Mapping[str, Any]) -> str:
    """Return the counts of other outcomes and of variants not run, as text; empty if there are none."""
    parts = [f"{n} {WORDS[status]}" for status, n in document["statuses"].items() if n and status != "ok"]
    missing = document["variants"] - document["finished"]
    return ", ".join([*parts, *([f"{missing} not run"] if missing else [])])


def basis_lines(document: Mapping[str, Any]) -> list[str]:
    """Return a line for each outcome that not every variant has: what matters to it is known of those alone."""
    return [
        f"What matters to {name_and_unit(outcome)[0]} is computed from {basis_text(basis)}."
        for outcome, basis in document["importance_from"].items()
        if basis["variants"] < basis["finished"]
    ]


def table(variables: Mapping[str, Distribution], records: Sequence[Record]) -> str:
    """Return the records as CSV, one row per variant: index, answer, variables, measures, time and memory, key."""
    measures = sorted({name for one in records for name in one["measures"]})
    ended = [name for name in ANSWER if name != "measures"]
    rows: list[list[Any]] = [["index", *ended, *variables, *measures, "seconds", "attempts", "key"]]
    for one in records:
        given = [one["parameters"][name] for name in variables]
        found = [one["measures"].get(name) for name in measures]
        end = [one[name] for name in ("seconds", "attempts", "key")]
        rows.append([one["index"], *(one[name] for name in ended), *given, *found, *end])
    return csv_text(rows)


def _replay_name(one: Record) -> str:
    return f"{WORST_FOLDER}/variant_{one['index']:06d}.py"


def replay_script(one: Record, script: Path, folder: Path, seed: int) -> str:
    """Return a task script in `folder` that runs one variant again, for `vpframe run … --view`."""
    reason = plain(str(one["reason"]))
    return "\n".join(
        [
            f"# Variant {one['index']} of a study: {WORDS[one['status']]}{': ' + reason if reason else ''}",
            "# Look at it: vpframe run THIS_FILE --view",
            "from pathlib import Path",
            "",
            "import vpframe as vp",
            "from vpframe.studies.replay import replayed",
            "",
            f"SCRIPT = Path(__file__).parent / {os.path.relpath(script.resolve(), folder.resolve())!r}",
            f"PARAMETERS = {dict(one['parameters'])!r}",
            "",
            f"_variant = replayed(SCRIPT, index={one['index']}, seed={seed}, parameters=PARAMETERS)",
            "scene, task, OPTIONS = _variant.scene, _variant.task, _variant.OPTIONS",
            "",
            'if __name__ == "__main__":',
            "    vp.main(__file__)",
            "",
        ]
    )


# ---- the page


def page(
    script: Path, variables: Mapping[str, Distribution], document: Mapping[str, Any], records: Sequence[Record]
) -> str:
    """Return one HTML file that contains all charts (`page.html`)."""
    failed = [one for one in records if one["status"] != "ok"]
    columns = {name: _column(name, variables[name], records, failed[:FAILURES]) for name in variables}
    return rendered(
        "studies/page.html",
        script=script,
        document=document,
        rate_text=rate_text(document),
        rest_text=rest_text(document),
        good=document["rate"]["ok"] == document["variants"],
        facts=[(WORDS[status], n) for status, n in document["statuses"].items() if n or status in ("ok", "no")],
        **_outcomes(document),
        variables=[(name_and_unit(name)[0], words) for name, words in document["variables"].items()],
        importance=_importance(document),
        rates=_rates(variables, document, records),
        scatter=_scatter(variables, document, records),
        reasons=[(r["count"], WORDS[r["status"]], r["reason"]) for r in document["reasons"]][:FAILURES],
        failure_head=("", "", "reason", *(label for label, _ in columns.values())),
        failures=[
            (one["index"], WORDS[one["status"]], one["reason"], *(texts[k] for _, texts in columns.values()))
            for k, one in enumerate(failed[:FAILURES])
        ],
        more_failures=len(failed) - FAILURES,
        worst=[(_replay_name(one), f"{WORDS[one['status']]}{_least(one)}") for one in worst(records)],
        run=_run(document),
    )


def _outcomes(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the table of percentiles, and of each outcome its counts or its histogram."""
    rows: list[Any] = []
    distributions: list[tuple[str, str, str]] = []
    for full, column in document["outcomes"].items():
        name, unit = name_and_unit(full)
        if "values" in column:
            distributions.append((name, ", ".join(f"{value}: {n}" for value, n in column["values"].items()), ""))
        elif column["count"]:
            scale = scale_of(column["percentiles"].values(), unit)
            values = (scale.number(column["percentiles"][str(p)]) for p in statistics.PERCENTS)
            rows.append((scale.label(name), f"{column['count']} of {document['finished']}", *values))
            edges = [scale.factor * edge for edge in column["histogram"]["edges"]]
            chart = plots.histogram(edges, column["histogram"]["counts"], scale.label(name))
            distributions.append((name, "", chart))
    head = ("", "variants", *(f"{p} %" for p in statistics.PERCENTS))
    return {"outcome_head": head, "outcomes": rows, "distributions": distributions}


def _importance(document: Mapping[str, Any]) -> list[Any]:
    rows = []
    for outcome, of in document["importance"].items():
        basis = basis_text(document["importance_from"][outcome])
        for variable in ranking(document, outcome):
            share, correlation = of[variable]["first_order"], of[variable]["rank_correlation"]
            if share is not None or correlation is not None:
                names = name_and_unit(outcome)[0], name_and_unit(variable)[0]
                rows.append((*names, _number(share, ".3f"), _number(correlation, "+.3f"), basis))
    return rows


def _number(value: float | None, form: str) -> str:
    """Return a number in a format; a dash where it is not known."""
    return "–" if value is None else format(value, form)


def _rates(variables: Mapping[str, Distribution], document: Mapping[str, Any], records: Sequence[Record]) -> list[str]:
    if len(records) < 2:
        return []
    parts = []
    good = np.array([one["status"] == "ok" for one in records])
    for name in ranking(document, SUCCESS)[:DRAWN]:
        x = [one["parameters"][name] for one in records]
        text = any(isinstance(value, str) for value in x)
        scale, label = Scale(""), name
        if not text:
            scale, label = _scale(name, variables[name], x)
            x = [scale.factor * value for value in x]
        of = statistics.groups([str(value) for value in x] if text else x)
        points, labels = [], []
        for group in np.unique(of):
            members = np.flatnonzero(of == group)
            hits = int(good[members].sum())
            at = float(group) if text else float(np.mean([x[i] for i in members]))
            within = interval([records[int(i)] for i in members], document["sampling"])
            points.append((at, hits / len(members), *within))
            labels.append(str(x[members[0]]))
        parts.append(plots.rates(points, label, labels if text else None))
    return parts


def _scale(name: str, variable: Distribution, values: Sequence[float]) -> tuple[Scale, str]:
    """Return how values of a variable are written, and its name with the unit."""
    scale = scale_of(values, unit_of(name, variable))
    return scale, scale.label(name_and_unit(name)[0])


def _scatter(
    variables: Mapping[str, Distribution], document: Mapping[str, Any], records: Sequence[Record]
) -> list[str]:
    good = [one["status"] == "ok" for one in records]
    if all(good):
        return []
    columns = {
        name: [float(one["parameters"][name]) for one in records]
        for name in ranking(document, SUCCESS)
        if all(isinstance(one["parameters"][name], int | float) for one in records)
    }
    drawn = []
    for name, values in list(columns.items())[:DRAWN]:
        scale, label = _scale(name, variables[name], values)
        drawn.append((label, [scale.factor * value for value in values]))
    if len(drawn) == 1:
        clearance = outcomes(records).get(CLEARANCE)
        if clearance is None or any(value is None for value in clearance):
            return []
        name, unit = name_and_unit(CLEARANCE)
        scale = scale_of(clearance, unit)
        drawn.append((scale.label(name), [scale.factor * value for value in clearance]))
    pairs = [(a, b) for i, a in enumerate(drawn) for b in drawn[i + 1 :]]
    return [plots.scatter(x, y, good, x_name, y_name) for (x_name, x), (y_name, y) in pairs]


def _column(
    name: str, variable: Distribution, records: Sequence[Record], shown: Sequence[Record]
) -> tuple[str, list[str]]:
    """Return the heading of a variable, with the unit that suits all records, and its values in those shown."""
    values = [one["parameters"][name] for one in shown]
    if any(isinstance(value, str | bool) for value in values):
        return name, [str(value) for value in values]
    scale, label = _scale(name, variable, [one["parameters"][name] for one in records])
    return label, [scale.number(value) for value in values]


def _least(one: Record) -> str:
    return "" if one["clearance"] is None else f", least clearance {quantity_text(one['clearance'], 'm')}"


def _run(document: Mapping[str, Any]) -> list[tuple[str, Any]]:
    twice = document["repeated"]
    different = twice["different"]
    same = (
        f"{len(different)} of {twice['variants']} differ: {', '.join(map(str, different[:FAILURES]))}: the task does "
        "not repeat itself"
        if different
        else f"{twice['variants']}, all equal to the last bit"
    )
    if unanswered := twice["unanswered"]:
        same += f"; {len(unanswered)} crashed or timed out then: {', '.join(map(str, unanswered[:FAILURES]))}"
    rows = [(name, value) for name, value in document["sampling"].items()]
    rows += [("vpframe", document["version"]), ("run again by another process", same)]
    if document["seconds"]:
        rows.append(("seconds a variant, median", f"{document['seconds']['50']:.3g}"))
    if document["memory"]:
        rows.append(("memory of a process that runs variants", f"{document['memory'] / 2**20:.0f} MiB at most"))
    return rows
