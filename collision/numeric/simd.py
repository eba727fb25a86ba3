"""Eight numbers at once: LLVM vector operations on rows of eight float32, which numba does not write by itself.

A node is six rows (least x, y, z, greatest x, y, z of eight boxes); a packet of triangles is nine (x, y, z of the
corners p, q, r). Both lie in flat arrays and are named by the place of their first number. An empty lane has the box
(inf, -inf) and compares false with everything, so its bit is never set.
"""

from __future__ import annotations

import math
from typing import Final

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

LANES: Final = 8
"""boxes a node, triangles a packet"""
NODE: Final = 6 * LANES
"""float32 a node takes"""
PACKET: Final = 9 * LANES
"""float32 a packet of triangles takes"""
PREPARED: Final = 21 * LANES
"""float32 a prepared packet takes: the nine rows of its corners, least x, y, z, greatest x, y, z, normals e × f where
e = q - p, f = r - p, their products with p, |e| + |f| and |e||f| in sum norms"""
MOTION: Final = 23
"""float32 that describe a motion: rotation by rows (9), its absolute values (9), translation (3), how far boxes are
inflated, and the least error bound of differences of vertices"""

_INT = ir.IntType(64)
_INT32 = ir.IntType(32)
_FLOAT = ir.FloatType()
_VECTOR = ir.VectorType(_FLOAT, LANES)


class _Vector:
    """A vector or a scalar while code is generated: arithmetic on it writes instructions."""

    def __init__(self, builder, value):
        self.builder, self.value = builder, value

    def _with(self, operation, other):
        return _Vector(self.builder, operation(self.value, other.value))

    def __add__(self, other):
        return self._with(self.builder.fadd, other)

    def __sub__(self, other):
        return self._with(self.builder.fsub, other)

    def __mul__(self, other):
        return self._with(self.builder.fmul, other)

    def __truediv__(self, other):
        return self._with(self.builder.fdiv, other)

    def __le__(self, other):
        return self._with(lambda a, b: self.builder.fcmp_ordered("<=", a, b), other)

    def __gt__(self, other):
        return self._with(lambda a, b: self.builder.fcmp_ordered(">", a, b), other)

    def __and__(self, other):
        return self._with(self.builder.and_, other)

    def __or__(self, other):
        return self._with(self.builder.or_, other)

    def __invert__(self):
        return _Vector(self.builder, self.builder.not_(self.value))

    def min(self, other):
        return _Vector(self.builder, self.builder.select((other > self).value, self.value, other.value))

    def max(self, other):
        return _Vector(self.builder, self.builder.select((self > other).value, self.value, other.value))

    def abs(self):
        return self.max(_Vector(self.builder, self.builder.fneg(self.value)))

    def sqrt(self):
        kind = ir.FunctionType(_VECTOR, [_VECTOR])
        function = cgutils.get_or_insert_function(self.builder.module, kind, f"llvm.sqrt.v{LANES}f32")
        return _Vector(self.builder, self.builder.call(function, [self.value]))

    def where(self, yes, no):
        """Lanes of `yes` where this is true, of `no` elsewhere."""
        return _Vector(self.builder, self.builder.select(self.value, yes.value, no.value))

    def splat(self):
        """All lanes this scalar."""
        undefined = ir.Constant(_VECTOR, ir.Undefined)
        first = self.builder.insert_element(undefined, self.value, ir.Constant(_INT32, 0))
        zeros = ir.Constant(ir.VectorType(_INT32, LANES), [0] * LANES)
        return _Vector(self.builder, self.builder.shuffle_vector(first, undefined, zeros))

    def bits(self):
        """A vector of truths as an int64, bit k from lane k."""
        return self.builder.zext(self.builder.bitcast(self.value, ir.IntType(LANES)), _INT)


