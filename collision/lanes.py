"""Eight at once: what numba does not vectorise by itself, as LLVM vector operations.

A node is rows of eight float32 in a flat array, as `collision.wide` lays them out. LLVM maps the operations to whatever
the processor has; an empty lane compares false with everything, so its bit is never set.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from collision.wide import LANES

MOTION: Final = 23
"""float32 that describe a motion: rotation by rows (9), its absolute values (9), translation (3), then what boxes are
inflated by, and what differences of vertices are off by at least"""
PREPARED: Final = 21 * LANES
"""float32 of a leaf prepared for the triangle filter: the 9 rows of its corners, least x, y, z, greatest x, y, z,
normals e × f where e = q - p, f = r - p, their products with p, |e| + |f| and |e||f| in sum norms"""

ROOM: Final = 4 * LANES
"""float32 that `clearances` works in"""

_INT = ir.IntType(64)
_FLOAT = ir.FloatType()
_VECTOR = ir.VectorType(_FLOAT, LANES)


class _Lanes:
    """A vector (or a scalar) in the making: arithmetic on it writes instructions."""

    def __init__(self, builder, value):
        self.builder, self.value = builder, value

    def _with(self, operation, other):
        return _Lanes(self.builder, operation(self.value, other.value))

    def __add__(self, other):
        return self._with(self.builder.fadd, other)

    def __sub__(self, other):
        return self._with(self.builder.fsub, other)

    def __mul__(self, other):
        return self._with(self.builder.fmul, other)

    def __le__(self, other):
        return self._with(lambda a, b: self.builder.fcmp_ordered("<=", a, b), other)

    def __gt__(self, other):
        return self._with(lambda a, b: self.builder.fcmp_ordered(">", a, b), other)

    def __and__(self, other):
        return self._with(self.builder.and_, other)

    def __or__(self, other):
        return self._with(self.builder.or_, other)

    def __invert__(self):
        return _Lanes(self.builder, self.builder.not_(self.value))

    def min(self, other):
        return _Lanes(self.builder, self.builder.select((other > self).value, self.value, other.value))

    def max(self, other):
        return _Lanes(self.builder, self.builder.select((self > other).value, self.value, other.value))

    def abs(self):
        return self.max(_Lanes(self.builder, self.builder.fneg(self.value)))

    def splat(self):
        """All lanes this scalar."""
        undefined = ir.Constant(_VECTOR, ir.Undefined)
        first = self.builder.insert_element(undefined, self.value, ir.Constant(ir.IntType(32), 0))
        zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return _Lanes(self.builder, self.builder.shuffle_vector(first, undefined, zeros))

    def bits(self):
        """A vector of truths as an int64, bit k from lane k."""
        return self.builder.zext(self.builder.bitcast(self.value, ir.IntType(LANES)), _INT)


class _Memory:
    """A place in an array of float32, or in one at an address."""

    def __init__(self, context, builder, kind, array, at):
        self.builder = builder
        if isinstance(kind, types.Integer):
            data = builder.inttoptr(array, _FLOAT.as_pointer())
        else:
            data = context.make_array(kind)(context, builder, array).data
        self.base = builder.gep(data, [at])

    def _row(self, i):
        place = self.builder.gep(self.base, [ir.Constant(_INT, LANES * i)])
        return self.builder.bitcast(place, _VECTOR.as_pointer())

    def row(self, i):
        return _Lanes(self.builder, self.builder.load(self._row(i), align=4))

    def store(self, i, lanes):
        self.builder.store(lanes.value, self._row(i), align=4)

    def number(self, i):
        return _Lanes(self.builder, self.builder.load(self.builder.gep(self.base, [ir.Constant(_INT, i)])))


def _constant(builder, x, like=_FLOAT):
    return _Lanes(builder, ir.Constant(like, x if like is _FLOAT else [x] * LANES))


def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _minus(a, b):
    return [x - y for x, y in zip(a, b, strict=True)]


def _near(low, high, other_low, other_high):
    """Bit k is set if boxes k overlap; by one comparison, not six that wait for each other. NaN and inf are apart."""
    gaps = [(low[d] - other_high[d]).max(other_low[d] - high[d]) for d in range(3)]
    gap = gaps[0].max(gaps[1]).max(gaps[2])
    return gap <= _constant(gap.builder, 0.0, _VECTOR)


@intrinsic
def overlapping(typingctx, nodes, at, x0, y0, z0, x1, y1, z1):
    """Bit k is set if box k of the inner node at `nodes[at]` overlaps the closed box x0 … z1 (float32)."""
    signature = types.int64(nodes, types.int64, *(types.float32,) * 6)

    def generate(context, builder, signature, args):
        node = _Memory(context, builder, signature.args[0], args[0], args[1])
        x = [_Lanes(builder, a).splat() for a in args[2:]]
        row = [node.row(i) for i in range(6)]
        return _near(row[:3], row[3:], x[:3], x[3:]).bits()

    return signature, generate


@intrinsic
def overlapping_lane(typingctx, nodes, at, others, lane):
    """The same for the box in one lane of another node, that at `others[lane]`."""
    signature = types.int64(nodes, types.int64, others, types.int64)

    def generate(context, builder, signature, args):
        node = _Memory(context, builder, signature.args[0], args[0], args[1])
        other = _Memory(context, builder, signature.args[2], args[2], args[3])
        row = [node.row(i) for i in range(6)]
        x = [other.number(LANES * i).splat() for i in range(6)]
        return _near(row[:3], row[3:], x[:3], x[3:]).bits()

    return signature, generate


@intrinsic
def move_boxes(typingctx, nodes, at, motion, out, to):
    """Place at `out[to]` an inner node of boxes that hold those of the one at `nodes[at]` moved by `motion`."""
    signature = types.void(nodes, types.int64, motion, out, types.int64)

    def generate(context, builder, signature, args):
        node = _Memory(context, builder, signature.args[0], args[0], args[1])
        m = _Memory(context, builder, signature.args[2], args[2], ir.Constant(_INT, 0))
        target = _Memory(context, builder, signature.args[3], args[3], args[4])
        half = _constant(builder, 0.5, _VECTOR)
        centre = [half * (node.row(d) + node.row(d + 3)) for d in range(3)]
        extent = [half * (node.row(d + 3) - node.row(d)) for d in range(3)]
        for d in range(3):
            c, h = m.number(18 + d).splat(), m.number(21).splat()
            for e in range(3):
                c = c + m.number(3 * d + e).splat() * centre[e]
                h = h + m.number(9 + 3 * d + e).splat() * extent[e]
            target.store(d, c - h)
            target.store(d + 3, c + h)
        return context.get_dummy_value()

    return signature, generate


def _prepare(corner, target):
    """Fill a `PREPARED` leaf from its corners."""
    e, f = _minus(corner[1], corner[0]), _minus(corner[2], corner[0])
    normal = [e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]]
    for i in range(3):
        for d in range(3):
            target.store(3 * i + d, corner[i][d])
    for d in range(3):
        target.store(9 + d, corner[0][d].min(corner[1][d]).min(corner[2][d]))
        target.store(12 + d, corner[0][d].max(corner[1][d]).max(corner[2][d]))
        target.store(15 + d, normal[d])
    me, mf = e[0].abs() + e[1].abs() + e[2].abs(), f[0].abs() + f[1].abs() + f[2].abs()
    target.store(18, _dot(normal, corner[0]))
    target.store(19, me + mf)
    target.store(20, me * mf)


@intrinsic
def prepare_triangles(typingctx, nodes, at, out, to):
    """Place at `out[to]` the prepared form of the leaf at `nodes[at]`."""
    signature = types.void(nodes, types.int64, out, types.int64)

    def generate(context, builder, signature, args):
        node = _Memory(context, builder, signature.args[0], args[0], args[1])
        target = _Memory(context, builder, signature.args[2], args[2], args[3])
        _prepare([[node.row(3 * i + d) for d in range(3)] for i in range(3)], target)
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def turn_triangles(typingctx, nodes, at, motion, out, to):
    """Place at `out[to]` the prepared form of the leaf at `nodes[at]` turned (not shifted) by `motion`."""
    signature = types.void(nodes, types.int64, motion, out, types.int64)

    def generate(context, builder, signature, args):
        node = _Memory(context, builder, signature.args[0], args[0], args[1])
        m = _Memory(context, builder, signature.args[2], args[2], ir.Constant(_INT, 0))
        target = _Memory(context, builder, signature.args[3], args[3], args[4])
        rotation = [m.number(i).splat() for i in range(9)]
        corner = [[node.row(3 * i + d) for d in range(3)] for i in range(3)]
        _prepare([[_dot(rotation[3 * d : 3 * d + 3], x) for d in range(3)] for x in corner], target)
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def reaching(typingctx, leaf, at, x0, y0, z0, x1, y1, z1):
    """Bit k is set if the box of triangle k of the prepared leaf at `leaf[at]` overlaps the closed box x0 … z1."""
    signature = types.int64(leaf, types.int64, *(types.float32,) * 6)

    def generate(context, builder, signature, args):
        node = _Memory(context, builder, signature.args[0], args[0], args[1])
        x = [_Lanes(builder, a).splat() for a in args[2:]]
        return _near([node.row(9 + d) for d in range(3)], [node.row(12 + d) for d in range(3)], x[:3], x[3:]).bits()

    return signature, generate


@intrinsic
def perhaps_meeting(typingctx, leaf, at, other, to, sx, sy, sz, off, kf, kp, k):
    """Bit i is set unless, beyond doubt, triangle i of the prepared leaf at `leaf[at]` and the triangle in the lane at
    `other[to]` of another, shifted by (sx, sy, sz), are apart: by their boxes or by the plane of either.

    `off` bounds the error of every difference of two coordinates, kf·(|e| + |f|) + kp·|e||f| + k that of the
    determinant of two edges e, f and a difference (see `best`).
    """
    signature = types.int64(leaf, types.int64, other, types.int64, *(types.float32,) * 7)

    def generate(context, builder, signature, args):
        node = _Memory(context, builder, signature.args[0], args[0], args[1])
        single = _Memory(context, builder, signature.args[2], args[2], args[3])
        shift = [_Lanes(builder, x) for x in args[4:7]]
        off, kf, kp, k = (_Lanes(builder, x) for x in args[7:])
        low = [(single.number(LANES * (9 + d)) + shift[d] - off).splat() for d in range(3)]
        high = [(single.number(LANES * (12 + d)) + shift[d] + off).splat() for d in range(3)]
        near = _near([node.row(9 + d) for d in range(3)], [node.row(12 + d) for d in range(3)], low, high)
        # corners of all eight against the plane of the one
        normal = [single.number(LANES * (15 + d)) for d in range(3)]
        plane = single.number(LANES * 18) + _dot(normal, shift)
        bound = kf * single.number(LANES * 19) + kp * single.number(LANES * 20) + k
        normal = [x.splat() for x in normal]
        side = [_dot(normal, [node.row(3 * i + d) for d in range(3)]) for i in range(3)]
        apart = (side[0].min(side[1]).min(side[2]) > (plane + bound).splat()) | (
            (plane - bound).splat() > side[0].max(side[1]).max(side[2])
        )
        # corners of the one against the planes of all eight
        normal = [node.row(15 + d) for d in range(3)]
        corner = [[(single.number(LANES * (3 * i + d)) + shift[d]).splat() for d in range(3)] for i in range(3)]
        side = [_dot(normal, x) for x in corner]
        plane = node.row(18)
        bound = kf.splat() * node.row(19) + kp.splat() * node.row(20) + k.splat()
        apart = apart | (side[0].min(side[1]).min(side[2]) > plane + bound)
        apart = apart | (plane - bound > side[0].max(side[1]).max(side[2]))
        return (near & ~apart).bits()

    return signature, generate


@intrinsic
def failing(typingctx, planes, at, motion):
    """Bit i is set unless certificate i of the eight at `planes[at]` holds for `motion`, beyond doubt."""
    signature = types.int64(types.int64, types.int64, types.int64)

    def generate(context, builder, signature, args):
        row = _Memory(context, builder, types.int64, args[0], args[1])
        m = _Memory(context, builder, types.int64, args[2], ir.Constant(_INT, 0))
        n, seen, c = ([row.row(i + d) for d in range(3)] for i in (0, 3, 6))
        u = [_dot(n, [m.number(3 * d + e).splat() for d in range(3)]) for e in range(3)]
        margin = row.row(10) + (_dot(u, c) + _dot(n, [m.number(18 + d).splat() for d in range(3)]))
        turned = _minus(u, seen)
        lost = row.row(9) * row.row(9) * _dot(turned, turned)
        margin = margin - (m.number(21) + m.number(21)).splat()
        holds = (margin > _constant(builder, 0.0, lost.value.type)) & (margin * margin > lost)
        return (~holds).bits()

    return signature, generate


def _across(lanes, pick):
    """The greatest or least (`pick`) of all lanes, in all lanes."""
    for step in (4, 2, 1):
        order = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [(i + step) % LANES for i in range(LANES)])
        other = _Lanes(lanes.builder, lanes.builder.shuffle_vector(lanes.value, lanes.value, order))
        lanes = pick(lanes, other)
    return lanes


@intrinsic
def clearances(typingctx, leaf, at, n_a, other, to, lanes, nx, ny, nz, along, which, room):
    """How far the triangles of the prepared leaf at `other[to]` are from all n_a of that at `leaf[at]`, along n and -n.

    along: n times the shift of the other leaf. In `room` rows are kept of the greatest so far for each triangle and of
    its direction, `which` for n, `which` + 1 for -n; then come the least over the `lanes` (bits), for n and for -n.
    """
    signature = types.void(*(types.int64,) * 6, *(types.float32,) * 5, types.int64)

    def generate(context, builder, signature, args):
        zero = ir.Constant(_INT, 0)
        a, b, kept = (_Memory(context, builder, types.int64, *pair) for pair in (args[:2], args[3:5], (args[11], zero)))
        n = [_Lanes(builder, x).splat() for x in args[6:9]]
        along, which = (_Lanes(builder, x).splat() for x in args[9:11])
        kind = along.value.type

        def least_and_greatest(row, filled):
            p, q, r = (_dot(n, [row.row(3 * i + d) for d in range(3)]) for i in range(3))
            low, high = p.min(q).min(r), p.max(q).max(r)
            infinite = _constant(builder, np.inf, kind)
            minus = _constant(builder, -np.inf, kind)
            return (
                _Lanes(builder, builder.select(filled, low.value, infinite.value)),
                _Lanes(builder, builder.select(filled, high.value, minus.value)),
            )

        numbers = ir.Constant(ir.VectorType(_INT, LANES), list(range(LANES)))
        count = builder.insert_element(ir.Constant(numbers.type, ir.Undefined), args[2], ir.Constant(ir.IntType(32), 0))
        count = builder.shuffle_vector(count, count, ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES))
        low_a, high_a = least_and_greatest(a, builder.icmp_signed("<", numbers, count))
        chosen = builder.bitcast(builder.trunc(args[5], ir.IntType(8)), ir.VectorType(ir.IntType(1), LANES))
        low_b, high_b = least_and_greatest(b, chosen)
        low_a, high_a = _across(low_a, _Lanes.min), _across(high_a, _Lanes.max)
        best, by = kept.row(0), kept.row(1)
        one = _constant(builder, 1.0, kind)
        for i, gap in enumerate((low_b + (along - high_a), low_a - along - high_b)):
            better = (gap > best).value
            best = _Lanes(builder, builder.select(better, gap.value, best.value))
            by = _Lanes(builder, builder.select(better, (which + one if i else which).value, by.value))
            kept.store(2 + i, _across(gap, _Lanes.min))
        kept.store(0, best)
        kept.store(1, by)
        return context.get_dummy_value()

    return signature, generate
