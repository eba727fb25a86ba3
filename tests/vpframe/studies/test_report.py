"""The page and the table of a study."""

import csv
import re

import pytest

from tests.vpframe.studies.records import VARIABLES, section
from tests.vpframe.studies.scripts import firsts
from vpframe.studies import report, statistics
from vpframe.studies.summary import SOBOL, basis_text, summary


def test_the_table_has_a_row_a_variant_by_index(endings) -> None:
    _, out, _ = endings
    rows = list(csv.DictReader((out / "results.csv").open()))
    assert [int(row["index"]) for row in rows] == list(range(10))
    for row, one in zip(rows, firsts(out), strict=True):
        assert float(row["x"]) == one["parameters"]["x"]
        assert row["status"] == one["status"]
        assert row["square"] == ("" if one["status"] != "ok" else repr(one["measures"]["square"]))


def test_the_page_is_one_file_without_scripts(endings) -> None:
    _, out, _ = endings
    page = (out / "index.html").read_text()
    assert "<script" not in page and not re.search(r"(src|href)=['\"]https?:", page)
    for title in ("Outcomes", "Which variables matter", "Rate by variable", "Why", "Worst variants"):
        assert f"<h2>{title}</h2>" in page
    ok = sum(one["status"] == "ok" for one in firsts(out))
    assert f"{ok} of 10 variants can be done: " in page
    assert "expected x is negative" in page


def test_the_page_has_no_metres_without_a_unit(reported) -> None:
    rows, _, page = reported
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


def test_what_matters_says_from_which_variants(reported) -> None:
    rows, document, page = reported
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


def test_the_rate_of_sobol_sequences_has_their_interval(reported) -> None:
    rows, _, _ = reported
    given = {"samples": 120, "seed": 3}
    sobol, random = (
        summary(VARIABLES, {"method": method, **given}, rows, [], 120)["rate"] for method in (SOBOL, "random")
    )
    good = [one["status"] == "ok" for one in rows]
    assert (sobol["low"], sobol["high"]) == statistics.replicated(good, [k % 16 for k in range(120)])
    assert (random["low"], random["high"]) == statistics.wilson(sum(good), 120)
