"""Traversal of two hierarchies: one walk for all queries, each of which is a task given to it.

A task is a NamedTuple of the limits of a query and of arrays for its results. Its operations are methods of its class,
resolved when the kernel that uses it is compiled (numba's `overload`):

- `is_bottom(self, bvh, lane)`: whether a box is not opened further; by default, whether a packet is below it;
- `children(self, ws, boxes, at, others, at_other)`: the node bound. Bit k of the result is set if the k-th of eight
  boxes and the other box may contain a result; it may write a lower bound of the distance, depth or time to
  `ws.bounds[k]`. A task that treats the two hierarchies differently has instead `children_of_a(self, a, b, ws, node,
  lane_b)` and `children_of_b(self, a, b, ws, lane_a, node)`;
- `visit(self, a, b, ws, lane_a, lane_b)`: the leaf visit, for two boxes that are both at the bottom. True ends the
  walk;
- `is_open(self, ws, bound)`: whether a pair with this bound may still contain a result when it is popped.

`walk` traverses depth first; `walk_nearest` does so too and opens the child of least bound first. Nodes of b are moved
into a's frame once per query, when they are first visited; their boxes are inflated by more than the rounding of
float32 here and of the float64 vertices in the exact tests. So every bound is conservative.
"""

from __future__ import annotations

import threading
from typing import Any, Final, NamedTuple

import numpy as np
from numba.extending import overload

from collision.bvh.layout import LANES, NODE, PREPARED, Bvh
from collision.bvh.single import below_packets_alone
from collision.numeric.kernel import inline_kernel, inner_kernel
from collision.numeric.predicates import FALLBACKS, WORKSPACE
from collision.numeric.rigid_transforms import rotate, transform
from collision.numeric.simd import MOTION, lowest, move_boxes, near_lane, prepare_triangles, reaching, turn_triangles

INLINE: Final[Any] = {"nogil": True, "_nrt": False, "error_model": "numpy", "forceinline": True}
STACK: Final = 64 * 24
"""capacity of the stack of pairs of boxes: up to eight at each level of either tree"""


class Pose(NamedTuple):
    """The pose of b in a's frame, prepared by `start`."""

    matrix: Any
    """(15,) float64: rotation by rows, translation; then the translation that takes boxes about b's centre to boxes
    about a's"""
    motion: Any
    """(23,) float32: the same for `numeric.simd.move_boxes`"""


class QueryWorkspace(NamedTuple):
    """Arrays that the queries of one thread write to; never part of a result. See `workspace`."""

    pose: Pose
    moved: Any
    """(48 nodes of b,) float32: boxes of b in a's frame"""
    turned: Any
    """(168 packets of b,) float32: prepared packets of b, turned"""
    prepared: Any
    """(168 packets of a,) float32: prepared packets of a"""
    fresh_nodes: Any
    """(nodes of b,) int64: number of the query in which each node was last moved"""
    fresh_b: Any
    """(packets of b,) int64: number of the query in which each packet was last turned"""
    fresh_a: Any
    """(packets of a,) int64: number of the query in which each packet was last prepared"""
    stack: Any
    """int64: pairs of lanes"""
    keys: Any
    """float32: bounds of the pairs on the stack"""
    bounds: Any
    """(74,) float32: bounds of the children of a node, of 64 pairs of triangles, and `NearestTriangles.limit`"""
    floats: Any
    """(11,) float64: `NearestTriangles.best`"""
    pairs: Any
    """int64: pairs of surfaces, surface of a · surfaces of b + surface of b"""
    rows: Any
    """(as many, 4) int32: object, surface, object, surface"""
    counts: Any
    """(7,) int64: see the places below"""
    exact: Any
    """(1024,) float64 of the exact predicates"""


OBJECT_PAIRS, SURFACE_BOXES, TRIANGLE_BOXES, TRIANGLES, QUESTION, FOUND, MET = range(7)
"""places in `QueryWorkspace.counts`: the first four fields of `Statistics`; the number of the query; of the pairs of
surfaces found; the triangles that `Intersect` found"""


