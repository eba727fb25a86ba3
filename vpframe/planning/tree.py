"""A tree of displacements sampled in all six freedoms, after RRT (LaValle & Kuffner, "Randomized Kinodynamic Planning",
2001).

The tree grows in a kernel on intersection tests alone: static parts are one mesh, moving parts another. A blocked push
slides along the contact: its twist is projected onto the half spaces of the intersecting triangles. The kind of the
next sample is chosen by a bandit (UCB1: Auer, Cesa-Bianchi & Fischer, Machine Learning 47, 2002, with a discounted
mean); each kind has a scale of its own that grows on success and shrinks on failure.

Tests at sampled poses prove nothing. A path is swept, leg by leg, before it is returned; a blocked leg is cut off the
tree with its descendants, and the search continues.
"""

from __future__ import annotations

from bisect import bisect
from collections.abc import Sequence
from itertools import count, pairwise
from typing import Any, Final, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import MeshPair, SurfaceMesh, colliding_surfaces, last_surfaces, prepare_pair
from collision.mesh_pair import pair_contact, pair_intersects
from collision.numeric.kernel import EntryPoint, inner_kernel, kernel
from collision.numeric.rigid_transforms import screw_pose, unrotate
from collision.numeric.vectors import cross, dot, norm, sub, unit
from constraints.freedom.escape import EscapeCone
from vpframe.planning import ways
from vpframe.planning.assembly import Assembly, Budget, BudgetError, translation
from vpframe.planning.pushes import Pushes, SearchResult

UNIFORM, CONE, AXES, TANGENT, ONWARD, EXIT = range(6)
"""arms: towards a random displacement; a twist of the escape cone; about or along an axis; a random twist that slides
along contacts; nearly the twist by which the node was reached; straight out"""
ARMS: Final = 6
NODES, TESTS, AT, DRAWN = range(4)
"""places in `Tree.count`"""
GROW, SHRINK = 1.6, 0.7
SCALES: Final = (3e-3, 4.0)
"""of the group's size: least and greatest scale of an arm"""
DISCOUNT: Final = 0.999
"""discount factor of the bandit, per pull"""
CURIOSITY: Final = 0.5
"""1: weight of the confidence bound"""
STEP: Final = 1e-2
"""of the group's size: step between two tests"""
LEAST: Final = 2e-3
"""of the group's size: least spacing of displacements"""
WIDER, NARROWER = 1.15, 0.99
"""factors by which the least spacing of new displacements is adapted"""
BENDS: Final = 24
"""contacts along which one push slides, at most"""
ROWS: Final = 8
"""contact rows kept by a push"""
PROJECTIONS: Final = 20
OFFSET: Final = 0.02
"""1: offset along the contact normal while sliding"""
TESTS_A_QUESTION: Final = 80
"""intersection tests that count as one question of the budget"""
FIRST: Final = 200_000
"""tests of the first tree; new ones follow, with 2, 1, 4, 1, 2, 1, 8 … times as many, because how long a tree takes
varies much (after Luby, Sinclair & Zuckerman, Information Processing Letters 47, 1993)"""
NODE_ARRAYS: Final = ("pose", "turn", "parent", "tries")
CHUNK: Final = 2000
"""tests between two looks at the clock"""
NUMBERS, MOST_DRAWN = 1 << 15, 100
"""random numbers for a chunk; more than one push uses"""
SHORTCUTS: Final = 300
"""attempts to shortcut a path by tests, before it is swept"""


# --- kernels ---------------------------------------------------------------------------------------------------------


class Tree(NamedTuple):
    """Displacements reached, as poses of the group's centre frame relative to the static parts, and the arrays of their
    growth."""

    pose: Any
    """(n, 12) float64"""
    turn: Any
    """(n, 4) float64: unit quaternions"""
    parent: Any
    """(n,) int64, -1 of the root"""
    tries: Any
    """(n,) int64: pushes from a node; -1 if it was cut off"""
    arms: Any
    """(ARMS, 3) float64: discounted pulls and gain; scale, m"""
    count: Any
    """(4,) int64: nodes, tests, last node of the path found, random numbers used"""
    numbers: Any
    """(n,) float64: random numbers in [0, 1)"""
    out: Any
    """(3,) float64: direction of the last, straight leg"""
    chain: Any
    """(BENDS + 1, 12) float64: poses at which a push changed direction, and its end"""
    screw: Any
    """(18,) float64: pose, body twist"""
    rows: Any
    """(ROWS, 6) float64: contacts of a push, see `_set_row`"""
    there: Any
    """(12,) float64: the pose to be tested"""


