import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vpframe.scene.units import METRES, NAMES, length, seconds


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        ("0.5mm", 5e-4),
        ("20 um", 2e-5),
        ("20µm", 2e-5),
        (".5in", 0.0127),
        ("1e-3m", 1e-3),
        ("3 μm", 3e-6),
        ("2.m", 2.0),
        (" 3 cm ", 0.03),
    ],
)
def test_lengths_as_people_write_them(text, metres):
    assert length(text) == pytest.approx(metres, rel=1e-15)


@pytest.mark.parametrize("text", ["", "mm", "five mm", "5 furlong", "nan", "inf", "1e999", "-1mm", "1 2", "0x10"])
def test_what_is_not_a_length_is_said(text):
    with pytest.raises(ValueError, match="is not a length"):
        length(text)


@pytest.mark.parametrize("text", ["0.5", "1e-3", " 3 ", ".5", "0"])
def test_a_number_alone_is_no_length(text):
    with pytest.raises(ValueError, match=f"is not a length without its unit.*: {text.strip()}mm$"):
        length(text)


def test_the_units_named_are_those_there_are():
    assert set(NAMES.split(", ")) == {unit for unit in METRES if unit.isascii()}


@given(st.floats(0, 1e300), st.sampled_from(sorted(METRES)))
def test_any_number_with_any_unit(value, unit):
    assert math.isclose(length(f"{value!r}{unit}"), value * METRES[unit], rel_tol=1e-15)


@pytest.mark.parametrize(
    ("text", "wanted"), [("120s", 120.0), ("2 min", 120.0), ("1h", 3600.0), ("250ms", 0.25), ("7", 7.0)]
)
def test_times_as_people_write_them(text, wanted):
    assert seconds(text) == pytest.approx(wanted, rel=1e-15)


@pytest.mark.parametrize("text", ["soon", "-1s", "1e400s", "3 mm", "", "nan"])
def test_what_is_not_a_time_is_said(text):
    with pytest.raises(ValueError, match="is not a time"):
        seconds(text)
