"""Charts of a study as SVG text, in the style of the report's plots: histogram, rate by class, scatter."""

from __future__ import annotations

from collections.abc import Sequence

from vpframe.report.plots import BOTTOM, LEFT, TOP, WIDTH, nice_ticks
from vpframe.text import escape

RIGHT = 20
HEIGHT = 170
GOOD, BAD, BLUE = "#1a9e57", "#c22420", "#2a6bd6"
MOST_POINTS = 4000
"""maximum number of successful variants in a scatter; failed ones are all drawn"""


class _Frame:
    """Axes of one chart."""

    def __init__(self, x: tuple[float, float], y: tuple[float, float], height: int = HEIGHT) -> None:
        self.height = height
        self.x_ticks, self.y_ticks = nice_ticks(*x, count=8), nice_ticks(*y)
        self.low_x, self.high_x = x if x[1] > x[0] else (self.x_ticks[0], self.x_ticks[-1])
        self.low_y, self.high_y = self.y_ticks[0], self.y_ticks[-1]

    def x(self, value: float) -> float:
        return LEFT + 16 + (value - self.low_x) / (self.high_x - self.low_x) * (WIDTH - LEFT - RIGHT - 16)

    def y(self, value: float) -> float:
        return self.height - BOTTOM - (value - self.low_y) / (self.high_y - self.low_y) * (self.height - TOP - BOTTOM)

    def svg(self, body: Sequence[str], x_name: str, y_name: str) -> str:
        parts = []
        for value in self.y_ticks:
            at = self.y(value)
            parts.append(f'<line x1="{LEFT + 16}" y1="{at:.1f}" x2="{WIDTH - RIGHT}" y2="{at:.1f}" class="grid"/>')
            parts.append(f'<text x="{LEFT + 10}" y="{at + 4:.1f}" text-anchor="end">{value:g}</text>')
        for value in self.x_ticks:
            if self.low_x <= value <= self.high_x:
                at = self.x(value)
                parts.append(f'<text x="{at:.1f}" y="{self.height - 8}" text-anchor="middle">{value:g}</text>')
        parts.append(f'<text x="{LEFT}" y="12">{escape(y_name)}</text>')
        parts.append(f'<text x="{WIDTH - RIGHT}" y="12" text-anchor="end">{escape(x_name)}</text>')
        return f'<svg viewBox="0 0 {WIDTH} {self.height}" role="img">{"".join(parts)}{"".join(body)}</svg>'


def histogram(edges: Sequence[float], counts: Sequence[int], name: str) -> str:
    """Bars of counts between edges; one value is one bar."""
    spread = edges[-1] - edges[0]
    if spread <= 0.0:
        half = 0.5 * abs(edges[0]) or 0.5
        frame = _Frame((edges[0] - half, edges[0] + half), (0.0, float(max(counts))))
        edges = (edges[0] - 0.05 * half, edges[0] + 0.05 * half)
    else:
        frame = _Frame((edges[0], edges[-1]), (0.0, float(max(counts))))
    bars = []
    for low, high, count in zip(edges, edges[1:], counts, strict=False):
        left, right, top = frame.x(low), frame.x(high), frame.y(count)
        bars.append(
            f'<rect x="{left + 0.5:.1f}" y="{top:.1f}" width="{max(right - left - 1.0, 1.0):.1f}" '
            f'height="{frame.y(0.0) - top:.1f}" fill="{BLUE}"><title>{low:g} – {high:g}: {count}</title></rect>'
        )
    return frame.svg(bars, name, "variants")


Point = tuple[float, float, float, float]
"""x, rate, low and high of its interval"""


def rates(points: Sequence[Point], name: str, labels: Sequence[str] | None = None) -> str:
    """Success rate with its interval by class of a variable; `labels` for classes that are no numbers."""
    xs = [p[0] for p in points]
    pad = 0.03 * (max(xs) - min(xs)) or 0.5
    frame = _Frame((min(xs) - pad, max(xs) + pad), (0.0, 1.0))
    if labels is not None:
        frame.x_ticks = []
    body = []
    for place, (x, rate, low, high) in enumerate(points):
        at = frame.x(x)
        body.append(
            f'<line x1="{at:.1f}" y1="{frame.y(low):.1f}" x2="{at:.1f}" y2="{frame.y(high):.1f}" stroke="{GOOD}" '
            f'stroke-width="2"/><circle cx="{at:.1f}" cy="{frame.y(rate):.1f}" r="3.5" fill="{GOOD}">'
            f"<title>{x:g}: {rate:.3f} ({low:.3f} – {high:.3f})</title></circle>"
        )
        if labels is not None:
            body.append(f'<text x="{at:.1f}" y="{HEIGHT - 8}" text-anchor="middle">{escape(labels[place][:24])}</text>')
    return frame.svg(body, name, "rate")


def scatter(x: Sequence[float], y: Sequence[float], good: Sequence[bool], x_name: str, y_name: str) -> str:
    """Points of variants; failed ones are red and on top."""
    frame = _Frame((min(x), max(x)), (min(y), max(y)), 300)
    fine = [i for i, is_good in enumerate(good) if is_good]
    shown = fine[:: -(-len(fine) // MOST_POINTS)] if fine else []
    body = []
    for chosen, color, radius in ((shown, GOOD, 2.0), ([i for i, g in enumerate(good) if not g], BAD, 3.0)):
        dots = "".join(f'<circle cx="{frame.x(x[i]):.1f}" cy="{frame.y(y[i]):.1f}" r="{radius}"/>' for i in chosen)
        body.append(f'<g fill="{color}" fill-opacity="0.55">{dots}</g>')
    return frame.svg(body, x_name, y_name)
