"""Vector operations on rows of eight float32, written as LLVM instructions because numba does not write them by itself.

A node is six rows (least x, y, z, greatest x, y, z of eight boxes); a packet of triangles is nine (x, y, z of the
corners p, q, r). Both lie in flat arrays and are named by the place of their first number. An empty lane has the box
(inf, -inf) and compares false with everything, so its bit is never set.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from inspect import Parameter, Signature
from typing import Any, Final

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
"""float32 that describe a motion: rotation by rows (9), its absolute values (9), translation (3), inflation of boxes,
least error bound of differences of vertices"""
RATES: Final = 23
"""float32 that bound how fast boxes of b come nearer to boxes of a: places 0–2 and 3–5, velocity and angular
velocity of b against a, about a's centre; 6–8 and 9–11, those of b's own motion; 12, 13 and 14, their angular speeds
and a's; 15–17 and 18–20, what the speed and b's own speed add to the acceleration along each axis; 21, what b's own
speed adds to it along any direction; 22, the error bound of speeds"""
TERMS: Final = 10
"""float32 of `perhaps_nearing`: shift of the single triangle (3), velocity of b against a about the packet's centre
(3), error bound of distances, bound of the acceleration, aim, until"""

_INT = ir.IntType(64)
_INT32 = ir.IntType(32)
_VECTOR = ir.VectorType(ir.FloatType(), LANES)


class _Vector:
    """A vector or a scalar while code is generated: arithmetic on it, and on float constants, writes instructions."""

    def __init__(self, builder, value):
        self.builder, self.value = builder, value

    def constant(self, x):
        """x as a vector or scalar like this one."""
        kind = self.value.type
        return _Vector(self.builder, ir.Constant(kind, [x] * LANES if kind == _VECTOR else x))

    def _with(self, operation, other, reverse=False):
        other = other if isinstance(other, _Vector) else self.constant(other)
        left, right = (other, self) if reverse else (self, other)
        return _Vector(self.builder, operation(left.value, right.value))

    def _compare(self, sign, other):
        return self._with(lambda a, b: self.builder.fcmp_ordered(sign, a, b), other)

    def __add__(self, other):
        return self._with(self.builder.fadd, other)

    def __sub__(self, other):
        return self._with(self.builder.fsub, other)

    def __rsub__(self, other):
        return self._with(self.builder.fsub, other, reverse=True)

    def __mul__(self, other):
        return self._with(self.builder.fmul, other)

    __rmul__ = __mul__

    def __truediv__(self, other):
        return self._with(self.builder.fdiv, other)

    def __rtruediv__(self, other):
        return self._with(self.builder.fdiv, other, reverse=True)

    def __le__(self, other):
        return self._compare("<=", other)

    def __lt__(self, other):
        return self._compare("<", other)

    def __gt__(self, other):
        return self._compare(">", other)

    def __and__(self, other):
        return self._with(self.builder.and_, other)

    def __or__(self, other):
        return self._with(self.builder.or_, other)

    def __invert__(self):
        return _Vector(self.builder, self.builder.not_(self.value))

    def min(self, other):
        """The lesser; `other` where this is NaN."""
        return (self < other).where(self, other)

    def max(self, other):
        """The greater; `other` where this is NaN."""
        return (self > other).where(self, other)

    def positive(self):
        """The greater of this and 0; NaN where this is NaN."""
        return (self < 0.0).where(0.0, self)

    def abs(self):
        return self.max(_Vector(self.builder, self.builder.fneg(self.value)))

    def sqrt(self):
        kind = ir.FunctionType(_VECTOR, [_VECTOR])
        function = cgutils.get_or_insert_function(self.builder.module, kind, f"llvm.sqrt.v{LANES}f32")
        return _Vector(self.builder, self.builder.call(function, [self.value]))

    def where(self, yes, no):
        """Lanes of `yes` where this is true, of `no` elsewhere; one of the two may be a float."""
        like = yes if isinstance(yes, _Vector) else no
        yes, no = (x if isinstance(x, _Vector) else like.constant(x) for x in (yes, no))
        return _Vector(self.builder, self.builder.select(self.value, yes.value, no.value))

    def splat(self):
        """This scalar in all lanes."""
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

    def xyz(self, i):
        """Rows i, i + 1, i + 2."""
        return [self.row(i + d) for d in range(3)]

    def corners(self):
        """Rows (x, y, z) of the corners p, q, r of a packet."""
        return [self.xyz(3 * i) for i in range(3)]

    def store(self, i, vector):
        self.builder.store(vector.value, self._row(i), align=4)

    def number(self, i):
        """The scalar at place i."""
        return _Vector(self.builder, self.builder.load(self.builder.gep(self.base, [ir.Constant(_INT, i)])))

    def lane(self, i):
        """Scalars of the rows i, i + 1, i + 2 in the lane at which these rows begin."""
        return [self.number(LANES * (i + d)) for d in range(3)]


def _operation(arguments: str, returns: Any = types.int64) -> Callable[[Callable[..., Any]], Any]:
    """Declare a function that writes instructions as one that kernels call with these arguments; a decorator.

    A kernel passes an array of float32 and, unless the rows begin at 0, the place of their first number: the function
    gets `_Rows`. It gets a float32 as a vector with that number in all lanes, a tuple of float32 as scalars.
    """

    def declare(write):
        def code(typingctx, *given):
            def generate(context, builder, signature, args):
                rest, values = list(zip(signature.args, args, strict=True)), list[Any]()
                while rest:
                    kind, value = rest.pop(0)
                    if isinstance(kind, types.Array):
                        at = rest.pop(0)[1] if rest and isinstance(rest[0][0], types.Integer) else ir.Constant(_INT, 0)
                        values.append(_Rows(context, builder, kind, value, at))
                    elif isinstance(kind, types.BaseTuple):
                        values.append([_Vector(builder, builder.extract_value(value, i)) for i in range(len(kind))])
                    else:
                        values.append(_Vector(builder, value).splat() if isinstance(kind, types.Float) else value)
                result = write(builder, *values)
                return context.get_dummy_value() if result is None else result

            return returns(*map(_passed, given)), generate

        names = [Parameter(name, Parameter.POSITIONAL_OR_KEYWORD) for name in ("typingctx", *arguments.split())]
        code.__name__, code.__doc__ = write.__name__, write.__doc__
        code.__signature__ = Signature(names)  # type: ignore[attr-defined]
        return intrinsic(code)

    return declare


def _passed(kind):
    """The type as which a value is passed: float32 for a float, int64 for an integer."""
    if isinstance(kind, types.Float):
        return types.float32
    return types.int64 if isinstance(kind, types.Integer) else kind


def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _plus(a, b):
    return [x + y for x, y in zip(a, b, strict=True)]


def _minus(a, b):
    return [x - y for x, y in zip(a, b, strict=True)]


def _cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _sum_norm(a):
    return a[0].abs() + a[1].abs() + a[2].abs()


def _least(x):
    return x[0].min(x[1]).min(x[2])


def _greatest(x):
    return x[0].max(x[1]).max(x[2])


def _splat(x):
    return [number.splat() for number in x]


def _edges(corners):
    """Edges p q, q r, r p of triangles."""
    return [_minus(corners[(i + 1) % 3], corners[i]) for i in range(3)]


def _separation(low, high, other_low, other_high):
    """Rows d: signed gap of the boxes along each axis, negative where they overlap."""
    return [(low[d] - other_high[d]).max(other_low[d] - high[d]) for d in range(3)]


def _overlap(low, high, other_low, other_high):
    """Truths: which boxes overlap, by one comparison, not six that wait for each other. NaN and inf are apart."""
    return _greatest(_separation(low, high, other_low, other_high)) <= 0.0


@_operation("bits")
def lowest(builder, bits):
    """The place of the lowest set bit."""
    return builder.cttz(bits, ir.Constant(ir.IntType(1), 1))


@_operation("nodes at x0 y0 z0 x1 y1 z1")
def overlapping(builder, node, *box):
    """Bit k is set if box k of a node overlaps the closed box x0, y0, z0, x1, y1, z1 (float32)."""
    return _overlap(node.xyz(0), node.xyz(3), box[:3], box[3:]).bits()


@_operation("nodes at others lane")
def overlapping_lane(builder, node, other):
    """Bit k is set if box k of a node overlaps the box in one lane of another node."""
    return _overlap(node.xyz(0), node.xyz(3), _splat(other.lane(0)), _splat(other.lane(3))).bits()


@_operation("nodes at others lane limit out")
def near_lane(builder, node, other, limit, out):
    """Place in `out[:8]` the squared distances of the boxes of a node from the box in a lane of another node.

    Bit k is set if the k-th is at most `limit`. Rounded down by more than their own rounding (7 operations of float32).
    """
    gap = _separation(node.xyz(0), node.xyz(3), _splat(other.lane(0)), _splat(other.lane(3)))
    beyond = [g.positive() for g in gap]  # a NaN, of an empty lane that was moved, stays one
    square = _dot(beyond, beyond) * (1.0 - 2.0**-20)
    out.store(0, square)
    return (square <= limit).bits()


@_operation("nodes at others lane limit out")
def signed_lane(builder, node, other, limit, out):
    """Place in `out[:8]` lower bounds of the signed distances of the boxes of a node from the box in a lane of another:
    their distance, or where they overlap minus the shortest translation along an axis that separates them.

    Bit k is set if the k-th is at most `limit`. Rounded down by more than their own rounding (7 operations of float32).
    """
    apart = _separation(node.xyz(0), node.xyz(3), _splat(other.lane(0)), _splat(other.lane(3)))
    deepest = _greatest(apart)  # (inf, -inf) moved is NaN, and NaN + anything is NaN
    beyond = [g.positive() for g in apart]
    signed = (deepest > 0.0).where(_dot(beyond, beyond).sqrt(), deepest) + (apart[0] + apart[1] + apart[2]) * 0.0
    signed = signed - signed.abs() * 2.0**-20
    out.store(0, signed)
    return (signed <= limit).bits()


def _time_above(gap, speed, growth):
    """The greatest time with speed·t + growth·t²/2 <= gap, for gap > 0 and growth >= 0; rounded down."""
    root = (speed * speed + 2.0 * growth * gap).sqrt()
    return (speed > 0.0).where(2.0 * gap / (speed + root), (root - speed) / growth) * (1.0 - 2.0**-18)


def _times_apart(a, b, rate, aim):
    """Times for which boxes a and b, six rows each, surely stay `aim` apart if they are farther apart, or overlap by
    less; else 0. See `collision.triangle.motion`."""
    more = 1.0 + 2.0**-18
    middle = [0.5 * (b[d] + b[d + 3]) for d in range(3)]
    extent = [0.5 * (b[d + 3] - b[d]) for d in range(3)]
    radius = _dot(extent, extent).sqrt()
    turn, own_turn, turn_a, slack = rate[12], rate[13], rate[14], rate[22]
    velocity = _plus(rate[:3], _cross(rate[3:6], middle))
    own = _plus(rate[6:9], _cross(rate[9:12], middle))
    pace = (_dot(own, own).sqrt() + own_turn * radius) * more + slack
    fastest = (_dot(velocity, velocity).sqrt() + turn * radius) * more + slack
    ever = (fastest + turn * pace) * more
    time = square = radius.constant(0.0)
    for d in range(3):
        e, f = (d + 1) % 3, (d + 2) % 3
        ahead, behind = b[d] - a[d + 3], a[d] - b[d + 3]
        gap = ahead.max(behind)
        gap = gap - gap.abs() * 2.0**-22
        spread = (rate[3 + e].abs() * extent[f] + rate[3 + f].abs() * extent[e]) * more + slack
        closing = (ahead > behind).where(0.0 - velocity[d], velocity[d]) + spread
        growth = (rate[15 + d] * ever + rate[18 + d] * pace) * more
        time = _longer(gap > aim, _time_above(gap - aim, closing, growth), time)
        gap = gap.positive()
        square = square + gap * gap
    distance = square.sqrt() * (1.0 - 2.0**-20)
    growth = (turn_a * ever + rate[21] * pace) * more
    return _longer(distance > aim.positive(), _time_above(distance - aim, fastest, growth), time)


def _longer(condition, time, before):
    """The longer of two times where the condition holds; what is not a number is no certificate."""
    return (condition & (time > before)).where(time, before)


def _apart_lane(moving):
    def apart_lane(builder, node, other, rates, aim, until, out):
        """Place in `out[:8]` times for which the boxes of a node and the box in a lane of another surely stay `aim` (m)
        apart; 0 where they are no farther apart. Bit k is set unless that of the k-th is at least `until`. rates: see
        `RATES`."""
        boxes = node.xyz(0) + node.xyz(3)
        box = _splat(other.lane(0) + other.lane(3))
        rate = _splat([rates.number(i) for i in range(RATES)])
        time = _times_apart(*((box, boxes) if moving else (boxes, box)), rate, aim)
        out.store(0, time)
        there = boxes[0] < 3e38  # neither inf nor NaN: no empty lane
        return (there & ~(until <= time)).bits()

    return _operation("nodes at others lane rates aim until out")(apart_lane)


apart_lane_a, apart_lane_b = _apart_lane(False), _apart_lane(True)


@_operation("packets at others lane rates terms")
def perhaps_nearing(builder, node, single, rates, terms):
    """Bit i is set unless triangle i of a prepared packet of a and one triangle of b, in a lane of another prepared
    packet, shifted, surely stay `aim` apart until `until`.

    The certificates are separating directions: the axes and the two normals. Along a direction all corners of the
    triangle of b count as near as the nearest, and as fast as the fastest of them. See `collision.triangle.motion`.
    """
    term = [terms.number(i) for i in range(TERMS)]
    turn, slack = [rates.number(3 + d) for d in range(3)], rates.number(22).splat()
    error, growth, aim, until = _splat(term[6:])
    more = 2.0**-18
    bend = 0.5 * growth * until * until
    bend, aim = bend + bend * more, aim + aim.abs() * 2.0**-20
    corner = [_plus(single.lane(3 * i), term[:3]) for i in range(3)]
    speed = [_splat(_plus(term[3:6], _cross(turn, c))) for c in corner]
    corner = [_splat(c) for c in corner]

    def held(low, high, there, speeds, length):
        ahead, behind = _least(there) - high, low - _greatest(there)
        gap = ahead.max(behind)
        way = (ahead > behind).where(0.0 - _least(speeds), _greatest(speeds)) * until
        way = way + way.abs() * more + (slack * until + bend) * length
        # convex over time and 0 at first: below the room at all times if it is so at the last
        return gap - gap.abs() * more - (error + aim) * length > way.positive()

    perhaps = node.row(9) < 3e38
    for d in range(3):
        there, speeds = [c[d] for c in corner], [v[d] for v in speed]
        perhaps = perhaps & ~held(node.row(9 + d), node.row(12 + d), there, speeds, aim.constant(1.0))
    before, bits = builder.block, perhaps.bits()
    with builder.if_then(builder.icmp_unsigned("!=", bits, ir.Constant(_INT, 0))):
        of_a = node.corners()
        for n in (node.xyz(15), _splat(single.lane(15))):
            square = _dot(n, n)
            here, there, speeds = ([_dot(n, x) for x in y] for y in (of_a, corner, speed))
            known = square > 1e-30
            perhaps = perhaps & ~(known & held(_least(here), _greatest(here), there, speeds, square.sqrt()))
        after, rest = builder.block, perhaps.bits()
    result = builder.phi(_INT)
    result.add_incoming(bits, before)
    result.add_incoming(rest, after)
    return result


@_operation("packets at scale x y z slack out", types.void)
def point_lane(builder, packet, scale, x, y, z, slack, out):
    """Place in `out[:8]` lower bounds of the distances of a point from the triangles of a packet.

    The packet and the point, both about the packet's centre, are scaled by `scale`, so that the edges of the packet's
    box have the sum 1; distances are scaled too. `slack`: error bound of these, at least 64·2^-24 of 1 and of the
    point. An empty lane has NaN.

    Where the foot of the point on the triangle's plane is surely beyond an edge, the nearest point is on an edge; else
    the distance from the plane is taken, which is never more than that from the triangle.
    """
    corner = [[scale * x for x in c] for c in packet.corners()]
    to, edge = [_minus((x, y, z), c) for c in corner], _edges(corner)
    normal = _cross(edge[0], edge[1])
    sides = [_sum_norm(e) for e in edge]
    length = sides[0] + sides[1] + sides[2]
    reach = _sum_norm(to[0]) + length
    error = 2.0**-18 * length * length * reach
    beyonds, squares = [], []
    for k in range(3):
        beyonds.append(_dot(_cross(normal, edge[k]), to[k]) + error < 0.0)
        along = (_dot(to[k], edge[k]) / _dot(edge[k], edge[k])).max(0.0).min(1.0)
        off = [to[k][d] - along * edge[k][d] for d in range(3)]
        squares.append(_dot(off, off))
    height = (_dot(normal, to[0]).abs() - 2.0**-19 * length * reach).positive()
    height = height / (_dot(normal, normal).sqrt() + 2.0**-20 * length)
    distance = (beyonds[0] | beyonds[1] | beyonds[2]).where(_least(squares).sqrt(), height) - slack
    out.store(0, distance.positive() + corner[0][0] * 0.0)


@_operation("nodes at motion out to", types.void)
def move_boxes(builder, node, motion, out):
    """Place in `out` a node of boxes that hold those of another node moved by `motion` (see `MOTION`)."""
    low, high = node.xyz(0), node.xyz(3)
    centre = [0.5 * (x + y) for x, y in zip(low, high, strict=True)]
    extent = [0.5 * (y - x) for x, y in zip(low, high, strict=True)]
    for d in range(3):
        c, h = motion.number(18 + d).splat(), motion.number(21).splat()
        for e in range(3):
            c = c + motion.number(3 * d + e).splat() * centre[e]
            h = h + motion.number(9 + 3 * d + e).splat() * extent[e]
        out.store(d, c - h)
        out.store(d + 3, c + h)


def _prepare(corner, out):
    """Fill a `PREPARED` packet from its corners."""
    e, f = _minus(corner[1], corner[0]), _minus(corner[2], corner[0])
    normal = _cross(e, f)
    me, mf = _sum_norm(e), _sum_norm(f)
    across = list(zip(*corner, strict=True))
    rows = *corner[0], *corner[1], *corner[2], *map(_least, across), *map(_greatest, across), *normal
    for i, row in enumerate((*rows, _dot(normal, corner[0]), me + mf, me * mf)):
        out.store(i, row)


@_operation("packets at out to", types.void)
def prepare_triangles(builder, packet, out):
    """Place in `out` the prepared form of a packet."""
    _prepare(packet.corners(), out)


@_operation("packets at motion out to", types.void)
def turn_triangles(builder, packet, motion, out):
    """Place in `out` the prepared form of a packet turned (not shifted) by `motion`."""
    rotation = _splat([motion.number(i) for i in range(9)])
    _prepare([[_dot(rotation[3 * d : 3 * d + 3], x) for d in range(3)] for x in packet.corners()], out)


@_operation("packets at x0 y0 z0 x1 y1 z1")
def reaching(builder, packet, *box):
    """Bit k is set if the box of triangle k of a prepared packet overlaps the closed box x0, y0, z0, x1, y1, z1."""
    return _overlap(packet.xyz(9), packet.xyz(12), box[:3], box[3:]).bits()


@_operation("packets at others lane shift errors")
def perhaps_meeting(builder, node, single, shift, errors):
    """Bit i is set unless triangle i of a prepared packet is certainly apart from one other triangle, in a lane of
    another prepared packet, shifted by (x, y, z) float32: by boxes or by either's plane.

    errors: (off, kf, kp, k) float32. `off` bounds the error of every difference of two coordinates,
    kf·(|e| + |f|) + kp·|e||f| + k that of the determinant of two edges e, f and a difference (see
    `collision.bvh.traverse.packet_errors`).
    """
    off, kf, kp, k = errors
    low = _splat(x - off for x in _plus(single.lane(9), shift))
    high = _splat(x + off for x in _plus(single.lane(12), shift))
    near = _overlap(node.xyz(9), node.xyz(12), low, high)
    # corners of all eight against the plane of the single one
    normal = single.lane(15)
    plane = single.number(LANES * 18) + _dot(normal, shift)
    bound = kf * single.number(LANES * 19) + kp * single.number(LANES * 20) + k
    normal = _splat(normal)
    side = [_dot(normal, c) for c in node.corners()]
    apart = (_least(side) > (plane + bound).splat()) | ((plane - bound).splat() > _greatest(side))
    # corners of the single one against the planes of all eight
    side = [_dot(node.xyz(15), _splat(_plus(single.lane(3 * i), shift))) for i in range(3)]
    plane = node.row(18)
    bound = kf.splat() * node.row(19) + kp.splat() * node.row(20) + k.splat()
    apart = apart | (_least(side) > plane + bound) | (plane - bound > _greatest(side))
    return (near & ~apart).bits()


def _corners_of_both(node, single, shift):
    """Corners of eight triangles; those of one other, shifted, in all lanes."""
    return node.corners(), [_plus(_splat(single.lane(3 * i)), _splat(shift)) for i in range(3)]


def _gap_along(direction, here, there, error):
    """Lower bounds of the gaps between triangles along a direction of any length, negative where they overlap; -inf
    where the direction is too short, or too long, to be known."""
    square = _dot(direction, direction)
    scale = 1.0 / square.sqrt()
    n = [scale * x for x in direction]
    ours, theirs = [_dot(n, c) for c in here], [_dot(n, c) for c in there]
    gap = (_least(theirs) - _greatest(ours)).max(_least(ours) - _greatest(theirs)) - error
    return ((square > 1e-30) & (square < 1e37)).where(gap, -math.inf)


def _raised(bound, directions, here, there, off):
    """Bounds raised by the separations along directions; an empty lane keeps inf."""
    for n in directions:
        gap = _gap_along(n, here, there, 4.0 * off)
        bound = (gap > bound).where(gap, bound)
    return bound


def _kept(bound, limit, out):
    """Store bounds, rounded down by more than the lengths of the directions are off; bits of those within a limit."""
    bound = bound - bound.abs() * 2.0**-18
    out.store(0, bound)
    return (bound <= limit).bits()


@_operation("packets at others lane shift off direction limit out")
def triangles_near(builder, node, single, shift, off, direction, limit, out):
    """Place in `out[:8]` lower bounds of the signed distances of the triangles of a prepared packet from one other
    triangle, in a lane of another prepared packet, shifted: their distance, or where they meet minus the shortest
    translation that separates them. Bit i is set if the i-th is at most `limit`.

    shift, direction: (x, y, z) float32. The bounds are the separations of the boxes, along either's normal, and along
    the direction (of any length): a separation along any direction is a lower bound. Along a unit vector it is off by
    less than 4·off, `off` bounding the error of a difference of two coordinates.
    """
    here, there = _corners_of_both(node, single, shift)
    low, high = (_plus(_splat(single.lane(i)), _splat(shift)) for i in (9, 12))
    gap = [g - off for g in _separation(node.xyz(9), node.xyz(12), low, high)]
    beyond, deepest = [g.positive() for g in gap], _greatest(gap)
    bound = (deepest > 0.0).where(_dot(beyond, beyond).sqrt(), deepest)
    directions = node.xyz(15), _splat(single.lane(15)), _splat(direction)
    return _kept(_raised(bound, directions, here, there, off), limit, out)


def _between_edges(here, there):
    """Rows d: the vector between the nearest points of the edges of two triangles, or near it.

    Ericson, *Real-Time Collision Detection*, 2005, 5.1.9, for all nine pairs of edges.
    """
    best = here[0][0].constant(math.inf)
    nearest = [best.constant(0.0)] * 3
    theirs = [(q, v, _dot(v, v)) for q, v in zip(there, _edges(there), strict=True)]
    for p, u in zip(here, _edges(here), strict=True):
        uu = _dot(u, u)
        for q, v, vv in theirs:
            r = _minus(p, q)
            c, f, b = _dot(u, r), _dot(v, r), _dot(u, v)
            s = ((b * f - c * vv) / (uu * vv - b * b)).max(0.0).min(1.0)
            t = ((b * s + f) / vv).max(0.0).min(1.0)
            s = ((b * t - c) / uu).max(0.0).min(1.0)
            w = [r[d] + s * u[d] - t * v[d] for d in range(3)]
            square = _dot(w, w)
            closer = square < best
            best, nearest = square.min(best), [closer.where(x, y) for x, y in zip(w, nearest, strict=True)]
    return nearest


@_operation("packets at others lane shift off limit out")
def edges_near(builder, node, single, shift, off, limit, out):
    """Raise the bounds in `out[:8]` (see `triangles_near`) for triangles that are apart; the same bits.

    The direction is that between their nearest edges.
    """
    here, there = _corners_of_both(node, single, shift)
    return _kept(_raised(out.row(0), [_between_edges(here, there)], here, there, off), limit, out)


@_operation("packets at others lane shift off limit out")
def edges_cross(builder, node, single, shift, off, limit, out):
    """Raise the bounds in `out[:8]` (see `triangles_near`) for triangles that meet; the same bits.

    The directions are the common normals of their edges.
    """
    here, there = _corners_of_both(node, single, shift)
    normals = [_cross(u, v) for u in _edges(here) for v in _edges(there)]
    return _kept(_raised(out.row(0), normals, here, there, off), limit, out)
