"""The page of the report: one HTML file with its pictures and plots (`run.html`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from vpframe.analysis.fits import BAD_KINDS
from vpframe.analysis.pairs import count_words, place_words
from vpframe.events import Event
from vpframe.report import plots
from vpframe.report.origins import BEFORE, EARLIER, TASK
from vpframe.scene.names import face_name, ignored_words
from vpframe.session.log import SessionLog
from vpframe.text import rendered
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
    ignored = ignored_words(document["ignored"], document["parts"])
    verdict = _VERDICTS[document["verdict"]] + (f", {ignored}" if ignored else "")
    verdict += f": {document['reason']}" if document["reason"] else "."
    verdict += "".join(f" {fit['text']}." for fit in document["press_fits"])
    events = _sorted_events(log.events)
    return rendered(
        "report/run.html",
        document=document,
        verdict=verdict,
        facts=_facts(document),
        pictures=pictures,
        initial=events[0],
        events=events[1],
        moments=_moments(log, pictures),
        **_constraints(document, log),
        freedom=plots.lines(
            {part: [(t, float(n)) for t, n, _ in changes] for part, changes in log.freedom.items()},
            "degrees of freedom", log.duration, steps=True,
        ),
        clearance=plots.lines({"clearance": [(t, 1e3 * c) for t, c in log.clearance]}, "mm", log.duration),
        origins=_origins(document["clashes"]),
        colliding=plots.lines(
            {"colliding": [(t, float(n)) for t, n in log.colliding]}, "surface pairs", log.duration, True, 120
        ),
        timings=_timings(document, log),
        timing_rows=[
            (name, f"{1e3 * t['median']:.3f}", f"{1e3 * t['p99']:.3f}", f"{t['total']:.3f}")
            for name, t in document["timings"].items()
        ],
        open_events=OPEN_EVENTS,
        open_pairs=OPEN_PAIRS,
        **{f.__name__: f for f in (place_words, count_words)},
        mm=_mm,
        tone=palette.tone,
        facts_of=_facts_of,
        size_of=_size,
        origin_words=_origin_words,
    )  # fmt: skip


def _facts(document: dict[str, Any]) -> list[tuple[str, str]]:
    clashing = [pair["origin"] for pair in document["clashes"] if is_open(pair)]
    least, steps = document["clearance"], document["steps"]
    used = sum(any(state["state"] == "active" for state in c["states"]) for c in document["constraints"])
    return [
        ("duration", f"{document['duration']:.2f} s"),
        ("steps", f"{steps}"),
        ("clashes by the task", f"{clashing.count(TASK)}" if steps else "not looked at"),
        ("clashes at the start", f"{clashing.count(BEFORE)}" if steps else "not looked at"),
        ("least clearance", "not measured" if least is None else _mm(least["least"])),
        ("constraints used", f"{used}"),
    ]


def is_open(pair: dict[str, Any]) -> bool:
    """Whether two parts clash and the clash has not been accepted."""
    return pair["kind"] in BAD_KINDS and pair["status"] in ("new", "persistent")


def _sorted_events(events: Sequence[Event]) -> tuple[list[Event], list[Event]]:
    """Return the events of the initial assembly, which are folded if they are many, and all others."""
    initial = [event for event in events if event.step <= 1 and event.kind in INITIAL]
    if len(initial) <= OPEN_INITIAL:
        return [], list(events)
    return initial, [event for event in events if event not in initial]


def _moments(log: SessionLog, pictures: dict[Any, bytes]) -> list[tuple[bytes, str]]:
    """Return a picture and its caption for each step with an event that is drawn."""
    captions: dict[int, tuple[bytes, list[str]]] = {}
    for number, (event, frame) in enumerate(log.moments):
        if number in pictures:
            captions.setdefault(frame.step, (pictures[number], []))[1].append(event.text or event.kind)
    return [(picture, f"{_few(texts)} (step {step})") for step, (picture, texts) in captions.items()]


def _few(texts: Sequence[str]) -> str:
    more = f" · and {len(texts) - CAPTIONED} more" if len(texts) > CAPTIONED else ""
    return " · ".join(texts[:CAPTIONED]) + more


def _constraints(document: dict[str, Any], log: SessionLog) -> dict[str, Any]:
    """Return the rows of the constraints, those that changed first, and lanes of their states over time (SVG)."""
    lasting = log.lasting()
    folded = len(log.mates) > OPEN_LANES and len(lasting) > 1
    lanes = {
        f"{m.kind}: {_short(m.parts[0])} – {_short(m.parts[1])} ({m.id})": m.spans
        for m in log.mates.values()
        if not (folded and m.id in lasting)
    }
    rows = [
        (
            c["kind"],
            " – ".join(_faces(log, part, of) for part, of in zip(c["parts"], c["surfaces"], strict=True)),
            f"{1e3 * c['residual']:.2g}" if c["residual"] > 1e-12 else "0",
            ", ".join(f"{s['state']} {s['from']:.2f}–{s['to']:.2f} s" for s in c["states"]),
            c["why"],
        )
        for c in sorted(document["constraints"], key=lambda c: c["id"] in lasting)
    ]
    return {
        "constraints": rows,
        "lanes": plots.spans(lanes, document["duration"]),
        "lasting": len(lasting) if folded else 0,
        "left_out": len(log.uninvolved()),
    }


def _short(part: str) -> str:
    """Return a part's own name without its path."""
    return part.rpartition("/")[2]


