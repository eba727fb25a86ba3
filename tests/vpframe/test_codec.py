"""Values go through bytes and come back to the bit; bytes that are anything else are refused, and nothing is run."""

import json
import math
import struct
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from collision.contact import CONTACT_DTYPE
from constraints import kinds
from constraints.geometry.surfaces import Cylinder, Geometry, Plane, Sphere
from constraints.solve.groups import OnCarrier
from vpframe.codec import Codec, CodecError, conforms
from vpframe.session.checkpoint import CODEC


@dataclass(frozen=True, eq=False)
class Unit:
    """A vector that its constructor normalises, and something derived from it."""

    axis: np.ndarray
    words: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "axis", self.axis / np.linalg.norm(self.axis))
        object.__setattr__(self, "derived", 2.0 * self.axis)


PLAIN = Codec([Unit])


def same(a: Any, b: Any) -> bool:
    """Equal to the bit, types and the order in memory included."""
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray):
        layout = (a.flags.c_contiguous, a.flags.f_contiguous) == (b.flags.c_contiguous, b.flags.f_contiguous)
        may = a.flags.writeable == b.flags.writeable
        return a.dtype == b.dtype and a.shape == b.shape and layout and may and a.tobytes() == b.tobytes()
    if isinstance(a, np.generic):
        return a.tobytes() == b.tobytes()
    if isinstance(a, float):
        return struct.pack("<d", a) == struct.pack("<d", b) or (math.isnan(a) and math.isnan(b))
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, dict):
        return same(list(a), list(b)) and same(list(a.values()), list(b.values()))
    if isinstance(a, pin.SE3):
        return a.homogeneous.tobytes() == b.homogeneous.tobytes()
    if hasattr(a, "__dataclass_fields__"):
        return all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return a == b


arrays = hnp.arrays(
    st.sampled_from([np.bool_, np.int32, np.int64, np.uint8, np.float32, np.float64]),
    hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4),
)
leaves = (
    st.none()
    | st.booleans()
    | st.integers(-(2**70), 2**70)
    | st.floats()
    | st.text(st.characters(codec="utf-8"))
    | st.binary()
    | arrays
    | arrays.map(np.asfortranarray)
    | st.floats().map(np.float64)
    | st.integers(-5, 5).map(np.int64)
)
keys = st.integers() | st.text() | st.tuples(st.integers(), st.text())
values = st.recursive(
    leaves,
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.lists(inner, max_size=4).map(tuple)
        | st.dictionaries(keys, inner, max_size=4)
        | st.sets(st.integers(), max_size=4)
        | st.frozensets(st.text(), max_size=4)
    ),
    max_leaves=12,
)


@settings(max_examples=300, deadline=None)
@given(values)
def test_what_is_encoded_comes_back_to_the_bit(value: Any) -> None:
    assert same(value, PLAIN.decode(PLAIN.encode(value)))
    assert PLAIN.encode(PLAIN.decode(PLAIN.encode(value))) == PLAIN.encode(value)


@settings(max_examples=300, deadline=None)
@given(st.data(), values)
def test_damaged_bytes_are_one_clear_error_or_a_value(data: Any, value: Any) -> None:
    """A flipped bit in a number is another number: checksums are the file's business."""
    encoded = bytearray(PLAIN.encode(value))
    at = data.draw(st.integers(0, len(encoded) - 1))
    encoded[at] ^= data.draw(st.integers(1, 255))
    for damaged in (bytes(encoded), bytes(encoded[:at])):
        try:
            PLAIN.decode(damaged)
        except CodecError as error:
            assert "\n" not in str(error)


def test_structured_arrays_and_poses_and_constraints_come_back() -> None:
    rows = np.zeros(3, CONTACT_DTYPE)
    rows["distance"], rows["point_a"] = [0.1, np.nan, -0.0], np.arange(9.0).reshape(3, 3)
    turned = pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.3])), np.array([0.1, -0.0, 1e-300]))
    axis = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
    hole, pin_ = Cylinder(np.zeros(3), axis, 0.005), Cylinder(np.ones(3), -axis, 0.0049)
    constraint = kinds.Concentric((0, 1), (hole, pin_), ((1, 2), (3,)), 0.01)
    weld = kinds.Fixed.between((2, 5), turned, pin.SE3.Identity())
    value = {
        "rows": rows,
        "pose": turned,
        (0, "a"): [constraint, weld],
        "spread": np.arange(12.0).reshape(3, 4)[:, ::2],
    }
    back = CODEC.decode(CODEC.encode(value))
    value["spread"] = value["spread"].copy()
    assert same(value, back)
    poses = turned, turned.inverse()
    assert constraint.residual(*poses).tobytes() == back[0, "a"][0].residual(*poses).tobytes()


def test_what_a_value_holds_twice_is_one_object_again() -> None:
    plane = Plane(np.zeros(3), np.array([0.0, 0.0, 1.0]))
    array = np.arange(3.0)
    one, two, (three, four) = CODEC.decode(CODEC.encode([plane, plane, (array, array)]))
    assert one is two and three is four
    assert len(CODEC.encode([array] * 1000)) < 20_000


