"""A verb is one generator: called on a hand it runs the session, inside another verb it is a part of that verb."""

import inspect
from typing import Any

import vpframe as vp
from vpframe.hands.segment import Condition

VERBS = [name for name in dir(vp.Hand) if hasattr(getattr(vp.Hand, name), "__wrapped__")]


def test_a_verb_keeps_its_name_its_text_and_its_arguments() -> None:
    assert len(VERBS) > 15
    for name in VERBS:
        method: Any = getattr(vp.Hand, name)
        assert method.__name__ == name and len(method.__doc__) > 20
        assert inspect.isgeneratorfunction(method.__wrapped__)
        assert next(iter(inspect.signature(method).parameters)) == "self"
    assert "required" in inspect.signature(vp.Hand.insert).parameters


def test_conditions_combine() -> None:
    yes, no = Condition("yes", lambda session, hand: True), Condition("no", lambda session, hand: False)
    assert (yes & ~no)(None) and (no | yes)(None) and not (yes & no)(None)
    assert str((yes & ~no) | no) == "yes and not no or no"