def _faces(log: SessionLog, part: str, surfaces: Sequence[int]) -> str:
    """Return the names of a part's faces."""
    if part in log.scene:
        return face_name(log.scene[part], *surfaces)
    return f"{part} · face {', '.join(map(str, surfaces))}"


Pairs = list[dict[str, Any]]


def _origins(pairs: Pairs) -> list[tuple[str, Pairs, Pairs]]:
    """Return heading, clashing and touching pairs of each origin; the task's also without any, if there are others."""
    out = []
    for origin, title in TITLES.items():
        of = [pair for pair in pairs if pair["origin"] == origin]
        clashing = [pair for pair in of if pair["kind"] in BAD_KINDS]
        if of or (pairs and origin == TASK):
            out.append((title, clashing, [pair for pair in of if pair["kind"] not in BAD_KINDS]))
    return out


def _origin_words(clashing: Pairs, touching: Pairs) -> str:
    found = ((clashing, " clash"), (touching, " touch"))
    return ", ".join(count_words(len(of), "parts") + verb for of, verb in found if of) or "none"


def _facts_of(pair: dict[str, Any]) -> list[str]:
    """Return what the row of a pair says below its names."""
    facts = [f"at {place_words(pair['point'])}" if pair["point"] else "", count_words(pair["count"], "surfaces")]
    if pair["steps"]:
        times = f"{pair['first_time']:.3f} … {pair['last_time']:.3f} s" if pair["origin"] == TASK else ""
        facts += [times, f"{pair['steps']} steps"]
    return [fact for fact in (*facts, pair["remark"]) if fact]


def _size(pair: dict[str, Any]) -> str:
    """Return the depth of a clash, or what two parts are that do not clash."""
    if pair["kind"] in BAD_KINDS:
        return _mm(pair["depth"])
    return ("touch" if pair["kind"] == "contact" else pair["kind"]) if pair["steps"] else ""


def _timings(document: dict[str, Any], log: SessionLog) -> str:
    """Return the plot of computing time by stage."""
    count = max((len(values) for values in log.timings.values()), default=0)
    scale = log.duration / max(count, 1)
    # compilation in step 1 would flatten the plot
    top = 2e3 * max((t["p99"] for t in document["timings"].values()), default=0.0)
    series = {name: [(i * scale, min(1e3 * s, top)) for i, s in enumerate(v, 1)] for name, v in log.timings.items()}
    return plots.lines(series, "ms, cut off at twice the 99 % quantile", log.duration)


def _mm(metres: float) -> str:
    return f"{1e3 * metres:.3f} mm"
