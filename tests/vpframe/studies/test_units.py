"""Numbers on the page of a study have units, and digits that tell them apart; what matters says from which variants."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vpframe.errors import VpframeError
from vpframe.scene.units import name_and_unit, quantity_text, scale_of
from vpframe.studies import report, statistics
from vpframe.studies.distributions import Choice, Distribution, LogNormal, Normal, Triangular, Uniform
from vpframe.studies.summary import SOBOL, basis_text, summary


@given(st.lists(st.floats(-1e6, 1e6).filter(lambda x: x == 0.0 or abs(x) > 1e-12), min_size=1, max_size=20))
def test_lengths_are_written_by_size_and_with_the_digits_of_their_spread(values: list[float]) -> None:
    scale = scale_of(values, "m")
    largest = max(map(abs, values))
    assert scale.unit == ("m" if largest >= 1.0 else "µm" if 0.0 < largest < 1e-3 else "mm")
    assert scale.factor == {"m": 1.0, "mm": 1e3, "µm": 1e6}[scale.unit]
    for value in values:
        written = float(scale.number(value)) / scale.factor
        assert abs(written - value) <= 0.6e-2 * (max(values) - min(values)) + 1e-5 * abs(value) * (
            len(set(values)) == 1
        )


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (8.02e-3, "m", "8.02 mm"), (5e-6, "m", "5 µm"), (1.25, "m", "1.25 m"), (0.0, "m", "0 mm"),
        (-4e-5, "m", "-40 µm"),
        (0.5, "rad", "0.5 rad"), (12.0, "N", "12 N"), (0.25, "", "0.25"), (3e-7, "m", "0.3 µm"),
    ],
)  # fmt: skip
def test_a_quantity_is_written_with_its_unit(value: float, unit: str, text: str) -> None:
    assert quantity_text(value, unit) == text


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("force (N)", ("force", "N")), ("least clearance (m)", ("least clearance", "m")), ("bore", ("bore", "")),
        ("f(x)", ("f(x)", "")), ("a (b c)", ("a (b c)", "")), ("(m)", ("(m)", "")), ("", ("", "")),
    ],
)  # fmt: skip
def test_units_in_names(name: str, parts: tuple[str, str]) -> None:
    assert name_and_unit(name) == parts


VARIABLES: dict[str, Distribution] = {
    "bore": Normal(8.02e-3, 5e-6, unit="m"),
    "gap (m)": Uniform(1e-5, 4e-5),
    "tilt": Triangular(-0.01, 0.0, 0.01, unit="rad"),
    "wear": LogNormal(2e-6, 0.3, unit="m"),
    "plain": Uniform(0.0, 1.0),
    "seal": Choice("a", "b"),
}


def records(count: int = 120, seed: int = 3) -> list[dict[str, Any]]:
    """Variants of which those with a narrow gap fail: they have a clearance and no measure."""
    rng = np.random.default_rng(seed)
    out = []
    for k in range(count):
        given = {name: distribution.quantile(float(rng.random())) for name, distribution in VARIABLES.items()}
        good = given["gap (m)"] > 1.6e-5
        found = {"force (N)": 1e3 * given["bore"], "depth (m)": 1e-6 * k} if good else {}
        out.append(
            {
                "key": str(k),
                "index": k,
                "status": "ok" if good else "no",
                "reason": "" if good else "expected it",
                "parameters": given,
                "measures": found,
                "clearance": given["gap (m)"] / 3,
                "time": 1.0,
                "steps": 60,
                "seconds": 0.1,
                "memory": 1,
                "attempts": 1,
                "worker": "",
            }
        )
    return out


@pytest.fixture(scope="module")
def written() -> tuple[list[dict[str, Any]], dict[str, Any], str]:
    """Records, document and page of a study."""
    rows = records()
    document = summary(VARIABLES, {"method": "random", "samples": len(rows), "seed": 3}, rows, [], len(rows))
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    return rows, document, report.page(Path("fits.py"), VARIABLES, document, rows)


def section(page: str, title: str) -> str:
    return page.split(f"<h2>{title}</h2>")[1].split("<h2>")[0]


def test_variables_are_written_with_units(written) -> None:
    _, document, page = written
    assert document["variables"] == {
        "bore": "Normal(mean=8.02 mm, deviation=5 µm)",
        "gap (m)": "Uniform(low=10 µm, high=40 µm)",
        "tilt": "Triangular(low=-0.01 rad, peak=0 rad, high=0.01 rad)",
        "wear": "LogNormal(median=2 µm, spread=0.3)",
        "plain": "Uniform(low=0, high=1)",
        "seal": "Choice(values=('a', 'b'))",
    }
    for words in ("mean=8.02 mm, deviation=5 µm", "median=2 µm, spread=0.3"):
        assert words in section(page, "Variables")


def test_the_page_has_no_metres_without_a_unit(written) -> None:
    rows, _, page = written
    failures = section(page, "Without success")
    head = re.findall(r"<th>(.*?)</th>", failures)
    assert head == ["", "", "reason", "bore (mm)", "gap (µm)", "tilt (rad)", "wear (µm)", "plain", "seal"]
    bad = [one for one in rows if one["status"] == "no"]
    for line, one in zip(re.findall(r"<tr>(<td>.*?)</tr>", failures), bad, strict=False):
        bore, gap, tilt, wear, plain, seal = re.findall(r"<td>(.*?)</td>", line)[3:]
        given = one["parameters"]
        assert float(bore) == pytest.approx(1e3 * given["bore"], abs=1e-4) and len(bore) >= 6, "5 µm are told apart"
        assert float(gap) == pytest.approx(1e6 * given["gap (m)"], rel=1e-2)
        assert (float(tilt), float(wear)) == pytest.approx((given["tilt"], 1e6 * given["wear"]), rel=2e-2, abs=1e-4)
        assert (float(plain), seal) == (pytest.approx(given["plain"], abs=1e-2), given["seal"])
    outcomes = section(page, "Outcomes")
    for label in ("least clearance (µm)", "force (N)", "depth (µm)"):
        assert f"<td>{label}</td>" in outcomes and f">{label}</text>" in outcomes
    assert "(m)" not in page.replace("gap (m)", "")
    assert re.search(r"least clearance 3\.\d+ µm</li>", section(page, "Worst variants"))
    for title in ("Rate by variable", "Where it fails"):
        assert ">gap (µm)</text>" in section(page, title)
    ticks = [
        float(x) for x in re.findall(r'text-anchor="middle">([-\d.e+]+)</text>', section(page, "Rate by variable"))
    ]
    assert max(ticks) > 1.0, "no tick is a metre"


def test_what_matters_says_from_which_variants(written) -> None:
    rows, document, page = written
    good = sum(one["status"] == "ok" for one in rows)
    assert 60 < good < 110
    assert document["importance_from"] == {
        "can be done": {"variants": 120, "ok": good, "finished": 120},
        "least clearance (m)": {"variants": 120, "ok": good, "finished": 120},
        "depth (m)": {"variants": good, "ok": good, "finished": 120},
        "force (N)": {"variants": good, "ok": good, "finished": 120},
    }
    words = f"{good} of 120 variants, those that succeeded"
    matter = section(page, "Which variables matter")
    assert re.search(rf"<td>force</td><td>bore</td><td>[\d.]+</td><td>\+1.000</td><td>{words}</td>", matter)
    assert "<td>all 120 variants</td>" in matter
    lines = [f"What matters to {name} is computed from {words}." for name in ("depth", "force")]
    assert report.basis_lines(document) == lines
    assert f"<td>{good} of 120</td>" in section(page, "Outcomes")
    assert basis_text({"variants": 7, "ok": 3, "finished": 9}) == "7 of 9 variants, 3 of which succeeded"


def test_the_rate_of_sobol_sequences_has_their_interval(written) -> None:
    rows, _, _ = written
    given = {"samples": 120, "seed": 3}
    sobol, random = (
        summary(VARIABLES, {"method": method, **given}, rows, [], 120)["rate"] for method in (SOBOL, "random")
    )
    good = [one["status"] == "ok" for one in rows]
    assert (sobol["low"], sobol["high"]) == statistics.replicated(good, [k % 16 for k in range(120)])
    assert (random["low"], random["high"]) == statistics.wilson(sum(good), 120)


@pytest.mark.parametrize(
    "made",
    [lambda: Normal(0.0, 1.0, unit=3), lambda: Choice("a", unit=None), lambda: Uniform(0.0, 1.0, unit=b"m")],
    ids=["normal", "choice", "uniform"],
)
def test_a_unit_is_a_text(made) -> None:
    with pytest.raises(VpframeError, match=r"unit=.* must be a text such as 'm' or 'rad'"):
        made()
