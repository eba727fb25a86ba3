"""`Pulls`: distances by which hands pull constraints apart, for many constraints in one call."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision.numeric.kernel import inner_kernel, kernel
from collision.numeric.vectors import dot, norm, rotated, sub
from constraints.geometry.surfaces import Plane
from constraints.recognition.candidate import Candidate
from constraints.solve.together import Together

Array = NDArray[np.float64]
LEAN = float(np.sin(np.radians(0.5)))
"""1: least ratio of the opening of two faces to a pull that counts as separating them; a smaller one slides along them,
and a screw's lead lifts its head by more"""


class Pulls:
    """Candidates in force, as arrays.

    Parameters
    ----------
    distances: (k,) m, by which each may be pulled apart before it is removed.
    """

    def __init__(self, candidates: Sequence[Candidate], distances: Sequence[float]) -> None:
        self.together = Together.of([c.constraint for c in candidates])
        self.distances = np.array(distances)
        self._of_row = np.repeat(np.arange(len(candidates)), np.diff(self.together.rows))
        faces, bodies, local, sizes = [], [], [], []
        for k, candidate in enumerate(candidates):
            p, q = candidate.geometries
            if candidate.kind == "against" and isinstance(p, Plane) and isinstance(q, Plane):
                faces.append(k)
                bodies.append(candidate.bodies)
                local.append((p.normal, candidate.match.local, q.normal, q.origin))
                sizes.append(candidate.match.size)
        self._faces, self._local = np.array(faces, np.int64), np.array(local).reshape(-1, 4, 3)
        self._sizes = np.array(sizes)
        place = {body: k for k, body in enumerate(self.together.named[0])}
        self._a, self._b = np.array([(place[a], place[b]) for a, b in bodies], np.int64).reshape(-1, 2).T

    def apart(self, at: Sequence[pin.SE3], poses: Sequence[pin.SE3]) -> tuple[Array, Array]:
        """Return (k,) m and (k,) rad by which hands that want bodies to go from `poses` to `at` pull each apart.

        For two faces only a pull that separates them counts, but then its whole length, and turns at the faces' size: a
        part wedged between slanted faces cannot move until both contacts release, nor a screw turn until its head does.
        """
        together, k = self.together, len(self.distances)
        now, before = together.gather(at), together.gather(poses)
        distance, turn = np.zeros(k), np.zeros(k)
        residual = together.residual_at(*now)
        _sum_residuals(self._of_row, together.linear, residual, distance, turn)
        _part_faces(self._faces, self._a, self._b, self._local, self._sizes, self.distances, *now, *before, distance)
        return distance, turn


@kernel
def _sum_residuals(of_row, linear, residual, distance, turn):  # pragma: no cover - compiled
    """Fill distance (k,) m and turn (k,) rad, zeros: norms of the rows (m,) of each constraint."""
    for row in range(len(residual)):
        square = residual[row] * residual[row]
        if linear[row]:
            distance[of_row[row]] += square
        else:
            turn[of_row[row]] += square
    for k in range(len(distance)):
        distance[k], turn[k] = np.sqrt(distance[k]), np.sqrt(turn[k])


@kernel
def _part_faces(faces, a, b, local, sizes, limits, rotation, translation, rotation_0, translation_0, distance):
    """Set the `distance` (k,) m of pairs of faces to their opening.

    rotation, translation: poses after the pull; rotation_0, translation_0: before it.
    """
    for m in range(len(faces)):
        k, i, j = faces[m], a[m], b[m]
        place = _place(local[m], rotation, translation, i, j)
        p, q = rotated(rotation[i], local[m, 0]), rotated(rotation[j], local[m, 2])
        facing = dot(p, q)
        if not facing < 0.0:
            distance[k] = np.inf
            continue
        opening = -dot(place, q) / facing
        if opening > LEAN * limits[k]:  # else no pull that separates the faces is as long as its limit
            trace = 0.0
            for x in range(3):
                for y in range(3):
                    turned = stood = 0.0
                    for z in range(3):
                        turned += rotation[i, z, x] * rotation[j, z, y]
                        stood += rotation_0[i, z, x] * rotation_0[j, z, y]
                    trace += turned * stood
            angle = np.arccos(min(max(0.5 * (trace - 1.0), -1.0), 1.0))
            pull = norm(sub(place, _place(local[m], rotation_0, translation_0, i, j))) + sizes[m] * angle
            if opening > LEAN * pull:
                opening = max(opening, pull)
        distance[k] = max(0.0, opening)  # pressing the faces together does not count


@inner_kernel
def _place(local, rotation, translation, i, j):  # pragma: no cover - compiled
    """Vector from the second face, of body j, to the first, of body i, m, world."""
    x, y = rotated(rotation[i], local[1]), rotated(rotation[j], local[3])
    s, t = translation[i], translation[j]
    return x[0] + s[0] - y[0] - t[0], x[1] + s[1] - y[1] - t[1], x[2] + s[2] - y[2] - t[2]
