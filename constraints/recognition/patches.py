"""Least-squares cylinders, cones, spheres and tori through many small sets of points, compiled.

The same as `fits.fit_kind` for each set. A segmentation fits tens of thousands of patches of ten points each: a call of
numpy would take longer than a whole fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from collision.numeric.kernel import inner_kernel, kernel
from constraints.errors import GeometryError
from constraints.geometry.surfaces import LARGEST, Cone, Cylinder, Geometry, Sphere, Torus
from constraints.recognition.fits import Fit

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Patch = tuple[Array, Array, Array]
"""points (n, 3), m; bases (k, 3), m, and rough normals (k, 3) there, as `fits.fit_surface` takes them"""

CYLINDER, CONE, SPHERE, TORUS = range(4)
NUMBERS = {"cylinder": CYLINDER, "cone": CONE, "sphere": SPHERE, "torus": TORUS}
_TINY = float(np.finfo(float).tiny)
_RANK = 1e-15
"""least pivot of normal equations, relative to the greatest diagonal element"""
_HOPELESS = 0.02
"""share of the squared distances by which a step must reduce them while their mean is beyond the limit"""


class FitWorkspace(NamedTuple):
    """Arrays of one fit."""

    points: Array
    """(n, 3) about the middle, in units of the extent"""
    bases: Array
    """(k, 3) likewise"""
    normals: Array
    """(k, 3)"""
    system: Array
    """(8, 9) matrix and right side"""
    square: Array
    """(3, 3)"""
    axes: Array
    """(3, 3)"""
    best: Array
    """(8,) origin, apex or centre; axis; radius, half angle, or major and minor radius"""
    trial: Array
    """(8,)"""
    row: Array
    """(8,)"""
    middle: Array
    """(4,) middle and extent, m"""


class Samples(NamedTuple):
    """Points and rough normals that patches share."""

    points: Array
    """(m, 3), m"""
    bases: Array
    """(b, 3), m"""
    normals: Array
    """(b, 3) at the bases"""


class Patches(NamedTuple):
    """n sets of samples and the kind of surface to fit to each.

    Patch i has the points `of[ends[i]:ends[i + 1]]`, and the bases and normals `at[stops[i]:stops[i + 1]]`.
    """

    kinds: Index
    """(n,) values of `NUMBERS`"""
    of: Index
    ends: Index
    """(n + 1,)"""
    at: Index
    stops: Index
    """(n + 1,)"""


def workspace(points: int, bases: int) -> FitWorkspace:
    """Return a workspace for sets of up to that many points and bases."""
    p, b, n = (np.zeros((max(rows, 1), 3)) for rows in (points, bases, bases))
    best, trial, row = np.zeros((3, 8))
    return FitWorkspace(p, b, n, np.zeros((8, 9)), np.zeros((3, 3)), np.zeros((3, 3)), best, trial, row, np.zeros(4))


def fit_patches(kind: str, patches: Sequence[Patch], limit: float, iterations: int = 40) -> list[Fit | None]:
    """Return the least-squares surface of one kind through each patch; None if there is none within `limit`, m."""
    found: list[Fit | None] = []
    for points, bases, normals in patches:
        ends = np.array([[0, len(points)], [0, len(bases)]])
        whole = np.arange(len(points)), ends[0], np.arange(len(bases)), ends[1]
        one = Patches(np.array([NUMBERS[kind]]), *whole)
        (numbers,) = fit_packed(Samples(points, bases, normals), one, limit, iterations)
        geometry = geometry_of(NUMBERS[kind], numbers)
        residual = np.inf if geometry is None else float(np.abs(geometry.distance(points)).max())
        found.append(Fit(geometry, residual) if geometry is not None and residual <= limit else None)
    return found


def fit_packed(samples: Samples, patches: Patches, limit: float, iterations: int) -> Array:
    """Return (n, 8) the surfaces through n patches, as `FitWorkspace.best`; NaN where none is within `limit`, m."""
    out = np.full((len(patches.kinds), 8), np.nan)
    if len(out):
        work = workspace(int(np.diff(patches.ends).max()), int(np.diff(patches.stops).max()))
        _fit_all(samples, patches, limit, iterations, work, out)
    return out


def numbers_of(geometry: Geometry) -> Array:
    """(8,) origin, axis and sizes of a surface; the inverse of `geometry_of`."""
    match geometry:
        case Cylinder():
            return np.array([*geometry.origin, *geometry.axis, geometry.radius, 0.0])
        case Cone():
            return np.array([*geometry.apex, *geometry.axis, geometry.half_angle, 0.0])
        case Sphere():
            return np.array([*geometry.center, 0.0, 0.0, 1.0, geometry.radius, 0.0])
        case Torus():
            return np.array([*geometry.center, *geometry.axis, geometry.major, geometry.minor])
    raise TypeError(f"{geometry.kind} is not fitted to patches")


def geometry_of(number: int, numbers: Array) -> Geometry | None:
    """Return the surface of a kind's number and its numbers (8,); None if they are none."""
    if not np.isfinite(numbers).all():
        return None
    origin, axis, sizes = numbers[:3].copy(), numbers[3:6].copy(), numbers[6:]
    try:
        if number == CYLINDER:
            return Cylinder(origin, axis, sizes[0])
        if number == CONE:
            return Cone(origin, axis, sizes[0])
        return Sphere(origin, sizes[0]) if number == SPHERE else Torus(origin, axis, sizes[0], sizes[1])
    except GeometryError:
        return None


