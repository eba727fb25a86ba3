"""The broad phase: the pairs of objects whose boxes and spheres in the world come near each other.

Two trees of boxes, one of the movable objects and one of the others, are kept between queries. Boxes are refitted after
their objects have moved, and a tree is rebuilt when its groups have grown too large. Movable objects are tested against
both trees; the others are not tested against each other. If few objects have moved, only those are tested.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from collision.bvh.build import nodes_over, order_groups
from collision.bvh.layout import LANES, NODE
from collision.numeric.kernel import EntryPoint, inline_kernel, inner_kernel, kernel
from collision.numeric.rigid_transforms import relative_poses, take_pose, take_poses
from collision.numeric.simd import lowest, overlapping

OFFSET: Final = 64.0 * 2.0**-53
"""1: rounding error of a moved vertex, a relative pose and a box in the world, per unit of the coordinates"""
SKEW: Final = 8.0
"""1: shift of a vertex by a rotation that is not orthogonal, per unit of |RᵀR - I| and of the coordinates: triangles
are tested with b moved into a's frame by a's transposed rotation, boxes and spheres in the world frame"""
GROWN: Final = 1.5
"""1: a tree is rebuilt when its groups of eight objects have grown by more than this factor"""
FEW: Final = 4
"""if at most one object in this number has moved, only the moved ones are tested"""


class ObjectArrays(NamedTuple):
    """Arrays by object id, longer than there are objects."""

    pose: Any
    """(n, 12) float64: rotation by rows, translation"""
    own: Any
    """(n, 7) float64, m: box in the object's frame, and the radius of the sphere about its centre"""
    box: Any
    """(n, 6) float64, m: box in the world"""
    radius: Any
    """(n,) float64, m: of the sphere about the centre of that box"""
    stale: Any
    """(n,) bool: whether the box in the world is out of date"""
    movable: Any
    """(n,) bool"""
    group: Any
    """(n,) int64: number of the object's group, -1 for none; objects of one group are not paired"""


class ObjectTree(NamedTuple):
    """Boxes in the world of some objects, eight a node, from groups of eight objects up to one node."""

    ids: Any
    """(n,) int64 in the order of the tree"""
    nodes: Any
    """float32, see `numeric.simd`: the groups, then the levels above them in order"""
    starts: Any
    """int64: where in `nodes` each level begins"""
    formed: Any
    """(1,) float64, m: sum of the extents of the groups when the tree was built"""


def bodies_for(n: int, before: ObjectArrays | None = None) -> ObjectArrays:
    """Return arrays for n objects; the first rows are those of `before`."""
    arrays = ObjectArrays(
        np.empty((n, 12)), np.empty((n, 7)), np.empty((n, 6)), np.empty(n), np.zeros(n, np.bool_),
        np.zeros(n, np.bool_), np.full(n, -1, np.int64),
    )  # fmt: skip
    for new, old in zip(arrays, before or (), strict=False):
        new[: len(old)] = old
    return arrays