class Guide(NamedTuple):
    """The parameters of the samples."""

    twists: Any
    """(k, 6) float64: of the escape cone, in the group's frame"""
    axes: Any
    """(m, 3) float64: of the group's surfaces"""
    exits: Any
    """(e, 3) float64: directions of straight removal"""
    box: Any
    """(2, 3) float64: corners of the box of the static parts, m"""
    length: Any
    """m: radius of the group about its centre; 1 rad counts as this length"""


@inner_kernel
def _meets(pair, tree):
    """Whether the group at the pose `tree.there` intersects the static parts."""
    tree.count[TESTS] += 1
    return pair_intersects(pair, tree.there)


@kernel
def meets_within(pair, tree, n):
    """Whether the group intersects at any of n poses, evenly on the screw `tree.screw` of unit time, the start left
    out."""
    for k in range(n, 0, -1):
        screw_pose(tree.screw, k / n, tree.there)
        if _meets(pair, tree):
            return True
    return False


@inner_kernel
def _set_row(rows, k, pose, p, n, length):
    """Set row k to the contact at p with normal n out of the static parts: a unit vector, angles times `length`."""
    r, m = unrotate(pose, sub(p, (pose[9], pose[10], pose[11]))), unrotate(pose, n)
    g = cross(r, m)
    size = np.sqrt(dot(m, m) + dot(g, g) / (length * length))
    for d in range(3):
        rows[k, d], rows[k, 3 + d] = m[d] / size, g[d] / (length * size)


@inner_kernel
def _within(rows, n, drive, length):
    """The body twist (v, w) near `drive` that violates none of the first n contacts (alternating projections)."""
    v = drive[0], drive[1], drive[2]
    w = length * drive[3], length * drive[4], length * drive[5]
    for _ in range(PROJECTIONS):
        most = 0.0
        for k in range(n):
            c = rows[k]
            into = c[0] * v[0] + c[1] * v[1] + c[2] * v[2] + c[3] * w[0] + c[4] * w[1] + c[5] * w[2] - OFFSET
            if into < 0.0:
                most = min(most, into)
                v = v[0] - into * c[0], v[1] - into * c[1], v[2] - into * c[2]
                w = w[0] - into * c[3], w[1] - into * c[4], w[2] - into * c[5]
        if most > -0.5 * OFFSET:
            break
    return v[0], v[1], v[2], w[0] / length, w[1] / length, w[2] / length


@inner_kernel
def _take(tree, twist, length, least):
    """Set the twist of `tree.screw`, normalised to one metre; False, without effect, if it is shorter than `least`."""
    size = norm((twist[0], twist[1], twist[2])) + length * norm((twist[3], twist[4], twist[5]))
    if not size > least:
        return False
    for d in range(6):
        tree.screw[12 + d] = twist[d] / size
    return True