class _Rows:
    """Rows of eight in an array of float32, from one of its places on."""

    def __init__(self, context, builder, kind, array, at):
        self.builder = builder
        self.base = builder.gep(context.make_array(kind)(context, builder, array).data, [at])

    def _row(self, i):
        place = self.builder.gep(self.base, [ir.Constant(_INT, LANES * i)])
        return self.builder.bitcast(place, _VECTOR.as_pointer())

    def row(self, i):
        return _Vector(self.builder, self.builder.load(self._row(i), align=4))

    def store(self, i, vector):
        self.builder.store(vector.value, self._row(i), align=4)

    def number(self, i):
        return _Vector(self.builder, self.builder.load(self.builder.gep(self.base, [ir.Constant(_INT, i)])))


def _constant(builder, x, like=_VECTOR):
    return _Vector(builder, ir.Constant(like, x if like is _FLOAT else [x] * LANES))


def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _minus(a, b):
    return [x - y for x, y in zip(a, b, strict=True)]


def _separation(low, high, other_low, other_high):
    """Rows d: how far the boxes are apart along each axis, negative where they overlap."""
    return [(low[d] - other_high[d]).max(other_low[d] - high[d]) for d in range(3)]


def _overlap(low, high, other_low, other_high):
    """Truths: which boxes overlap, by one comparison, not six that wait for each other. NaN and inf are apart."""
    gap = _separation(low, high, other_low, other_high)
    gap = gap[0].max(gap[1]).max(gap[2])
    return gap <= _constant(gap.builder, 0.0)


@intrinsic
def lowest(typingctx, bits):
    """The place of the lowest set bit."""
    signature = types.int64(types.int64)

    def generate(context, builder, signature, args):
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return signature, generate


@intrinsic
def overlapping(typingctx, nodes, at, x0, y0, z0, x1, y1, z1):
    """Bit k is set if box k of the node at `nodes[at]` overlaps the closed box x0 … z1 (float32)."""
    signature = types.int64(nodes, types.int64, *(types.float32,) * 6)

    def generate(context, builder, signature, args):
        node = _Rows(context, builder, signature.args[0], args[0], args[1])
        x = [_Vector(builder, a).splat() for a in args[2:]]
        row = [node.row(i) for i in range(6)]
        return _overlap(row[:3], row[3:], x[:3], x[3:]).bits()

    return signature, generate


def _node_and_lane(context, builder, signature, args):
    """The rows of a node, and those of one lane of another in all lanes."""
    node = _Rows(context, builder, signature.args[0], args[0], args[1])
    other = _Rows(context, builder, signature.args[2], args[2], args[3])
    return [node.row(i) for i in range(6)], [other.number(LANES * i).splat() for i in range(6)]


@intrinsic
def overlapping_lane(typingctx, nodes, at, others, lane):
    """Bit k is set if box k of the node at `nodes[at]` overlaps the box in the lane at `others[lane]`."""
    signature = types.int64(nodes, types.int64, others, types.int64)

    def generate(context, builder, signature, args):
        row, x = _node_and_lane(context, builder, signature, args)
        return _overlap(row[:3], row[3:], x[:3], x[3:]).bits()

    return signature, generate


@intrinsic
def near_lane(typingctx, nodes, at, others, lane, limit, out):
    """Place in `out[:8]` the squared distances of the boxes of a node from the box in a lane of another node.

    Bit k is set if the k-th is at most `limit`. Rounded down by more than their own rounding (7 operations of float32).
    """
    signature = types.int64(nodes, types.int64, others, types.int64, types.float32, out)

    def generate(context, builder, signature, args):
        row, x = _node_and_lane(context, builder, signature, args)
        zero = _constant(builder, 0.0)  # first: a NaN, of an empty lane that was moved, must stay one
        gap = [zero.max(g) for g in _separation(row[:3], row[3:], x[:3], x[3:])]
        square = _dot(gap, gap) * _constant(builder, 1.0 - 2.0**-20)
        _Rows(context, builder, signature.args[5], args[5], ir.Constant(_INT, 0)).store(0, square)
        return (square <= _Vector(builder, args[4]).splat()).bits()

    return signature, generate


