"""The page of the report: one HTML file with its pictures and plots."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from vpframe.analysis.fits import BAD_KINDS
from vpframe.analysis.pairs import count_words, place_words
from vpframe.events import Event
from vpframe.report import elements, plots
from vpframe.report.origins import BEFORE, EARLIER, TASK
from vpframe.scene.names import face_name, ignored_words
from vpframe.session.log import SessionLog
from vpframe.text import escape
from vpframe.view import palette

OPEN_EVENTS = 40
"""number of events above which the list is folded"""
OPEN_INITIAL = 6
"""number of events of the initial assembly above which they are folded"""
INITIAL = ("recognised", "accepted", "refused", "satisfied")
"""kinds of these events"""
OPEN_LANES = 12
"""number of constraints above which lasting ones are not drawn"""
OPEN_PAIRS = 3
"""number of clashing pairs above which all are folded, and of touching pairs above which they are folded"""
TITLES = {TASK: "Caused by the task", BEFORE: "At the start", EARLIER: "Of an earlier run, not seen in this one"}
"""headings by origin of the clashes"""
CAPTIONED = 3
"""maximum number of events in a picture's caption"""
_VERDICTS = {
    "can be done": "The task can be done",
    "cannot be done": "The task cannot be done",
    "not decided": "Not decided",
}


def html(document: dict[str, Any], log: SessionLog, pictures: dict[Any, bytes]) -> str:
    """Return the page for `document` (as in report.json); `pictures` from `writer`."""
    sections = [
        _head(document),
        elements.figure(pictures.get("end"), "at the end", "wide"),
        elements.section("Notes on the model", "".join(f"<div>{escape(note)}</div>" for note in document["notes"])),
        elements.section("Steps", _stages(document["stages"])),
        elements.section("What happened", _events(log.events) + _moments(log, pictures)),
        elements.section("Constraints", _constraints(document, log)),
        elements.section("Freedom left", _freedom(log)),
        elements.section("Clearance along the path", _clearance(document, log, pictures)),
        elements.section("Clashes", _clashes(document, log, pictures)),
        elements.section("Swept volumes", _swept(document["swept"])),
        elements.section("Time a step took", _timings(document, log)),
    ]
    return elements.whole(f"{document['task']}: report", sections)


def _head(document: dict[str, Any]) -> str:
    ignored = ignored_words(document["ignored"], document["parts"])
    verdict = _VERDICTS[document["verdict"]] + (f", {ignored}" if ignored else "")
    verdict += f": {document['reason']}" if document["reason"] else "."
    verdict += "".join(f" {fit['text']}." for fit in document["press_fits"])
    clashing = [pair for pair in document["clashes"] if is_open(pair)]
    least = document["clearance"]
    facts = [
        ("duration", f"{document['duration']:.2f} s"),
        ("steps", f"{document['steps']}"),
        *(
            (f"clashes {when}", _number(document, clashing, of))
            for when, of in (("by the task", TASK), ("at the start", BEFORE))
        ),
        ("least clearance", "not measured" if least is None else _mm(least["least"])),
        ("constraints used", f"{sum(_was_active(c) for c in document['constraints'])}"),
    ]
    model = f"{document['model'] or 'built in code'}, {document['parts']} parts"
    links = (("scene.html", "play it back in 3D"), *((name, name) for name in ("report.json", "clashes.csv")))
    line = " · ".join([escape(model), *(f"<a href='{file}'>{name}</a>" for file, name in links)])
    return elements.head(document["task"], line, verdict, document["can_be_done"], facts)


def _number(document: dict[str, Any], clashing: Sequence[dict[str, Any]], origin: str) -> str:
    """Return the number of clashing pairs of one origin; without a step nothing was looked at."""
    return f"{sum(pair['origin'] == origin for pair in clashing)}" if document["steps"] else "not looked at"


def is_open(pair: dict[str, Any]) -> bool:
    """Whether two parts clash and the clash has not been accepted."""
    return pair["kind"] in BAD_KINDS and pair["status"] in ("new", "persistent")


def _stages(stages: Sequence[dict[str, Any]]) -> str:
    rows = [
        (f"{s['start']:.2f}", f"{s['end'] - s['start']:.2f}", f"<code>{escape(s['text'])}</code>")
        for s in stages
        if s["text"]
    ]
    return _folded(elements.table(("from (s)", "for (s)", "script"), rows, numbers=(0, 1)), "steps", len(rows))


def _events(events: Sequence[Event]) -> str:
    """Return the events; those of the initial assembly are folded."""
    parts: tuple[list[Event], list[Event]] = [], []
    for event in events:
        parts[event.step <= 1 and event.kind in INITIAL].append(event)
    rest, initial = parts
    if len(initial) <= OPEN_INITIAL:
        return _folded(_event_table(events), "events", len(events))
    found = f"<summary>{len(initial)} events: what the parts are to each other as they stand</summary>"
    return f"<details>{found}{_event_table(initial)}</details>" + _folded(_event_table(rest), "events", len(rest))