@inner_kernel
def _push(pair, tree, far, comply, length):
    """Move `far` m along `tree.screw`, sliding along contacts if `comply`: (poses written to `tree.chain`, m left)."""
    step, t, n, kept = STEP * length, 0.0, 0, 0
    screw, there, chain, rows = tree.screw, tree.there, tree.chain, tree.rows
    drive = screw[12], screw[13], screw[14], screw[15], screw[16], screw[17]
    while far > 0.0:
        h = min(step, far)
        screw_pose(screw, t + h, there)
        if not _meets(pair, tree):
            t += h
            far -= h
            continue
        if t > 0.0:
            screw_pose(screw, t, chain[n])
            for d in range(12):
                screw[d] = chain[n, d]
            n += 1
            t = 0.0
        if not comply or n >= BENDS:
            break
        p, out, back = pair_contact(pair, there)
        if kept > ROWS - 2:  # the oldest go
            for k in range(kept - 2):
                for d in range(6):
                    rows[k, d] = rows[k + 2, d]
            kept -= 2
        _set_row(rows, kept, there, p, out, length)
        _set_row(rows, kept + 1, there, p, (-back[0], -back[1], -back[2]), length)
        goes = False
        for k in range(3):
            if k == 2:  # the other triangle's alone
                for d in range(6):
                    rows[kept, d] = rows[kept + 1, d]
            more = 2 if k == 1 else 1
            if not _take(tree, _within(rows, kept + more, drive, length), length, 0.1):
                continue
            h = min(0.5 * step, far)
            screw_pose(screw, h, there)
            if not _meets(pair, tree):
                kept += more
                t = h
                far -= h
                goes = True
                break
        if not goes:
            break
    if t > 0.0:
        screw_pose(screw, t, chain[n])
        n += 1
    return n, far


@inner_kernel
def quaternion_of(pose, out):
    """Fill `out` (4,) with the unit quaternion (x, y, z, w) of a pose (12,)."""
    m = pose
    trace = m[0] + m[4] + m[8]
    if trace > 0.0:
        s = 2.0 * np.sqrt(1.0 + trace)
        q = (m[7] - m[5]) / s, (m[2] - m[6]) / s, (m[3] - m[1]) / s, 0.25 * s
    elif m[0] >= m[4] and m[0] >= m[8]:
        s = 2.0 * np.sqrt(1.0 + m[0] - m[4] - m[8])
        q = 0.25 * s, (m[1] + m[3]) / s, (m[2] + m[6]) / s, (m[7] - m[5]) / s
    elif m[4] >= m[8]:
        s = 2.0 * np.sqrt(1.0 + m[4] - m[0] - m[8])
        q = (m[1] + m[3]) / s, 0.25 * s, (m[5] + m[7]) / s, (m[2] - m[6]) / s
    else:
        s = 2.0 * np.sqrt(1.0 + m[8] - m[0] - m[4])
        q = (m[2] + m[6]) / s, (m[5] + m[7]) / s, 0.25 * s, (m[3] - m[1]) / s
    for d in range(4):
        out[d] = q[d]


@inner_kernel
def _nearest(tree, x, q, length):
    """(nearest node that was not cut off, its distance in m) to a position and quaternion."""
    best, at = np.inf, np.int64(0)
    for k in range(tree.count[NODES]):
        if tree.tries[k] < 0:
            continue
        d = norm((tree.pose[k, 9] - x[0], tree.pose[k, 10] - x[1], tree.pose[k, 11] - x[2]))
        if d >= best:
            continue
        c = abs(tree.turn[k, 0] * q[0] + tree.turn[k, 1] * q[1] + tree.turn[k, 2] * q[2] + tree.turn[k, 3] * q[3])
        d += length * 2.0 * np.sqrt(max(0.0, 2.0 - 2.0 * c))
        if d < best:
            best, at = d, np.int64(k)
    return at, best


@inner_kernel
def _draw(tree):
    """The next random number in [0, 1)."""
    k = tree.count[DRAWN]
    tree.count[DRAWN] = k + 1
    return tree.numbers[k]


@inner_kernel
def _node(tree):
    """Least-expanded of six random nodes, biased to recent ones."""
    n = tree.count[NODES]
    low = max(0, n - 40) if _draw(tree) < 0.4 else 0
    at, least = np.int64(0), np.int64(1) << 60
    for _ in range(6):
        k = low + np.int64(_draw(tree) * (n - low))
        if 0 <= tree.tries[k] < least:
            at, least = k, tree.tries[k]
    return at


@inner_kernel
def _choose(arms):
    total, at, best = 1.0, 0, -np.inf
    for k in range(ARMS):
        total += arms[k, 0]
    for k in range(ARMS):
        pulls = max(arms[k, 0], 1e-3)
        worth = arms[k, 1] / pulls + CURIOSITY * np.sqrt(np.log(total + 1.0) / pulls)
        if worth > best:
            at, best = k, worth
    return at


