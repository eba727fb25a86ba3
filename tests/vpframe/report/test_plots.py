"""Plots: ticks, thinned and stepped lines, gaps, long names."""

import re

import numpy as np
import pytest

from vpframe.report import plots


@pytest.mark.parametrize(
    ("low", "high"), [(0, 1), (0, 0), (-3, 17), (0, 1e-9), (2.5e6, 2.6e6), (0, 0.00123), (-1e-3, 1e3)]
)
def test_ticks_enclose_the_range_and_are_few(low, high):
    ticks = plots.nice_ticks(low, high)
    assert ticks[0] <= low + 1e-9 * abs(low) and ticks[-1] >= high - 1e-9 * abs(high)
    assert 2 <= len(ticks) <= 8
    assert np.ptp(np.diff(ticks)) <= 1e-9 * (ticks[-1] - ticks[0])


def test_a_thinned_line_keeps_its_extremes():
    rng = np.random.default_rng(0)
    values = rng.normal(size=20000)
    values[[777, 15000]] = 9.0, -9.0
    line = [(i / 100, float(v)) for i, v in enumerate(values)]
    drawn = plots.lines({"noise": line}, "m", 200.0)
    points = np.array([[float(x) for x in p.split(",")] for p in re.search(r'points="([^"]*)"', drawn)[1].split()])
    assert len(points) < 2000
    assert (np.diff(points[:, 0]) >= 0).all()
    whole = plots.lines({"noise": [(7.77, 9.0), (150.0, -9.0)]}, "m", 200.0)
    two = np.array([[float(x) for x in p.split(",")] for p in re.search(r'points="([^"]*)"', whole)[1].split()])
    np.testing.assert_allclose([points[:, 1].min(), points[:, 1].max()], [two[:, 1].min(), two[:, 1].max()], atol=0.11)


def test_a_stepped_line_goes_sideways_and_then_up():
    drawn = plots.lines({"freedom": [(0.0, 6.0), (1.0, 2.0)]}, "", 2.0, steps=True)
    points = [[float(x) for x in p.split(",")] for p in re.search(r'points="([^"]*)"', drawn)[1].split()]
    assert len(points) == 4
    assert points[0][1] == points[1][1] and points[1][0] == points[2][0] and points[2][1] == points[3][1]


def test_a_line_is_broken_where_there_is_nothing_to_draw():
    line = [(0.0, 1.0), (0.5, 2.0), (1.0, float("nan")), (1.5, float("nan")), (2.0, 3.0), (2.5, 1.0)]
    drawn = plots.lines({"clearance": line}, "mm", 3.0)
    assert drawn.count("<polyline") == 2
    assert "nan" not in drawn


def test_long_names_and_many_lines_stay_within_a_plot():
    name = "gearbox/housing/cover/" + 40 * "x"
    drawn = plots.lines({f"{name}_{k}": [(0.0, 6.0), (1.0, 2.0)] for k in range(30)}, "degrees of freedom", 1.0)
    assert drawn.count("<polyline") == 8
    assert "and 22 more" in drawn
    shown = re.sub(r"<title>.*?</title>", "", drawn)
    assert all(len(text) <= 19 for text in re.findall(r">([^<]*x_\d+)</text>", shown))
    assert f"<title>{name}_0</title>" in drawn