@intrinsic
def signed_lane(typingctx, nodes, at, others, lane, limit, out):
    """Place in `out[:8]` lower bounds of the signed distances of the boxes of a node from the box in a lane of another:
    their distance, or where they overlap minus the least way along an axis that parts them.

    Bit k is set if the k-th is at most `limit`. Rounded down by more than their own rounding (7 operations of float32).
    """
    signature = types.int64(nodes, types.int64, others, types.int64, types.float32, out)

    def generate(context, builder, signature, args):
        row, x = _node_and_lane(context, builder, signature, args)
        zero = _constant(builder, 0.0)
        apart = _separation(row[:3], row[3:], x[:3], x[3:])
        deepest = apart[0].max(apart[1]).max(apart[2])  # (inf, -inf) moved is NaN, and NaN + anything is NaN
        gap = [zero.max(g) for g in apart]
        far = _dot(gap, gap).sqrt()
        signed = (deepest > zero).where(far, deepest) + (apart[0] + apart[1] + apart[2]) * zero
        signed = signed - signed.abs() * _constant(builder, 2.0**-20)
        _Rows(context, builder, signature.args[5], args[5], ir.Constant(_INT, 0)).store(0, signed)
        return (signed <= _Vector(builder, args[4]).splat()).bits()

    return signature, generate


RATES: Final = 23
"""float32 that bound how fast boxes of b come nearer to boxes of a: places 0–2 and 3–5, velocity and angular
velocity of b against a, about a's centre; 6–8 and 9–11, those of b's own motion; 12, 13 and 14, their angular speeds
and a's; 15–17 and 18–20, what the speed and b's own speed add to the acceleration along each axis; 21, what b's own
speed adds to it along any direction; 22, the error bound of speeds"""


def _time_above(gap, speed, growth):
    """The greatest time with speed·t + growth·t²/2 <= gap, for gap > 0 and growth >= 0; rounded down."""
    two = _constant(gap.builder, 2.0)
    root = (speed * speed + two * growth * gap).sqrt()
    closing = speed > _constant(gap.builder, 0.0)
    return closing.where(two * gap / (speed + root), (root - speed) / growth) * _constant(gap.builder, 1.0 - 2.0**-18)


def _times_apart(builder, a, b, rate, aim):
    """Times for which boxes a and b, six rows each, surely stay `aim` apart if they are farther apart, or overlap by
    less; else 0. See `collision.triangle.motion`."""
    zero, half = _constant(builder, 0.0), _constant(builder, 0.5)
    more = _constant(builder, 1.0 + 2.0**-18)
    middle = [half * (b[d] + b[d + 3]) for d in range(3)]
    extent = [half * (b[d + 3] - b[d]) for d in range(3)]
    radius = _dot(extent, extent).sqrt()
    turn, own_turn, turn_a, slack = rate[12], rate[13], rate[14], rate[22]
    velocity = [x + y for x, y in zip(rate[:3], _cross(rate[3:6], middle), strict=True)]
    own = [x + y for x, y in zip(rate[6:9], _cross(rate[9:12], middle), strict=True)]
    pace = (_dot(own, own).sqrt() + own_turn * radius) * more + slack
    fastest = (_dot(velocity, velocity).sqrt() + turn * radius) * more + slack
    ever = (fastest + turn * pace) * more
    time, square = zero, zero
    for d in range(3):
        e, f = (d + 1) % 3, (d + 2) % 3
        ahead, behind = b[d] - a[d + 3], a[d] - b[d + 3]
        gap = ahead.max(behind)
        gap = gap - gap.abs() * _constant(builder, 2.0**-22)
        spread = (rate[3 + e].abs() * extent[f] + rate[3 + f].abs() * extent[e]) * more + slack
        closing = (ahead > behind).where(zero - velocity[d], velocity[d]) + spread
        growth = (rate[15 + d] * ever + rate[18 + d] * pace) * more
        time = _longer(gap > aim, _time_above(gap - aim, closing, growth), time)
        gap = zero.max(gap)
        square = square + gap * gap
    distance = square.sqrt() * _constant(builder, 1.0 - 2.0**-20)
    growth = (turn_a * ever + rate[21] * pace) * more
    return _longer(distance > zero.max(aim), _time_above(distance - aim, fastest, growth), time)


