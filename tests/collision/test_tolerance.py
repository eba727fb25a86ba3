"""The one value that holds the epsilons."""

from dataclasses import fields
from typing import Any

import pytest

from collision import CollisionError, Tolerance


@pytest.mark.parametrize("value", [-1e-9, float("nan"), "1 mm", None])
@pytest.mark.parametrize("name", [field.name for field in fields(Tolerance) if not isinstance(field.default, str)])
def test_what_is_no_size_is_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(CollisionError, match=f"Tolerance: {name} is"):
        Tolerance(**{name: value})


@pytest.mark.parametrize("name", ["fit_class", "press_fit"])
def test_what_is_no_class_is_refused_by_name(name: str) -> None:
    with pytest.raises(CollisionError, match=f"Tolerance: {name} is 7"):
        Tolerance(**{name: 7})


def test_infinity_stands_for_never() -> None:
    assert Tolerance(break_distance=float("inf")).break_distance == float("inf")