def new_workspace(nodes: int, packets: int, pairs: int, before: QueryWorkspace | None = None) -> QueryWorkspace:
    """Return a workspace for these numbers of nodes and packets per mesh, and of pairs of surfaces.

    before: an earlier workspace, whose counts are continued.
    """
    counts, exact = (np.zeros(7, np.int64), np.zeros(WORKSPACE)) if before is None else (before.counts, before.exact)
    return QueryWorkspace(
        Pose(np.empty(15), np.empty(MOTION, np.float32)),
        moved=np.empty(NODE * nodes, np.float32),
        turned=np.empty(PREPARED * packets, np.float32),
        prepared=np.empty(PREPARED * packets, np.float32),
        fresh_nodes=np.zeros(nodes, np.int64),
        fresh_b=np.zeros(packets, np.int64),
        fresh_a=np.zeros(packets, np.int64),
        stack=np.empty(STACK, np.int64),
        keys=np.empty(STACK, np.float32),
        bounds=np.empty(9 * LANES + 2, np.float32),
        floats=np.empty(11),
        pairs=np.empty(pairs, np.int64),
        rows=np.empty((pairs, 4), np.int32),
        counts=counts,
        exact=exact,
    )


def large_enough(ws: QueryWorkspace | None, nodes: int = 1, packets: int = 1, pairs: int = 64) -> QueryWorkspace:
    """Return the given workspace, or a larger one if it is too small."""
    if ws is None:
        return new_workspace(nodes, packets, pairs)
    has = len(ws.fresh_nodes), len(ws.fresh_a), len(ws.pairs)
    if nodes > has[0] or packets > has[1] or pairs > has[2]:
        return new_workspace(max(nodes, has[0]), max(packets, has[1]), max(pairs, has[2]), ws)
    return ws


class _Local(threading.local):
    workspace: QueryWorkspace | None = None


_local = _Local()


def workspace(nodes: int = 1, packets: int = 1, pairs: int = 64) -> QueryWorkspace:
    """Return this thread's workspace, enlarged to these sizes if need be."""
    ws = _local.workspace = large_enough(_local.workspace, nodes, packets, pairs)
    return ws