def _longer(condition, time, before):
    """The longer of two times where the condition holds; what is not a number is no certificate."""
    return (condition & (time > before)).where(time, before)


def _apart_lane(moving):
    @intrinsic
    def code(typingctx, nodes, at, others, lane, rates, aim, until, out):
        """Place in `out[:8]` times for which the boxes of a node, at `nodes[at]`, and the box in a lane of another, at
        `others[lane]`, surely stay `aim` (m) apart; 0 where they are no farther apart. Bit k is set unless that of the
        k-th is at least `until`. rates: see `RATES`."""
        signature = types.int64(nodes, types.int64, others, types.int64, rates, *(types.float32,) * 2, out)

        def generate(context, builder, signature, args):
            row, x = _node_and_lane(context, builder, signature, args)
            rates = _Rows(context, builder, signature.args[4], args[4], ir.Constant(_INT, 0))
            rate = [rates.number(i).splat() for i in range(RATES)]
            aim, until = (_Vector(builder, y).splat() for y in args[5:7])
            time = _times_apart(builder, *((x, row) if moving else (row, x)), rate, aim)
            _Rows(context, builder, signature.args[7], args[7], ir.Constant(_INT, 0)).store(0, time)
            there = _constant(builder, 3e38) > row[0]  # neither inf nor NaN: no empty lane
            return (there & ~(until <= time)).bits()

        return signature, generate

    return code


TERMS: Final = 10
"""float32 of `perhaps_nearing`: shift of the single triangle (3), velocity of b against a about the packet's centre
(3), error bound of distances, bound of the acceleration, aim, until"""


@intrinsic
def perhaps_nearing(typingctx, packets, at, other, to, rates, terms):
    """Bit i is set unless triangle i of the prepared packet of a at `packets[at]` and one other triangle, of b, that in
    the lane at `other[to]` of another prepared packet, shifted, surely stay `aim` apart until `until`.

    The certificates are separating directions: the axes and the two normals. Along a direction all corners of the
    triangle of b count as near as the nearest, and as fast as the fastest of them. See `collision.triangle.motion`.
    """
    signature = types.int64(packets, types.int64, other, types.int64, rates, terms)

    def generate(context, builder, signature, args):
        node = _Rows(context, builder, signature.args[0], args[0], args[1])
        single = _Rows(context, builder, signature.args[2], args[2], args[3])
        rates = _Rows(context, builder, signature.args[4], args[4], ir.Constant(_INT, 0))
        terms = _Rows(context, builder, signature.args[5], args[5], ir.Constant(_INT, 0))
        term = [terms.number(i) for i in range(TERMS)]
        turn, slack = [rates.number(3 + d) for d in range(3)], rates.number(22).splat()
        error, growth, aim, until = (x.splat() for x in term[6:])
        zero, more = _constant(builder, 0.0), _constant(builder, 2.0**-18)
        bend = _constant(builder, 0.5) * growth * until * until
        bend, aim = bend + bend * more, aim + aim.abs() * _constant(builder, 2.0**-20)
        corner = [[single.number(LANES * (3 * i + d)) + term[d] for d in range(3)] for i in range(3)]
        speed = [[x + y for x, y in zip(term[3:6], _cross(turn, c), strict=True)] for c in corner]
        corner, speed = ([[x.splat() for x in c] for c in y] for y in (corner, speed))

        def held(low, high, there, speeds, length):
            ahead, behind = _least(there) - high, low - _greatest(there)
            gap = ahead.max(behind)
            way = (ahead > behind).where(zero - _least(speeds), _greatest(speeds)) * until
            way = way + way.abs() * more + (slack * until + bend) * length
            # it is convex over time and 0 at first, so less than the room at all times if it is so at the last
            return gap - gap.abs() * more - (error + aim) * length > zero.max(way)

        perhaps = _constant(builder, 3e38) > node.row(9)
        for d in range(3):
            there, speeds = [c[d] for c in corner], [v[d] for v in speed]
            perhaps = perhaps & ~held(node.row(9 + d), node.row(12 + d), there, speeds, _constant(builder, 1.0))
        before, bits = builder.block, perhaps.bits()
        with builder.if_then(builder.icmp_unsigned("!=", bits, ir.Constant(_INT, 0))):
            of_a = [[node.row(3 * i + d) for d in range(3)] for i in range(3)]
            other_normal = [single.number(LANES * (15 + d)).splat() for d in range(3)]
            for n in ([node.row(15 + d) for d in range(3)], other_normal):
                square = _dot(n, n)
                here, there, speeds = ([_dot(n, x) for x in y] for y in (of_a, corner, speed))
                known = square > _constant(builder, 1e-30)
                perhaps = perhaps & ~(known & held(_least(here), _greatest(here), there, speeds, square.sqrt()))
            after, rest = builder.block, perhaps.bits()
        result = builder.phi(_INT)
        result.add_incoming(bits, before)
        result.add_incoming(rest, after)
        return result

    return signature, generate


