"""Numba kernels that build a `MeshTree` and a `WideTree`, see `collision.tree` and `collision.wide` for the layouts."""

from __future__ import annotations

import numpy as np
from numba import njit

import collision.compiling  # noqa: F401, says so on standard error
from collision.wide import BOXES, COUNT, FIRST, INFO, LANES, NUMBER, STARTS, TOP, TRIANGLES


@njit(cache=True, nogil=True)
def select(keys, item, lo, hi, nth, key):
    """Hoare's quickselect: permute `item[lo:hi]` so that the first `nth - lo` have the least (keys[item], item).

    Partitions as Lomuto does, but without a branch that depends on a key; `key` is scratch, as long as `item`.
    """
    for i in range(lo, hi):
        key[i] = keys[item[i]]
    hi -= 1
    while lo < hi:
        mid = (lo + hi) >> 1
        a, b, c = key[lo], key[mid], key[hi]
        if (a < b) != (a < c):
            pivot = lo
        elif (b < a) != (b < c):
            pivot = mid
        else:
            pivot = hi
        kp, ip = key[pivot], item[pivot]
        key[pivot], item[pivot] = key[hi], item[hi]
        less = lo
        for i in range(lo, hi):
            k, it = key[i], item[i]
            key[i], item[i] = key[less], item[less]
            key[less], item[less] = k, it
            less += np.int64((k < kp) | ((k == kp) & (it < ip)))
        key[hi], item[hi] = key[less], item[less]
        key[less], item[less] = kp, ip
        if nth < less:
            hi = less - 1
        elif nth > less + 1:
            lo = less + 1
        else:
            return


@njit(cache=True, nogil=True)
def longest_axis(centre, item, lo, hi):
    """The axis along which the centres of `item[lo:hi]` spread most."""
    i = item[lo]
    x0 = x1 = centre[0, i]
    y0 = y1 = centre[1, i]
    z0 = z1 = centre[2, i]
    for k in range(lo + 1, hi):
        i = item[k]
        x, y, z = centre[0, i], centre[1, i], centre[2, i]
        x0, y0, z0 = min(x0, x), min(y0, y), min(z0, z)
        x1, y1, z1 = max(x1, x), max(y1, y), max(z1, z)
    dx, dy, dz = x1 - x0, y1 - y0, z1 - z0
    if dx >= dy and dx >= dz:
        return 0
    return 1 if dy >= dz else 2


