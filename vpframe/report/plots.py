"""Plots as SVG text for one page width: lines and spans over time, histograms, rates by class, scatter."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from math import ceil, floor, isfinite, log10

from vpframe.text import escape, plain
from vpframe.view import palette

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 860, 170, 64, 20, 22, 26
ROW, LANES, LEGEND = 20, 300, 150
"""height of a lane, width of the names of lanes, and of a legend"""
LANE_LABEL, LEGEND_LABEL, CLASS_LABEL = 44, 19, 24
"""maximum number of characters"""
LINES = 8
"""maximum number of lines in a plot; only the first ones are drawn"""
MOST_POINTS = 4000
"""maximum number of successful variants in a scatter; failed ones are all drawn"""
SERIES = ("#2a6bd6", "#d9822b", "#1a9e57", "#9b4dca", "#c0392b", "#16838f", "#7f6a00", "#56606e")
GOOD, BAD, BLUE = "#1a9e57", "#c22420", SERIES[0]

Line = Sequence[tuple[float, float]]


def lines(series: Mapping[str, Line], unit: str, duration: float, steps: bool = False, height: int = 180) -> str:
    """Plot lines over time (s), interrupted at NaN. `steps`: values are constant until the next one."""
    there = [(name, line) for name, line in series.items() if len(line)]
    if not there:
        return ""
    values = [v for _, line in there[:LINES] for _, v in line if isfinite(v)]
    axes = _Axes((0.0, duration), (min(0.0, min(values, default=0.0)), max(values, default=1.0)), height, LEGEND, " s")
    body, right = [], WIDTH - LEGEND + 10
    for place, (name, line) in enumerate(there[:LINES]):
        color, y = SERIES[place % len(SERIES)], TOP + 12 + 17 * place
        for points in [axes.stepped(line)] if steps else [axes.thinned(piece) for piece in unbroken(line)]:
            body.append(f'<polyline points="{points}" fill="none" stroke="{color}" stroke-width="1.6"/>')
        body.append(_line(right, y - 4, right + 14, y - 4, f'stroke="{color}" stroke-width="2.5"'))
        body.append(_text(right + 19, y, _label(name, LEGEND_LABEL)))
    if len(there) > LINES:
        body.append(_text(right + 19, TOP + 12 + 17 * LINES, f"and {len(there) - LINES} more"))
    return axes.svg(body, "", unit)


def spans(lanes: Mapping[str, Sequence[tuple[str, float, float]]], duration: float) -> str:
    """Plot lanes of spans (state, start, end in s), coloured by state."""
    if not lanes:
        return ""
    height = TOP + BOTTOM + ROW * len(lanes)
    scale = (WIDTH - LANES - RIGHT) / max(duration, 1e-9)
    body = []
    for tick in nice_ticks(0.0, duration):
        if tick <= duration:
            x = LANES + tick * scale
            body += [_line(x, TOP, x, height - BOTTOM), _text(x, height - 8, f"{tick:g} s", "middle")]
    for place, (name, parts) in enumerate(lanes.items()):
        y = TOP + ROW * place
        body.append(_text(LANES - 8, y + 14, _label(name, LANE_LABEL), "end"))
        for state, start, end in parts:
            color = palette.hex_color(palette.STATE[state]) if state in palette.STATE else BLUE
            title = f"{escape(state)} {start:.3f} – {end:.3f} s"
            width = max((end - start) * scale, 2.0)
            body.append(_bar(LANES + start * scale, y + 3, width, ROW - 6, f'rx="2" fill="{color}"', title))
    return _svg(height, body)


def histogram(edges: Sequence[float], counts: Sequence[int], name: str) -> str:
    """Bars of counts of variants between edges; one value is one bar."""
    reach = (edges[0], edges[-1])
    if not reach[1] > reach[0]:
        half = 0.5 * abs(edges[0]) or 0.5
        reach = (edges[0] - half, edges[0] + half)
        edges = (edges[0] - 0.05 * half, edges[0] + 0.05 * half)
    axes = _Axes(reach, (0.0, float(max(counts))))
    bars = []
    for low, high, count in zip(edges, edges[1:], counts, strict=False):
        left, top, width = axes.x(low), axes.y(count), axes.x(high) - axes.x(low)
        title = f"{low:g} – {high:g}: {count}"
        bars.append(_bar(left + 0.5, top, max(width - 1.0, 1.0), axes.y(0.0) - top, f'fill="{BLUE}"', title))
    return axes.svg(bars, name, "variants")


Point = tuple[float, float, float, float]
"""x, rate, low and high of its interval"""


def rates(points: Sequence[Point], name: str, labels: Sequence[str] | None = None) -> str:
    """Success rate with its interval by class of a variable; `labels` for classes that are no numbers."""
    xs = [p[0] for p in points]
    pad = 0.03 * (max(xs) - min(xs)) or 0.5
    axes = _Axes((min(xs) - pad, max(xs) + pad), (0.0, 1.0))
    if labels is not None:
        axes.x_ticks = []
    body = []
    for place, (x, rate, low, high) in enumerate(points):
        at = axes.x(x)
        body.append(_line(at, axes.y(low), at, axes.y(high), f'stroke="{GOOD}" stroke-width="2"'))
        title = f"<title>{x:g}: {rate:.3f} ({low:.3f} – {high:.3f})</title>"
        body.append(f'<circle cx="{at:.1f}" cy="{axes.y(rate):.1f}" r="3.5" fill="{GOOD}">{title}</circle>')
        if labels is not None:
            body.append(_text(at, HEIGHT - 8, escape(labels[place][:CLASS_LABEL]), "middle"))
    return axes.svg(body, name, "rate")


def scatter(x: Sequence[float], y: Sequence[float], good: Sequence[bool], x_name: str, y_name: str) -> str:
    """Points of variants; failed ones are red and on top."""
    axes = _Axes((min(x), max(x)), (min(y), max(y)), 300)
    fine = [i for i, is_good in enumerate(good) if is_good]
    shown = fine[:: -(-len(fine) // MOST_POINTS)] if fine else []
    body = []
    for chosen, color, radius in ((shown, GOOD, 2.0), ([i for i, g in enumerate(good) if not g], BAD, 3.0)):
        dots = "".join(f'<circle cx="{axes.x(x[i]):.1f}" cy="{axes.y(y[i]):.1f}" r="{radius}"/>' for i in chosen)
        body.append(f'<g fill="{color}" fill-opacity="0.55">{dots}</g>')
    return axes.svg(body, x_name, y_name)


def nice_ticks(low: float, high: float, count: int = 5) -> list[float]:
    """Return about `count` round numbers that enclose low … high."""
    if not high > low:
        high = low + 1.0
    raw = (high - low) / count
    magnitude = 10.0 ** floor(log10(raw))
    step = next(m * magnitude for m in (1.0, 2.0, 2.5, 5.0, 10.0) if m * magnitude >= raw)
    first, last = floor(low / step + 1e-9), ceil(high / step - 1e-9)
    return [round(i * step, 12) for i in range(first, last + 1)]


def unbroken(line: Line) -> list[list[tuple[float, float]]]:
    """Return the sections of a line between values that are not finite."""
    return [list(group) for finite, group in groupby(line, key=lambda point: isfinite(point[1])) if finite]


class _Axes:
    """Axes of one plot over a range of x and one of y; `right`: margin, `suffix`: of the numbers along x."""

    def __init__(
        self, x: tuple[float, float], y: tuple[float, float], height: int = HEIGHT, right: int = RIGHT, suffix: str = ""
    ) -> None:
        self.height, self.right, self.suffix = height, WIDTH - right, suffix
        self.x_ticks, self.y_ticks = nice_ticks(*x, count=8), nice_ticks(*y)
        self.low_x, self.high_x = x if x[1] > x[0] else (self.x_ticks[0], self.x_ticks[-1])
        self.low_y, self.high_y = self.y_ticks[0], self.y_ticks[-1]

    def x(self, value: float) -> float:
        return LEFT + (value - self.low_x) / (self.high_x - self.low_x) * (self.right - LEFT)

    def y(self, value: float) -> float:
        return self.height - BOTTOM - (value - self.low_y) / (self.high_y - self.low_y) * (self.height - TOP - BOTTOM)

    def thinned(self, line: Line) -> str:
        """Return the points of a line, at most the lowest and highest of each pixel column."""
        columns: dict[int, list[tuple[float, float]]] = {}
        for time, value in line:
            columns.setdefault(int(self.x(time)), []).append((time, value))
        by_value = (sorted(points, key=lambda p: p[1]) for points in columns.values())
        return self._points(p for points in by_value for p in sorted({points[0], points[-1]}))

    def stepped(self, line: Line) -> str:
        ends = [*(time for time, _ in line[1:]), self.high_x]
        return self._points((at, value) for (time, value), end in zip(line, ends, strict=True) for at in (time, end))

    def _points(self, line: Iterable[tuple[float, float]]) -> str:
        return " ".join(f"{self.x(t):.1f},{self.y(v):.1f}" for t, v in line)

    def svg(self, body: Sequence[str], x_name: str, y_name: str) -> str:
        """Return the plot: grid, numbers and names of both axes, and what is drawn in them."""
        grid = []
        for value in self.y_ticks:
            at = self.y(value)
            grid += [_line(LEFT, at, self.right, at), _text(LEFT - 6, at + 4, f"{value:g}", "end")]
        for value in self.x_ticks:
            if self.low_x <= value <= self.high_x:
                grid.append(_text(self.x(value), self.height - 8, f"{value:g}{self.suffix}", "middle"))
        names = [_text(LEFT, 12, escape(y_name))] * bool(y_name)
        names += [_text(self.right, 12, escape(x_name), "end")] * bool(x_name)
        return _svg(self.height, [*grid, *names, *body])


def _svg(height: float, body: Iterable[str]) -> str:
    return f'<svg viewBox="0 0 {WIDTH} {height}" role="img">{"".join(body)}</svg>'


def _line(x1: float, y1: float, x2: float, y2: float, style: str = 'class="grid"') -> str:
    return f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" {style}/>'


def _text(x: float, y: float, text: str, anchor: str = "") -> str:
    """Return a text, which must be escaped."""
    aligned = f' text-anchor="{anchor}"' if anchor else ""
    return f'<text x="{x:.1f}" y="{y:.1f}"{aligned}>{text}</text>'


def _bar(x: float, y: float, width: float, height: float, style: str, title: str) -> str:
    size = f'width="{width:.1f}" height="{height:.1f}"'
    return f'<rect x="{x:.1f}" y="{y:.1f}" {size} {style}><title>{title}</title></rect>'


def _label(name: str, length: int) -> str:
    """Shorten a name to `length` characters, keeping its end; the tooltip shows it in full."""
    name = plain(name)
    if len(name) <= length:
        return escape(name)
    return f"<title>{escape(name)}</title>…{escape(name[1 - length :])}"