apart_lane_a, apart_lane_b = _apart_lane(False), _apart_lane(True)


@intrinsic
def point_lane(typingctx, packets, at, scale, x, y, z, slack, out):
    """Place in `out[:8]` lower bounds of the distances of a point from the triangles of the packet at `packets[at]`.

    The packet and the point, both about the packet's centre, are scaled by `scale`, so that the edges of the packet's
    box have the sum 1; distances are scaled too. `slack`: how far these may be off, at least 64·2^-24 of 1 and of the
    point. An empty lane has NaN.

    Where the foot of the point on the triangle's plane is surely beyond an edge, the nearest point is on an edge; else
    the distance from the plane is taken, which is never more than that from the triangle.
    """
    signature = types.void(packets, types.int64, *(types.float32,) * 5, out)

    def generate(context, builder, signature, args):
        packet = _Rows(context, builder, signature.args[0], args[0], args[1])
        scale = _Vector(builder, args[2]).splat()
        point = [_Vector(builder, x).splat() for x in args[3:6]]
        zero, one = _constant(builder, 0.0), _constant(builder, 1.0)
        corner = [[scale * packet.row(3 * i + d) for d in range(3)] for i in range(3)]
        to = [_minus(point, c) for c in corner]
        edge = [_minus(corner[1], corner[0]), _minus(corner[2], corner[1]), _minus(corner[0], corner[2])]
        normal = _cross(edge[0], edge[1])
        sides = [e[0].abs() + e[1].abs() + e[2].abs() for e in edge]
        length = sides[0] + sides[1] + sides[2]
        reach = to[0][0].abs() + to[0][1].abs() + to[0][2].abs() + length
        error = _constant(builder, 2.0**-18) * length * length * reach
        beyonds, squares = [], []
        for k in range(3):
            beyonds.append(zero > _dot(_cross(normal, edge[k]), to[k]) + error)
            along = (_dot(to[k], edge[k]) / _dot(edge[k], edge[k])).max(zero)
            along = (one > along).where(along, one)
            off = [to[k][d] - along * edge[k][d] for d in range(3)]
            squares.append(_dot(off, off))
        beyond, least = beyonds[0] | beyonds[1] | beyonds[2], squares[0].min(squares[1]).min(squares[2])
        height = zero.max(_dot(normal, to[0]).abs() - _constant(builder, 2.0**-19) * length * reach)
        height = height / (_dot(normal, normal).sqrt() + _constant(builder, 2.0**-20) * length)
        distance = beyond.where(least.sqrt(), height) - _Vector(builder, args[6]).splat()
        target = _Rows(context, builder, signature.args[7], args[7], ir.Constant(_INT, 0))
        target.store(0, zero.max(distance) + corner[0][0] * zero)
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def move_boxes(typingctx, nodes, at, motion, out, to):
    """Place at `out[to]` a node of boxes that hold those of the one at `nodes[at]` moved by `motion`."""
    signature = types.void(nodes, types.int64, motion, out, types.int64)

    def generate(context, builder, signature, args):
        node = _Rows(context, builder, signature.args[0], args[0], args[1])
        m = _Rows(context, builder, signature.args[2], args[2], ir.Constant(_INT, 0))
        target = _Rows(context, builder, signature.args[3], args[3], args[4])
        half = _constant(builder, 0.5)
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


