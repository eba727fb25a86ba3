"""Each physics example runs, and what it says is so."""

import importlib.util
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


def run(name, **arguments):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.main(**arguments)


def test_parts_fall_into_the_tray():
    assert run("physics_tray", seconds=0.6, parts=3)["inside"]


def test_the_balloon_reaches_the_ceiling():
    result = run("physics_balloon", height=1.2)
    assert 0.0 < result["touched"] < 5.0
    assert result["top"] == pytest.approx(1.2, abs=1e-9)


def test_the_cradle_passes_the_blow_to_the_last_ball():
    result = run("physics_newtons_cradle", seconds=0.6)
    assert result["least"][-1] == pytest.approx(-0.5, abs=2e-3)
    assert max(abs(x) for x in (*result["least"][:-1], *result["most"][1:])) < 1e-6


def test_the_cradle_goes_on_when_its_inner_balls_have_slept():
    """Five blows: the balls between rest longer than they need to fall asleep, and each blow wakes them in passing."""
    result = run("physics_newtons_cradle", seconds=3.0)
    assert (result["most"][0], result["least"][-1]) == pytest.approx((0.5, -0.5), abs=2e-3)
    assert max(abs(x) for x in (*result["least"][:-1], *result["most"][1:])) < 1e-6
    first, last = result["energy"]
    assert last == pytest.approx(first, rel=2e-4)  # contacts with joints are integrated at second order


def test_the_hinge_swings_and_holds():
    result = run("physics_hinge")
    assert result["weight"] > 1.0 and result["opened"] < 1e-12
    assert result["lowest"] < -0.18 and result["fell"] > 0.1


@pytest.mark.slow
def test_the_nut_stays_where_the_wrench_leaves_it():
    result = run("physics_nut", seconds=2.0)
    assert result["left"] == result["after"] == 0.0
    assert abs(result["seat"]) < 1e-12 and abs(result["down"]) < 1e-12
    assert result["up"] > 0.14
    for name in ("raise", "lower"):
        assert result[name] == pytest.approx(result[f"{name} exact"], rel=1e-9)