def test_a_constructor_that_rounds_does_not_change_the_bits() -> None:
    """0.1, 0.7, 0.707… normalised again differs in the last bit for some of many directions."""
    differ = 0
    rng = np.random.default_rng(1)
    for axis in rng.normal(size=(200, 3)):
        unit = Unit(axis)
        back = PLAIN.decode(PLAIN.encode(unit))
        differ += Unit(unit.axis).axis.tobytes() != unit.axis.tobytes()
        assert back.axis.tobytes() == unit.axis.tobytes()
    assert differ > 0, "the case is there"


def every(kind: type) -> set[type]:
    """The concrete types below a type."""
    return {c for sub in kind.__subclasses__() for c in (sub, *every(sub)) if "__dataclass_fields__" in vars(c)}


def test_every_kind_and_every_geometry_has_an_encoding() -> None:
    known = set(CODEC._names)
    assert every(kinds.Constraint) - known == {OnCarrier}, "which is made of another one whenever a hand carries"
    assert every(Geometry) - known == set()


HOSTILE = [
    {"Plane": [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]},
    {"Sphere": [{"array": 0}, -1.0]},
    {"Sphere": [{"array": 0}, "large"]},
    {"Sphere": [{"array": 0}]},
    {"Sphere": [{"array": 0}, 1.0, 2.0]},
    {"Popen": ["ls"]},
    {"__reduce__": ["os.system", "ls"]},
    {"array": 1},
    {"array": -2},
    {"same": 0},
    {"same": -1},
    {"SE3": {"array": 0}},
    {"tuple": 3},
    {"dict": [[[], 1]]},
    {"dict": [1]},
    {"float": "1e3"},
    {"bytes": "?"},
    {"tuple": [], "set": []},
    {},
]


@pytest.mark.parametrize("tree", HOSTILE, ids=str)
def test_a_value_that_was_made_up_is_refused(tree: Any) -> None:
    block = np.zeros(3).tobytes()
    head = json.dumps({"arrays": [["<f8", [3], "C"]], "value": tree}).encode()
    with pytest.raises(CodecError, match=r"^damaged: [^\n]+$"):
        CODEC.decode(struct.pack("<I", len(head)) + head + block)


@pytest.mark.parametrize(
    "head",
    [
        ["|O", [3], "C"],
        ["<U3", [3], "C"],
        [">f8", [3], "C"],
        ["<f8", [-3], "C"],
        ["<f8", [2**62, 4], "C"],
        ["<f8", [True, 3], "C"],
        ["<f8", [3.0], "C"],
        ["<f8", [3], "A"],
        [[["a", "|O"]], [3], "C"],
        [[["a", "<f8"], ["a", "<f8"]], [3], "C"],
        "<f8",
    ],
    ids=str,
)
def test_an_array_that_was_made_up_is_refused(head: Any) -> None:
    text = json.dumps({"arrays": [head], "value": {"array": 0}}).encode()
    with pytest.raises(CodecError, match=r"^damaged: [^\n]+$"):
        CODEC.decode(struct.pack("<I", len(text)) + text + np.zeros(3).tobytes())


@pytest.mark.parametrize("text", [b"[" * 100_000, b"NaN", b"9" * 5000, b"\xff", b"", b"{}", b"3", b'{"value": 1}'])
def test_text_that_is_no_json_of_ours_is_refused(text: bytes) -> None:
    with pytest.raises(CodecError):
        CODEC.decode(struct.pack("<I", len(text)) + text)


def test_what_cannot_be_kept_is_named() -> None:
    for value, name in ((open, "builtin"), (object(), "object"), (np.array([object()]), "object"), (1j, "complex")):
        with pytest.raises(CodecError, match=f"{name}.* cannot be kept"):
            PLAIN.encode(value)
    with pytest.raises(CodecError, match="Sphere"):
        PLAIN.encode(Sphere(np.zeros(3), 1.0))


@dataclass
class _Hints:
    a: dict[str, tuple[int, ...]] = field(default_factory=dict)


@pytest.mark.parametrize(
    ("value", "hint", "holds"),
    [
        (3, int, True),
        (3.0, int, True),
        (3.5, int, False),
        (True, int, False),
        (3, float, True),
        ("3", float, False),
        (None, float | None, True),
        ((1, "a"), tuple[int, str], True),
        ((1, "a", 2), tuple[int, str], False),
        ((1, 2, 3), tuple[int, ...], True),
        ([1, "a"], list[int], False),
        ({1: [2]}, dict[int, list[int]], True),
        ({1: [2]}, dict[str, list[int]], False),
        ({1}, set[int], True),
        (np.zeros(3), np.ndarray[Any, np.dtype[np.float64]], True),
        (np.zeros(3, int), np.ndarray[Any, np.dtype[np.float64]], False),
        ([0.0], np.ndarray[Any, np.dtype[np.float64]], False),
    ],
)
def test_declared_types_are_checked(value: Any, hint: Any, holds: bool) -> None:
    assert conforms(value, hint) is holds