@kernel
def _fit_all(samples, patches, limit, iterations, work, out):
    points, bases, normals = samples
    kinds, of, ends, at, stops = patches
    for i in range(len(kinds)):
        n, k = ends[i + 1] - ends[i], stops[i + 1] - stops[i]
        if n < 3 or k < 1 or not _normalise(points, of, ends[i], n, work):
            continue
        scale = work.middle[3]
        for j in range(k):
            row = at[stops[i] + j]
            for d in range(3):
                work.bases[j, d] = (bases[row, d] - work.middle[d]) / scale
                work.normals[j, d] = normals[row, d]
        if not _guess(kinds[i], n, k, work) or not _is_surface(kinds[i], work.best):
            continue
        _refine(kinds[i], n, limit / scale, iterations, work)
        good = True
        for j in range(n):
            if not abs(_distance(kinds[i], work.best, work.points, j, work.row)) * scale <= limit:
                good = False
                break
        if good:
            _restore(kinds[i], work)
            for d in range(8):
                out[i, d] = work.best[d]


@kernel
def refine_at(kind, points, of, n, iterations, work):
    """Refine `work.best`, m, to the points `of[:n]`; returns False if they determine none."""
    if not _normalise(points, of, 0, n, work):
        return False
    q, scale = work.best, work.middle[3]
    for d in range(3):
        q[d] = (q[d] - work.middle[d]) / scale
    if kind != CONE:
        q[6] /= scale
        q[7] /= scale
    _refine(kind, n, 0.0, iterations, work)
    _restore(kind, work)
    return _is_surface(kind, q)


@inner_kernel
def _normalise(points, of, start, n, work):
    """Copy points `of[start:start + n]` to the workspace, about their middle and in units of their extent.

    Returns False if they have none.
    """
    extent = 0.0
    for d in range(3):
        total, low, high = 0.0, np.inf, -np.inf
        for j in range(n):
            x = points[of[start + j], d]
            work.points[j, d] = x
            total += x
            low, high = min(low, x), max(high, x)
        work.middle[d] = total / n
        extent += (high - low) ** 2
    scale = np.sqrt(extent)
    work.middle[3] = scale
    if not scale > 0.0:
        return False
    for j in range(n):
        for d in range(3):
            work.points[j, d] = (work.points[j, d] - work.middle[d]) / scale
    return True


@inner_kernel
def _restore(kind, work):
    """Return `work.best` to metres; the origin of a cylinder is moved beside the points' middle."""
    q, scale = work.best, work.middle[3]
    if kind == CYLINDER:
        along = q[0] * q[3] + q[1] * q[4] + q[2] * q[5]
        for d in range(3):
            q[d] -= along * q[3 + d]
    for d in range(3):
        q[d] = q[d] * scale + work.middle[d]
    if kind != CONE:
        q[6] *= scale
        q[7] *= scale


@inner_kernel
def _is_surface(kind, q):
    for d in range(3):
        if not abs(q[d]) <= LARGEST or not np.isfinite(q[3 + d]):
            return False
    most = np.pi / 2 if kind == CONE else LARGEST
    if not (0.0 < q[6] <= most) or (kind == CONE and q[6] == most):
        return False
    return kind != TORUS or 0.0 < q[7] <= most