def _event_table(events: Iterable[Event]) -> str:
    rows = [
        (
            f"{event.time:.3f}",
            f"<span class='kind {palette.tone(event)}'>{escape(event.kind)}</span>",
            escape(event.text or " – ".join(event.parts)),
        )
        for event in events
    ]
    return elements.table(("time (s)", "event", ""), rows, numbers=(0,))


def _moments(log: SessionLog, pictures: dict[Any, bytes]) -> str:
    captions: dict[int, tuple[bytes, list[str]]] = {}
    for number, (event, frame) in enumerate(log.moments):
        if number in pictures:
            captions.setdefault(frame.step, (pictures[number], []))[1].append(event.text or event.kind)
    figures = [
        elements.figure(picture, f"{escape(_few(texts))} (step {step})") for step, (picture, texts) in captions.items()
    ]
    return f"<div class='pictures' style='margin-top:16px'>{''.join(figures)}</div>" if figures else ""


def _off(residual: float) -> str:
    """Format a residual (m) in mm; below a picometre it is zero."""
    return f"{1e3 * residual:.2g}" if residual > 1e-12 else "0"


def _short(part: str) -> str:
    """Return a part's own name without its path."""
    return part.rpartition("/")[2]


def _few(texts: Sequence[str]) -> str:
    more = f" · and {len(texts) - CAPTIONED} more" if len(texts) > CAPTIONED else ""
    return " · ".join(texts[:CAPTIONED]) + more


def _constraints(document: dict[str, Any], log: SessionLog) -> str:
    if not log.mates:
        return ""
    lasting = log.lasting()
    folded = len(log.mates) > OPEN_LANES and len(lasting) > 1
    lanes = {
        f"{m.kind}: {_short(m.parts[0])} – {_short(m.parts[1])} ({m.id})": m.spans
        for m in log.mates.values()
        if not (folded and m.id in lasting)
    }
    note = (
        f"<p class='dim'>{len(lasting)} constraints hold from beginning to end; they are not drawn.</p>"
        if folded
        else ""
    )
    if left_out := len(log.uninvolved()):
        note += f"<p class='dim'>Pictures and scene.html leave out {left_out}, of parts that no hand held.</p>"
    rows = [
        (
            escape(c["kind"]),
            escape(" – ".join(_faces(log, part, of) for part, of in zip(c["parts"], c["surfaces"], strict=True))),
            _off(c["residual"]),
            ", ".join(f"{s['state']} {s['from']:.2f}–{s['to']:.2f} s" for s in c["states"]),
            escape(c["why"]),
        )
        for c in sorted(document["constraints"], key=lambda c: c["id"] in lasting)  # changed constraints first
    ]
    table = elements.table(("kind", "parts and surfaces", "off by (mm)", "when", "why"), rows)
    drawn = plots.spans(lanes, document["duration"]) if lanes else ""
    return drawn + note + _folded(table, "constraints", len(rows))


def _freedom(log: SessionLog) -> str:
    series = {part: [(t, float(n)) for t, n, _ in changes] for part, changes in log.freedom.items()}
    return plots.lines(series, "degrees of freedom", log.duration, steps=True)


def _clearance(document: dict[str, Any], log: SessionLog, pictures: dict[Any, bytes]) -> str:
    least = document["clearance"]
    if least is None:
        return ""
    text = f"Least: {_mm(least['least'])} at {least['time']:.3f} s (step {least['step']})"
    if least["parts"]:
        a, b = (f"{part} · {face}" for part, face in zip(least["parts"], least["faces"], strict=True))
        text += f", between {escape(a)} and {escape(b)} at {place_words(least['points'][0])}"
    plot = plots.lines({"clearance": [(t, 1e3 * c) for t, c in log.clearance]}, "mm", log.duration)
    return f"<p>{text}.</p>{plot}{elements.figure(pictures.get('least'), 'where it is least', 'wide')}"


def _clashes(document: dict[str, Any], log: SessionLog, pictures: dict[Any, bytes]) -> str:
    authorised = "".join(
        f"<li>{escape(a)} – {escape(b)}: authorised: the overlap as drawn is meant</li>"
        for a, b in document["authorised"]
    )
    authorised += "".join(
        f"<li>{escape(a)} – {escape(b)}: ignored, may pass through each other</li>" for a, b in document["ignored"]
    )
    content = f"<ul>{authorised}</ul>" if authorised else ""
    if not document["clashes"]:
        return content + ("<p>None.</p>" if document["steps"] else "<p>Not looked at: no step was taken.</p>")
    content += "".join(
        _origin(title, [pair for pair in document["clashes"] if pair["origin"] == origin], pictures)
        for origin, title in TITLES.items()
    )
    how = "<code>vpframe clash accept DIR A:B</code> accepts the clashes of two parts; DIR is the folder of this page"
    note = f"<p class='dim'>{how}; they stay accepted while they last.</p>"
    lines = {"colliding": [(t, float(n)) for t, n in log.colliding]}
    return content + note + plots.lines(lines, "surface pairs", log.duration, steps=True, height=120)