@inner_kernel
def normal_sample(tree):
    """Three samples of the standard normal distribution (Box & Muller 1958)."""
    r, s = np.sqrt(-2.0 * np.log(1.0 - _draw(tree))), np.sqrt(-2.0 * np.log(1.0 - _draw(tree)))
    u, v = 2.0 * np.pi * _draw(tree), 2.0 * np.pi * _draw(tree)
    return r * np.cos(u), r * np.sin(u), s * np.cos(v)


@inner_kernel
def _turn(p, q):
    """Vector and scalar part of p⁻¹·q, unit quaternions."""
    return (
        p[3] * q[0] - p[0] * q[3] - (p[1] * q[2] - p[2] * q[1]),
        p[3] * q[1] - p[1] * q[3] - (p[2] * q[0] - p[0] * q[2]),
        p[3] * q[2] - p[2] * q[3] - (p[0] * q[1] - p[1] * q[0]),
    ), p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3]


@inner_kernel
def _towards(tree, guide):
    """(node, twist, m) from the nearest node to a random displacement, anywhere or near a node."""
    length, box = guide.length, guide.box
    r, (q0, q1, q2), (q3, _, _) = normal_sample(tree), normal_sample(tree), normal_sample(tree)
    spread = tree.arms[UNIFORM, 2]
    if _draw(tree) < 0.5:
        k = _node(tree)
        x = tree.pose[k, 9] + spread * r[0], tree.pose[k, 10] + spread * r[1], tree.pose[k, 11] + spread * r[2]
        s = min(1.0, spread / length)
        q0, q1, q2, q3 = (
            tree.turn[k, 0] + s * q0, tree.turn[k, 1] + s * q1, tree.turn[k, 2] + s * q2, tree.turn[k, 3] + s * q3,
        )  # fmt: skip
    else:
        s, u, v = _draw(tree), _draw(tree), _draw(tree)
        x = (
            box[0, 0] - length + s * (box[1, 0] - box[0, 0] + 2.0 * length),
            box[0, 1] - length + u * (box[1, 1] - box[0, 1] + 2.0 * length),
            box[0, 2] - length + v * (box[1, 2] - box[0, 2] + 2.0 * length),
        )
    size = np.sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
    q = q0 / size, q1 / size, q2 / size, q3 / size
    node, d = _nearest(tree, x, q, length)
    p, pose = tree.turn[node], tree.pose[node]
    e, c = _turn(p, q)
    s = norm(e)
    angle = 2.0 * np.arctan2(s, abs(c)) * (1.0 if c >= 0.0 else -1.0) / max(s, 1e-300)
    v = unrotate(pose, sub(x, (pose[9], pose[10], pose[11])))
    return node, (v[0], v[1], v[2], angle * e[0], angle * e[1], angle * e[2]), d


@inner_kernel
def _arrival(tree, node, length):
    """The body twist, normalised to about one metre, by which a node was reached from its parent."""
    p, q, k = tree.turn[tree.parent[node]], tree.turn[node], tree.parent[node]
    e, c = _turn(p, q)
    x = (
        tree.pose[node, 9] - tree.pose[k, 9],
        tree.pose[node, 10] - tree.pose[k, 10],
        tree.pose[node, 11] - tree.pose[k, 11],
    )
    v, s = unrotate(tree.pose[node], x), 2.0 if c >= 0.0 else -2.0
    size = max(norm(v) + length * 2.0 * norm(e), 1e-300)
    return v[0] / size, v[1] / size, v[2] / size, s * e[0] / size, s * e[1] / size, s * e[2] / size


