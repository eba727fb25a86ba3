"""Variants depend on the seed and their number alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vpframe.errors import VpframeError
from vpframe.scene import modelling
from vpframe.studies import Choice, Normal, Uniform, Variant, load
from vpframe.studies.variants import SEQUENCES, grid, nominal, random_sample, sequence_of, sobol_sample

VARIABLES = {"bore": Normal(8.02e-3, 5e-6), "tilt": Uniform(-0.01, 0.01), "seal": Choice("a", "b")}


@given(st.integers(1, 40), st.integers(1, 40), st.integers(0, 2**40))
@settings(max_examples=20, deadline=None)
@pytest.mark.parametrize("sample", [random_sample, sobol_sample])
def test_a_longer_study_begins_with_the_shorter_one(sample, few: int, more: int, seed: int) -> None:
    few, more = sorted((few, more))
    assert sample(VARIABLES, more, seed)[:few] == sample(VARIABLES, few, seed)


@pytest.mark.parametrize("sample", [random_sample, sobol_sample])
def test_another_seed_gives_other_values(sample) -> None:
    a, b = sample(VARIABLES, 8, 1), sample(VARIABLES, 8, 2)
    assert all(x["bore"] != y["bore"] for x, y in zip(a, b, strict=True))


def test_values_follow_their_distributions() -> None:
    taken = random_sample(VARIABLES, 4000, 7)
    bore = np.array([v["bore"] for v in taken])
    assert bore.mean() == pytest.approx(8.02e-3, abs=4 * 5e-6 / np.sqrt(4000))
    assert bore.std() == pytest.approx(5e-6, rel=0.05)
    assert sum(v["seal"] == "a" for v in taken) == pytest.approx(2000, abs=4 * np.sqrt(1000))
    correlation = np.corrcoef(bore, [v["tilt"] for v in taken])[0, 1]
    assert abs(correlation) < 4 / np.sqrt(4000)


def test_a_sobol_sequence_fills_every_strip() -> None:
    taken = sobol_sample(VARIABLES, 64 * SEQUENCES, 3)
    for number in range(SEQUENCES):
        tilts = np.sort([v["tilt"] for v in taken if sequence_of(v.index) == number])
        strips = np.floor((tilts + 0.01) / 0.02 * 64).astype(int)
        assert strips.tolist() == list(range(64))
    assert len({v["tilt"] for v in taken}) == len(taken), "each sequence is scrambled in its own way"


def test_a_grid_has_all_combinations_in_order() -> None:
    taken = grid(VARIABLES, 3, 0)
    assert len(taken) == 3 * 3 * 2 == len({tuple(v.items()) for v in taken})
    assert [v.index for v in taken] == list(range(18))
    assert {v["seal"] for v in taken} == {"a", "b"}
    assert sorted({v["tilt"] for v in taken}) == pytest.approx([-0.01 * 2 / 3, 0.0, 0.01 * 2 / 3])


def test_the_nominal_variant() -> None:
    assert dict(nominal(VARIABLES)) == {"bore": 8.02e-3, "tilt": 0.0, "seal": "a"}


def test_a_variant_has_a_generator_of_its_own_that_repeats_itself() -> None:
    first, again, other = (Variant(i, 5, {"x": 1.0}) for i in (3, 3, 4))
    drawn = first.rng.random(4)
    assert (again.rng.random(4) == drawn).all()
    assert not (other.rng.random(4) == drawn).any()
    values = np.random.default_rng(np.random.SeedSequence(5, spawn_key=(3,))).random(4)
    assert not (values == drawn).any()


def test_an_unknown_variable_is_named_with_those_there_are() -> None:
    with pytest.raises(VpframeError, match=r"no variable 'bor' in VARIANTS; there are: 'bore', 'tilt'"):
        Variant(0, 0, {"bore": 1.0, "tilt": 2.0})["bor"]


def test_a_file_is_read_once_and_its_scenes_are_apart(tmp_path) -> None:
    path = modelling.write_step(tmp_path / "box.step", {"box": modelling.box(0.01, 0.02, 0.03)})
    first = load(path)
    first["box"].pose.translation[:] = 1.0
    first["box"].fixed = True
    second = load(path)
    assert second["box"].shape is first["box"].shape
    assert (second["box"].pose.translation == 0.0).all() and not second["box"].fixed
