"""Construction of a `Bvh`: object-median splits along the longest axis, in blocks of 8, 64, 512 … items.

Ericson, *Real-Time Collision Detection*, 2005, 6.2. With whole blocks every node is full but the last of its level, so
that the number of nodes is known in advance, and eight consecutive blocks of one size form a block of the next size.
`bvh_of(mesh)` builds the hierarchy at the first call and keeps it on the mesh.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from collision.bvh.layout import LANES, LARGEST, NODE, PACKET, Bvh
from collision.errors import MeshError
from collision.mesh import SurfaceMesh
from collision.numeric.kernel import inner_kernel, kernel
from collision.reference.shape import triangles_needed

THREADS: Final = 2
"""threads that build hierarchies; the result does not depend on their number"""
WORTH_THREADS: Final = 4096
"""triangles of a mesh above which its surfaces are built on several threads"""


def bvh_of(mesh: SurfaceMesh) -> Bvh:
    """Return the mesh's hierarchy, built at the first call and kept on the mesh.

    Raises
    ------
    MeshError: a coordinate is beyond `LARGEST`.
    CollisionError: the mesh stands for a shape without triangles.
    """
    bvh: Bvh | None = mesh._cache.get("bvh")
    if bvh is None:
        build([mesh])
        bvh = mesh._cache["bvh"]
    return bvh


def build(meshes: Iterable[SurfaceMesh]) -> None:
    """Build the missing hierarchies of meshes on `THREADS` threads, which share the meshes, or a mesh's surfaces."""
    missing = list({id(mesh): mesh for mesh in meshes if "bvh" not in mesh._cache}.values())
    if len(missing) == 1:
        _build(missing[0], THREADS if missing[0].n_triangles > WORTH_THREADS else 1)
    elif missing:
        largest_first = sorted(missing, key=lambda mesh: -mesh.n_triangles)
        # fixed shares: handing meshes over one by one costs as much as the threads gain
        shares = [largest_first[t::THREADS] for t in range(THREADS)]
        _on_threads(lambda share: [_build(mesh, 1) for mesh in share], shares)  # type: ignore[func-returns-value]