@inner_kernel
def _distance(kind, q, points, j, row):
    """Return the signed distance of point j; `row` becomes its derivatives by a twist of the surface and its sizes."""
    x, y, z = points[j, 0], points[j, 1], points[j, 2]
    dx, dy, dz = x - q[0], y - q[1], z - q[2]
    row[6], row[7] = -1.0, 0.0
    if kind == SPHERE:
        length = np.sqrt(dx * dx + dy * dy + dz * dz)
        distance = length - q[6]
        if length > 0.0:
            nx, ny, nz = dx / length, dy / length, dz / length
        else:
            nx, ny, nz = 0.0, 0.0, 1.0
    else:
        height = dx * q[3] + dy * q[4] + dz * q[5]
        rx, ry, rz = dx - height * q[3], dy - height * q[4], dz - height * q[5]
        radius = np.sqrt(rx * rx + ry * ry + rz * rz)
        if radius > 0.0:
            rx, ry, rz = rx / radius, ry / radius, rz / radius
        else:
            rx, ry, rz = _aside(q[3], q[4], q[5])
        if kind == CYLINDER:
            distance = radius - q[6]
            nx, ny, nz = rx, ry, rz
        elif kind == CONE:
            c, s = np.cos(q[6]), np.sin(q[6])
            if height * c + radius * s < 0.0:
                distance = np.hypot(height, radius)
            else:
                distance = radius * c - height * s
            nx, ny, nz = rx * c - q[3] * s, ry * c - q[4] * s, rz * c - q[5] * s
            row[6] = -radius * s - height * c
        else:
            across = radius - q[6]
            length = np.hypot(across, height)
            distance = length - q[7]
            if length > 0.0:
                u, v = across / length, height / length
                nx, ny, nz = rx * u + q[3] * v, ry * u + q[4] * v, rz * u + q[5] * v
                row[6] = -u
            else:
                nx, ny, nz = rx, ry, rz
                row[6] = 0.0
            row[7] = -1.0
    row[0], row[1], row[2] = -nx, -ny, -nz
    row[3], row[4], row[5] = ny * z - nz * y, nz * x - nx * z, nx * y - ny * x
    return distance


@inner_kernel
def _aside(x, y, z):
    """Return a unit vector at right angles to a unit vector."""
    if abs(x) <= abs(y) and abs(x) <= abs(z):
        length = np.sqrt(y * y + z * z)
        return 0.0, z / length, -y / length
    if abs(y) <= abs(z):
        length = np.sqrt(x * x + z * z)
        return -z / length, 0.0, x / length
    length = np.sqrt(x * x + y * y)
    return y / length, -x / length, 0.0


@inner_kernel
def _refine(kind, n, limit, iterations, work):
    """Levenberg-Marquardt from `work.best`, as `fits.refine`.

    With a `limit` above 0 it ends early where the mean square distance stays beyond it.
    """
    q, trial, row, system = work.best, work.trial, work.row, work.system
    m = 8 if kind == TORUS else 7
    cost, damping = 0.0, 1e-9
    for j in range(n):
        cost += _distance(kind, q, work.points, j, row) ** 2
    for _ in range(iterations):
        for a in range(m):
            for b in range(m + 1):
                system[a, b] = 0.0
        for j in range(n):
            distance = _distance(kind, q, work.points, j, row)
            for a in range(m):
                for b in range(a + 1):
                    system[a, b] += row[a] * row[b]
                system[a, m] -= row[a] * distance
        trace = 0.0
        for a in range(m):
            trace += system[a, a]
            for b in range(a):
                system[b, a] = system[a, b]
        if not np.isfinite(trace) or not trace > 0.0:
            return
        for a in range(m):
            system[a, a] += damping * trace
        _solve(system, m)
        _step(q, system, m, trial)
        gain = -1.0
        if _is_surface(kind, trial):
            moved = 0.0
            for j in range(n):
                moved += _distance(kind, trial, work.points, j, row) ** 2
            gain = cost - moved
        if gain > 0.0:
            for d in range(8):
                q[d] = trial[d]
            cost -= gain
            damping = max(0.1 * damping, 1e-12)
            if not gain > 1e-9 * cost or (gain < _HOPELESS * cost and cost > n * limit * limit > 0.0):
                return
            continue
        if damping > 1e-3 or cost < 1e-28 * n:
            return
        damping *= 100.0


