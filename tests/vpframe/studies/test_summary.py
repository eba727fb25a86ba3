"""Numbers on the page of a study have units, and digits that tell them apart; what matters says from which variants."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.vpframe.studies.records import section
from vpframe.errors import VpframeError
from vpframe.scene.units import name_and_unit, quantity_text, scale_of
from vpframe.studies.distributions import Choice, Normal, Uniform


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


def test_variables_are_written_with_units(reported) -> None:
    _, document, page = reported
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


@pytest.mark.parametrize(
    "made",
    [lambda: Normal(0.0, 1.0, unit=3), lambda: Choice("a", unit=None), lambda: Uniform(0.0, 1.0, unit=b"m")],
    ids=["normal", "choice", "uniform"],
)
def test_a_unit_is_a_text(made) -> None:
    with pytest.raises(VpframeError, match=r"unit=.* must be a text such as 'm' or 'rad'"):
        made()