def workspace_for(a: Bvh, b: Bvh) -> QueryWorkspace:
    """Return this thread's workspace, large enough for two hierarchies."""
    return workspace(max(len(a.child), len(b.child)) // LANES, max(len(a.first), len(b.first)) - 1)


def counts_of(ws: QueryWorkspace) -> tuple[int, ...]:
    """Return the five counts of `Statistics`, of all queries of a thread so far."""
    return (*ws.counts[:4].tolist(), int(ws.exact[FALLBACKS]))


# --- the operations of a task ----------------------------------------------------------------------------------------


def is_bottom(task, bvh, lane):
    """Whether the box in a lane is not opened."""


def children(task, ws, boxes, at, others, at_other):
    """Bits: which of the eight boxes at `at` may contain a result with the box at `at_other`, in a's frame."""


def children_of_a(task, a, b, ws, node, lane_b):
    """Bits: which boxes of a node of a may contain a result with a box of b."""


def children_of_b(task, a, b, ws, lane_a, node):
    """Bits: which boxes of a moved node of b may contain a result with a box of a."""


def visit(task, a, b, ws, lane_a, lane_b):
    """Test two boxes at the bottom; True ends the walk."""


def is_open(task, ws, bound):
    """Whether a pair with this bound may still contain a result."""


def below_packets(task, bvh, lane):
    """Whether a box has packets of triangles below it."""
    return bvh.child[lane] < 0


def pairs_with_a(task, a, b, ws, node, lane_b):
    """`children_of_a` by `children`."""
    return children(task, ws, a.boxes, NODE * node, ws.moved, box_at(lane_b))


def pairs_with_b(task, a, b, ws, lane_a, node):
    """`children_of_b` by `children`."""
    return children(task, ws, ws.moved, NODE * node, a.boxes, box_at(lane_a))


def no_children(task, a, b, ws, lane_a, node):
    """`children_of_b` of a task for one hierarchy: never called, since the single box is at the bottom."""
    return 0


_OF_TWO = {"is_bottom": below_packets, "children_of_a": pairs_with_a, "children_of_b": pairs_with_b}
_OF_ONE = {"is_bottom": below_packets_alone, "children_of_b": no_children}
"""default operations; a task with neither `children` nor `children_of_b` is one for a single hierarchy"""


def _operation(stub: Any) -> None:
    """Compile calls of an operation as calls of the method of that name of the task's class."""

    def choose(task, *rest):
        known = getattr(task, "instance_class", None)
        of_two = hasattr(known, "children") or hasattr(known, "children_of_b")
        return getattr(known, stub.__name__, (_OF_TWO if of_two else _OF_ONE).get(stub.__name__))

    overload(stub, jit_options=INLINE, strict=False)(choose)


for _stub in (is_bottom, children, children_of_a, children_of_b, visit, is_open):
    _operation(_stub)


# --- the traversal ---------------------------------------------------------------------------------------------------


@inline_kernel
def box_at(lane):
    """The place in `boxes` of the first number of the box in a lane."""
    return NODE * (lane >> 3) + (lane & 7)


@inline_kernel
def fresh_node(b, ws, node):
    """Move a node of b into a's frame, unless this query has done so."""
    question = ws.counts[QUESTION]
    if ws.fresh_nodes[node] != question:
        ws.fresh_nodes[node] = question
        move_boxes(b.boxes, NODE * node, ws.pose.motion, ws.moved, NODE * node)


@inline_kernel
def open_pair(task, a, b, ws, lane_a, lane_b, bottom_a, bottom_b):
    """Open the larger box of a pair that is not at the bottom: (bits of its children, first child pair, stride)."""
    if bottom_b or (not bottom_a and a.size[lane_a] >= b.size[lane_b]):
        node = np.int64(a.child[lane_a])
        return children_of_a(task, a, b, ws, node, lane_b), (node << 35) | lane_b, 1 << 32
    node = np.int64(b.child[lane_b])
    fresh_node(b, ws, node)
    return children_of_b(task, a, b, ws, lane_a, node), (lane_a << 32) | (node << 3), 1


@inline_kernel
def walk(task, a, b, ws, lane_a, lane_b):
    """Visit the pairs at the bottom below two boxes, depth first; return whether a visit ended the walk."""
    stack = ws.stack
    stack[0] = (np.int64(lane_a) << 32) | lane_b
    depth = 1
    while depth > 0:
        depth -= 1
        pair = stack[depth]
        lane_a, lane_b = pair >> 32, pair & 0xFFFFFFFF
        bottom_a, bottom_b = is_bottom(task, a, lane_a), is_bottom(task, b, lane_b)
        if bottom_a and bottom_b:
            if visit(task, a, b, ws, lane_a, lane_b):
                return True
            continue
        bits, first, step = open_pair(task, a, b, ws, lane_a, lane_b, bottom_a, bottom_b)
        while bits != 0:
            stack[depth] = first + step * lowest(bits)
            depth += 1
            bits &= bits - 1
    return False


@inline_kernel
def walk_nearest(task, a, b, ws, lane_a, lane_b, bound):
    """`walk` that opens the child of least bound first and skips pairs that are no longer open.

    bound: of the first pair.
    """
    stack, keys, bounds = ws.stack, ws.keys, ws.bounds
    stack[0], keys[0] = (np.int64(lane_a) << 32) | lane_b, bound
    depth = 1
    while depth > 0:
        depth -= 1
        if not is_open(task, ws, keys[depth]):
            continue
        pair = stack[depth]
        lane_a, lane_b = pair >> 32, pair & 0xFFFFFFFF
        bottom_a, bottom_b = is_bottom(task, a, lane_a), is_bottom(task, b, lane_b)
        if bottom_a and bottom_b:
            if visit(task, a, b, ws, lane_a, lane_b):
                return True
            continue
        bits, first, step = open_pair(task, a, b, ws, lane_a, lane_b, bottom_a, bottom_b)
        bottom = depth
        while bits != 0:
            k = lowest(bits)
            bits &= bits - 1
            key, i = bounds[k], depth
            while i > bottom and keys[i - 1] < key:
                stack[i], keys[i] = stack[i - 1], keys[i - 1]
                i -= 1
            stack[i], keys[i] = first + step * k, key
            depth += 1
    return False


# --- the start of a query --------------------------------------------------------------------------------------------


@inner_kernel
def prepare_motion(pose, frame_a, frame_b):
    """Fill `pose.motion`, and the last three numbers of `pose.matrix`, from the first twelve of `pose.matrix`."""
    matrix, motion = pose.matrix, pose.motion
    size = 0.0
    for d in range(3):
        shift = matrix[9 + d] - frame_a[d]
        for e in range(3):
            r = matrix[3 * d + e]
            shift += r * frame_b[e]
            motion[3 * d + e] = r
            motion[9 + 3 * d + e] = abs(r)
        matrix[12 + d] = shift
        motion[18 + d] = shift
        size += abs(shift) + frame_a[3 + d] + 2.0 * frame_b[3 + d]
    # at most 16 roundings of float32 in a box, and 32 of float64 in a vertex
    reach = abs(matrix[9]) + abs(matrix[10]) + abs(matrix[11])
    place = 32.0 * 2.0**-53 * (reach + 2.0 * frame_a[6] + 4.0 * frame_b[6])
    motion[21] = 16.0 * 2.0**-24 * size + place + 1e-30
    motion[22] = 4.0 * place + 1e-30


@inline_kernel
def start(a, b, ws):
    """Start a query of a and b at the pose in `ws.pose.matrix[:12]`: number it, move the box of b."""
    ws.counts[QUESTION] += 1
    ws.counts[OBJECT_PAIRS] += 1
    prepare_motion(ws.pose, a.frame, b.frame)
    move_boxes(b.boxes, 0, ws.pose.motion, ws.moved, 0)
    ws.fresh_nodes[0] = ws.counts[QUESTION]


@inline_kernel
def fresh_packets(a, b, ws, p, q):
    """Prepare packet p of a and turn packet q of b, unless this query has done so."""
    question = ws.counts[QUESTION]
    if ws.fresh_a[p] != question:
        ws.fresh_a[p] = question
        prepare_triangles(a.packets, 72 * p, ws.prepared, PREPARED * p)
    if ws.fresh_b[q] != question:
        ws.fresh_b[q] = question
        turn_triangles(b.packets, 72 * q, ws.pose.motion, ws.turned, PREPARED * q)


@inline_kernel
def middle_and_half(boxes, at):
    """(middle, half edges), each (x, y, z) float64, m, of the box whose first number is `boxes[at]`."""
    x0, x1 = np.float64(boxes[at]), np.float64(boxes[at + 3 * LANES])
    y0, y1 = np.float64(boxes[at + LANES]), np.float64(boxes[at + 4 * LANES])
    z0, z1 = np.float64(boxes[at + 2 * LANES]), np.float64(boxes[at + 5 * LANES])
    return (0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.5 * (z0 + z1)), (0.5 * (x1 - x0), 0.5 * (y1 - y0), 0.5 * (z1 - z0))


@inline_kernel
def packet_errors(a, b, ws, lane_a, lane_b):
    """Shift of b's packet and half the box of a's, (x, y, z), and error bounds (off, kf, kp, k), all float32.

    Coordinates are relative to the centre of a's box; b's packet is turned, then shifted. The error of a coordinate is
    at most 10 roundings of float32 of the packets' size plus the error of the float64 vertices; `off` bounds that of a
    difference. If every entry of e, f, w has an error of `off`, that of their determinant is at most
    off·(|e||f| + |f||w| + |w||e|) in sum norms, each enlarged by 2·off; its rounding adds less than 2·off·|e||f|, and
    1 % covers the rounding of the bound: kf·(|e| + |f|) + kp·|e||f| + k.
    """
    m = ws.pose.matrix
    (ax, ay, az), (hx, hy, hz) = middle_and_half(a.boxes, box_at(lane_a))
    x, y, z = rotate(m, middle_and_half(b.boxes, box_at(lane_b))[0])
    sx, sy, sz = np.float32(x + (m[12] - ax)), np.float32(y + (m[13] - ay)), np.float32(z + (m[14] - az))
    size_a, size_b = a.size[lane_a], b.size[lane_b]
    half, shift = np.float32(0.5) * size_a + np.float32(0.9) * size_b, abs(sx) + abs(sy) + abs(sz)
    # where boxes do not overlap the shift may be large against the packets
    off = np.float32(20.0 * 2.0**-24) * (size_a + size_b + max(np.float32(0.0), shift - half)) + ws.pose.motion[22]
    reach = half + shift + np.float32(2.0) * off  # of any difference
    kf = np.float32(1.01) * off * (reach + np.float32(6.0) * off)
    kp = np.float32(3.03) * off
    k = np.float32(1.01) * off * off * (np.float32(4.0) * reach + np.float32(12.0) * off)
    return (sx, sy, sz), (np.float32(hx), np.float32(hy), np.float32(hz)), (off, kf, kp, k)


@inline_kernel
def reached(ws, q, shift, half, reach):
    """Bits: which triangles of packet q of b, turned and shifted, have boxes within `reach` (float32, m) of the box of
    half edges `half` about the origin."""
    return reaching(
        ws.turned, PREPARED * q,
        -half[0] - shift[0] - reach, -half[1] - shift[1] - reach, -half[2] - shift[2] - reach,
        half[0] - shift[0] + reach, half[1] - shift[1] + reach, half[2] - shift[2] + reach,
    )  # fmt: skip


@inline_kernel
def corner_of(a, i):
    """The vertex at place i of `Bvh.corner`: (x, y, z) float64, m."""
    v = 3 * np.int64(a.corner[i])
    return a.vertices[v], a.vertices[v + 1], a.vertices[v + 2]


@inline_kernel
def moved_corner(b, i, matrix):
    """The vertex of b at place i of `Bvh.corner` in a's frame, m, by the arithmetic with which all methods move it."""
    return transform(matrix, corner_of(b, i))


@inner_kernel
def float_limit(x):
    """A finite float32 not below x."""
    return np.float32(min(x + 2.0**-20 * abs(x) + 1e-37, 3e38))


class Surfaces(NamedTuple):
    """Task: write the pairs of surfaces whose boxes are near to `ws.pairs`, and their number to `ws.counts[FOUND]`."""

    limit: Any
    """float32, m²: the greatest squared distance of the boxes, at most 3e38"""

    def is_bottom(self, bvh, lane):
        """Boxes of surfaces are not opened."""
        return bvh.surface[lane] >= 0

    def children(self, ws, boxes, at, others, at_other):
        """Bits: which boxes of a node come within the limit of a box of the other hierarchy."""
        ws.counts[SURFACE_BOXES] += LANES
        return near_lane(boxes, at, others, at_other, self.limit, ws.bounds)

    def visit(self, a, b, ws, lane_a, lane_b):
        """Count a pair of surfaces, and add it unless `ws.pairs` is full."""
        found = ws.counts[FOUND]
        if found < len(ws.pairs):
            ws.pairs[found] = np.int64(a.surface[lane_a]) * len(b.root) + b.surface[lane_b]
        ws.counts[FOUND] = found + 1
        return False


@inline_kernel
def near_surfaces(a, b, ws, limit):
    """Fill `ws.pairs` with the pairs of surfaces whose boxes are within `limit` (squared, m²); return their number.

    If they are more than `ws.pairs` can hold, its content is undefined; the caller must call again with a longer one.
    """
    ws.counts[FOUND] = 0
    task = Surfaces(float_limit(limit))
    if len(a.root) > 1 or len(b.root) > 1:
        walk(task, a, b, ws, 0, 0)
        return ws.counts[FOUND]
    ws.counts[SURFACE_BOXES] += LANES
    if near_lane(a.boxes, 0, ws.moved, 0, task.limit, ws.bounds) & 1:
        ws.pairs[0] = 0
        return 1
    return 0


@inner_kernel
def sort(keys, n):
    """Sort the first n of `keys` (Shell's sort: numba's own takes seconds to compile)."""
    gap = n // 2
    while gap > 0:
        for i in range(gap, n):
            key = keys[i]
            j = i
            while j >= gap and keys[j - gap] > key:
                keys[j] = keys[j - gap]
                j -= gap
            keys[j] = key
        gap //= 2
