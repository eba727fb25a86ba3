"""A part is pulled off what it rests on; the parts that hold it are named first, and no fixed one is to be removed."""

import numpy as np
import pinocchio as pin
import pytest

from tests.vpframe.bench_scene import at
from vpframe.errors import TaskError
from vpframe.hands import hand as hands
from vpframe.scene import modelling as m
from vpframe.scene.names import holders, obstacles_words
from vpframe.scene.scene import Part, Scene
from vpframe.session.session import Session

SCREWS = ((0.022, 0.0), (-0.022, 0.0))
UPRIGHT, OVER, ASIDE = np.eye(3), np.diag([1.0, -1.0, -1.0]), np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])


def pump(fixed: tuple[str, ...] = ("housing",), turned: np.ndarray = UPRIGHT) -> Scene:
    """The pump of docs/tutorial.md: housing, valve in its bore, cover on both, two screws through the cover."""
    housing = m.box(0.060, 0.040, 0.040).translated(-0.030, -0.020, 0.0)
    housing = housing - m.cylinder(0.01001, 0.032).translated(0.0, 0.0, 0.008)
    cover = m.box(0.060, 0.040, 0.006).translated(-0.030, -0.020, 0.0)
    for x, y in SCREWS:
        housing = housing - m.cylinder(0.0025, 0.006).translated(x, y, 0.034)
        cover = cover - m.cylinder(0.00275, 0.006).translated(x, y, 0.0)
    valve = m.revolve([(0, 0), (0.009, 0), (0.010, 0.001), (0.010, 0.028), (0.004, 0.028), (0.004, 0.032), (0, 0.032)])
    shank = m.revolve([(0, -0.010), (0.0021, -0.010), (0.0025, -0.0096), (0.0025, 0.0005), (0, 0.0005)])
    solids = {"housing": (housing, at(0, 0, 0)), "valve": (valve, at(0, 0, 0.008)), "cover": (cover, at(0, 0, 0.040))}
    for k, (x, y) in enumerate(SCREWS, start=1):
        solids[f"screw_{k}"] = (shank + m.hexagon(0.008, 0.0035), at(x, y, 0.046))
    all_round = pin.SE3(turned, np.zeros(3))
    return Scene([Part(n, m.shape(s), all_round * pose, fixed=n in fixed) for n, (s, pose) in solids.items()])


def refusal(scene: Scene, part: str, monkeypatch: pytest.MonkeyPatch, **how: object) -> str:
    monkeypatch.setattr(hands, "SEARCH", 0.01)  # another way out is not looked for
    with Session(scene) as session, pytest.raises(TaskError) as failed:
        session.hand().remove(part, **how)
    return str(failed.value).partition("; no other way out")[0]


@pytest.mark.parametrize("turned", [UPRIGHT, OVER, ASIDE], ids=["upright", "upside down", "on its side"])
@pytest.mark.parametrize("fixed", [("housing",), ()], ids=["housing fixed", "nothing fixed"])
def test_a_cover_is_pulled_off_its_housing_and_its_screws_are_named(
    fixed: tuple[str, ...], turned: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = turned @ [0.0, 0.0, 1.0] + 0.0
    text = refusal(pump(fixed, turned), "cover", monkeypatch)
    assert f"pull({np.round(out, 3).tolist()}" in text.replace("-0.0", "0.0")
    assert "screw_1 (face" in text and "screw_2 (face" in text
    assert text.endswith("hold it; remove them first")
    assert "housing" not in text and "valve" not in text


def test_a_cover_that_is_pulled_into_its_fixed_housing_is_told_to_remove_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    text = refusal(pump(), "cover", monkeypatch, along="down")
    assert text.endswith("stand in its way; housing is fixed")
    assert "remove it" not in text and "remove them" not in text and "remove valve" not in text


def test_once_its_screws_are_out_the_cover_comes_off_and_the_valve_after_it() -> None:
    with Session(pump()) as session:
        assert session.hand().remove(["screw_1", "screw_2", "cover", "valve"])


def ringed(cap_fixed: bool) -> Scene:
    """A bush on the floor of a blind bore, under a cap that lies on the rim of the housing."""
    housing = m.box(0.06, 0.06, 0.03).translated(-0.03, -0.03, 0.0) - m.cylinder(0.01, 0.02).translated(0, 0, 0.01)
    bush = m.cylinder(0.00999, 0.02) - m.cylinder(0.005, 0.02)
    cap = m.box(0.04, 0.04, 0.01).translated(-0.02, -0.02, 0.0) - m.cylinder(0.004, 0.01)
    return Scene(
        [
            Part("cap", m.shape(cap), at(0, 0, 0.03), fixed=cap_fixed),
            Part("bush", m.shape(bush), at(0, 0, 0.01)),
            Part("housing", m.shape(housing), at(0, 0, 0)),
        ]
    )


def test_a_cap_that_closes_a_bore_holds_the_bush_in_it(monkeypatch: pytest.MonkeyPatch) -> None:
    text = refusal(ringed(cap_fixed=False), "bush", monkeypatch)
    assert "pull([0.0, 0.0, 1.0]" in text.replace("-0.0", "0.0")
    assert "cap holds it (face" in text and text.endswith("; remove it first")
    # with the cap fixed the bush rests on the cap, and the housing comes off, not the cap
    text = refusal(ringed(cap_fixed=True), "bush", monkeypatch)
    assert "remove it first" in text and "cap" not in text.partition("mm")[2]


def test_parts_that_are_bolted_behind_hold_and_others_only_stand_in_the_way() -> None:
    pairs = [("screw", "housing"), ("housing", "cover"), ("cover", "screw"), ("lid", "cover")]
    assert holders(["screw", "lid"], ["cover"], pairs) == {"screw"}
    assert holders(["housing", "screw"], ["cover"], pairs) == frozenset()  # both ahead: neither holds
    assert holders(["lid"], ["cover"], []) == frozenset()


def test_words_name_what_holds_first_and_nothing_fixed_to_remove() -> None:
    shape = m.shape(m.box(0.01, 0.01, 0.01))
    part = {n: Part(n, shape, at(0, 0, 0), fixed=n.startswith("fixed")) for n in ("a", "b", "c", "fixed", "fixed_2")}
    met = [(part[n], "face 0") for n in ("a", "b", "c")]
    assert obstacles_words(met[:1]) == "a stands in its way (face 0); remove it first"
    assert obstacles_words(met[:2]) == "a (face 0) and b (face 0) stand in its way; remove them first"
    assert obstacles_words(met[:2], {"b"}) == "b holds it (face 0), a stands in its way (face 0); remove b first"
    assert obstacles_words(met, {"a", "b"}) == (
        "a (face 0) and b (face 0) hold it, c stands in its way (face 0); remove a and b first"
    )
    stuck = [(part["fixed"], "face 0"), (part["a"], "face 0")]
    assert obstacles_words(stuck) == "fixed (face 0) and a (face 0) stand in its way; fixed is fixed"
    assert obstacles_words(stuck, {"a", "fixed"}) == (
        "a holds it (face 0), fixed stands in its way (face 0); remove a first"
    )
    both = [(part["fixed"], "face 0"), (part["fixed_2"], "face 0")]
    assert obstacles_words(both).endswith("; fixed and fixed_2 are fixed")
    many = [(Part(f"p{k}", shape, at(0, 0, 0)), "face 0") for k in range(8)]
    assert "p5 (face 0) and 2 more stand in its way; remove them first" in obstacles_words(many)
