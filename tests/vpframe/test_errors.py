"""Names that are proposed in place of an unknown one share something with it."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vpframe.errors import ALIKE, CONTAINED, UnknownPartError, near_names

PARTS = (
    "frame/base",
    "cover/lid",
    "cover/seal",
    "rotor/shaft",
    "rotor/pulley",
    "fasteners/M5x25_1",
    "fasteners/washer_1",
)


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("seall", ["cover/seal"]),
        ("SEAL", ["cover/seal"]),
        ("shft", ["rotor/shaft"]),
        ("m5x25", ["fasteners/M5x25_1"]),
        ("washer", ["fasteners/washer_1"]),
        ("cover/sael", ["cover/seal", "cover/lid"]),
    ],
)
def test_a_slip_is_answered_with_what_was_meant(name, near):
    assert near_names(name, PARTS) == near
    assert f"did you mean {near[0]!r}" in str(UnknownPartError(name, PARTS))


@pytest.mark.parametrize("name", ["valve", "xyz", "gear", "q", "", "handle", "motor", "bus"])
def test_a_name_that_nothing_is_like_is_answered_with_what_there_is(name):
    words = str(UnknownPartError(name, PARTS))
    assert near_names(name, PARTS) == [] and "did you mean" not in words and "there are: frame/base" in words


letters = st.text("abcdefgh_/", max_size=12)


@given(letters, st.lists(letters, max_size=6, unique=True))
def test_what_is_proposed_shares_a_part_of_the_name_or_most_letters(name, known):
    for own in near_names(name, known):
        ends = [word for word in (own, own.rsplit("/", 1)[-1]) if word]
        inside = any(min(len(name), len(w)) >= CONTAINED and (name in w or w in name) for w in ends)
        common = [2 * sum(min(name.count(c), w.count(c)) for c in set(name)) / (len(name) + len(w)) for w in ends]
        assert inside or max(common) >= ALIKE
    if name in known and name:
        assert name in near_names(name, known, most=len(known))