@njit(cache=True, nogil=True)
def middle(n, leaf):
    """Where to split n > leaf items: halves, but whole blocks of leaf, 8, 64, 512 … items, the greatest less than n.

    So any eight consecutive blocks of one size are a block of the next: see `collision.wide`.
    """
    block = leaf
    if n > 8:
        block = 8
        while 8 * block < n:
            block *= 8
    return block * (((n + block - 1) // block + 1) >> 1)


@njit(cache=True, nogil=True)
def _box_of(vertices, triangles, which):
    """Least x, y, z, greatest x, y, z of the triangles `triangles[which]`."""
    x0 = y0 = z0 = np.inf
    x1 = y1 = z1 = -np.inf
    for t in which:
        for c in range(3):
            v = triangles[t, c]
            x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
            x0, y0, z0 = min(x0, x), min(y0, y), min(z0, z)
            x1, y1, z1 = max(x1, x), max(y1, y), max(z1, z)
    return x0, y0, z0, x1, y1, z1


@njit(cache=True, nogil=True)
def plan_top(vertices, triangles, by_surface, start, leaf, second, past, first, count, root, begin):
    """Lay out the nodes above the surfaces: `root`, and `begin`, where each surface's triangles begin in leaf order."""
    k = len(start) - 1
    centre = np.empty((3, k))
    for s in range(k):
        box = _box_of(vertices, triangles, by_surface[start[s] : start[s + 1]])
        for d in range(3):
            centre[d, s] = 0.5 * box[d] + 0.5 * box[d + 3]
    item, key = np.empty(k, np.int64), np.empty(k)
    for s in range(k):
        item[s] = s
    # a stack of ranges of surfaces still to be laid out; the parent waits for its second child's place
    stack = np.empty((2 * k + 2, 3), np.int64)
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, k, -1
    top = 1
    node = 0
    triangle = 0
    while top > 0:
        top -= 1
        lo, hi, parent = stack[top, 0], stack[top, 1], stack[top, 2]
        if parent >= 0:
            second[parent] = node
        if hi - lo == 1:
            s = item[lo]
            m = start[s + 1] - start[s]
            root[s] = node
            begin[s] = triangle
            node += 2 * ((m + leaf - 1) // leaf) - 1
            triangle += m
            continue
        mid = lo + middle(hi - lo, 1)
        select(centre[longest_axis(centre, item, lo, hi)], item, lo, hi, mid, key)
        triangles_below = 0
        nodes_below = hi - lo - 1
        for i in range(lo, hi):
            m = start[item[i] + 1] - start[item[i]]
            triangles_below += m
            nodes_below += 2 * ((m + leaf - 1) // leaf) - 1
        first[node] = triangle
        count[node] = triangles_below
        past[node] = node + nodes_below
        stack[top, 0], stack[top, 1], stack[top, 2] = mid, hi, node
        stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = lo, mid, -1
        top += 2
        node += 1


@njit(cache=True, nogil=True)
def build_surface(
    vertices, triangles, by_surface, start, leaf,
    box, second, past, first, count, surface, root, begin, order, corner, surface_from, surface_to,
):  # fmt: skip
    """Build the subtrees of the surfaces `surface_from` … `surface_to` - 1."""
    stack = np.empty((128, 3), np.int64)
    for s in range(surface_from, surface_to):
        m = start[s + 1] - start[s]
        centre = np.empty((3, m))
        item, key = np.empty(m, np.int64), np.empty(m)
        for i in range(m):
            item[i] = i
            t = by_surface[start[s] + i]
            a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            for d in range(3):
                x, y, z = vertices[a, d], vertices[b, d], vertices[c, d]
                centre[d, i] = 0.5 * min(x, y, z) + 0.5 * max(x, y, z)
        node = root[s]
        end = node + 2 * ((m + leaf - 1) // leaf) - 1
        stack[0, 0], stack[0, 1], stack[0, 2] = 0, m, -1
        top = 1
        while top > 0:
            top -= 1
            lo, hi, parent = stack[top, 0], stack[top, 1], stack[top, 2]
            if parent >= 0:
                second[parent] = node
            leaves = (hi - lo + leaf - 1) // leaf
            first[node] = begin[s] + lo
            count[node] = hi - lo
            past[node] = node + 2 * leaves - 1
            surface[node] = s
            if leaves > 1:
                mid = lo + middle(hi - lo, leaf)
                select(centre[longest_axis(centre, item, lo, hi)], item, lo, hi, mid, key)
                # number by number: numba takes two seconds to compile the error of a row of another length
                stack[top, 0], stack[top, 1], stack[top, 2] = mid, hi, node
                stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = lo, mid, -1
                top += 2
            node += 1
        for i in range(m):
            t = by_surface[start[s] + item[i]]
            order[begin[s] + i] = t
            for c in range(3):
                corner[begin[s] + i, c] = triangles[t, c]
        for node in range(end - 1, root[s] - 1, -1):
            if second[node] >= 0:
                _join(box, node, second[node])
            else:
                leaf_box = _box_of(vertices, corner, range(first[node], first[node] + count[node]))
                for d in range(6):
                    box[node, d] = leaf_box[d]


@njit(cache=True, nogil=True)
def _join(box, node, other):
    """The box of an inner node from its two children's."""
    for d in range(3):
        box[node, d] = min(box[node + 1, d], box[other, d])
        box[node, d + 3] = max(box[node + 1, d + 3], box[other, d + 3])


@njit(cache=True, nogil=True)
def close_top(box, second, surface):
    """The boxes of the nodes above the surfaces, once those are built."""
    for node in range(len(second) - 1, -1, -1):
        if surface[node] < 0:
            _join(box, node, second[node])


@njit(cache=True, nogil=True)
def _down(x):
    """A float32 not above x."""
    y = np.float32(x)
    return y - abs(y) * np.float32(1.2e-7)


@njit(cache=True, nogil=True)
def _up(x):
    y = np.float32(x)
    return y + abs(y) * np.float32(1.2e-7)


@njit(cache=True, nogil=True)
def add_levels(nodes, at, boxes):
    """Fill the levels above a level of `boxes` inner nodes at `nodes[at]`; the place after the last."""
    while boxes > 1:
        above = at + BOXES * boxes
        for i in range(LANES * ((boxes + LANES - 1) // LANES)):
            to = above + BOXES * (i // LANES) + i % LANES
            for d in range(3):
                low, high = np.float32(np.inf), np.float32(-np.inf)
                if i < boxes:
                    for k in range(LANES):
                        low = min(low, nodes[at + BOXES * i + LANES * d + k])
                        high = max(high, nodes[at + BOXES * i + LANES * (d + 3) + k])
                nodes[to + LANES * d] = low
                nodes[to + LANES * (d + 3)] = high
        at = above
        boxes = (boxes + LANES - 1) // LANES
    return at + BOXES * boxes


@njit(cache=True, nogil=True)
def widen(vertices, corner, box, second, first, count, root, by_place, frame, nodes, info):
    """Fill `nodes` and `info` of a `WideTree` from the binary tree's arrays; `by_place`: the surfaces by root.

    Leaves of both trees are the same.
    """
    k = len(root)
    level = (k + LANES - 1) // LANES
    at = BOXES * level
    while level > 1:
        level = (level + LANES - 1) // LANES
        at += BOXES * level
    for i in range((k + LANES - 1) // LANES):
        empty_node(nodes, BOXES * i)
    for place in range(k):
        s = by_place[place]
        begin = first[root[s]]
        m = count[root[s]]
        leaves = (m + LANES - 1) // LANES
        above = at + TRIANGLES * leaves
        o = INFO * place
        info[o + NUMBER], info[o + FIRST], info[o + COUNT] = s, begin, m
        if leaves > 1:
            for i in range((leaves + LANES - 1) // LANES):
                empty_node(nodes, above + BOXES * i)
        top = BOXES * (place // LANES) + place % LANES
        level = _levels(info, o, at, above, leaves)
        info[o + STARTS + level] = top
        leaf = root[s] - 1
        for i in range(leaves):
            low, high = begin + LANES * i, begin + min(m, LANES * (i + 1))
            leaf += 1
            while second[leaf] >= 0:
                leaf += 1
            own = above + BOXES * (i // LANES) + i % LANES if leaves > 1 else top
            for d in range(3):
                nodes[own + LANES * d] = _down(box[leaf, d] - frame[d])
                nodes[own + LANES * (d + 3)] = _up(box[leaf, d + 3] - frame[d])
                nodes[top + LANES * d] = min(nodes[top + LANES * d], nodes[own + LANES * d])
                nodes[top + LANES * (d + 3)] = max(nodes[top + LANES * (d + 3)], nodes[own + LANES * (d + 3)])
                # as the query computes it
                centre = 0.5 * (np.float64(nodes[own + LANES * d]) + np.float64(nodes[own + LANES * (d + 3)]))
                for c in range(3):
                    row = at + TRIANGLES * i + LANES * (3 * c + d)
                    for t in range(LANES):
                        x = np.inf
                        if low + t < high:
                            x = vertices[corner[low + t, c], d] - frame[d] - centre
                        nodes[row + t] = x
        at = above
        if leaves > 1:
            at = add_levels(nodes, above, (leaves + LANES - 1) // LANES)
    add_levels(nodes, np.int64(0), (k + LANES - 1) // LANES)
    o = INFO * k
    info[o + NUMBER], info[o + FIRST], info[o + COUNT] = -1, 0, k
    _levels(info, o, np.int64(0), BOXES * ((k + LANES - 1) // LANES), (k + LANES - 1) // LANES)


@njit(cache=True, nogil=True)
def _levels(info, o, at, above, boxes):
    """Note in the row at `info[o]` where levels over `boxes` nodes at `at` begin, from 2 on at `above`; how many."""
    info[o + STARTS] = at
    level = 1
    while boxes > 1:
        info[o + STARTS + level] = above
        level += 1
        boxes = (boxes + LANES - 1) // LANES
        above += BOXES * boxes
    info[o + TOP] = level
    return level


@njit(cache=True, nogil=True)
def empty_node(nodes, at):
    """An inner node without boxes."""
    for i in range(3 * LANES):
        nodes[at + i] = np.inf
        nodes[at + 3 * LANES + i] = -np.inf
