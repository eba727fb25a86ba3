"""`Pulls`: how far hands pull constraints apart, of many in one go."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from constraints.geometry.surfaces import Plane
from constraints.recognition.candidate import Candidate
from constraints.solve.together import Together

Array = NDArray[np.float64]
LEAN = float(np.sin(np.radians(0.5)))
"""of a pull, that parts two faces: less is a pull along them, not off them; a screw's lead parts its head by more"""


class Pulls:
    """Some candidates in force, as arrays.

    Parameters
    ----------
    distances: (k,) m, to which each may be pulled apart.
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
        """(k,) m and (k,) rad that each is pulled apart by hands that want bodies from their `poses` to be `at`.

        Of faces only a pull that parts them counts, but then all of it, and turns at the faces' size: wedged between
        slanted faces a part goes no way before these give way, and a screw does not turn before its head comes off.
        """
        together = self.together
        rotation, translation = together.gather(at)
        squares = together.residual_at(rotation, translation) ** 2
        k = len(self.distances)
        turn = np.sqrt(np.bincount(self._of_row, np.where(together.linear, 0.0, squares), k))
        distance = np.sqrt(np.bincount(self._of_row, np.where(together.linear, squares, 0.0), k))
        if len(self._faces):
            facing, opening, place = self._opening(rotation, translation)
            limit = LEAN * self.distances[self._faces]
            if (opening > limit).any():  # else no pull is as long as its limit and parts the faces
                before = together.gather(poses)
                pull = np.linalg.norm(place - self._opening(*before)[2], axis=1)
                pull += self._sizes * self._turns(rotation, before[0])
                opening = np.where(opening > LEAN * pull, np.maximum(opening, pull), opening)
            # only parting counts: pressing together is what the faces are for
            distance[self._faces] = np.where(facing < 0.0, np.maximum(0.0, opening), np.inf)
        return distance, turn

    def _opening(self, rotation: Array, translation: Array) -> tuple[Array, Array, Array]:
        """Of faces: cosine between their normals, m that they are apart, (m, 3) place of the first from the second."""
        back = rotation.transpose(0, 2, 1)
        of_a, of_b = self._local[:, :2] @ back[self._a], self._local[:, 2:] @ back[self._b]
        p, q = of_a[:, 0], of_b[:, 0]
        place = of_a[:, 1] + translation[self._a] - of_b[:, 1] - translation[self._b]
        facing = (p * q).sum(axis=1)
        return facing, (-place * q).sum(axis=1) / np.where(facing < 0.0, facing, 1.0), place

    def _turns(self, rotation: Array, before: Array) -> Array:
        """Of faces: rad by which one body turned against the other since rotations were those `before`."""
        now, then = (r[self._a].transpose(0, 2, 1) @ r[self._b] for r in (rotation, before))
        return np.arccos(np.clip(0.5 * ((now * then).sum(axis=(1, 2)) - 1.0), -1.0, 1.0))
