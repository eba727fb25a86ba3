"""Numbers at addresses. The fast query is given two tables of addresses in place of some thirty arrays.

Handing numba an array costs 40 ns a call, and every signed index into one a check for wrapping around. Whoever fills a
table keeps the arrays alive, C-contiguous and where they are.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array


def _place(context: Any, builder: Any, kind: Any, args: Any) -> Any:
    base = builder.inttoptr(args[0], context.get_value_type(kind).as_pointer())
    return builder.gep(base, [args[1]])


def _reader(kind: Any) -> Any:
    @intrinsic
    def read(typingctx, address, i):
        def generate(context, builder, signature, args):
            return builder.load(_place(context, builder, kind, args))

        return kind(types.int64, types.int64), generate

    return read


def _writer(kind: Any) -> Any:
    @intrinsic
    def write(typingctx, address, i, x):
        def generate(context, builder, signature, args):
            builder.store(args[2], _place(context, builder, kind, args))
            return context.get_dummy_value()

        return types.void(types.int64, types.int64, kind), generate

    return write


f32, f64, i32, i64 = (_reader(kind) for kind in (types.float32, types.float64, types.int32, types.int64))
"""The i-th number of the array at an address"""
put_f32, put_f64, put_i32, put_i64 = (
    _writer(kind) for kind in (types.float32, types.float64, types.int32, types.int64)
)
"""Set the i-th number of the array at an address"""


@intrinsic
def doubles(typingctx, address, n):
    """The n float64 at an address as an array, which owns nothing."""
    kind = types.Array(types.float64, 1, "C")

    def generate(context, builder, signature, args):
        array = context.make_array(kind)(context, builder)
        data = builder.inttoptr(args[0], array.data.type)
        size = ir.Constant(ir.IntType(64), 8)
        populate_array(array, data=data, shape=[args[1]], strides=[size], itemsize=size, meminfo=None)
        return array._getvalue()

    return kind(types.int64, types.int64), generate


@intrinsic
def lowest(typingctx, bits):
    """The place of the lowest set bit."""
    signature = types.int64(types.int64)

    def generate(context, builder, signature, args):
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return signature, generate