def _cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _prepare(corner, target):
    """Fill a `PREPARED` packet from its corners."""
    e, f = _minus(corner[1], corner[0]), _minus(corner[2], corner[0])
    normal = _cross(e, f)
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
def prepare_triangles(typingctx, packets, at, out, to):
    """Place at `out[to]` the prepared form of the packet at `packets[at]`."""
    signature = types.void(packets, types.int64, out, types.int64)

    def generate(context, builder, signature, args):
        packet = _Rows(context, builder, signature.args[0], args[0], args[1])
        target = _Rows(context, builder, signature.args[2], args[2], args[3])
        _prepare([[packet.row(3 * i + d) for d in range(3)] for i in range(3)], target)
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def turn_triangles(typingctx, packets, at, motion, out, to):
    """Place at `out[to]` the prepared form of the packet at `packets[at]` turned (not shifted) by `motion`."""
    signature = types.void(packets, types.int64, motion, out, types.int64)

    def generate(context, builder, signature, args):
        packet = _Rows(context, builder, signature.args[0], args[0], args[1])
        m = _Rows(context, builder, signature.args[2], args[2], ir.Constant(_INT, 0))
        target = _Rows(context, builder, signature.args[3], args[3], args[4])
        rotation = [m.number(i).splat() for i in range(9)]
        corner = [[packet.row(3 * i + d) for d in range(3)] for i in range(3)]
        _prepare([[_dot(rotation[3 * d : 3 * d + 3], x) for d in range(3)] for x in corner], target)
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def reaching(typingctx, packets, at, x0, y0, z0, x1, y1, z1):
    """Bit k is set if the box of triangle k of the prepared packet at `packets[at]` overlaps the closed box x0 … z1."""
    signature = types.int64(packets, types.int64, *(types.float32,) * 6)

    def generate(context, builder, signature, args):
        packet = _Rows(context, builder, signature.args[0], args[0], args[1])
        x = [_Vector(builder, a).splat() for a in args[2:]]
        low, high = [packet.row(9 + d) for d in range(3)], [packet.row(12 + d) for d in range(3)]
        return _overlap(low, high, x[:3], x[3:]).bits()

    return signature, generate