@inner_kernel
def _sample(tree, guide, arm):
    """(node, twist, largest length in m) of a push."""
    if arm == UNIFORM:
        return _towards(tree, guide)
    node = _node(tree)
    far = tree.arms[arm, 2] * _draw(tree)
    (x0, x1, x2), (x3, x4, x5) = normal_sample(tree), normal_sample(tree)
    x = x0, x1, x2, x3, x4, x5
    if arm == CONE and len(guide.twists) > 0:
        x = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        for k in range(len(guide.twists)):
            c, s = guide.twists[k], _draw(tree) ** 4
            x = x[0] + s * c[0], x[1] + s * c[1], x[2] + s * c[2], x[3] + s * c[3], x[4] + s * c[4], x[5] + s * c[5]
        return node, x, far
    if arm == AXES:
        c, sign = guide.axes[int(_draw(tree) * len(guide.axes))], 1.0 if _draw(tree) < 0.5 else -1.0
        u = sign * c[0], sign * c[1], sign * c[2]
        if _draw(tree) < 0.5:
            return node, (u[0], u[1], u[2], 0.0, 0.0, 0.0), far
        return node, (0.0, 0.0, 0.0, u[0], u[1], u[2]), far
    if arm == ONWARD and tree.parent[node] >= 0:
        y = _arrival(tree, node, guide.length)
        c = 0.5 * _draw(tree)
        s = c / guide.length
        return node, (
            y[0] + c * x[0], y[1] + c * x[1], y[2] + c * x[2], y[3] + s * x[3], y[4] + s * x[4], y[5] + s * x[5],
        ), far  # fmt: skip
    s = 1.0 / guide.length if _draw(tree) < 0.6 else 0.0
    t = 1.0 if s == 0.0 or _draw(tree) < 0.6 else 0.0
    return node, (t * x[0], t * x[1], t * x[2], s * x[3], s * x[4], s * x[5]), far


@inner_kernel
def _way_out(tree, guide):
    """(node, twist, m) of a straight push out of the box of the static parts, with its direction in `tree.out`."""
    node = _node(tree)
    if _draw(tree) < 0.7:
        c = guide.exits[int(_draw(tree) * len(guide.exits))]
        d = c[0], c[1], c[2]
    else:
        d = unit(normal_sample(tree))
    pose, far = tree.pose[node], guide.length
    for k in range(3):
        tree.out[k] = d[k]
        far += d[k] * (guide.box[1 if d[k] > 0.0 else 0, k] - pose[9 + k])
    v = unrotate(pose, d)
    return node, (v[0], v[1], v[2], 0.0, 0.0, 0.0), max(far, guide.length)


@kernel
def grow(pair, tree, guide, limit):
    """Grow the tree until a path out is found, `limit` tests were made, or the arrays of nodes are full.

    Returns whether one was found: to the node in `tree.count[AT]`, then straight along `tree.out`.
    """
    length, arms, count = guide.length, tree.arms, tree.count
    count[DRAWN] = 0
    while (
        count[TESTS] < limit
        and count[NODES] + BENDS + 1 < len(tree.parent)
        and count[DRAWN] + MOST_DRAWN < len(tree.numbers)
    ):
        arm = _choose(arms)
        for k in range(ARMS):
            arms[k, 0] *= DISCOUNT
            arms[k, 1] *= DISCOUNT
        arms[arm, 0] += 1.0
        node, twist, far = _way_out(tree, guide) if arm == EXIT else _sample(tree, guide, arm)
        tree.tries[node] += 1
        for d in range(12):
            tree.screw[d] = tree.pose[node, d]
        if not _take(tree, twist, length, 0.0):
            continue
        if arm == UNIFORM:
            far = min(far, arms[arm, 2])
        turn = norm((tree.screw[15], tree.screw[16], tree.screw[17]))
        if far * turn > 2.5:
            far = 2.5 / turn
        comply = arm != EXIT and (arm in (TANGENT, ONWARD) or _draw(tree) < 0.7)
        n, left = _push(pair, tree, far, comply, length)
        if arm == EXIT and left <= 0.0:
            count[AT] = node
            return True
        if arm != EXIT:
            arms[arm, 2] *= GROW if left < 0.5 * far else SHRINK
            arms[arm, 2] = min(max(arms[arm, 2], SCALES[0] * length), SCALES[1] * length)
        if n == 0:
            continue
        place, end = count[NODES], tree.chain[n - 1]
        quaternion_of(end, tree.turn[place])
        q = tree.turn[place]
        _, new = _nearest(tree, (end[9], end[10], end[11]), (q[0], q[1], q[2], q[3]), length)
        spacing = arms[EXIT, 2]  # a third or so of the pushes come to something new
        arms[EXIT, 2] = min(max(spacing * (WIDER if new >= spacing else NARROWER), LEAST * length), 0.3 * length)
        if new < spacing:
            continue
        arms[arm, 1] += min(1.0, new / length)
        for k in range(n):
            for d in range(12):
                tree.pose[place + k, d] = tree.chain[k, d]
            quaternion_of(tree.chain[k], tree.turn[place + k])
            tree.parent[place + k] = node if k == 0 else place + k - 1
            tree.tries[place + k] = 0
        count[NODES] += n
        if _is_beside(tree, guide, end):
            count[AT] = count[NODES] - 1
            return True
    return False


