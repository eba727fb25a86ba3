"""The truth for triangles: arithmetic on Python integers, slow and obviously right. Shared by the tests."""

from fractions import Fraction
from itertools import product
from math import lcm
from typing import Any

import numpy as np

Vector = tuple[int, int, int]


def integers(corners: Any) -> list[Vector]:
    """Float64 points, scaled by one power of two so that all are integers: nothing is lost."""
    exact = [[Fraction(float(x)) for x in point] for point in corners]
    scale = lcm(*(x.denominator for point in exact for x in point))
    return [tuple(int(x * scale) for x in point) for point in exact]  # type: ignore[misc]


def sub(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def dot(a: Vector, b: Vector) -> int:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def triangles_meet(corners: Any) -> bool:
    """Whether the triangles of corners 0-2 and 3-5 meet: two convex sets are apart if and only if some direction
    separates them strictly, and for two triangles (or segments, or points) one of these directions does: the line
    between their nearest points is normal to a face, to two edges, to an edge towards a vertex, or joins two vertices.
    """
    points = integers(corners)
    a, b = points[:3], points[3:]
    edges_a = [sub(a[1], a[0]), sub(a[2], a[1]), sub(a[0], a[2])]
    edges_b = [sub(b[1], b[0]), sub(b[2], b[1]), sub(b[0], b[2])]
    joins = [sub(p, q) for p, q in product(a, b)]
    directions = [cross(edges_a[0], edges_a[1]), cross(edges_b[0], edges_b[1])]
    directions += [cross(e, f) for e, f in product(edges_a, edges_b)]
    directions += joins
    directions += [cross(e, cross(j, e)) for e, j in product(edges_a + edges_b, joins)]
    for n in directions:
        along_a, along_b = [dot(n, p) for p in a], [dot(n, p) for p in b]
        if max(along_a) < min(along_b) or max(along_b) < min(along_a):
            return False
    return True


def orient3d(a: Any, b: Any, c: Any, d: Any) -> int:
    """The sign of det[a - d, b - d, c - d]."""
    p = integers([a, b, c, d])
    value = dot(sub(p[0], p[3]), cross(sub(p[1], p[3]), sub(p[2], p[3])))
    return int(np.sign(value)) if abs(value) < 2**62 else (1 if value > 0 else -1)