@intrinsic
def perhaps_meeting(typingctx, packets, at, other, to, shift, errors):
    """Bit i is set unless triangle i of the prepared packet at `packets[at]` is certainly apart from one other
    triangle, that in the lane at `other[to]` of another prepared packet, shifted by (x, y, z) float32: by boxes or by
    either's plane.

    errors: (off, kf, kp, k) float32. `off` bounds the error of every difference of two coordinates,
    kf·(|e| + |f|) + kp·|e||f| + k that of the determinant of two edges e, f and a difference (see
    `collision.bvh.traverse.packet_errors`).
    """
    signature = types.int64(packets, types.int64, other, types.int64, shift, errors)

    def generate(context, builder, signature, args):
        node = _Rows(context, builder, signature.args[0], args[0], args[1])
        single = _Rows(context, builder, signature.args[2], args[2], args[3])
        shift = [_Vector(builder, builder.extract_value(args[4], d)) for d in range(3)]
        off, kf, kp, k = (_Vector(builder, builder.extract_value(args[5], i)) for i in range(4))
        low = [(single.number(LANES * (9 + d)) + shift[d] - off).splat() for d in range(3)]
        high = [(single.number(LANES * (12 + d)) + shift[d] + off).splat() for d in range(3)]
        near = _overlap([node.row(9 + d) for d in range(3)], [node.row(12 + d) for d in range(3)], low, high)
        # corners of all eight against the plane of the single one
        normal = [single.number(LANES * (15 + d)) for d in range(3)]
        plane = single.number(LANES * 18) + _dot(normal, shift)
        bound = kf * single.number(LANES * 19) + kp * single.number(LANES * 20) + k
        normal = [x.splat() for x in normal]
        side = [_dot(normal, [node.row(3 * i + d) for d in range(3)]) for i in range(3)]
        apart = (side[0].min(side[1]).min(side[2]) > (plane + bound).splat()) | (
            (plane - bound).splat() > side[0].max(side[1]).max(side[2])
        )
        # corners of the single one against the planes of all eight
        normal = [node.row(15 + d) for d in range(3)]
        corner = [[(single.number(LANES * (3 * i + d)) + shift[d]).splat() for d in range(3)] for i in range(3)]
        side = [_dot(normal, x) for x in corner]
        plane = node.row(18)
        bound = kf.splat() * node.row(19) + kp.splat() * node.row(20) + k.splat()
        apart = apart | (side[0].min(side[1]).min(side[2]) > plane + bound)
        apart = apart | (plane - bound > side[0].max(side[1]).max(side[2]))
        return (near & ~apart).bits()

    return signature, generate


def _pairs_of_triangles(context, builder, signature, args):
    """Boxes and corners of eight triangles; those of one other, shifted, in all lanes; the normals of both."""
    node = _Rows(context, builder, signature.args[0], args[0], args[1])
    single = _Rows(context, builder, signature.args[2], args[2], args[3])
    shift = [_Vector(builder, builder.extract_value(args[4], d)).splat() for d in range(3)]

    def of_both(row):
        return [node.row(row + d) for d in range(3)], [single.number(LANES * (row + d)).splat() for d in range(3)]

    corners = [of_both(3 * i) for i in range(3)]
    boxes = [of_both(9), of_both(12)]
    here, there = [mine for mine, _ in corners], [[x + s for x, s in zip(c, shift, strict=True)] for _, c in corners]
    low, high = ([x + s for x, s in zip(box, shift, strict=True)] for _, box in boxes)
    return [box for box, _ in boxes], (low, high), here, there, of_both(15)


def _least(x):
    return x[0].min(x[1]).min(x[2])


def _greatest(x):
    return x[0].max(x[1]).max(x[2])


def _gap_along(direction, here, there, error):
    """Lower bounds of how far triangles are apart along a direction of any length, negative where they overlap; -inf
    where the direction is too short, or too long, to be known."""
    square = _dot(direction, direction)
    builder = square.builder
    one, low, high = _constant(builder, 1.0), _constant(builder, 1e-30), _constant(builder, 1e37)
    scale = one / square.sqrt()
    n = [scale * x for x in direction]
    ours, theirs = [_dot(n, c) for c in here], [_dot(n, c) for c in there]
    gap = (_least(theirs) - _greatest(ours)).max(_least(ours) - _greatest(theirs)) - error
    return ((square > low) & (high > square)).where(gap, _constant(builder, -math.inf))


def _kept(builder, bound, limit, out):
    """Store bounds, rounded down by more than the lengths of the directions are off; bits of those within a limit."""
    bound = bound - bound.abs() * _constant(builder, 2.0**-18)
    out.store(0, bound)
    return (bound <= limit).bits()


