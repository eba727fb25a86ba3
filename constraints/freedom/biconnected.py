"""Blocks: the biconnected components of the constraint graph, whose motions are independent of each other.

Nodes are bodies (all fixed bodies are one node, the ground), edges are constraints. A block is a single pair, or loops
that share more than one body. The freedom of an assembly is the sum over its blocks, most of which are small.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from constraints.kinds.base import Constraint

GROUND = -1


@dataclass(frozen=True)
class Block:
    """One biconnected component, attached to `root`."""

    root: int
    """body (or GROUND) that connects the block to the rest"""
    bodies: tuple[int, ...]
    """the others, ascending"""
    constraints: tuple[int, ...]
    """indices in the given sequence, ascending"""


def blocks(constraints: Sequence[Constraint | None], fixed: Iterable[int]) -> tuple[Block, ...]:
    """Return the blocks in an order in which each root is the ground, a base body, or in an earlier block.

    The root of a component without a fixed body is its lowest body. Constraints between fixed bodies are in no block,
    nor is None in place of a constraint.
    """
    held = set(fixed)
    neighbours: dict[int, dict[int, list[int]]] = {}
    for i, c in enumerate(constraints):
        if c is None:
            continue
        a, b = (GROUND if x in held else x for x in c.bodies)
        if a != b:
            neighbours.setdefault(a, {}).setdefault(b, []).append(i)
            neighbours.setdefault(b, {}).setdefault(a, []).append(i)
    found: list[Block] = []
    depth: dict[int, int] = {}
    for start in sorted(neighbours):
        if start not in depth:
            found += _blocks_from(start, neighbours, depth)
    return tuple(found)


def _blocks_from(start: int, neighbours: dict[int, dict[int, list[int]]], depth: dict[int, int]) -> list[Block]:
    """Blocks of the component of `start`, by depth-first search (Hopcroft and Tarjan 1973), without recursion."""
    low: dict[int, int] = {start: 0}
    depth[start] = 0
    trail: list[tuple[int, int]] = []  # edges of blocks not yet complete
    stack = [(start, start, iter(sorted(neighbours[start])))]
    out: list[Block] = []
    while stack:
        node, parent, rest = stack[-1]
        for other in rest:
            if other == parent:
                continue
            if other not in depth:
                depth[other] = low[other] = len(stack)
                trail.append((node, other))
                stack.append((other, node, iter(sorted(neighbours[other]))))
                break
            if depth[other] < depth[node]:
                trail.append((node, other))
                low[node] = min(low[node], depth[other])
        else:
            stack.pop()
            if not stack:
                break
            low[parent] = min(low[parent], low[node])
            if low[node] >= depth[parent]:
                edges = []
                while True:
                    edges.append(trail.pop())
                    if edges[-1] == (parent, node):
                        break
                bodies = tuple(sorted({x for e in edges for x in e} - {parent}))
                members = tuple(sorted(i for a, b in edges for i in neighbours[a][b]))
                out.append(Block(parent, bodies, members))
    return out[::-1]  # a block is completed after those attached to it
