"""Values to bytes and back without running code: JSON for structure, raw memory for arrays.

    codec = Codec([Candidate, Match, …])
    same = codec.decode(codec.encode(value))

Supported are None, bool, int, float, str, bytes, list, tuple, dict, set, frozenset, numpy arrays and numbers, and the
types given to the codec. Decoding restores every bit, including NaN and memory order of arrays, and shared objects.
Decoded data is not trusted: fields must have their declared types.

The bytes are the length of the JSON text (uint32, little-endian), the text, and the arrays in order. JSON represents
its own types (a list is a list); other values are objects of one entry: {"tuple": […]}, {"dict": [[key, value], …]},
{"array": 3}, {"Plane": [origin, normal]}, {"same": 7}.
"""

from __future__ import annotations

import hashlib
import json
import math
import struct
import types
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from functools import cache
from typing import Any

import numpy as np

from vpframe.errors import VpframeError

_LENGTH = struct.Struct("<I")
_PLAIN = frozenset(("|b1", "|i1", "|u1", *(f"<{kind}{size}" for kind in "iu" for size in (2, 4, 8)), "<f4", "<f8"))
"""permitted types of arrays and of fields in structured arrays"""
_COLLECTIONS: dict[str, Callable[[Iterable[Any]], Any]] = {"tuple": tuple, "set": set, "frozenset": frozenset}

WRONG = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError)
"""errors that damaged data causes"""


class CodecError(VpframeError):
    """The bytes cannot be decoded, or a value cannot be encoded."""


class Packing(typing.NamedTuple):
    """Conversion of a foreign type to and from a value that the codec supports."""

    pack: Callable[[Any], Any]
    unpack: Callable[[Any], Any]
    """raises ValueError for a value that `pack` never returns"""


class Codec:
    """An encoding for a fixed set of types.

    Parameters
    ----------
    known: dataclasses, identified by their names.
    foreign: other types.
    """

    def __init__(self, known: Iterable[type] = (), foreign: Mapping[type, Packing] | None = None) -> None:
        self._names = {kind: tuple(f.name for f in fields(kind)) for kind in known}
        self._foreign = dict(foreign or {})
        self._types = {kind.__name__: kind for kind in (*self._names, *self._foreign)}

    @property
    def schema(self) -> str:
        """Digest of the fields of all known types; data can only be read with the schema it was written with."""
        known = sorted((kind.__name__, *names) for kind, names in self._names.items())
        return hashlib.sha256(repr(known).encode()).hexdigest()[:16]

    def encode(self, value: Any) -> bytes:
        """Return the value as bytes; CodecError names a type that is not supported."""
        return _Encoder(self._names, self._foreign).bytes(value)

    def decode(self, data: bytes) -> Any:
        """Return the value that `encode` was given; CodecError if `data` is damaged."""
        try:
            return _Decoder(self._types, self._names, self._foreign, data).value()
        except (*WRONG, RecursionError, struct.error) as error:
            what = " ".join(str(error).split())[:120] or type(error).__name__
            raise CodecError(f"damaged: {what}") from None


class _Encoder:
    def __init__(self, names: Mapping[type, Sequence[str]], foreign: Mapping[type, Packing]) -> None:
        self._names = names
        self._foreign = foreign
        self._blocks: list[bytes] = []
        self._heads: list[Any] = []
        self._seen: dict[int, int] = {}
        self._alive: list[Any] = []  # keeps the ids in `_seen` unique

    def bytes(self, value: Any) -> bytes:
        tree = self._of(value)
        head = json.dumps({"arrays": self._heads, "value": tree}, allow_nan=False, separators=(",", ":")).encode()
        return b"".join([_LENGTH.pack(len(head)), head, *self._blocks])

    def _of(self, value: Any) -> Any:
        kind = type(value)
        if value is None or kind in (bool, int, str):
            return value
        if kind is float:
            return value if math.isfinite(value) else {"float": repr(value)}
        if kind is list:
            return [self._of(x) for x in value]
        if kind in (tuple, set, frozenset):
            return {kind.__name__: [self._of(x) for x in (value if kind is tuple else sorted(value))]}
        if kind is dict:
            return {"dict": [[self._of(k), self._of(x)] for k, x in value.items()]}
        if kind is bytes:
            return {"bytes": self._array(np.frombuffer(value, np.uint8))}
        if isinstance(value, np.generic):
            return {"number": self._array(np.asarray(value))}
        if id(value) in self._seen:
            return {"same": self._seen[id(value)]}
        tree: dict[str, Any]
        if kind is np.ndarray:
            tree = {"array": self._array(value)}
        elif kind in self._names:
            tree = {kind.__name__: [self._of(getattr(value, name)) for name in self._names[kind]]}
        elif kind in self._foreign:
            return {kind.__name__: self._of(self._foreign[kind].pack(value))}
        else:
            raise CodecError(f"a {kind.__module__}.{kind.__qualname__} cannot be kept in a file")
        self._seen[id(value)] = len(self._seen)
        self._alive.append(value)
        return tree

    def _array(self, array: np.ndarray[Any, Any]) -> int:
        spec = _spec(array.dtype)
        order = "F" if array.flags.f_contiguous and not array.flags.c_contiguous else "C"
        self._heads.append([spec, list(array.shape), order])
        self._blocks.append(array.tobytes(order))  # type: ignore[arg-type]
        return len(self._heads) - 1


