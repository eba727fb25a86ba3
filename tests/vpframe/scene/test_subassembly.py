"""Names in the product tree."""

import pytest

from vpframe.errors import TaskError, UnknownPartError
from vpframe.scene.subassembly import name_of, parts_named

NAMES = (
    "frame",
    "head/board",
    "head/chip_1",
    "head/chip_2",
    "head/fan/base",
    "head/fan/rotor",
    "fan/base",
    "spare/fan",
)


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("frame", ["frame"]),
        ("head/fan", ["head/fan/base", "head/fan/rotor"]),
        ("head", ["head/board", "head/chip_1", "head/chip_2", "head/fan/base", "head/fan/rotor"]),
        ("fan", ["fan/base"]),
        ("rotor", ["head/fan/rotor"]),
        ("…/chip_2", ["head/chip_2"]),
        (".../chip_2", ["head/chip_2"]),
        ("fan/rotor", ["head/fan/rotor"]),
        ("spare", ["spare/fan"]),
    ],
)
def test_a_name_in_the_tree(name: str, parts: list[str]) -> None:
    assert list(parts_named(NAMES, name)) == parts


def test_parts_that_are_a_subassembly_go_by_its_name() -> None:
    assert name_of(NAMES, ("head/fan/rotor", "head/fan/base")) == "head/fan"
    assert name_of(NAMES, tuple(n for n in reversed(NAMES) if n.startswith("head/"))) == "head"
    for parts in (("head/fan/base",), ("head/fan/base", "frame"), ("head/board", "head/chip_1"), ("spare/fan",)):
        assert name_of(NAMES, parts) == parts[0]


def test_a_name_of_nothing_or_of_several_things_is_refused_with_those_there_are() -> None:
    with pytest.raises(UnknownPartError, match=r"'head/chip_3'.*'head/chip_1'"):
        parts_named(NAMES, "head/chip_3")
    with pytest.raises(TaskError, match=r"'base' names 2 things: head/fan/base, fan/base; give more of the path"):
        parts_named(NAMES, "base")
    for name in ("", "/", "…/"):
        with pytest.raises(UnknownPartError):
            parts_named(NAMES, name)
