"""What pages send is read by one table; whatever else comes is dropped."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vpframe.session.requests import ACTIONS, FARTHEST, Request

GOOD = {
    "accept": {"id": 3},
    "grab": {"part": 1, "level": 0, "surface": -1},
    "drag": {"point": [0, 0.5, 1], "to": [1, 2, 3], "free": False},
    "place": {"pose": [0, 0, 0, 0, 0, 0, 1.0], "free": True},
    "slide": {"along": "axis", "distance": 0.01},
    "turn": {"about": "z", "angle": -1.5},
    "look": {"frame": -1},
}


@pytest.mark.parametrize("action", GOOD)
def test_a_message_of_the_table_is_read(action: str) -> None:
    request = Request.read({"action": action, **GOOD[action]}, 7)
    assert request is not None and request.action == action and request.client == 7
    fields = {**request.given, **({} if request.id is None else {"id": request.id})}
    assert fields == {n: tuple(v) if isinstance(v, list) else v for n, v in GOOD[action].items()}


BAD = [None, True, "1", 1.5, [], {}, [1, 2], [1, 2, "3"], [1, 2, math.inf], math.nan, 10 * FARTHEST, 1 << 40, "w"]


@pytest.mark.parametrize("action", GOOD)
def test_a_field_that_is_missing_or_of_another_kind_is_refused(action: str) -> None:
    for name, value in GOOD[action].items():
        assert Request.read({"action": action, **{n: v for n, v in GOOD[action].items() if n != name}}) is None
        for bad in BAD:
            if type(bad) is type(value) and isinstance(value, bool):
                continue
            if isinstance(value, float) and isinstance(bad, float) and abs(bad) < FARTHEST:
                continue
            assert Request.read({"action": action, **GOOD[action], name: bad}) is None, (name, bad)


def test_what_is_no_request_is_refused() -> None:
    for content in (
        None,
        3,
        [],
        {},
        {"action": None},
        {"action": ["play"]},
        {"action": "quit"},
        {"action": "__init__"},
    ):
        assert Request.read(content) is None


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=8) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=10,
)


@given(st.sampled_from(sorted(ACTIONS)), st.data())
def test_nothing_that_a_page_sends_raises(action: str, data: st.DataObject) -> None:
    fields = {name: data.draw(JSON) for name in ACTIONS[action]}
    request = Request.read({"action": action, **fields, "more": 1})
    if request is not None:
        assert set(request.given) <= set(ACTIONS[action])
        json.dumps(dict(request.given), allow_nan=False)