def bounds_of(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """Return (7,) m: the box of the mesh's triangles, and the radius of the sphere about its centre that holds them.

    Computed at the first call and kept on the mesh; needs no hierarchy.
    """
    bounds: NDArray[np.float64] | None = mesh._cache.get("bounds")
    if bounds is None:
        used = mesh.vertices[np.unique(mesh.triangles)]
        low, high = mesh.bounds
        radius = np.linalg.norm(used - (0.5 * low + 0.5 * high), axis=1).max()
        bounds = mesh._cache["bounds"] = np.array([*low, *high, radius])
    return bounds


def nodes_over(boxes: int | NDArray[np.integer]) -> Any:
    """Return the number of nodes of all levels above that many boxes; 0 for a single box. Elementwise for an array."""
    boxes = np.asarray(boxes, np.int64)
    total = np.zeros_like(boxes)
    while (boxes > 1).any():
        boxes = np.where(boxes > 1, -(-boxes // LANES), 0)
        total += boxes
    return total


def _build(mesh: SurfaceMesh, threads: int) -> None:
    triangles_needed(mesh)
    largest = max(float(mesh.vertices.max()), -float(mesh.vertices.min()))
    if largest > LARGEST:
        raise MeshError(f"{mesh.name}: a coordinate is {largest:g}; the largest allowed is {LARGEST:g}", mesh.name)
    k, m = mesh.n_surfaces, mesh.n_triangles
    place = np.empty(k, np.int64)
    order_surfaces(mesh.vertices, mesh.triangles, mesh.order, mesh.surface_start, place)
    triangles = np.diff(mesh.surface_start)[place]
    packets = -(-triangles // LANES)
    above = 1 + int(nodes_over(k))
    # for each surface, in the order of the tree: its number, first triangle, first packet, first node
    plan = np.stack([place, _before(triangles), _before(packets), above + _before(nodes_over(packets))], axis=1)
    n, p = above + int(nodes_over(packets).sum()), int(packets.sum())
    box = bounds_of(mesh)
    bvh = Bvh(
        boxes=np.repeat(np.tile(np.array([np.inf, -np.inf], np.float32), n), NODE // 2),
        child=np.zeros(LANES * n, np.int32),
        size=np.zeros(LANES * n, np.float32),
        surface=np.full(LANES * n, -1, np.int32),
        root=np.empty(k, np.int32),
        packets=np.empty(PACKET * p, np.float32),
        first=np.empty(p + 1, np.int32),
        order=np.empty(m, np.int32),
        corner=np.empty(3 * m, np.int32),
        vertices=mesh.vertices.ravel(),
        frame=np.array([*(0.5 * (box[:3] + box[3:6])), *(0.5 * (box[3:6] - box[:3])), largest]),
    )
    given = mesh.vertices, mesh.triangles, mesh.order, mesh.surface_start, plan, bvh
    if threads == 1:
        build_surfaces(*given, 0, k)
    else:
        _on_threads(lambda share: build_surfaces(*given, *share), _shares(triangles, threads))
    close_top(bvh)
    for array in bvh:
        array.setflags(write=False)
    mesh._cache["bvh"] = bvh


def _before(counts: NDArray[Any]) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64)


def _on_threads(work: Callable[[Any], Any], shares: list[Any]) -> None:
    with ThreadPoolExecutor(THREADS) as pool:
        list(pool.map(work, shares))


def _shares(triangles: NDArray[Any], parts: int) -> list[tuple[int, int]]:
    """Consecutive ranges of surfaces of about equal triangle counts."""
    total = np.cumsum(triangles)
    cuts = np.searchsorted(total, [int(total[-1]) * i // parts for i in range(1, parts)])
    ends = [0, *(int(c) for c in cuts), len(triangles)]
    return [(a, b) for a, b in pairwise(ends) if b > a]


# --- kernels ---------------------------------------------------------------------------------------------------------


@inner_kernel
def select(keys, item, lo, hi, nth, key):
    """Hoare's quickselect: permute `item[lo:hi]` so that the first `nth - lo` have the least (keys[item], item).

    Partitions as Lomuto does, but without a branch that depends on a key; `key` is workspace, as long as `item`.
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


@inner_kernel
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


@kernel(allocates=True)
def order_groups(item, centre):
    """Permute `item` so that each block of 8, 64, 512 … consecutive items is compact, by their centres (3, n)."""
    key = np.empty(len(item))
    stack = np.empty((128, 2), np.int64)
    stack[0, 0], stack[0, 1] = 0, len(item)
    top = 1
    while top > 0:
        top -= 1
        lo, hi = stack[top, 0], stack[top, 1]
        n = hi - lo
        if n > LANES:
            block = LANES  # halves, but whole blocks of 8, 64, 512 … items, the greatest less than n
            while LANES * block < n:
                block *= LANES
            mid = lo + block * (((n + block - 1) // block + 1) >> 1)
            select(centre[longest_axis(centre, item, lo, hi)], item, lo, hi, mid, key)
            # number by number: numba takes two seconds to compile the error of a row of another length
            stack[top, 0], stack[top, 1] = mid, hi
            stack[top + 1, 0], stack[top + 1, 1] = lo, mid
            top += 2


@kernel(allocates=True)
def order_surfaces(vertices, triangles, by_surface, start, place):
    """Fill `place` (k,) with the surfaces in the order of the tree, by the centres of their boxes."""
    centre = np.empty((3, len(place)))
    for s in range(len(place)):
        place[s] = s
        for d in range(3):
            low, high = np.inf, -np.inf
            for i in range(start[s], start[s + 1]):
                t = by_surface[i]
                x, y, z = vertices[triangles[t, 0], d], vertices[triangles[t, 1], d], vertices[triangles[t, 2], d]
                low, high = min(low, x, y, z), max(high, x, y, z)
            centre[d, s] = 0.5 * low + 0.5 * high
    order_groups(place, centre)


@inner_kernel
def rounded_down(x):
    """A float32 not above x."""
    y = np.float32(x)
    return y - abs(y) * np.float32(1.2e-7)


@inner_kernel
def rounded_up(x):
    """A float32 not below x."""
    y = np.float32(x)
    return y + abs(y) * np.float32(1.2e-7)


@inner_kernel
def hold_children(bvh, lane, node):
    """Set the box in a lane to the union of the eight boxes of a node, and the node as its child."""
    to, at = NODE * (lane // LANES) + lane % LANES, NODE * node
    size = np.float32(0.0)
    for d in range(3):
        low, high = np.float32(np.inf), np.float32(-np.inf)
        for k in range(LANES):
            low = min(low, bvh.boxes[at + LANES * d + k])
            high = max(high, bvh.boxes[at + LANES * (d + 3) + k])
        bvh.boxes[to + LANES * d], bvh.boxes[to + LANES * (d + 3)] = low, high
        size += high - low
    bvh.size[lane], bvh.child[lane] = size, node


@inner_kernel
def add_levels(bvh, node, nodes, surface):
    """Build the levels above `nodes` consecutive nodes of one surface, or of several (-1); return the top node."""
    while nodes > 1:
        above = node + nodes
        for i in range(nodes):
            hold_children(bvh, LANES * above + i, node + i)
            bvh.surface[LANES * above + i] = surface
        node = above
        nodes = (nodes + LANES - 1) // LANES
    return node


@inner_kernel
def add_packet(vertices, bvh, lane, packet, begin, end):
    """Build the packet of the triangles `begin` … `end` - 1, and its box in a lane."""
    boxes, corner = bvh.boxes, bvh.corner
    to = NODE * (lane // LANES) + lane % LANES
    bvh.child[lane], bvh.first[packet] = ~packet, begin
    size = np.float32(0.0)
    for d in range(3):
        low, high = np.inf, -np.inf
        for i in range(3 * begin, 3 * end):
            low, high = min(low, vertices[corner[i], d]), max(high, vertices[corner[i], d])
        x0, x1 = rounded_down(low - bvh.frame[d]), rounded_up(high - bvh.frame[d])
        boxes[to + LANES * d], boxes[to + LANES * (d + 3)] = x0, x1
        size += x1 - x0
        centre = bvh.frame[d] + 0.5 * (np.float64(x0) + np.float64(x1))
        for c in range(3):
            row = PACKET * packet + LANES * (3 * c + d)
            for t in range(LANES):
                x = np.inf
                if begin + t < end:
                    x = vertices[corner[3 * (begin + t) + c], d] - centre
                bvh.packets[row + t] = x
    bvh.size[lane] = size


@kernel(allocates=True)
def build_surfaces(vertices, triangles, by_surface, start, plan, bvh, place_from, place_to):
    """Build the subtrees of the surfaces at the places `place_from` … `place_to` - 1 of the plan; the nodes above them
    are left to `close_top`."""
    one = len(plan) == 1
    for place in range(place_from, place_to):
        s, triangle, packet, node = plan[place]
        m = start[s + 1] - start[s]
        centre, item = np.empty((3, m)), np.empty(m, np.int64)
        for i in range(m):
            item[i] = i
            t = by_surface[start[s] + i]
            a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            for d in range(3):
                x, y, z = vertices[a, d], vertices[b, d], vertices[c, d]
                centre[d, i] = 0.5 * min(x, y, z) + 0.5 * max(x, y, z)
        order_groups(item, centre)
        for i in range(m):
            t = by_surface[start[s] + item[i]]
            bvh.order[triangle + i] = t
            for c in range(3):
                bvh.corner[3 * (triangle + i) + c] = triangles[t, c]
        lane = 0 if one else LANES + place
        bvh.root[s], bvh.surface[lane] = lane, s
        packets = (m + LANES - 1) // LANES
        for p in range(packets):
            begin = triangle + LANES * p
            end = min(begin + LANES, triangle + m)
            own = LANES * node + p if packets > 1 else lane
            bvh.surface[own] = s
            add_packet(vertices, bvh, own, packet + p, begin, end)
        if packets > 1:
            hold_children(bvh, lane, add_levels(bvh, node, (packets + LANES - 1) // LANES, s))


@kernel(allocates=True)
def close_top(bvh):
    """Build the nodes above the surfaces, whose subtrees must exist, and end the list of packets."""
    bvh.first[len(bvh.first) - 1] = len(bvh.order)
    k = len(bvh.root)
    if k > 1:
        hold_children(bvh, 0, add_levels(bvh, 1, (k + LANES - 1) // LANES, -1))
