"""The examples' studies against closed forms: variant by variant, and as rates."""

import importlib.util
import sys
from types import ModuleType

import numpy as np
import pytest

from constraints.recognition.iso286 import fit_class
from tests.vpframe.studies.scripts import ROOT
from vpframe.studies import statistics
from vpframe.studies.child import Children
from vpframe.studies.variants import Variant, random_sample

MARGIN = 2e-6
"""m: facets and tolerance of the position study; nearer to the limit the closed form does not decide a variant"""


def imported(name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(ROOT / "examples"))
    spec = importlib.util.spec_from_file_location(name, ROOT / "examples" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    sys.modules.pop("parts", None)
    return module


@pytest.fixture
def tolerances(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    return imported("tolerance_study", monkeypatch)


@pytest.fixture
def positions(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    return imported("position_study", monkeypatch)


def clearance(module: ModuleType, v: Variant) -> float:
    """Diametral, m."""
    return module.size(module.BORE, v["bore"]) - module.size(module.SHAFTS[v["fit"]], v["shaft"])


def worst_hole(module: ModuleType, v: Variant) -> float:
    """Greatest distance of a hole from its place, m."""
    return max(float(np.hypot(v[f"x{i}"], v[f"y{i}"])) for i in range(1, len(module.HOLES) + 1))


def test_zones_are_those_of_the_standard(tolerances: ModuleType) -> None:
    fit = fit_class("H7/h6", tolerances.DIAMETER)
    (low, high), (least, most) = tolerances.SHAFTS["h6"], tolerances.BORE
    assert 1e-6 * (least - high) == pytest.approx(fit.least, abs=1e-12)
    assert 1e-6 * (most - low) == pytest.approx(fit.most, abs=1e-12)
    assert {high - low for low, high in tolerances.SHAFTS.values()} == {13.0}


def covers(hits: int, trials: int, rate: float) -> bool:
    low, high = statistics.wilson(hits, trials, 0.999)
    return low <= rate <= high


def test_the_closed_forms_are_those_of_the_samples(tolerances: ModuleType, positions: ModuleType) -> None:
    sample = random_sample(tolerances.VARIANTS, 20000, 1)
    for fit in tolerances.SHAFTS:
        members = [v for v in sample if v["fit"] == fit]
        hits = sum(clearance(tolerances, v) > 0.0 for v in members)
        assert covers(hits, len(members), tolerances.expected_rate(fit)), fit
    sample = random_sample(positions.VARIANTS, 20000, 1)
    limit = 0.5 * (positions.HOLE - positions.BOLT)
    assert covers(sum(worst_hole(positions, v) < limit for v in sample), 20000, positions.expected_rate())


def statuses(name: str, sample: list[Variant]) -> list[str]:
    pool = Children(ROOT / "examples" / f"{name}.py", 120.0, 0)
    try:
        outcomes = [pool.run(v) for v in sample]
    finally:
        pool.close()
    wrong = [outcome["reason"] for outcome in outcomes if outcome["status"] not in ("ok", "no")]
    assert wrong == []
    return [outcome["status"] for outcome in outcomes]


@pytest.mark.parametrize("count", [6, pytest.param(300, marks=pytest.mark.slow)])
def test_shafts_go_in_exactly_where_there_is_clearance(tolerances: ModuleType, count: int) -> None:
    sample = random_sample(tolerances.VARIANTS, 5 * count, 2)
    near = sorted(sample, key=lambda v: abs(clearance(tolerances, v)))[:count]
    found = statuses("tolerance_study", near)
    assert found == ["ok" if clearance(tolerances, v) > 0.0 else "no" for v in near]
    assert {"ok", "no"} == set(found)
    assert abs(clearance(tolerances, near[0])) < 2e-6, "some are near the limit"


@pytest.mark.parametrize("count", [2, pytest.param(150, marks=pytest.mark.slow)])
def test_bolts_go_in_exactly_where_their_holes_leave_room(positions: ModuleType, count: int) -> None:
    limit = 0.5 * (positions.HOLE - positions.BOLT)
    sample = random_sample(positions.VARIANTS, count * 5, 2)

    def decided(v: Variant) -> float:
        return abs(worst_hole(positions, v) - limit)

    near = sorted((v for v in sample if decided(v) > MARGIN), key=decided)[:count]
    found = statuses("position_study", near)
    assert found == ["ok" if worst_hole(positions, v) < limit else "no" for v in near]
    assert {"ok", "no"} == set(found)
    assert decided(near[0]) < 2e-5, "some are near the limit"