@inner_kernel
def _step(q, system, m, trial):
    """Write the surface after a step of the twist and sizes in the last column of `system`."""
    wx, wy, wz = system[3, m], system[4, m], system[5, m]
    angle = np.sqrt(wx * wx + wy * wy + wz * wz)
    length = max(angle, _TINY)
    ux, uy, uz = wx / length, wy / length, wz / length
    sine, rest = np.sin(angle), 2.0 * np.sin(0.5 * angle) ** 2
    for k in (0, 3):
        x, y, z = q[k], q[k + 1], q[k + 2]
        ax, ay, az = uy * z - uz * y, uz * x - ux * z, ux * y - uy * x
        trial[k] = x + sine * ax + rest * (uy * az - uz * ay)
        trial[k + 1] = y + sine * ay + rest * (uz * ax - ux * az)
        trial[k + 2] = z + sine * az + rest * (ux * ay - uy * ax)
    norm = np.sqrt(trial[3] ** 2 + trial[4] ** 2 + trial[5] ** 2)
    for d in range(3):
        trial[d] += system[d, m]
        trial[3 + d] /= norm
    trial[6] = q[6] + system[6, m]
    trial[7] = q[7] + system[7, m] if m == 8 else q[7]


@inner_kernel
def _solve(system, m):
    """Solve the positive definite system (m, m) with the right side in column m, in place; return its rank's measure.

    That is the least pivot over the greatest diagonal element, 0 for none.
    """
    most = _TINY
    for a in range(m):
        most = max(most, system[a, a])
    least = np.inf
    for a in range(m):
        pivot = system[a, a]
        least = min(least, pivot)
        if not pivot > 0.0:
            return 0.0
        for b in range(a + 1, m):
            factor = system[b, a] / pivot
            for c in range(a + 1, m + 1):
                system[b, c] -= factor * system[a, c]
    for a in range(m - 1, -1, -1):
        total = system[a, m]
        for b in range(a + 1, m):
            total -= system[a, b] * system[b, m]
        system[a, m] = total / system[a, a]
    return least / most


@inner_kernel
def _eigen(square, axes):
    """Turn a symmetric matrix (3, 3) into its eigenvalues on the diagonal, with eigenvectors `axes[:, k]` (Jacobi)."""
    for a in range(3):
        for b in range(3):
            axes[a, b] = 1.0 if a == b else 0.0
    for _ in range(30):
        off = abs(square[0, 1]) + abs(square[0, 2]) + abs(square[1, 2])
        if not off > 1e-300 + 1e-17 * (abs(square[0, 0]) + abs(square[1, 1]) + abs(square[2, 2])):
            return
        for p in range(2):
            for q in range(p + 1, 3):
                if square[p, q] == 0.0:
                    continue
                theta = 0.5 * (square[q, q] - square[p, p]) / square[p, q]
                t = 1.0 / (abs(theta) + np.sqrt(theta * theta + 1.0))
                if theta < 0.0:
                    t = -t
                c = 1.0 / np.sqrt(t * t + 1.0)
                s = t * c
                for k in range(3):
                    x, y = square[k, p], square[k, q]
                    square[k, p], square[k, q] = c * x - s * y, s * x + c * y
                for k in range(3):
                    x, y = square[p, k], square[q, k]
                    square[p, k], square[q, k] = c * x - s * y, s * x + c * y
                for k in range(3):
                    x, y = axes[k, p], axes[k, q]
                    axes[k, p], axes[k, q] = c * x - s * y, s * x + c * y


@inner_kernel
def _least(square):
    """Return the column of the least eigenvalue on the diagonal."""
    k = 0
    for i in range(1, 3):
        if square[i, i] < square[k, k]:
            k = i
    return k


@inner_kernel
def _spread(rows, n, square):
    """Write the sum of the dyads of n rows (., 3)."""
    for a in range(3):
        for b in range(3):
            total = 0.0
            for j in range(n):
                total += rows[j, a] * rows[j, b]
            square[a, b] = total