@intrinsic
def triangles_near(typingctx, packets, at, other, to, shift, off, direction, limit, out):
    """Place in `out[:8]` lower bounds of the signed distances of the triangles of the prepared packet at `packets[at]`
    from one other triangle, that in the lane at `other[to]` of another prepared packet, shifted: their distance, or
    where they meet minus the shortest translation that parts them. Bit i is set if the i-th is at most `limit`.

    shift, direction: (x, y, z) float32. The bounds are the separations of the boxes, along either's normal, and along
    the direction (of any length). Whatever a direction is made of, what is separated along it is as far apart. Along a
    unit vector the separation is off by less than 4·off, `off` bounding the error of a difference of two coordinates.
    """
    signature = types.int64(
        packets, types.int64, other, types.int64, shift, types.float32, direction, types.float32, out
    )

    def generate(context, builder, signature, args):
        (low, high), (other_low, other_high), here, there, normals = _pairs_of_triangles(
            context, builder, signature, args
        )
        off, limit = (_Vector(builder, x).splat() for x in (args[5], args[7]))
        zero, error = _constant(builder, 0.0), _constant(builder, 4.0) * off
        gap = [g - off for g in _separation(low, high, other_low, other_high)]
        beyond = [zero.max(g) for g in gap]
        deepest = _greatest(gap)
        bound = (deepest > zero).where(_dot(beyond, beyond).sqrt(), deepest)
        given = [_Vector(builder, builder.extract_value(args[6], d)).splat() for d in range(3)]
        for n in (*normals, given):
            gap = _gap_along(n, here, there, error)
            bound = (gap > bound).where(gap, bound)  # an empty lane keeps inf
        out = _Rows(context, builder, signature.args[8], args[8], ir.Constant(_INT, 0))
        return _kept(builder, bound, limit, out)

    return signature, generate


def _between_edges(here, there):
    """Rows d: from the nearest point of the edges of one triangle to that of the edges of another, or near it.

    Ericson, *Real-Time Collision Detection*, 2005, 5.1.9, for all nine pairs of edges.
    """
    builder = here[0][0].builder
    zero, one, best = _constant(builder, 0.0), _constant(builder, 1.0), _constant(builder, math.inf)
    nearest = [zero, zero, zero]

    def within(x):
        return x.max(zero).min(one)

    ours, theirs = ([(c[i], _minus(c[(i + 1) % 3], c[i])) for i in range(3)] for c in (here, there))
    lengths = [_dot(v, v) for _, v in theirs]
    for p, u in ours:
        uu = _dot(u, u)
        for (q, v), vv in zip(theirs, lengths, strict=True):
            r = _minus(p, q)
            c, f, b = _dot(u, r), _dot(v, r), _dot(u, v)
            s = within((b * f - c * vv) / (uu * vv - b * b))
            t = within((b * s + f) / vv)
            s = within((b * t - c) / uu)
            w = [r[d] + s * u[d] - t * v[d] for d in range(3)]
            square = _dot(w, w)
            closer = best > square
            best, nearest = square.min(best), [closer.where(x, y) for x, y in zip(w, nearest, strict=True)]
    return nearest


def _by_edges(directions):
    @intrinsic
    def code(typingctx, packets, at, other, to, shift, off, limit, out):
        """Raise the bounds in `out[:8]` (see `triangles_near`) by what edges tell; the same bits.

        For triangles that are apart, along the way from the nearest edge to the nearest edge; for such as meet, along
        the common normals of edges."""
        signature = types.int64(packets, types.int64, other, types.int64, shift, types.float32, types.float32, out)

        def generate(context, builder, signature, args):
            *_, here, there, _ = _pairs_of_triangles(context, builder, signature, args)
            off, limit = (_Vector(builder, x).splat() for x in args[5:7])
            out = _Rows(context, builder, signature.args[7], args[7], ir.Constant(_INT, 0))
            bound, error = out.row(0), _constant(builder, 4.0) * off
            for n in directions(here, there):
                gap = _gap_along(n, here, there, error)
                bound = (gap > bound).where(gap, bound)
            return _kept(builder, bound, limit, out)

        return signature, generate

    return code


def _common_normals(here, there):
    ours, theirs = ([_minus(c[(i + 1) % 3], c[i]) for i in range(3)] for c in (here, there))
    return [_cross(u, v) for u in ours for v in theirs]


edges_near = _by_edges(lambda here, there: [_between_edges(here, there)])
edges_cross = _by_edges(_common_normals)
