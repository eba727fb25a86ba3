"""The benchmark of studies: its clusters on paper, its table, and a run of a few variants."""

import pytest
from bench_run import suite


def test_a_cluster_on_paper_is_as_fast_as_its_workers_or_its_scheduler() -> None:
    bench = suite("study")
    few, many = bench.on_paper(10, 1.0, 0.004), bench.on_paper(1000, 1.0, 0.004)
    assert (few["seconds"], few["efficiency"]) == (0.1, 1.0)
    assert (many["seconds"], many["efficiency"]) == (0.004, pytest.approx(0.25))


@pytest.mark.slow
def test_a_few_variants() -> None:
    bench = suite("study")
    result = bench.run(quick=True, variants=12)
    assert result["suite"] == "study"
    assert result["ratios"]["blocks with answers that are equal to the last bit"] == 1.0
    assert [row["method"] for row in result["rows"][:3]] == ["plain loop", "study, 1 job", "study, 2 jobs"]
    assert [row["n"] for row in result["rows"][:3]] == [10, 10, 12]
    assert "goals: overhead under 10%" in bench.table(result)
