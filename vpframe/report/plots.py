"""Plots as SVG text for one page width: lines and step functions over time, and spans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from math import ceil, floor, isfinite, log10

from vpframe.text import escape, plain
from vpframe.view import palette

WIDTH, LEFT, RIGHT, TOP, BOTTOM = 860, 48, 150, 22, 26
LANE_LABEL, LEGEND_LABEL = 44, 19
"""maximum number of characters"""
LINES = 8
"""maximum number of lines in a plot; only the first ones are drawn"""
SERIES = ("#2a6bd6", "#d9822b", "#1a9e57", "#9b4dca", "#c0392b", "#16838f", "#7f6a00", "#56606e")

Line = Sequence[tuple[float, float]]


def lines(series: Mapping[str, Line], unit: str, duration: float, steps: bool = False, height: int = 180) -> str:
    """Plot lines over time (s), interrupted at NaN. `steps`: values are constant until the next one."""
    there = [(name, line) for name, line in series.items() if len(line)]
    drawn = dict(there[:LINES])
    if not drawn:
        return ""
    values = [v for line in drawn.values() for _, v in line if isfinite(v)]
    ticks = nice_ticks(min(0.0, min(values, default=0.0)), max(values, default=1.0))
    low, high = ticks[0], ticks[-1]
    plot = _Plot(duration, low, high, height)
    body = [plot.axes(ticks, unit)]
    for place, (name, line) in enumerate(drawn.items()):
        color = SERIES[place % len(SERIES)]
        for points in [plot.stepped(line)] if steps else [plot.thinned(piece) for piece in unbroken(line)]:
            body.append(f'<polyline points="{points}" fill="none" stroke="{color}" stroke-width="1.6"/>')
        body.append(plot.legend(place, name, color))
    if len(there) > LINES:
        body.append(plot.legend(LINES, f"and {len(there) - LINES} more", "none"))
    return plot.svg(body)


def spans(lanes: Mapping[str, Sequence[tuple[str, float, float]]], duration: float) -> str:
    """Plot lanes of spans (state, start, end in s), coloured by state."""
    if not lanes:
        return ""
    row = 20
    height = TOP + BOTTOM + row * len(lanes)
    left = 300
    scale = (WIDTH - left - 20) / max(duration, 1e-9)
    body = []
    for tick in nice_ticks(0.0, duration):
        if tick <= duration:
            x = left + tick * scale
            body.append(f'<line x1="{x:.1f}" y1="{TOP}" x2="{x:.1f}" y2="{height - BOTTOM}" class="grid"/>')
            body.append(f'<text x="{x:.1f}" y="{height - 8}" text-anchor="middle">{tick:g} s</text>')
    for place, (name, parts) in enumerate(lanes.items()):
        y = TOP + row * place
        body.append(f'<text x="{left - 8}" y="{y + 14}" text-anchor="end">{_label(name, LANE_LABEL)}</text>')
        for state, start, end in parts:
            color = palette.hex_color(palette.STATE.get(state, palette.REFUSED))
            width = max((end - start) * scale, 2.0)
            body.append(
                f'<rect x="{left + start * scale:.1f}" y="{y + 3}" width="{width:.1f}" height="{row - 6}" rx="2" '
                f'fill="{color}"><title>{escape(state)} {start:.3f} – {end:.3f} s</title></rect>'
            )
    return f'<svg viewBox="0 0 {WIDTH} {height}" role="img">{"".join(body)}</svg>'


def _label(name: str, length: int) -> str:
    """Shorten a name to `length` characters, keeping its end; the tooltip shows it in full."""
    name = plain(name)
    if len(name) <= length:
        return escape(name)
    return f"<title>{escape(name)}</title>…{escape(name[1 - length :])}"


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


class _Plot:
    def __init__(self, duration: float, low: float, high: float, height: int) -> None:
        self.height = height
        self.low = low
        self.x_scale = (WIDTH - LEFT - RIGHT) / max(duration, 1e-9)
        self.y_scale = (height - TOP - BOTTOM) / (high - low)
        self.duration = duration

    def x(self, time: float) -> float:
        return LEFT + time * self.x_scale

    def y(self, value: float) -> float:
        return self.height - BOTTOM - (value - self.low) * self.y_scale

    def axes(self, ticks: Sequence[float], unit: str) -> str:
        parts = []
        for value in ticks:
            y = self.y(value)
            parts.append(f'<line x1="{LEFT}" y1="{y:.1f}" x2="{WIDTH - RIGHT}" y2="{y:.1f}" class="grid"/>')
            parts.append(f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text>')
        for tick in nice_ticks(0.0, self.duration, 8):
            if tick <= self.duration:
                parts.append(
                    f'<text x="{self.x(tick):.1f}" y="{self.height - 8}" text-anchor="middle">{tick:g} s</text>'
                )
        parts.append(f'<text x="{LEFT}" y="12">{escape(unit)}</text>')
        return "".join(parts)

    def thinned(self, line: Line) -> str:
        """Return the points of a line, at most the lowest and highest of each pixel column."""
        columns: dict[int, list[tuple[float, float]]] = {}
        for time, value in line:
            columns.setdefault(int(self.x(time)), []).append((time, value))
        kept: list[tuple[float, float]] = []
        for points in columns.values():
            extremes = {min(points, key=lambda p: p[1]), max(points, key=lambda p: p[1])}
            kept += sorted(extremes)
        return " ".join(f"{self.x(t):.1f},{self.y(v):.1f}" for t, v in kept)

    def stepped(self, line: Line) -> str:
        points = []
        for place, (time, value) in enumerate(line):
            until = line[place + 1][0] if place + 1 < len(line) else self.duration
            points += [f"{self.x(time):.1f},{self.y(value):.1f}", f"{self.x(until):.1f},{self.y(value):.1f}"]
        return " ".join(points)

    def legend(self, place: int, name: str, color: str) -> str:
        y = TOP + 12 + 17 * place
        x = WIDTH - RIGHT + 10
        return (
            f'<line x1="{x}" y1="{y - 4}" x2="{x + 14}" y2="{y - 4}" stroke="{color}" stroke-width="2.5"/>'
            f'<text x="{x + 19}" y="{y}">{_label(name, LEGEND_LABEL)}</text>'
        )

    def svg(self, body: Sequence[str]) -> str:
        return f'<svg viewBox="0 0 {WIDTH} {self.height}" role="img">{"".join(body)}</svg>'