class _Decoder:
    def __init__(
        self,
        types: Mapping[str, type],
        names: Mapping[type, Sequence[str]],
        foreign: Mapping[type, Packing],
        data: bytes,
    ) -> None:
        self._types, self._names, self._foreign = types, names, foreign
        self._objects: list[Any] = []
        (length,) = _LENGTH.unpack(data[: _LENGTH.size])
        self._block = memoryview(data)[_LENGTH.size + length :]
        head = json.loads(data[_LENGTH.size : _LENGTH.size + length], parse_constant=_refused)
        self._tree = head["value"]
        self._heads: list[tuple[np.dtype[Any], tuple[int, ...], str, int]] = []
        end = 0
        for spec, shape, order in head["arrays"]:
            dtype = _dtype(spec)
            if order not in ("C", "F") or not all(type(n) is int and n >= 0 for n in shape):
                raise ValueError(f"an array of shape {shape}, order {order}")
            self._heads.append((dtype, tuple(shape), order, end))
            end += math.prod(shape) * dtype.itemsize
        if end != len(self._block):
            raise ValueError(f"{len(self._block)} bytes of arrays, {end} expected")

    def value(self) -> Any:
        return self._of(self._tree)

    def _of(self, tree: Any) -> Any:
        if isinstance(tree, list):
            return [self._of(x) for x in tree]
        if not isinstance(tree, dict):
            return tree
        ((tag, content),) = tree.items()
        if tag in _COLLECTIONS:
            return _COLLECTIONS[tag](self._of(x) for x in content)
        if tag == "dict":
            return {self._of(k): self._of(x) for k, x in content}
        if tag == "bytes":
            return self._array(content).tobytes()
        if tag == "float":
            return {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}[content]
        if tag == "number":
            return self._array(content)[()]
        if tag == "same":
            return self._objects[content]
        if tag == "array":
            made: Any = self._array(content)
        else:
            kind = self._types[tag]
            if kind in self._foreign:
                return self._foreign[kind].unpack(self._of(content))
            made = _made(kind, self._names[kind], [self._of(x) for x in content])
        self._objects.append(made)
        return made

    def _array(self, number: int) -> np.ndarray[Any, Any]:
        dtype, shape, order, start = self._heads[number]
        flat = np.frombuffer(self._block, dtype, math.prod(shape), start)
        return flat.reshape(shape, order=order).copy(order=order)  # type: ignore[call-overload,no-any-return]


def _made(kind: type, names: Sequence[str], values: Sequence[Any]) -> Any:
    """Construct a dataclass. Where its constructor rounds a field (unit vectors), the given bits are kept."""
    hints = _hints(kind)
    for name, value in zip(names, values, strict=True):
        if not conforms(value, hints[name]):
            raise TypeError(f"{kind.__name__}.{name} is {type(value).__name__}")
    made = kind(*values)
    rounded = False
    for name, value in zip(names, values, strict=True):
        given = getattr(made, name)
        if isinstance(value, np.ndarray) and given is not value:
            if given.shape != value.shape or given.dtype != value.dtype:
                raise ValueError(f"{kind.__name__}.{name} is not what it may be")
            if given.tobytes() != value.tobytes():
                if not np.allclose(given, value):
                    raise ValueError(f"{kind.__name__}.{name} is not what it may be")
                value.flags.writeable = given.flags.writeable
                object.__setattr__(made, name, value)
                rounded = True
    if rounded:  # clears values cached by the constructor
        for derived in vars(made).keys() - names:
            del vars(made)[derived]
    return made


@cache
def _hints(kind: type) -> dict[str, Any]:
    return typing.get_type_hints(kind)


def conforms(value: Any, hint: Any) -> bool:
    """Whether a value has a declared type: a class, a union, `tuple[…]`, `list[…]`, `dict[…]`, an array type."""
    if hint is Any or type(value) is hint:
        return True
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if hint is None or hint is types.NoneType:
        return value is None
    if origin in (typing.Union, types.UnionType):
        return any(conforms(value, other) for other in arguments)
    if origin is np.ndarray:  # NDArray[x]
        wanted = typing.get_args(arguments[1])[0]
        return type(value) is np.ndarray and (wanted is Any or value.dtype == np.dtype(wanted))
    if origin is tuple:
        if len(arguments) == 2 and arguments[1] is Ellipsis:
            return type(value) is tuple and all(conforms(x, arguments[0]) for x in value)
        return type(value) is tuple and len(value) == len(arguments) and all(map(conforms, value, arguments))
    if origin in (list, set, frozenset, Sequence):
        kinds: Any = (list, tuple) if origin is Sequence else origin
        return isinstance(value, kinds) and all(conforms(x, arguments[0]) for x in value)
    if origin in (dict, Mapping):
        key, item = arguments
        return type(value) is dict and all(conforms(k, key) and conforms(x, item) for k, x in value.items())
    if hint is float:
        return isinstance(value, float | int | np.floating | np.integer) and not isinstance(value, bool)
    if hint is int:  # 20.0 teeth are accepted as an integer
        whole = isinstance(value, int | np.integer) or (isinstance(value, float) and value.is_integer())
        return whole and not isinstance(value, bool)
    if hint is bool:
        return isinstance(value, bool | np.bool_)
    return isinstance(value, origin or hint)


@cache
def _spec(dtype: np.dtype[Any]) -> Any:
    """JSON description of an array's dtype."""
    spec: Any = dtype.str if dtype.names is None else [list(field) for field in dtype.descr]
    try:
        known = _dtype(json.loads(json.dumps(spec))) == dtype
    except (TypeError, ValueError):
        known = False
    if not known:
        raise CodecError(f"an array of {dtype} cannot be kept in a file")
    return spec


def _dtype(spec: Any) -> np.dtype[Any]:
    if isinstance(spec, str):
        if spec not in _PLAIN:
            raise ValueError(f"an array of {spec}")
        return np.dtype(spec)
    named = [(name, _dtype(plain), *map(tuple, shape)) for name, plain, *shape in spec]
    return np.dtype(named)


def _refused(constant: str) -> float:
    raise ValueError(f"{constant} is no JSON")