@inner_kernel
def _circle(n, meridian, work):
    """Fit a circle to the points as the axis of `work.trial` shows them: from its end, or as meridian about it.

    Algebraic least squares. Returns the centre and the radius; a radius of 0 if there is none.
    """
    q, system = work.trial, work.system
    ux, uy, uz = _aside(q[3], q[4], q[5])
    vx, vy, vz = q[4] * uz - q[5] * uy, q[5] * ux - q[3] * uz, q[3] * uy - q[4] * ux
    for a in range(3):
        for b in range(4):
            system[a, b] = 0.0
    for j in range(n):
        x, y, z = work.points[j, 0], work.points[j, 1], work.points[j, 2]
        if meridian:
            dx, dy, dz = x - q[0], y - q[1], z - q[2]
            v = dx * q[3] + dy * q[4] + dz * q[5]
            u = np.sqrt((dx - v * q[3]) ** 2 + (dy - v * q[4]) ** 2 + (dz - v * q[5]) ** 2)
        else:
            u, v = x * ux + y * uy + z * uz, x * vx + y * vy + z * vz
        square = u * u + v * v
        system[0, 0] += 4.0 * u * u
        system[0, 1] += 4.0 * u * v
        system[0, 2] += 2.0 * u
        system[1, 1] += 4.0 * v * v
        system[1, 2] += 2.0 * v
        system[2, 2] += 1.0
        system[0, 3] += 2.0 * u * square
        system[1, 3] += 2.0 * v * square
        system[2, 3] += square
    system[1, 0], system[2, 0], system[2, 1] = system[0, 1], system[0, 2], system[1, 2]
    if not _solve(system, 3) > _RANK:
        return 0.0, 0.0, 0.0
    u, v = system[0, 3], system[1, 3]
    return u, v, np.sqrt(max(system[2, 3] + u * u + v * v, 0.0))


@inner_kernel
def _guess(kind, n, k, work):
    """Write a first surface to `work.best`; return whether there is one. See `fits._GUESS`."""
    work.best[7] = 0.0
    if kind == SPHERE:
        return _guess_sphere(n, work)
    if kind == CYLINDER:
        return _guess_cylinder(n, k, work)
    total = 0.0
    kept = 0
    for j in range(k):
        area = np.sqrt(work.normals[j, 0] ** 2 + work.normals[j, 1] ** 2 + work.normals[j, 2] ** 2)
        total += area
        kept += area > 0.0
    if not (0.0 < total < np.inf):
        return False
    if kind == CONE:
        return kept >= 3 and _guess_cone(n, k, total, work)
    return _guess_torus(n, k, total, work)


@inner_kernel
def _guess_sphere(n, work):
    system, q = work.system, work.best
    for a in range(4):
        for b in range(5):
            system[a, b] = 0.0
    for j in range(n):
        square = 0.0
        for a in range(3):
            square += work.points[j, a] ** 2
        for a in range(3):
            x = 2.0 * work.points[j, a]
            for b in range(3):
                system[a, b] += x * 2.0 * work.points[j, b]
            system[a, 3] += x
            system[3, a] += x
            system[a, 4] += x * square
        system[3, 3] += 1.0
        system[3, 4] += square
    if not _solve(system, 4) > _RANK:
        return False
    square = system[3, 4]
    for a in range(3):
        q[a] = system[a, 4]
        square += q[a] ** 2
    q[3], q[4], q[5], q[6] = 0.0, 0.0, 1.0, np.sqrt(max(square, 0.0))
    return square > 0.0


@inner_kernel
def _guess_cylinder(n, k, work):
    """Axis at right angles to the normals, or along the points' spread: whichever circle fits best."""
    q, trial = work.best, work.trial
    least = np.inf
    for source in range(2):
        if source == 0:
            _spread(work.normals, k, work.square)
        else:
            _spread(work.points, n, work.square)
        if not np.isfinite(work.square[0, 0] + work.square[1, 1] + work.square[2, 2]):
            continue
        _eigen(work.square, work.axes)
        for column in range(3):
            for d in range(3):
                trial[d], trial[3 + d] = 0.0, work.axes[d, column]
            u, v, radius = _circle(n, False, work)
            if not radius > 0.0:
                continue
            ax, ay, az = _aside(trial[3], trial[4], trial[5])
            bx, by, bz = trial[4] * az - trial[5] * ay, trial[5] * ax - trial[3] * az, trial[3] * ay - trial[4] * ax
            trial[0], trial[1], trial[2] = u * ax + v * bx, u * ay + v * by, u * az + v * bz
            trial[6], trial[7] = radius, 0.0
            cost = 0.0
            for j in range(n):
                cost += _distance(CYLINDER, trial, work.points, j, work.row) ** 2
            if cost < least:
                least = cost
                for d in range(8):
                    q[d] = trial[d]
    return least < np.inf


