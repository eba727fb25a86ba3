"""Directions, lines and places that a script names."""

import numpy as np
import pytest

from tests.vpframe.bench_scene import at
from tests.vpframe.watching import box
from vpframe.errors import TaskError
from vpframe.hands.directions import direction, line, top_of, way_out
from vpframe.scene import modelling as m
from vpframe.scene.scene import Part, Scene
from vpframe.session.session import Session


@pytest.fixture
def hand():
    """A hand that holds a cube in the air, 0.1 m above a table."""
    table = Part("table", m.shape(m.box(1.0, 1.0, 0.1)), at(-0.5, -0.5, -0.05), fixed=True)
    with Session(Scene([table, Part("cube", box((0.1, 0.1, 0.1)), at(0.2, 0.0, 0.2))])) as session:
        hand = session.hand(at=(0.2, 0.0, 0.25))
        hand.grab("cube")
        yield hand


@pytest.mark.parametrize(
    ("along", "expected"), [("up", [0, 0, 1]), ("-x", [-1, 0, 0]), ([0.0, 3.0, 4.0], [0.0, 0.6, 0.8])]
)
def test_a_direction_is_a_unit_vector_of_the_world(hand, along, expected) -> None:
    assert direction(hand, along, outward=False) == pytest.approx(np.array(expected, dtype=float))


@pytest.mark.parametrize(
    ("along", "words"),
    [
        ("left", "give 'axis', one of up, down"),
        ([0, 0, 0], "zero vector"),
        ("axis", "no axis to go by"),
        ([1, 2], "three"),
    ],
)
def test_what_names_no_direction_is_refused(hand, along, words: str) -> None:
    with pytest.raises(TaskError, match=words):
        direction(hand, along, outward=True)


def test_a_line_goes_through_the_part_or_a_given_point(hand) -> None:
    origin, axis = line(hand, "y")
    assert origin == pytest.approx([0.2, 0.0, 0.2]) and axis == pytest.approx([0.0, 1.0, 0.0])
    origin, axis = line(hand, ((1.0, 2.0, 3.0), "down"))
    assert origin == pytest.approx([1.0, 2.0, 3.0]) and axis == pytest.approx([0.0, 0.0, -1.0])


def test_a_part_that_nothing_holds_leaves_upwards(hand) -> None:
    assert way_out(hand, None) == pytest.approx([0.0, 0.0, 1.0])


def test_the_top_is_the_largest_plane_that_faces_up(hand) -> None:
    height, middle = top_of([hand.scene["table"]], "table")
    assert height == pytest.approx(0.05) and middle == pytest.approx([0.0, 0.0])
