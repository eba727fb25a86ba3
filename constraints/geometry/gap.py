"""The gap of two trimmed faces on planes, cylinders, cones, spheres and tori, from the surfaces themselves.

Where the distance of two faces is least, or the depth of one in the other greatest, the nearest points lie inside both
faces, on a border of one of them, or on a border of each. Each of the three is a smooth minimisation in two, one and
two parameters, of a distance in closed form:

- inside both: the signed distance to one surface, minimised over the other by Newton's method in its tangent planes;
- border and inside: the same over the border, a curve in which the surfaces of two neighbouring faces meet;
- two borders: the distance of two such curves.

They start at vertices of the facets, which lie on the surfaces, and at the facets' witness. A stationary point counts
if it lies in both faces. Which side of a curved border a point lies on is decided by the neighbour's surface, not by
chords. What the facets and their deflection rule out is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import SurfaceMesh
from collision.numeric.kernel import inner_kernel, kernel
from collision.numeric.point_triangle import closest_on_triangle
from collision.numeric.vectors import along, cross, dot, norm, row, sub
from constraints.geometry.surfaces import Cone, Cylinder, Freeform, Geometry, Plane, Sphere, Torus

Array = NDArray[np.float64]

PLANE, CYLINDER, CONE, SPHERE, TORUS, FREEFORM = range(6)
STRAIGHT, CURVE, SMOOTH, UNKNOWN = range(4)
"""sides of a border: exact as they are; on the curve in which two surfaces meet; on one along which two surfaces are
tangent; of an unknown curve, because the neighbour is freeform or missing"""
TANGENT: Final = 0.02
"""rad: surfaces that meet at less are tangent"""
SAME: Final = 1e-9
"""m: points nearer than this to a surface or to a border lie on it"""
RIM: Final = 1e-8
"""m: a foot nearer than this to a border may be on the neighbouring face as well"""
SEEDS: Final = 12
"""local minima among the vertices of a face from which the interior is searched"""
TINY: Final = 1e-300


class Faces(NamedTuple):
    """Trimmed faces of a part, by their index in its mesh; lengths in m, in the part's or the world's frame."""

    geometry: Array
    """(n, 9) kind, point, direction, two sizes: radius; cosine and sine; radius; major and minor radius"""
    sense: Array
    """(n,) 1 where the outward normal is the surface's own, else -1"""
    vertices: Array
    """(v, 3)"""
    triangles: NDArray[np.int64]
    """(m, 3) by face"""
    first: NDArray[np.int64]
    """(n + 1,) where each face's triangles begin"""
    corners: NDArray[np.int64]
    """(c,) vertices of the faces, by face"""
    first_corner: NDArray[np.int64]
    """(n + 1,) where each face's vertices begin"""
    sides: NDArray[np.int64]
    """(k, 4) of the faces' borders, by face: start, end, neighbouring face or -1, and one of STRAIGHT … UNKNOWN"""
    first_side: NDArray[np.int64]
    """(n + 1,) where each face's sides begin"""
    inward: Array
    """(k, 3) unit: from each side into its face, in the plane of its triangle"""
    deflection: Array
    """(k,) bound of the distance between each side and the border's curve"""