@inner_kernel
def _is_beside(tree, guide, pose):
    """Whether an axis-aligned plane separates the group at a pose from the static parts; its normal is `tree.out`."""
    for k in range(3):
        tree.out[k] = 0.0
    for k in range(3):
        if pose[9 + k] > guide.box[1, k] + guide.length:
            tree.out[k] = 1.0
            return True
        if pose[9 + k] < guide.box[0, k] - guide.length:
            tree.out[k] = -1.0
            return True
    return False


# --- from Python -----------------------------------------------------------------------------------------------------

_grow, _meets_within = EntryPoint(grow), EntryPoint(meets_within)


def search(
    assembly: Assembly, group: Sequence[int], others: Sequence[int], cone: EscapeCone, budget: Budget, seed: int
) -> SearchResult:
    """Grow trees until a path passes the sweeps, or the budget is used up."""
    pushes = Pushes(assembly, group, others, budget)
    tree = _Search(pushes, cone, seed)
    try:
        return tree.run()
    except BudgetError:
        tree.note_last()
        return pushes.found(None, budget.ended)


class _Search:
    def __init__(self, pushes: Pushes, cone: EscapeCone, seed: int) -> None:
        assembly, group = pushes.assembly, pushes.group
        self.pushes = pushes
        static = [j for j in pushes.others if any(frozenset((i, j)) not in assembly.ignored for i in group)]
        self.static_parts, shift = static, translation(0.0 - pushes.center)
        self.static, self.first_static = _joined(assembly, static, shift)
        self.moving, self.first_moving = _joined(assembly, group, shift)
        corners = np.concatenate([assembly.sweeps.corners(j) for j in pushes.others]) - pushes.center
        axes = [*(ways.own_axes(assembly, group) or ways.AXES)[::2], *ways.own_axes(assembly, pushes.others)[:6:2]]
        twists = np.array(cone.twists()).reshape(-1, 6)
        self.guide = Guide(
            twists, np.array(axes), np.array(ways.directions(assembly, group, pushes.others, cone)[:20]),
            np.array([corners.min(axis=0), corners.max(axis=0)]), pushes.length,
        )  # fmt: skip
        self.enabled = self._enabled(static)
        self.pair = self._pair()
        self.tree = _new_tree(pushes.length)
        self.certified: dict[int, bool] = {}
        self.random = np.random.default_rng(seed)

    def run(self) -> SearchResult:
        for trees in count(1):
            self._root()
            while self.tree.count[TESTS] < FIRST * (trees & -trees):
                before = int(self.tree.count[TESTS])
                self.tree.numbers[:] = self.random.random(NUMBERS)
                found = _grow.call(self.pair, self.tree, self.guide, before + CHUNK)
                self.pushes.budget.ask(-(-(int(self.tree.count[TESTS]) - before) // TESTS_A_QUESTION))
                self._note_reached()
                way = self._certified_way() if found else None
                if way is not None:
                    return self.pushes.found(way)
                if self.tree.count[NODES] + BENDS + 1 >= len(self.tree.parent):
                    self.tree = _larger(self.tree)
        raise AssertionError("the budget ends it")

    def _pair(self) -> MeshPair:
        return prepare_pair(self.static, self.moving, self.enabled)

    def _enabled(self, static: Sequence[int]) -> NDArray[np.uint8]:
        """(static, moving surfaces) uint8, 0 for ignored parts and for fits and threads, whose facets cross."""
        assembly, ka, kb = self.pushes.assembly, self.static.n_surfaces, self.moving.n_surfaces
        mask = np.ones((ka, kb), np.uint8)
        for i, own in zip(self.pushes.group, self.first_moving, strict=True):
            for j, at in zip(static, self.first_static, strict=True):
                if frozenset((i, j)) in assembly.ignored:
                    mask[at : at + assembly.meshes[j].n_surfaces, own : own + assembly.meshes[i].n_surfaces] = 0
                for mine, theirs in assembly.excused(i, j):
                    mask[np.ix_([at + s for s in theirs], [own + s for s in mine])] = 0
        return mask

    def _root(self) -> None:
        """Start a tree at the initial pose.

        If the group intersects others there, start at the nearest free displacement found that a sweep reaches; without
        one exclude the surfaces that touch at the initial pose.
        """
        tree, length = _new_tree(self.pushes.length), self.pushes.length
        self.tree, self.certified, self.pair.last[0] = tree, {}, -1
        _set(tree, 0, pin.SE3.Identity())
        tree.parent[0], tree.count[NODES] = -1, 1
        if not self._meets(pin.SE3.Identity(), pin.SE3.Identity()):
            return
        for size in np.geomspace(1e-5, 3e-2, 8) * length:
            for _ in range(25):
                x = self.random.normal(size=6)
                if len(self.guide.twists) and self.random.random() < 0.7:
                    x = 0.2 * x + 3.0 * self.random.random(len(self.guide.twists)) @ self.guide.twists
                else:
                    x[3:] /= length
                x *= size / (np.linalg.norm(x[:3]) + length * np.linalg.norm(x[3:]))
                at = pin.exp6(x)
                if self._meets(at, at):
                    continue
                _, stop = self.pushes.push(pin.SE3.Identity(), self._displacement(at))
                if stop is None:
                    _set(tree, 1, at)
                    tree.parent[1], tree.count[NODES], tree.tries[0] = 0, 2, -1
                    self.certified[1] = True
                    return
        self.enabled[tuple(colliding_surfaces(self.static, self.moving, pin.SE3.Identity()).T)] = 0
        self.pair = self._pair()

    def _meets(self, first: pin.SE3, last: pin.SE3) -> bool:
        """Whether the group intersects others at sampled poses on the screw from one pose to another."""
        twist = np.asarray(pin.log6(first.actInv(last)))
        far = float(np.linalg.norm(twist[:3]) + self.pushes.length * np.linalg.norm(twist[3:]))
        screw = self.tree.screw
        screw[:9], screw[9:12], screw[12:] = first.rotation.ravel(), first.translation, twist
        return bool(_meets_within.call(self.pair, self.tree, max(1, int(np.ceil(far / (STEP * self.pushes.length))))))

    def _displacement(self, at: pin.SE3) -> pin.SE3:
        """The displacement of the group for a pose of its centre frame."""
        return translation(self.pushes.center) * at * translation(0.0 - self.pushes.center)

    def _at(self, node: int) -> pin.SE3:
        row = self.tree.pose[node]
        return pin.SE3(row[:9].reshape(3, 3).copy(), row[9:].copy())

    def _note_reached(self) -> None:
        n = int(self.tree.count[NODES])
        self.pushes.reached = max(self.pushes.reached, float(np.linalg.norm(self.tree.pose[:n, 9:], axis=1).max()))

    def note_last(self) -> None:
        """Record the surfaces that intersected in the last test of the tree."""
        found = last_surfaces(self.pair, self.static, self.moving)
        if found is not None:
            k, m = bisect(self.first_static, found[0]) - 1, bisect(self.first_moving, found[1]) - 1
            j, i = self.static_parts[k], self.pushes.group[m]
            self.pushes.note(j, [(i, found[1] - self.first_moving[m], j, found[0] - self.first_static[k])])

    # -- a way out

    def _certified_way(self) -> ways.RemovalPath | None:
        """The path found, if all its legs pass the sweeps; else None, and the blocked node is cut off the tree."""
        nodes, node = [], int(self.tree.count[AT])
        while node >= 0:
            nodes.append(node)
            node = int(self.tree.parent[node])
        nodes = nodes[::-1]
        direction = ways.unit(self.tree.out)
        poses = [self._at(k) for k in nodes]
        kept = self._shortened(poses)
        knots = [pin.SE3.Identity()]
        for first, last in pairwise(kept):
            legs = self._legs(nodes, poses, first, last)
            if legs is None:
                return None
            knots += legs
        end = self.pushes.exit(knots[-1], direction)
        _, stop = self.pushes.push(knots[-1], end)
        if stop is not None:
            return None
        return self.pushes.cut_short("free", direction, [*knots, end])

    def _shortened(self, poses: Sequence[pin.SE3]) -> list[int]:
        """Indices of poses with screws between them that are free by tests."""
        kept = list(range(len(poses)))
        for k in range(SHORTCUTS):
            if len(kept) < 3:
                break
            span = max(2, (len(kept) - 1) >> (k // 30))
            i = int(self.random.integers(0, len(kept) - span))
            first, last = poses[kept[i]], poses[kept[i + span]]
            turn = float(np.linalg.norm(pin.log3(first.rotation.T @ last.rotation)))
            if kept[i] > 0 and turn < 2.5 and not self._meets(first, last):
                del kept[i + 1 : i + span]
        return kept

    def _legs(self, nodes: Sequence[int], poses: Sequence[pin.SE3], first: int, last: int) -> list[pin.SE3] | None:
        """Swept displacements from one pose to another: direct, or along the tree; None if both are blocked."""
        start, end = self._displacement(poses[first]), self._displacement(poses[last])
        if last - first > 1:
            _, stop = self.pushes.push(start, end)
            if stop is None:
                return [end]
        out = []
        for k in range(first, last):
            start, end, node = self._displacement(poses[k]), self._displacement(poses[k + 1]), nodes[k + 1]
            if node not in self.certified:
                _, stop = self.pushes.push(start, end)
                self.certified[node] = stop is None
            if not self.certified[node]:
                self._cut(node)
                return None
            out.append(end)
        return out

    def _cut(self, node: int) -> None:
        """Cut off a node and its descendants."""
        cut = {node}
        for k in range(node, int(self.tree.count[NODES])):  # a parent comes before its children
            if k == node or int(self.tree.parent[k]) in cut:
                cut.add(k)
                self.tree.tries[k] = -1


def _joined(assembly: Assembly, parts: Sequence[int], shift: pin.SE3) -> tuple[SurfaceMesh, list[int]]:
    """One mesh of parts at their initial poses, transformed by `shift`; the first surface of each part."""
    vertices, triangles, surfaces, first = [], [], [], []
    points = count = 0
    for i in parts:
        mesh, pose = assembly.meshes[i], shift * assembly.poses[i]
        vertices.append(mesh.vertices @ pose.rotation.T + pose.translation)
        triangles.append(mesh.triangles + points)
        surfaces.append(mesh.surface_of_triangle + count)
        first.append(count)
        points, count = points + len(mesh.vertices), count + mesh.n_surfaces
    return SurfaceMesh(np.concatenate(vertices), np.concatenate(triangles), np.concatenate(surfaces)), first


def _new_tree(length: float, room: int = 4096) -> Tree:
    arms = np.zeros((ARMS, 3))
    arms[:, 2] = 0.5 * length
    return Tree(
        np.zeros((room, 12)), np.zeros((room, 4)), np.zeros(room, np.int64), np.zeros(room, np.int64), arms,
        np.zeros(4, np.int64), np.zeros(NUMBERS), np.zeros(3), np.zeros((BENDS + 1, 12)), np.zeros(18),
        np.zeros((ROWS, 6)), np.zeros(12),
    )  # fmt: skip


def _larger(tree: Tree) -> Tree:
    """Double the capacity."""
    more = {name: np.concatenate([x := getattr(tree, name), np.zeros_like(x)]) for name in NODE_ARRAYS}
    return tree._replace(**more)


def _set(tree: Tree, node: int, at: pin.SE3) -> None:
    tree.pose[node, :9], tree.pose[node, 9:] = at.rotation.ravel(), at.translation
    tree.turn[node] = pin.Quaternion(at.rotation).coeffs()