def tree_of_objects(ids: NDArray[np.int64]) -> ObjectTree:
    """Return an empty tree for objects of these ids, (n,)."""
    starts, boxes = [0], -(-len(ids) // LANES)
    while boxes > 1:
        starts.append(starts[-1] + NODE * boxes)
        boxes = -(-boxes // LANES)
    nodes = np.empty(NODE * max(1, int(nodes_over(len(ids)))), np.float32)
    return ObjectTree(ids, nodes, np.array(starts, np.int64), np.full(1, -1.0))


class BroadPhase:
    """The two trees over all objects, and the pairs of the last query."""

    def __init__(self) -> None:
        self._movers = self._fixed = tree_of_objects(np.empty(0, np.int64))
        self._stack = np.empty((128, 2), np.int64)
        self._found = np.empty(64, np.int64)
        self._none = np.empty(0, np.bool_)
        self._keys: NDArray[np.int64] | None = None
        """keys of the pairs whose boxes and spheres meet, valid for objects that are not stale; None if unknown"""

    def rebuild(self, ids: NDArray[np.int64], bodies: ObjectArrays) -> None:
        """Rebuild both trees with the objects of these ids, (n,)."""
        movable = bodies.movable[ids]
        self._movers, self._fixed = tree_of_objects(ids[movable]), tree_of_objects(ids[~movable])
        bodies.stale[:] = False
        bodies.stale[ids] = True
        self._keys = None

    def set_groups(self, bodies: ObjectArrays, groups: Iterable[Iterable[int]]) -> None:
        """Leave out the pairs within each of these groups of objects; replaces earlier groups."""
        bodies.group[:] = -1
        for number, group in enumerate(groups):
            bodies.group[list(group)] = number
        self._keys = None

    def place(self, bodies: ObjectArrays, i: int, matrix: NDArray[np.float64], rigid: float) -> bool:
        """Set the pose of object i to a (4, 4) matrix; return False, without a change, if it is no rigid motion."""
        return bool(_place.call(bodies, i, matrix, rigid))

    def packed(self, matrices: NDArray[np.float64], rigid: float) -> tuple[NDArray[np.float64], int]:
        """Return (n, 12) poses of (n, 4, 4) matrices, and the index of the first that is no rigid motion, or -1."""
        out = np.empty((len(matrices), 12))
        return out, _take_poses.call(matrices, rigid, out)

    def relative_poses(self, pose: NDArray[np.float64], pairs: NDArray[np.int32]) -> NDArray[np.float64]:
        """Return (k, 12) poses of the second of each pair of objects (k, 2) in the frame of the first."""
        out = np.empty((len(pairs), 12))
        _relative_poses.call(pose, pairs, out)
        return out

    def follow(self, bodies: ObjectArrays) -> None:
        """Refit boxes and trees to the poses."""
        grown = _follow.call(bodies, self._movers, self._fixed, False)
        if grown:
            for bit, tree in ((1, self._movers), (2, self._fixed)):
                if grown & bit:
                    box = bodies.box[: int(tree.ids.max()) + 1]
                    order_groups(tree.ids, np.ascontiguousarray((0.5 * box[:, :3] + 0.5 * box[:, 3:]).T))
            _follow.call(bodies, self._movers, self._fixed, True)

    def near(
        self, bodies: ObjectArrays, n: int, within: float = 0.0, chosen: NDArray[np.bool_] | None = None
    ) -> NDArray[np.int64]:
        """Return the keys, 2³²·i + j, of the pairs i < j of the first n objects that come within `within` (m), sorted.

        chosen: (n,) bool, only pairs with at least one of these. The result is read-only.
        """
        if within == 0.0 and chosen is None:
            return self._near_all(bodies, n)
        if self._keys is not None and bodies.stale[:n].any():  # refitting clears what is stale
            if FEW * np.count_nonzero(bodies.stale[:n]) <= n:
                self._near_all(bodies, n)
            else:
                self._keys = None
        self.follow(bodies)
        return self._find(bodies, within, chosen)

    def _near_all(self, bodies: ObjectArrays, n: int) -> NDArray[np.int64]:
        if self._keys is not None and n > 16:
            stale = bodies.stale[:n].copy()
            moved = np.count_nonzero(stale)
            if FEW * moved <= n:
                if moved:
                    self.follow(bodies)
                    keys = self._keys
                    still = keys[~(stale[keys >> 32] | stale[keys & 0xFFFFFFFF])]
                    self._keys = np.concatenate([still, self._find(bodies, 0.0, stale)])
                    self._keys.sort()
                return self._keys
        self.follow(bodies)
        self._keys = self._find(bodies, 0.0, None)
        return self._keys

    def _find(self, bodies: ObjectArrays, within: float, chosen: NDArray[np.bool_] | None) -> NDArray[np.int64]:
        chosen = self._none if chosen is None else chosen
        while True:
            found = _near_pairs.call(bodies, self._movers, self._fixed, within, chosen, self._stack, self._found)
            if found <= len(self._found):
                break
            self._found = np.empty(2 * found, np.int64)
        keys = self._found[:found].copy()
        if found > 1:
            keys.sort()
        return keys


# --- kernels ---------------------------------------------------------------------------------------------------------


@kernel
def place(bodies, i, matrix, rigid):
    """Set the pose of object i to a (4, 4) matrix, and its box to stale; return False if it is no rigid motion."""
    if not take_pose(matrix, rigid, bodies.pose[i]):
        return False
    bodies.stale[i] = True
    return True


@inner_kernel
def move_world_box(bodies, i):
    """Refit the box and the sphere of object i in the world to its pose."""
    own, pose = bodies.own[i], bodies.pose[i]
    length = size = off = 0.0
    for d in range(3):
        greatest = max(abs(own[d]), abs(own[d + 3]))
        length += abs(pose[9 + d]) + greatest
        size += greatest
        for e in range(d, 3):
            r = pose[d] * pose[e] + pose[3 + d] * pose[3 + e] + pose[6 + d] * pose[6 + e]
            off = max(off, abs(r - (1.0 if d == e else 0.0)))
    error = OFFSET * length + SKEW * off * size
    bodies.radius[i] = own[6] + 2.0 * error
    for d in range(3):
        centre, half = pose[9 + d], error
        for e in range(3):
            r = pose[3 * d + e]
            centre += r * (0.5 * own[e] + 0.5 * own[e + 3])
            half += abs(r) * (0.5 * own[e + 3] - 0.5 * own[e])
        bodies.box[i, d] = centre - half
        bodies.box[i, d + 3] = centre + half


@inner_kernel
def below(x):
    """Return a float32 below x; finite, if x is above all float32."""
    y = np.float32(min(x, 3e38) - 1e-30)
    return y - abs(y) * np.float32(1.2e-7)


@inner_kernel
def above(x):
    """Return a float32 above x; finite, if x is below all float32."""
    y = np.float32(max(x, -3e38) + 1e-30)
    return y + abs(y) * np.float32(1.2e-7)


@inline_kernel
def set_nodes(tree, box):
    """Fill the nodes of an `ObjectTree`; return the sum of the extents of its groups of eight objects."""
    ids, nodes = tree.ids, tree.nodes
    groups = (len(ids) + LANES - 1) // LANES
    extent = 0.0
    for group in range(groups):
        at = NODE * group
        for d in range(3):
            low, high = np.inf, -np.inf
            for k in range(LANES):
                x0, x1 = np.float32(np.inf), np.float32(-np.inf)
                if LANES * group + k < len(ids):
                    i = ids[LANES * group + k]
                    x0, x1 = below(box[i, d]), above(box[i, d + 3])
                    low, high = min(low, box[i, d]), max(high, box[i, d + 3])
                nodes[at + LANES * d + k], nodes[at + LANES * (d + 3) + k] = x0, x1
            extent += high - low
    at, boxes = 0, groups
    while boxes > 1:
        up = at + NODE * boxes
        for i in range(LANES * ((boxes + LANES - 1) // LANES)):
            to = up + NODE * (i // LANES) + i % LANES
            for d in range(3):
                x0, x1 = np.float32(np.inf), np.float32(-np.inf)
                if i < boxes:
                    for k in range(LANES):
                        x0 = min(x0, nodes[at + NODE * i + LANES * d + k])
                        x1 = max(x1, nodes[at + NODE * i + LANES * (d + 3) + k])
                nodes[to + LANES * d], nodes[to + LANES * (d + 3)] = x0, x1
        at = up
        boxes = (boxes + LANES - 1) // LANES
    return extent


@inline_kernel
def follow_tree(bodies, tree, formed):
    """Refit a tree to the poses; return whether its groups have grown too large. formed: it has just been built."""
    outdated = formed
    for k in range(len(tree.ids)):
        i = tree.ids[k]
        if bodies.stale[i]:
            bodies.stale[i] = False
            outdated = True
            move_world_box(bodies, i)
    if not outdated:
        return False
    extent = set_nodes(tree, bodies.box)
    if formed:
        tree.formed[0] = extent
    return extent > GROWN * tree.formed[0]


@kernel
def follow(bodies, movers, fixed, formed):
    """Refit both trees; return 1 if the groups of `movers` have grown too large, plus 2 for those of `fixed`.

    formed: the trees have just been built.
    """
    return 1 * follow_tree(bodies, movers, formed) + 2 * follow_tree(bodies, fixed, formed)


@inner_kernel
def boxes_and_spheres_meet(i, j, box, radius, within):
    """Whether the boxes and the spheres of two objects come within `within` (m)."""
    apart = 0.0
    for d in range(3):
        if box[i, d] - within > box[j, d + 3] or box[j, d] - within > box[i, d + 3]:
            return False
        apart += (0.5 * (box[i, d] + box[i, d + 3]) - 0.5 * (box[j, d] + box[j, d + 3])) ** 2
    return apart <= (radius[i] + radius[j] + within) ** 2


@inline_kernel
def near_in_tree(bodies, i, after, tree, within, chosen, stack, keys, n):
    """Append the pairs of i with objects from index `after` of a tree on to the n `keys`; return their new number.

    A pair of two chosen objects is added for the lower id, or for the movable one. Pairs beyond the end of `keys` are
    only counted.
    """
    box, ids, starts = bodies.box, tree.ids, tree.starts
    x0, y0, z0 = below(box[i, 0] - within), below(box[i, 1] - within), below(box[i, 2] - within)
    x1, y1, z1 = above(box[i, 3] + within), above(box[i, 4] + within), above(box[i, 5] + within)
    stack[0, 0], stack[0, 1] = len(starts) - 1, 0
    top = 1
    while top > 0:
        top -= 1
        level, node = stack[top, 0], stack[top, 1]
        bits = overlapping(tree.nodes, starts[level] + NODE * node, x0, y0, z0, x1, y1, z1)
        while bits != 0:
            child = LANES * node + lowest(bits)
            bits &= bits - 1
            first, size = child << (3 * level), 1 << (3 * level)
            if first >= len(ids) or first + size <= after:  # an empty lane is in a box without end
                continue
            if level > 0:
                stack[top, 0], stack[top, 1] = level - 1, child
                top += 1
                continue
            j = ids[child]
            if j == i or (bodies.group[i] >= 0 and bodies.group[i] == bodies.group[j]):
                continue
            if len(chosen) > 0 and chosen[j] and (not bodies.movable[i] or (bodies.movable[j] and j < i)):
                continue
            if boxes_and_spheres_meet(i, j, box, bodies.radius, within):
                if n < len(keys):
                    keys[n] = (min(i, j) << 32) | max(i, j)
                n += 1
    return n


@kernel
def near_pairs(bodies, movers, fixed, within, chosen, stack, keys):
    """Fill `keys` with the pairs i < j (2³²·i + j), one of them movable, whose boxes and spheres come within `within`.

    Returns their number, which may exceed the length of `keys`. chosen: (n,) bool, only pairs with at least one of
    these; (0,) for all.
    """
    n = np.int64(0)
    if len(chosen) == 0:
        for place in range(len(movers.ids)):
            i = movers.ids[place]
            n = near_in_tree(bodies, i, place + 1, movers, within, chosen, stack, keys, n)
            if len(fixed.ids) > 0:
                n = near_in_tree(bodies, i, 0, fixed, within, chosen, stack, keys, n)
        return n
    for i in range(len(chosen)):
        if chosen[i]:
            n = near_in_tree(bodies, i, 0, movers, within, chosen, stack, keys, n)
            if bodies.movable[i] and len(fixed.ids) > 0:
                n = near_in_tree(bodies, i, 0, fixed, within, chosen, stack, keys, n)
    return n


_follow, _near_pairs, _place = EntryPoint(follow), EntryPoint(near_pairs), EntryPoint(place)
_take_poses, _relative_poses = EntryPoint(take_poses), EntryPoint(relative_poses)