def _origin(title: str, pairs: Sequence[dict[str, Any]], pictures: dict[Any, bytes]) -> str:
    """Return the pairs of one origin: clashing pairs with pictures, touching pairs folded."""
    clashing = [pair for pair in pairs if pair["kind"] in BAD_KINDS]
    touching = [pair for pair in pairs if pair["kind"] not in BAD_KINDS]
    if not pairs and title != TITLES[TASK]:
        return ""
    words = [count_words(len(of), "parts") + verb for of, verb in ((clashing, " clash"), (touching, " touch")) if of]
    few = len(clashing) <= OPEN_PAIRS
    inner = "".join(_pair(pair, pictures.get((pair["origin"], *pair["parts"])), few) for pair in clashing)
    if touching:
        rows = "".join(_pair(pair, pictures.get((pair["origin"], *pair["parts"]))) for pair in touching)
        total = count_words(sum(pair["count"] for pair in touching), "surfaces")
        found = f"{count_words(len(touching), 'parts')} only touch ({total})"
        inner += rows if len(touching) <= OPEN_PAIRS else f"<details><summary>{found}</summary>{rows}</details>"
    return f"<h3>{title}: {', '.join(words) or 'none'}</h3><div class='pairs pictures'>{inner}</div>"


def _pair(pair: dict[str, Any], picture: bytes | None, opened: bool = False) -> str:
    """Return a row of two parts with their surfaces folded."""
    what = " – ".join(pair["parts"])
    names = " – ".join(
        f"{_path(part)} · {escape(face)}" for part, face in zip(pair["parts"], pair["faces"], strict=True)
    )
    touch = "touch" if pair["kind"] == "contact" else pair["kind"]
    size = _mm(pair["depth"]) if pair["kind"] in BAD_KINDS else touch if pair["steps"] else ""
    facts = [f"at {place_words(pair['point'])}" if pair["point"] else "", count_words(pair["count"], "surfaces")]
    if pair["steps"]:
        times = f"{pair['first_time']:.3f} … {pair['last_time']:.3f} s" if pair["origin"] == TASK else ""
        facts += [times, f"{pair['steps']} steps"]
    facts += [escape(pair["remark"])]
    rows = [
        (
            f"<span class='status {row['status']}'>{row['status']}</span>",
            " – ".join(f"{escape(face)}" for face in row["faces"]),
            "" if row["first_time"] is None else f"{row['first_time']:.3f}",
            f"{row['steps']}",
            "" if row["depth"] is None else _mm(row["depth"]),
            escape(row["remark"]),
        )
        for row in pair["surface_pairs"]
    ]
    table = elements.table(("status", "surfaces", "first (s)", "steps", "depth", "remark"), rows)
    return (
        f"<details class='pair'{' open' if opened and picture else ''}><summary>"
        f"{elements.image(picture, escape(what)) if picture else '<span></span>'}"
        f"<span>{names}<br><span class='dim'>{' · '.join(filter(None, facts))}</span></span>"
        f"<b>{size}</b><span class='status {pair['status']}'>{pair['status']}</span>"
        f"</summary>{table}</details>"
    )


def _path(part: str) -> str:
    """Return a part's name with its path dimmed."""
    path, slash, name = part.rpartition("/")
    return f"<span class='dim'>{escape(path + slash)}</span>{escape(name)}" if slash else escape(name)


def _faces(log: SessionLog, part: str, surfaces: Sequence[int]) -> str:
    """Return the names of a part's faces."""
    if part in log.scene:
        return face_name(log.scene[part], *surfaces)
    return f"{part} · face {', '.join(map(str, surfaces))}"


def _swept(volumes: Iterable[dict[str, Any]]) -> str:
    rows = [
        (
            escape(v["part"]),
            f"<a href='{escape(v['file'])}'>{escape(v['file'])}</a>",
            f"{v['triangles']}",
            _mm(v["error"]),
            escape(", ".join(v["clashes"]) or "none"),
        )
        for v in volumes
    ]
    return elements.table(("part", "mesh", "triangles", "off by at most", "clashes with"), rows) if rows else ""


def _timings(document: dict[str, Any], log: SessionLog) -> str:
    if not log.timings:
        return ""
    rows = [
        (escape(name), f"{1e3 * t['median']:.3f}", f"{1e3 * t['p99']:.3f}", f"{t['total']:.3f}")
        for name, t in document["timings"].items()
    ]
    count = max(len(values) for values in log.timings.values())
    scale = log.duration / max(count, 1)
    top = 2e3 * max(t["p99"] for t in document["timings"].values())  # compilation in step 1 would flatten the plot
    series = {name: [(i * scale, min(1e3 * s, top)) for i, s in enumerate(v, 1)] for name, v in log.timings.items()}
    return plots.lines(series, "ms, cut off at twice the 99 % quantile", log.duration) + elements.table(
        ("", "median (ms)", "99 % (ms)", "total (s)"), rows
    )


def _folded(table: str, what: str, count: int) -> str:
    if count <= OPEN_EVENTS:
        return table
    return f"<details><summary>{count} {what}</summary>{table}</details>"


def _mm(metres: float) -> str:
    return f"{1e3 * metres:.3f} mm"


def _was_active(constraint: dict[str, Any]) -> bool:
    return any(state["state"] == "active" for state in constraint["states"])