def faces_of(
    mesh: SurfaceMesh, geometries: Sequence[Geometry], senses: Sequence[int], deflections: Array
) -> Faces:  # fmt: skip
    """Return the trimmed faces of a part, in its own frame.

    Parameters
    ----------
    geometries, senses: of each face, as in `constraints.geometry.features.group_features`.
    deflections: (n,) m, between each face's triangles and its surface.
    """
    order = np.argsort(mesh.surface_of_triangle, kind="stable")
    triangles = mesh.triangles[order].astype(np.int64)
    owner = mesh.surface_of_triangle[order].astype(np.int64)
    n = len(geometries)
    rows = np.array([_row(geometry) for geometry in geometries], dtype=np.float64).reshape(n, 9)
    corners = mesh.vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    start, end = triangles.reshape(-1), np.roll(triangles, -1, axis=1).reshape(-1)
    key = np.minimum(start, end) * len(mesh.vertices) + np.maximum(start, end)
    by_key = np.argsort(key, kind="stable")
    _, at, count = np.unique(key[by_key], return_index=True, return_counts=True)
    other = np.full(len(key), -1, np.int64)
    twins = at[count == 2]
    other[by_key[twins]], other[by_key[twins + 1]] = owner[by_key[twins + 1] // 3], owner[by_key[twins] // 3]
    own = np.repeat(owner, 3)
    border = np.flatnonzero(other != own)
    own, other, a, b = own[border], other[border], start[border], end[border]
    chord = mesh.vertices[b] - mesh.vertices[a]
    inward = np.cross(normals[border // 3], chord)
    inward /= np.maximum(np.linalg.norm(inward, axis=1), TINY)[:, None]
    used = np.unique(np.repeat(owner, 3) * len(mesh.vertices) + start)
    kind, deflection = np.empty(len(border), np.int64), np.empty(len(border))
    _sides(rows, deflections, mesh.vertices, own, other, a, b, kind, deflection)
    return Faces(
        rows,
        np.array(senses, dtype=np.float64),
        np.array(mesh.vertices, dtype=np.float64, order="C"),
        np.ascontiguousarray(triangles),
        np.searchsorted(owner, np.arange(n + 1)).astype(np.int64),
        used % len(mesh.vertices),
        np.searchsorted(used // len(mesh.vertices), np.arange(n + 1)).astype(np.int64),
        np.ascontiguousarray(np.stack([a, b, other, kind], axis=1)),
        np.searchsorted(own, np.arange(n + 1)).astype(np.int64),
        np.ascontiguousarray(inward),
        deflection,
    )


def moved(faces: Faces, pose: pin.SE3) -> Faces:
    """Return faces in the frame that `pose` maps into."""
    turn, shift = np.ascontiguousarray(pose.rotation.T), pose.translation
    geometry = faces.geometry.copy()
    geometry[:, 1:4] = geometry[:, 1:4] @ turn + shift
    geometry[:, 4:7] = geometry[:, 4:7] @ turn
    vertices = faces.vertices @ turn + shift
    return faces._replace(geometry=geometry, vertices=vertices, inward=np.ascontiguousarray(faces.inward @ turn))


def gap(
    a: Faces, face_a: int, b: Faces, face_b: int, low: float, high: float, seed: Array
) -> tuple[float, float, Array]:  # fmt: skip
    """Return least and greatest value, m, of the signed gap of two faces, and the point (3,) where it is least.

    Negative gaps are depths: of the point of one face that is deepest behind the other.

    Parameters
    ----------
    a, b: in one frame; neither face is freeform.
    low, high: bounds of the gap from the facets, m. The result lies within; these bounds themselves, and `seed`, are
        returned where no stationary point lies in both faces.
    seed: (3,) m, near the nearest or deepest points of the facets.
    """
    out = np.array([np.inf, np.inf, *seed, np.inf])
    _gap(a, face_a, b, face_b, low, high, np.asarray(seed, dtype=np.float64), out)
    if not np.isfinite(out[0]):
        return low, high, out[2:5]
    least = max(low, float(out[0]))
    return least, max(least, min(high, float(out[1]))), out[2:5]


def _row(geometry: Geometry) -> tuple[float, ...]:
    match geometry:
        case Plane():
            return (PLANE, *geometry.origin, *geometry.normal, 0.0, 0.0)
        case Cylinder():
            return (CYLINDER, *geometry.origin, *geometry.axis, geometry.radius, 0.0)
        case Cone():
            return (CONE, *geometry.apex, *geometry.axis, np.cos(geometry.half_angle), np.sin(geometry.half_angle))
        case Sphere():
            return (SPHERE, *geometry.center, 0.0, 0.0, 1.0, geometry.radius, 0.0)
        case Torus():
            return (TORUS, *geometry.center, *geometry.axis, geometry.major, geometry.minor)
        case Freeform():
            return (FREEFORM, *np.zeros(8))
    raise TypeError(f"{geometry!r} is no known surface")


@inner_kernel
def _radial(u, v):  # pragma: no cover - compiled
    """A unit vector along u, which is at right angles to v; any at right angles to v where u is 0, and the length."""
    length = norm(u)
    if length > 1e-15:
        return (u[0] / length, u[1] / length, u[2] / length), length
    w = (1.0, 0.0, 0.0) if abs(v[0]) < 0.6 else (0.0, 1.0, 0.0)
    w = along(w, -dot(v, w), v)
    length = norm(w)
    return (w[0] / length, w[1] / length, w[2] / length), 1e-15


@inner_kernel
def _field(g, x):  # pragma: no cover - compiled
    """Signed distance of x, its gradient n, and its Hessian k tt' + m ss' as (k, t, m, s)."""
    kind = int(g[0])
    q = (x[0] - g[1], x[1] - g[2], x[2] - g[3])
    a = (g[4], g[5], g[6])
    zero = (0.0, 0.0, 0.0)
    if kind == PLANE:
        return dot(q, a), a, 0.0, zero, 0.0, zero
    if kind == SPHERE:
        n, length = _radial(q, a)
        t, _ = _radial(zero, n)
        return length - g[7], n, 1.0 / length, t, 1.0 / length, cross(n, t)
    h = dot(q, a)
    e, rho = _radial(along(q, -h, a), a)
    t = cross(a, e)
    if kind == CYLINDER:
        return rho - g[7], e, 1.0 / rho, t, 0.0, zero
    if kind == CONE:
        c, s = g[7], g[8]
        if h * c + rho * s < 0.0:  # nearest is the apex
            n, length = _radial(q, t)
            t, _ = _radial(zero, n)
            return length, n, 1.0 / length, t, 1.0 / length, cross(n, t)
        n = (c * e[0] - s * a[0], c * e[1] - s * a[1], c * e[2] - s * a[2])
        return rho * c - h * s, n, c / rho, t, 0.0, zero
    u = rho - g[7]
    length = max(np.sqrt(u * u + h * h), 1e-15)
    n = ((u * e[0] + h * a[0]) / length, (u * e[1] + h * a[1]) / length, (u * e[2] + h * a[2]) / length)
    return length - g[8], n, u / (length * rho), t, 1.0 / length, cross(n, t)


@inner_kernel
def _onto(g, x):  # pragma: no cover - compiled
    """The nearest point of a surface."""
    d, n, _, _, _, _ = _field(g, x)
    return along(x, -d, n)


@inner_kernel
def _on_curve(g, h, kind, x):  # pragma: no cover - compiled
    """The point of a border of face g, with neighbour h, beside a point of a side."""
    if kind == STRAIGHT:
        return x
    for _ in range(8):
        d, n, _, _, _, _ = _field(g, x)
        if kind != CURVE:
            return along(x, -d, n)
        e, m, _, _, _, _ = _field(h, x)
        if abs(d) + abs(e) < 1e-14:
            break
        c = dot(n, m)
        w = max(1.0 - c * c, 1e-6)
        x = along(along(x, (c * e - d) / w, n), (c * d - e) / w, m)
    return x


@kernel
def _sides(geometry, deflections, vertices, own, other, a, b, kind, deflection):  # pragma: no cover - compiled
    """Classify the sides of borders, and bound their distance from the curves that they are chords of."""
    for k in range(len(own)):
        f, g = own[k], other[k]
        kind[k], deflection[k] = UNKNOWN, deflections[f]
        if g < 0:
            continue
        deflection[k] = max(deflections[f], deflections[g])
        if geometry[f, 0] == FREEFORM or geometry[g, 0] == FREEFORM:
            continue
        p, q = row(vertices, a[k]), row(vertices, b[k])
        x = along(p, 0.5, sub(q, p))
        d, n, _, _, _, _ = _field(geometry[f], x)
        e, m, _, _, _, _ = _field(geometry[g], x)
        if abs(d) <= SAME and abs(e) <= SAME:
            kind[k], deflection[k] = STRAIGHT, 0.0
        elif norm(cross(n, m)) < TANGENT:
            kind[k] = SMOOTH
        else:
            kind[k] = CURVE
            deflection[k] = min(
                1.5 * norm(sub(_on_curve(geometry[f], geometry[g], CURVE, x), x)) + SAME, norm(sub(q, p))
            )


@inner_kernel
def _beyond(faces, f, k, x):  # pragma: no cover - compiled
    """How far x, on the surface of face f, lies beyond the border at its side k, and how exactly that is known."""
    p = row(faces.vertices, faces.sides[k, 0])
    m = row(faces.inward, k)
    kind = faces.sides[k, 3]
    if kind == CURVE:
        g = faces.geometry[faces.sides[k, 2]]
        q = row(faces.vertices, faces.sides[k, 1])
        _, n, _, _, _, _ = _field(g, along(p, 0.5, sub(q, p)))
        d, _, _, _, _, _ = _field(g, x)
        return (-d if dot(n, m) > 0.0 else d), SAME
    return -dot(sub(x, p), m), SAME if kind == STRAIGHT else faces.deflection[k]


@inner_kernel
def _member(faces, f, x):  # pragma: no cover - compiled
    """Whether x, on the surface of face f, lies in the face: (1, 0, or 2 if an unknown border is too near; …).

    Also returned are the nearest side of the border, a second one if x is nearest to a corner, -1 for none, and the
    distance from the border, m, 0 on it.
    """
    y, near = x, np.inf
    side, twin = -1, -1
    for k in range(faces.first_side[f], faces.first_side[f + 1]):
        p, q = row(faces.vertices, faces.sides[k, 0]), row(faces.vertices, faces.sides[k, 1])
        u, w = sub(q, p), sub(x, p)
        length = dot(u, u)
        s = min(1.0, max(0.0, dot(u, w) / length)) if length > 0.0 else 0.0
        foot = along(p, s, u)
        d = norm(sub(x, foot))
        if d < near - 1e-13:
            y, near, side, twin = foot, d, k, -1
        elif d <= near + 1e-13:
            twin = k
    if side < 0:
        return 1, -1, -1, np.inf
    within = np.inf
    for k in range(faces.first[f], faces.first[f + 1]):
        p, q, r = (
            row(faces.vertices, faces.triangles[k, 0]),
            row(faces.vertices, faces.triangles[k, 1]),
            row(faces.vertices, faces.triangles[k, 2]),
        )
        limit = min(within, near)
        far = False
        for i in range(3):
            far |= x[i] < min(p[i], q[i], r[i]) - limit or x[i] > max(p[i], q[i], r[i]) + limit
        if far:
            continue
        z, _ = closest_on_triangle(x, p, q, r)
        within = min(within, norm(sub(x, z)))
    _, n, _, _, _, _ = _field(faces.geometry[f], x)
    w = sub(x, y)
    aside = norm(along(w, -dot(w, n), n))
    widest = faces.deflection[side] if twin < 0 else max(faces.deflection[side], faces.deflection[twin])
    if aside > 2.0 * widest + SAME:
        return (1 if within < near - 1e-13 else 0), side, twin, near
    out, exact = _beyond(faces, f, side, x)
    known = faces.sides[side, 3] != UNKNOWN
    if twin >= 0:
        other, precision = _beyond(faces, f, twin, x)
        p, q = row(faces.vertices, faces.sides[twin, 0]), row(faces.vertices, faces.sides[twin, 1])
        # the direction from the common corner along the twin
        t = sub(q, p) if faces.sides[twin, 0] == faces.sides[side, 1] else sub(p, q)
        convex = dot(row(faces.inward, side), t) >= 0.0
        if (other - precision > out - exact) == convex:
            out, exact, known = other, precision, faces.sides[twin, 3] != UNKNOWN
    if out > exact:
        return 0, side, twin, 0.0
    return (1 if known or out < -exact else 2), side, twin, 0.0 if out >= -RIM else -out


@inner_kernel
def _behind(b, k, x):  # pragma: no cover - compiled
    """How deep x lies behind the neighbour at side k; infinite if that does not bound the solid there, 0 if unknown."""
    h = b.sides[k, 2]
    if h < 0 or b.geometry[h, 0] == FREEFORM:
        return 0.0
    _, n, _, _, _, _ = _field(b.geometry[h], row(b.vertices, b.sides[k, 0]))
    if b.sense[h] * dot(n, row(b.inward, k)) > -TANGENT:  # a tangent neighbour, or a concave edge
        return np.inf
    d, _, _, _, _, _ = _field(b.geometry[h], x)
    return max(0.0, -b.sense[h] * d)


@inner_kernel
def _certain(a, f, x, first, second, b, g, depth, side, twin, margin):  # pragma: no cover - compiled
    """How deep x, on face a, or a point of it nearby, lies in the solid behind face g at least; -1 if it does not.

    depth: of x behind face g. side, twin, margin: the border of g near the foot of x, as `_member` returns them; beyond
    a convex edge the neighbouring face may be nearer. first, second: sides of a on which x lies, or -1.
    """
    if side < 0 or margin > depth:
        return depth
    least = _behind(b, side, x)
    m = row(b.inward, side)
    w = m
    if twin >= 0:
        least = min(least, _behind(b, twin, x))
        w = along(w, 1.0, row(b.inward, twin))
    least = min(depth, least)
    # from a point of the rim of both a step into both faces leads inside, where there is one
    _, n, _, _, _, _ = _field(a.geometry[f], x)
    w = along(w, -dot(w, n), n)
    for k in (first, second):
        if k >= 0:
            u = row(a.inward, k)
            w = along(w, -min(0.0, dot(w, u)), u)
    length = norm(w)
    if length < 1e-6 or dot(w, m) < 1e-6 * length:
        return least if least > SAME else -1.0
    y = _onto(a.geometry[f], along(x, 3.0 * depth / length, w))
    d, n, _, _, _, _ = _field(b.geometry[g], y)
    inside, _, _, _ = _member(a, f, y)
    if inside == 1:
        inside, side, twin, _ = _member(b, g, along(y, -d, n))
        if inside == 1:
            other = min(-b.sense[g] * d, _behind(b, side, y))
            least = max(least, other if twin < 0 else min(other, _behind(b, twin, y)))
    return least if least > SAME else -1.0


@inner_kernel
def _offer(out, low, high, least, most, x):  # pragma: no cover - compiled
    """Take a candidate, a gap between least and most at x, if the facets' bounds do not exclude it."""
    if most < low - SAME or least > high + SAME:
        return
    if most < out[1] or (np.isinf(out[1]) and least < out[0]):
        out[2], out[3], out[4] = x
    out[0], out[1] = min(out[0], least), min(out[1], most)


@inner_kernel
def _descend(f, g, sign, x, reach):  # pragma: no cover - compiled
    """Minimise sign × distance to surface g over surface f, from x: the point, and whether it is stationary."""
    x = _onto(f, x)
    d, n, k, t, m, s = _field(g, x)
    value = sign * d
    for _ in range(60):
        _, nf, kf, tf, mf, sf = _field(f, x)
        e1, _ = _radial((0.0, 0.0, 0.0), nf)
        e2 = cross(nf, e1)
        g1, g2 = sign * dot(n, e1), sign * dot(n, e2)
        slope = np.sqrt(g1 * g1 + g2 * g2)
        if slope < 1e-11:
            return x, True
        lever = -sign * dot(n, nf)
        t1, t2, s1, s2 = dot(t, e1), dot(t, e2), dot(s, e1), dot(s, e2)
        a1, a2, b1, b2 = dot(tf, e1), dot(tf, e2), dot(sf, e1), dot(sf, e2)
        h11 = sign * (k * t1 * t1 + m * s1 * s1) + lever * (kf * a1 * a1 + mf * b1 * b1)
        h12 = sign * (k * t1 * t2 + m * s1 * s2) + lever * (kf * a1 * a2 + mf * b1 * b2)
        h22 = sign * (k * t2 * t2 + m * s2 * s2) + lever * (kf * a2 * a2 + mf * b2 * b2)
        # along the eigenvectors of the Hessian
        half, diff = 0.5 * (h11 + h22), 0.5 * (h11 - h22)
        root = np.sqrt(diff * diff + h12 * h12)
        angle = 0.5 * np.arctan2(h12, diff) if root > 0.0 else 0.0
        c, w = np.cos(angle), np.sin(angle)
        along_c, along_w = g1 * c + g2 * w, -g1 * w + g2 * c
        p = -along_c / max(abs(half + root), TINY)
        q = -along_w / max(abs(half - root), TINY)
        if abs(along_c) < 1e-12:
            p = 0.0
        if abs(along_w) < 1e-12:
            q = 0.0
        p, q = min(max(p, -1e3 * reach), 1e3 * reach), min(max(q, -1e3 * reach), 1e3 * reach)
        u, v = p * c - q * w, p * w + q * c
        length = np.sqrt(u * u + v * v)
        if length < 1e-15:
            return x, True
        scale = min(1.0, reach / length)
        better = False
        for _ in range(20):
            y = _onto(f, along(along(x, scale * u, e1), scale * v, e2))
            d, n, k, t, m, s = _field(g, y)
            if sign * d <= value + 1e-17:
                better = value - sign * d > 1e-16 or scale * length > 1e-12
                x, value = y, sign * d
                break
            scale *= 0.25
        else:
            d, n, k, t, m, s = _field(g, x)
        if not better:
            return x, slope < 1e-6
    return x, slope < 1e-6


@inner_kernel
def _interior(a, f, b, g, low, high, x, sign, reach, out):  # pragma: no cover - compiled
    """Offer the stationary point inside both faces that is reached from x."""
    x, found = _descend(a.geometry[f], b.geometry[g], sign, x, reach)
    if not found:
        return
    d, n, _, _, _, _ = _field(b.geometry[g], x)
    value = sign * d
    out[5] = min(out[5], value)
    if value < low - SAME or value > high + SAME or value >= out[1]:
        return
    _, m, _, _, _, _ = _field(a.geometry[f], x)
    if value < 0.0 and a.sense[f] * b.sense[g] * dot(m, n) >= 0.0:
        return
    first, k, k2, margin = _member(a, f, x)
    if first == 0:
        return
    if margin > 0.0:
        k, k2 = -1, -1
    second, side, twin, margin = _member(b, g, along(x, -d, n))
    if second == 0:
        return
    most = value
    if value < -SAME:
        most = -_certain(a, f, x, k, k2, b, g, -value, side, twin, margin)
        if most > 0.0:
            return
    _offer(out, low, high, value, most if first == 1 and second == 1 else high, along(x, -0.5 * d, n))


@inner_kernel
def _insides(a, f, b, g, low, high, seed, out, values, lowest):  # pragma: no cover - compiled
    """Search for stationary points inside both faces from the seed and from local minima among the vertices of f."""
    begin, end = a.first_corner[f], a.first_corner[f + 1]
    ga, gb = a.geometry[f], b.geometry[g]
    apart = low > 0.0
    corner = row(a.vertices, a.corners[begin])
    reach = 0.0
    for k in range(begin, end):
        v = a.corners[k]
        x = row(a.vertices, v)
        d, _, _, _, _, _ = _field(gb, x)
        values[v] = abs(d) if apart else b.sense[g] * d
        lowest[v] = values[v] >= low - SAME
        out[5] = min(out[5], values[v])
        reach = max(reach, norm(sub(x, corner)))
    d, _, _, _, _, _ = _field(gb, _onto(ga, seed))
    _interior(a, f, b, g, low, high, seed, (1.0 if d >= 0.0 else -1.0) if apart else b.sense[g], reach, out)
    for k in range(a.first[f], a.first[f + 1]):
        u, v, w = a.triangles[k, 0], a.triangles[k, 1], a.triangles[k, 2]
        least = min(values[u], values[v], values[w])
        lowest[u] &= values[u] <= least
        lowest[v] &= values[v] <= least
        lowest[w] &= values[w] <= least
    for _ in range(SEEDS):
        best, at = np.inf, -1
        for k in range(begin, end):
            v = a.corners[k]
            if lowest[v] and values[v] < best:
                best, at = values[v], v
        if at < 0:
            return
        lowest[at] = False
        x = row(a.vertices, at)
        d, _, _, _, _, _ = _field(gb, x)
        _interior(a, f, b, g, low, high, x, (1.0 if d >= 0.0 else -1.0) if apart else b.sense[g], reach, out)


@inner_kernel
def _tangent(a, f, k, x, chord):  # pragma: no cover - compiled
    """Unit direction of the border at x, on side k of face f."""
    t = chord
    if a.sides[k, 3] == CURVE:
        _, n, _, _, _, _ = _field(a.geometry[f], x)
        _, m, _, _, _, _ = _field(a.geometry[a.sides[k, 2]], x)
        t = cross(n, m)
        if dot(t, chord) < 0.0:
            t = (-t[0], -t[1], -t[2])
    t, _ = _radial(t, (0.0, 0.0, 1.0))
    return t


@inner_kernel
def _rate(a, f, k, chord, sign, gb, x):  # pragma: no cover - compiled
    """Rate of sign × distance to gb along the border at x, on side k of face f."""
    _, n, _, _, _, _ = _field(gb, x)
    return sign * dot(n, _tangent(a, f, k, x, chord))


@inner_kernel
def _curve_error(a, k, w):  # pragma: no cover - compiled
    """How exactly points on the border at side k are known in the direction w, m."""
    kind = a.sides[k, 3]
    if kind == SMOOTH:  # it strays within the common tangent plane
        return a.deflection[k] * abs(dot(w, row(a.inward, k)))
    return a.deflection[k] if kind == UNKNOWN else 0.0


@inner_kernel
def _border(a, f, k, b, g, low, high, out):  # pragma: no cover - compiled
    """Offer the least signed distance of side k of face f to face g."""
    ga, gb = a.geometry[f], b.geometry[g]
    kind, other = a.sides[k, 3], a.sides[k, 2]
    gj = a.geometry[other] if kind == CURVE else ga
    p, q = row(a.vertices, a.sides[k, 0]), row(a.vertices, a.sides[k, 1])
    chord = sub(q, p)
    d, _, _, _, _, _ = _field(gb, along(p, 0.5, chord))
    sign = (1.0 if d >= 0.0 else -1.0) if low > 0.0 else b.sense[g]
    start, end = _rate(a, f, k, chord, sign, gb, p), _rate(a, f, k, chord, sign, gb, q)
    if start >= 0.0 and end > 0.0:
        t = 0.0
    elif end <= 0.0:
        t = 1.0 if start < 0.0 or end < 0.0 else 0.5
    else:  # the root of the rate by regula falsi (Illinois)
        s, e, held = 0.0, 1.0, 0
        t = 0.5
        for _ in range(40):
            t = (s * end - e * start) / (end - start)
            rate = _rate(a, f, k, chord, sign, gb, _on_curve(ga, gj, kind, along(p, t, chord)))
            if abs(rate) < 1e-12 or e - s < 1e-12:
                break
            if rate < 0.0:
                s, start = t, rate
                end *= 0.5 if held == -1 else 1.0
                held = -1
            else:
                e, end = t, rate
                start *= 0.5 if held == 1 else 1.0
                held = 1
    x = _on_curve(ga, gj, kind, along(p, t, chord))
    d, n, _, _, _, _ = _field(gb, x)
    value = sign * d
    error = _curve_error(a, k, n)
    out[5] = min(out[5], value - error)
    if value + error < low - SAME or value - error > high + SAME or value - error >= out[1]:
        return
    if value < 0.0:
        _, m, _, _, _, _ = _field(ga, x)
        facing = a.sense[f] * dot(m, n)
        if kind != UNKNOWN:
            _, m, _, _, _, _ = _field(a.geometry[other], x)
            facing += a.sense[other] * dot(m, n)
        if b.sense[g] * facing >= -1e-9:
            return
    inside, side, twin, margin = _member(b, g, along(x, -d, n))
    if inside == 0:
        return
    most = value
    if value < -SAME:
        most = -_certain(a, f, x, k, -1, b, g, -value, side, twin, margin)
        if most > 0.0:
            return
    _offer(out, low, high, value - error, most + error if inside == 1 else high, along(x, -0.5 * d, n))


@inner_kernel
def _borders(a, f, b, g, low, high, out):  # pragma: no cover - compiled
    """Search the border of face f for points nearest to the inside of face g."""
    gb = b.geometry[g]
    for k in range(a.first_side[f], a.first_side[f + 1]):
        p, q = row(a.vertices, a.sides[k, 0]), row(a.vertices, a.sides[k, 1])
        chord = sub(q, p)
        start, _, _, _, _, _ = _field(gb, p)
        end, _, _, _, _, _ = _field(gb, q)
        middle, _, s, _, t, _ = _field(gb, along(p, 0.5, chord))
        # between samples the gap changes by the square of their spacing times the curvatures; `deflection` bounds the
        # border's own
        change = dot(chord, chord) * max(abs(s), abs(t)) / 16.0 + 2.0 * a.deflection[k]
        if low > 0.0:
            least, most = min(abs(start), abs(middle), abs(end)), max(abs(start), abs(middle), abs(end))
        else:
            sign = b.sense[g]
            start, middle, end = sign * start, sign * middle, sign * end
            least, most = min(start, middle, end), max(start, middle, end)
        if most + change >= low and least - change <= min(high, out[1]):
            _border(a, f, k, b, g, low, high, out)


@inner_kernel
def _depth(b, f, k, s, y, x):  # pragma: no cover - compiled
    """How deep x lies behind the faces at place s (0 … 1) of side k of face f, or 0; how deep behind f; the outward
    normals at y of f and of its neighbour."""
    sense = b.sense[f]
    d, _, _, _, _, _ = _field(b.geometry[f], x)
    _, n, _, _, _, _ = _field(b.geometry[f], y)
    n = (sense * n[0], sense * n[1], sense * n[2])
    g, own = b.sides[k, 2], max(0.0, -sense * d)
    depth = own
    corner = b.sides[k, 0] if s < 1e-6 else (b.sides[k, 1] if s > 1.0 - 1e-6 else -1)
    for i in range(b.first_side[f], b.first_side[f + 1]):  # in a corner the face of the next side counts as well
        if i == k or b.sides[i, 0] == corner or b.sides[i, 1] == corner:
            h = b.sides[i, 2]
            if h < 0 or b.geometry[h, 0] == FREEFORM:
                return 0.0, own, n, n
            d, _, _, _, _, _ = _field(b.geometry[h], x)
            depth = max(0.0, min(depth, -b.sense[h] * d))
    _, m, _, _, _, _ = _field(b.geometry[g], y)
    sense = b.sense[g]
    return depth, own, n, (sense * m[0], sense * m[1], sense * m[2])


@inner_kernel
def _between(n, m, w):  # pragma: no cover - compiled
    """Whether the unit vector w lies between the unit vectors n and m, to `TANGENT`, or they are tangent."""
    c = dot(n, m)
    s, t = dot(n, w), dot(m, w)
    limit = -TANGENT * (1.0 - c * c)
    return s - c * t >= limit and t - c * s >= limit


@inner_kernel
def _behind_both(a, f, h, x):  # pragma: no cover - compiled
    """How deep x lies behind the surfaces of the faces f and h, negative in front of either; and behind f."""
    d, _, _, _, _, _ = _field(a.geometry[f], x)
    e, _, _, _, _, _ = _field(a.geometry[h], x)
    return min(-a.sense[f] * d, -a.sense[h] * e), -a.sense[f] * d


@inner_kernel
def _reaches_in(a, f, k, b, g, j):  # pragma: no cover - compiled
    """Whether the border of face g at its side j reaches behind face f and its neighbour at side k, f being as near."""
    h = a.sides[k, 2]
    if h < 0 or a.geometry[h, 0] == FREEFORM:
        return False
    p, c = row(b.vertices, b.sides[j, 0]), sub(row(b.vertices, b.sides[j, 1]), row(b.vertices, b.sides[j, 0]))
    kind, gb = b.sides[j, 3], b.geometry[g]
    hb = b.geometry[b.sides[j, 2]] if kind == CURVE else gb
    s, t = 0.0, 1.0
    for _ in range(60):  # a ternary search: behind two surfaces a curve is deepest in one place
        third = (t - s) / 3.0
        before, _ = _behind_both(a, f, h, _on_curve(gb, hb, kind, along(p, s + third, c)))
        after, _ = _behind_both(a, f, h, _on_curve(gb, hb, kind, along(p, t - third, c)))
        s, t = (s + third, t) if after > before else (s, t - third)
    x = _on_curve(gb, hb, kind, along(p, 0.5 * (s + t), c))
    depth, own = _behind_both(a, f, h, x)
    if depth <= SAME or own > depth + SAME:
        return False
    d, n, _, _, _, _ = _field(a.geometry[f], x)
    inside, _, _, _ = _member(a, f, along(x, -d, n))
    return inside != 0


@inner_kernel
def _two_sides(a, f, k, b, g, j, s, t, low, high, out):  # pragma: no cover - compiled
    """Offer the distance of two borders near the places s and t (0 … 1) of their sides k and j."""
    p, c = row(a.vertices, a.sides[k, 0]), sub(row(a.vertices, a.sides[k, 1]), row(a.vertices, a.sides[k, 0]))
    q, e = row(b.vertices, b.sides[j, 0]), sub(row(b.vertices, b.sides[j, 1]), row(b.vertices, b.sides[j, 0]))
    ga, gb = a.geometry[f], b.geometry[g]
    ha = a.geometry[a.sides[k, 2]] if a.sides[k, 3] == CURVE else ga
    hb = b.geometry[b.sides[j, 2]] if b.sides[j, 3] == CURVE else gb
    ka, kb = a.sides[k, 3], b.sides[j, 3]
    x, y = _on_curve(ga, ha, ka, along(p, s, c)), _on_curve(gb, hb, kb, along(q, t, e))
    best, px, py, at, bt = norm(sub(y, x)), x, y, s, t
    for _ in range(60):
        u, v = _tangent(a, f, k, x, c), _tangent(b, g, j, y, e)
        w = sub(y, x)
        uv = dot(u, v)
        det = 1.0 - uv * uv
        along_u, along_v = dot(w, u), -dot(w, v)
        cu, ev = dot(c, u), dot(e, v)
        if abs(cu) < TINY or abs(ev) < TINY:
            break
        # the nearest points of the two tangents, within the sides; of parallel ones the nearest to x
        du = (along_u + uv * along_v) / det if det > 1e-8 else 0.0
        s2 = min(1.0, max(0.0, s + du / cu))
        du = (s2 - s) * cu
        dv = along_v + uv * du
        t2 = min(1.0, max(0.0, t + dv / ev))
        dv = (t2 - t) * ev
        s2 = min(1.0, max(0.0, s + (along_u + uv * dv) / cu))
        if abs(s2 - s) < 1e-13 and abs(t2 - t) < 1e-13:
            break
        s, t = s2, t2
        x, y = _on_curve(ga, ha, ka, along(p, s, c)), _on_curve(gb, hb, kb, along(q, t, e))
        length = norm(sub(y, x))
        if length < best:
            best, px, py, at, bt = length, x, y, s, t
    w, _ = _radial(sub(py, px), (0.0, 0.0, 1.0))
    error = _curve_error(a, k, w) + _curve_error(b, j, w)
    if low <= 0.0:
        first, behind_g, n, n2 = _depth(b, g, j, bt, py, px)
        second, behind_f, m, m2 = _depth(a, f, k, at, px, py)
        depth = 0.0
        overlap = max(first, second) > SAME and dot(along(n, 1.0, n2), along(m, 1.0, m2)) < 0.0
        if overlap:  # as deep as these faces, unless their neighbours are nearer
            depth = max(first if behind_g <= first + SAME else 0.0, second if behind_f <= second + SAME else 0.0)
        elif best > SAME and not (_between(m, m2, w) and _between(n, n2, (-w[0], -w[1], -w[2]))):
            overlap = _reaches_in(a, f, k, b, g, j) or _reaches_in(b, g, j, a, f, k)  # beside these nearest points
        if overlap:
            # the deepest point near two edges that overlap is not stationary: it is as far from two faces; but none is
            # deeper than the deepest point of one face behind the whole surface of its partner
            most = -depth if depth > SAME else best + error
            _offer(out, low, high, max(low, min(out[5], most)), most, along(px, 0.5, sub(py, px)))
            return
    if best - error < out[1]:
        _offer(out, low, high, best - error, best + error, along(px, 0.5, sub(py, px)))


@inner_kernel
def _segments(p, u, q, v):  # pragma: no cover - compiled
    """Places (0 … 1) of the nearest points of the segments p + s u and q + t v, and their distance.

    Ericson, "Real-Time Collision Detection", 2005, 5.1.9.
    """
    r = sub(p, q)
    a, e, f = max(dot(u, u), TINY), max(dot(v, v), TINY), dot(v, r)
    c, b = dot(u, r), dot(u, v)
    det = a * e - b * b
    s = min(1.0, max(0.0, (b * f - c * e) / det)) if det > 1e-14 * a * e else 0.5
    t = (b * s + f) / e
    if t < 0.0 or t > 1.0:
        t = min(1.0, max(0.0, t))
        s = min(1.0, max(0.0, (b * t - c) / a))
    return s, t, norm(sub(along(p, s, u), along(q, t, v)))


@inner_kernel
def _edges(a, f, b, g, low, high, out):  # pragma: no cover - compiled
    """Search the borders of both faces for points nearest to each other."""
    reach = max(abs(low), abs(high))
    box = (np.inf, np.inf, np.inf)
    far = (-np.inf, -np.inf, -np.inf)
    widest = 0.0
    for j in range(b.first_side[g], b.first_side[g + 1]):
        widest = max(widest, b.deflection[j])
        for v in (b.sides[j, 0], b.sides[j, 1]):
            q = row(b.vertices, v)
            box = (min(box[0], q[0]), min(box[1], q[1]), min(box[2], q[2]))
            far = (max(far[0], q[0]), max(far[1], q[1]), max(far[2], q[2]))
    for k in range(a.first_side[f], a.first_side[f + 1]):
        p, p2 = row(a.vertices, a.sides[k, 0]), row(a.vertices, a.sides[k, 1])
        limit = reach + a.deflection[k] + widest
        apart = False
        for i in range(3):
            apart |= min(p[i], p2[i]) > far[i] + limit or max(p[i], p2[i]) < box[i] - limit
        if apart:
            continue
        u = sub(p2, p)
        for j in range(b.first_side[g], b.first_side[g + 1]):
            q, q2 = row(b.vertices, b.sides[j, 0]), row(b.vertices, b.sides[j, 1])
            limit = (min(reach, out[1]) if low > 0.0 else reach) + a.deflection[k] + b.deflection[j] + SAME
            apart = False
            for i in range(3):
                apart |= min(p[i], p2[i]) > max(q[i], q2[i]) + limit or max(p[i], p2[i]) < min(q[i], q2[i]) - limit
            if apart:
                continue
            s, t, d = _segments(p, u, q, sub(q2, q))
            if d <= limit:
                _two_sides(a, f, k, b, g, j, s, t, low, high, out)


@kernel(allocates=True)
def _gap(
    a: Any, f: int, b: Any, g: int, low: float, high: float, seed: Array, out: Array
) -> None:  # pragma: no cover - compiled
    """Fill `out` with least and greatest value of the gap, infinite where there is no candidate, and its point.

    Its last number is the least distance found from points of one face to the whole surface of its partner.
    """
    x = (seed[0], seed[1], seed[2])
    size = max(len(a.vertices), len(b.vertices))
    values, lowest = np.empty(size), np.empty(size, np.bool_)
    _insides(a, f, b, g, low, high, x, out, values, lowest)
    _insides(b, g, a, f, low, high, x, out, values, lowest)
    _borders(a, f, b, g, low, high, out)
    _borders(b, g, a, f, low, high, out)
    _edges(a, f, b, g, low, high, out)