@inner_kernel
def _guess_cone(n, k, total, work):
    """Normals of a cone end on a circle about its axis; its tangent planes meet in the apex."""
    q, system, square = work.best, work.system, work.square
    mean = work.row
    for a in range(3):
        mean[a] = 0.0
        for j in range(k):
            mean[a] += work.normals[j, a] / total  # the sum of w n, w = area / total
        for b in range(4):
            system[a, b] = 0.0
        for b in range(3):
            square[a, b] = 0.0
    for j in range(k):
        area = np.sqrt(work.normals[j, 0] ** 2 + work.normals[j, 1] ** 2 + work.normals[j, 2] ** 2)
        if not area > 0.0:
            continue
        w = area / total
        level = 0.0
        for a in range(3):
            level += work.normals[j, a] / area * work.bases[j, a]
        for a in range(3):
            x = work.normals[j, a] / area
            for b in range(3):
                y = work.normals[j, b] / area
                square[a, b] += w * (x - mean[a]) * (y - mean[b])
                system[a, b] += w * x * y
            system[a, 3] += w * x * level
    if not _solve(system, 3) > 1e-18:
        return False
    _eigen(square, work.axes)
    column = _least(square)
    along = tilt = 0.0
    for a in range(3):
        q[a], q[3 + a] = system[a, 3], work.axes[a, column]
        along -= q[a] * q[3 + a]  # the points' middle is the origin
        tilt += mean[a] * q[3 + a]
    if along < 0.0:
        for a in range(3, 6):
            q[a] = -q[a]
    q[6] = np.arcsin(min(max(abs(tilt), 1e-6), 1.0 - 1e-6))
    return True


@inner_kernel
def _guess_torus(n, k, total, work):
    """The normals meet the axis, found as a linear complex (Pottmann and Randrup, Computing 60 (1998) 307); the
    meridian is a circle."""
    q, trial, square, system = work.best, work.trial, work.square, work.system
    for a in range(6):
        for b in range(6):
            system[a, b] = 0.0
    line = work.row
    for j in range(k):
        area = np.sqrt(work.normals[j, 0] ** 2 + work.normals[j, 1] ** 2 + work.normals[j, 2] ** 2)
        if not area > 0.0:
            continue
        x, y, z = work.normals[j, 0] / area, work.normals[j, 1] / area, work.normals[j, 2] / area
        p, r, s = work.bases[j, 0], work.bases[j, 1], work.bases[j, 2]
        line[0], line[1], line[2], line[3], line[4], line[5] = r * z - s * y, s * x - p * z, p * y - r * x, x, y, z
        for a in range(6):
            for b in range(6):
                system[a, b] += area / total * line[a] * line[b]
    for a in range(3):
        for b in range(3):
            square[a, b] = system[3 + a, 3 + b]
    _eigen(square, work.axes)
    most = max(abs(square[0, 0]), abs(square[1, 1]), abs(square[2, 2]))
    for a in range(3):  # columns 6 … 8: the pseudoinverse times the transpose of the upper right block
        for b in range(3):
            value = 0.0
            for e in range(3):
                if abs(square[e, e]) > 1e-12 * most:
                    inner = 0.0
                    for d in range(3):
                        inner += work.axes[d, e] * system[b, 3 + d]
                    value += work.axes[a, e] * inner / square[e, e]
            system[a, 6 + b] = value
    for a in range(3):
        for b in range(3):
            value = 0.5 * (system[a, b] + system[b, a])
            for d in range(3):
                value -= 0.5 * (system[a, 3 + d] * system[d, 6 + b] + system[b, 3 + d] * system[d, 6 + a])
            square[a, b] = value
    _eigen(square, work.axes)
    column = _least(square)
    for a in range(3):
        trial[3 + a] = work.axes[a, column]
    for a in range(3):
        line[a] = 0.0
        for b in range(3):
            line[a] -= system[a, 6 + b] * trial[3 + b]  # moment of the axis
    trial[0] = trial[4] * line[2] - trial[5] * line[1]
    trial[1] = trial[5] * line[0] - trial[3] * line[2]
    trial[2] = trial[3] * line[1] - trial[4] * line[0]
    u, v, radius = _circle(n, True, work)
    for a in range(3):
        q[a], q[3 + a] = trial[a] + v * trial[3 + a], trial[3 + a]
    q[6], q[7] = u, radius
    return radius > 0.0
