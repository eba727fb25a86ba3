"""Lengths in words."""

import pytest

from constraints.geometry.words import millimetres


@pytest.mark.parametrize(
    ("x", "words"),
    [(0.0, "0 mm"), (9e-13, "0 mm"), (-2e-6, "-2 µm"), (9.99e-5, "99.9 µm"), (1e-4, "0.1 mm"), (0.0123456, "12.35 mm")],
)
def test_lengths_have_the_unit_of_their_size(x: float, words: str) -> None:
    assert millimetres(x) == words
