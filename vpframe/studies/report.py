"""The report of a study: `study.json`, `results.csv`, `index.html`, and the worst variants as task scripts."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import vpframe.report
from vpframe.files import replace
from vpframe.outputs import STUDY_FILES, VARIANT, OutputFolder
from vpframe.scene.units import Scale, name_and_unit, quantity_text, scale_of
from vpframe.studies import charts, statistics
from vpframe.studies.distributions import Distribution
from vpframe.studies.results import ANSWER, Record
from vpframe.studies.summary import CLEARANCE, SUCCESS, basis_text, interval, outcomes, ranking, unit_of, worst
from vpframe.text import csv_text, escape, filled, plain

WORST_FOLDER = "worst"
TEMPLATE = Path(vpframe.report.__file__).parent / "page.html"
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
    """Return one HTML file that contains all charts."""
    sections = [
        _head(script, document),
        _section("Variables", _rows(("variable", "varies as"), document["variables"].items())),
        _section("Outcomes", _outcomes(document)),
        _section("Which variables matter", _importance(document)),
        _section("Rate by variable", _rates(variables, document, records)),
        _section("Where it fails", _scatter(variables, document, records)),
        _section("Why", _reasons(document)),
        _section("Without success", _failures(variables, records)),
        _section("Worst variants", _worst(records)),
        _section("How it was run", _run(document)),
    ]
    return filled(TEMPLATE, title=escape(f"{script.stem}: study"), body="\n".join(filter(None, sections)))


def _head(script: Path, document: Mapping[str, Any]) -> str:
    rest = rest_text(document)
    good = document["rate"]["ok"] == document["variants"]
    links = "".join(f" · <a href='{name}'>{name}</a>" for name in ("study.json", "results.csv", "results.jsonl"))
    facts = [(WORDS[status], str(n)) for status, n in document["statuses"].items() if n or status in ("ok", "no")]
    cells = "".join(f'<div class="fact"><span class="dim">{name}</span><b>{n}</b></div>' for name, n in facts)
    return (
        f"<h1>{escape(script.stem)}: study</h1><div class='dim'>{escape(script.name)}, {document['variants']} variants"
        f"{links}</div><div class='verdict{'' if good else ' no'}'>{escape(rate_text(document))}</div>"
        f"<div>{escape(rest)}</div><div class='facts'>{cells}</div>"
    )


def _section(title: str, content: str) -> str:
    return f"<h2>{title}</h2>\n{content}" if content else ""


def _rows(head: Sequence[str], rows: Any) -> str:
    """Return an HTML table of escaped cells."""
    body = "".join("<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows)
    if not body:
        return ""
    return f"<table><tr>{''.join(f'<th>{escape(cell)}</th>' for cell in head)}</tr>{body}</table>"


def _outcomes(document: Mapping[str, Any]) -> str:
    parts, rows = [], []
    for full, column in document["outcomes"].items():
        name, unit = name_and_unit(full)
        if "values" in column:
            counts = ", ".join(f"{value}: {count}" for value, count in column["values"].items())
            parts.append(f"<p><b>{escape(name)}</b>: {escape(counts)}</p>")
        elif column["count"]:
            scale = scale_of(column["percentiles"].values(), unit)
            values = (scale.number(column["percentiles"][str(p)]) for p in statistics.PERCENTS)
            rows.append((scale.label(name), f"{column['count']} of {document['finished']}", *values))
            edges = [scale.factor * edge for edge in column["histogram"]["edges"]]
            parts.append(charts.histogram(edges, column["histogram"]["counts"], scale.label(name)))
    return _rows(("", "variants", *(f"{p} %" for p in statistics.PERCENTS)), rows) + "".join(parts)


def _importance(document: Mapping[str, Any]) -> str:
    rows = []
    for outcome in document["importance"]:
        for variable in ranking(document, outcome):
            row = document["importance"][outcome][variable]
            if any(value is not None for value in row.values()):
                found = _share(row["first_order"]), _signed(row["rank_correlation"])
                basis = basis_text(document["importance_from"][outcome])
                rows.append((name_and_unit(outcome)[0], name_and_unit(variable)[0], *found, basis))
    note = (
        "<p class='dim'>First-order Sobol' index: the share of an outcome's variance that the variable alone explains, "
        "estimated from the variants that have the outcome. Rank correlation: whether the outcome rises (+) or falls "
        "(-) with it.</p>"
    )
    made = _rows(("outcome", "variable", "Sobol' index", "rank correlation", "from"), rows)
    return made + note if made else ""


def basis_lines(document: Mapping[str, Any]) -> list[str]:
    """Return a line for each outcome that not every variant has: what matters to it is known of those alone."""
    return [
        f"What matters to {name_and_unit(outcome)[0]} is computed from {basis_text(basis)}."
        for outcome, basis in document["importance_from"].items()
        if basis["variants"] < basis["finished"]
    ]


def _share(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"


def _signed(value: float | None) -> str:
    return "" if value is None else f"{value:+.3f}"


def _rates(variables: Mapping[str, Distribution], document: Mapping[str, Any], records: Sequence[Record]) -> str:
    if len(records) < 2:
        return ""
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
        parts.append(charts.rates(points, label, labels if text else None))
    return "".join(parts)


def _scale(name: str, variable: Distribution, values: Sequence[float]) -> tuple[Scale, str]:
    """Return how values of a variable are written, and its name with the unit."""
    scale = scale_of(values, unit_of(name, variable))
    return scale, scale.label(name_and_unit(name)[0])


def _scatter(variables: Mapping[str, Distribution], document: Mapping[str, Any], records: Sequence[Record]) -> str:
    good = [one["status"] == "ok" for one in records]
    if all(good):
        return ""
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
            return ""
        name, unit = name_and_unit(CLEARANCE)
        scale = scale_of(clearance, unit)
        drawn.append((scale.label(name), [scale.factor * value for value in clearance]))
    pairs = [(a, b) for i, a in enumerate(drawn) for b in drawn[i + 1 :]]
    return "".join(charts.scatter(x, y, good, x_name, y_name) for (x_name, x), (y_name, y) in pairs)


def _reasons(document: Mapping[str, Any]) -> str:
    rows = [(r["count"], WORDS[r["status"]], r["reason"]) for r in document["reasons"]]
    return _rows(("variants", "", "first reason of its kind"), rows[:FAILURES])


def _failures(variables: Mapping[str, Distribution], records: Sequence[Record]) -> str:
    bad = [one for one in records if one["status"] != "ok"]
    labels, columns = [], []
    for name, variable in variables.items():
        values = [one["parameters"][name] for one in bad[:FAILURES]]
        label, texts = name, [str(value) for value in values]
        if not any(isinstance(value, str | bool) for value in values):
            scale, label = _scale(name, variable, [one["parameters"][name] for one in records])
            texts = [scale.number(value) for value in values]
        labels.append(label)
        columns.append(texts)
    rows = [
        (one["index"], WORDS[one["status"]], one["reason"], *(texts[k] for texts in columns))
        for k, one in enumerate(bad[:FAILURES])
    ]
    more = f"<p class='dim'>and {len(bad) - FAILURES} more in results.csv</p>" if len(bad) > FAILURES else ""
    return _rows(("", "", "reason", *labels), rows) + more


def _worst(records: Sequence[Record]) -> str:
    rows = [
        f"<li><a href='{_replay_name(one)}'>{_replay_name(one)}</a>: {WORDS[one['status']]}{_least(one)}</li>"
        for one in worst(records)
    ]
    how = "<p class='dim'><code>vpframe run worst/variant_….py --view</code> replays one in the viewer.</p>"
    return f"<ul>{''.join(rows)}</ul>{how}" if rows else ""


def _least(one: Record) -> str:
    return "" if one["clearance"] is None else f", least clearance {quantity_text(one['clearance'], 'm')}"


def _run(document: Mapping[str, Any]) -> str:
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
    return _rows(("", ""), rows)
