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
        faces, self._bodies, local = [], [], []
        for k, candidate in enumerate(candidates):
            p, q = candidate.geometries
            if candidate.kind == "against" and isinstance(p, Plane) and isinstance(q, Plane):
                faces.append(k)
                self._bodies.append(candidate.bodies)
                local.append((p.normal, candidate.match.local, q.normal, q.origin))
        self._faces, self._local = np.array(faces, np.int64), np.array(local).reshape(-1, 4, 3)

    def apart(self, at: Sequence[pin.SE3]) -> tuple[Array, Array]:
        """(k,) m and (k,) rad that each is apart where bodies are `at`; of faces only what parts them counts."""
        together = self.together
        squares = together.residual(at) ** 2
        k = len(self.distances)
        turn = np.sqrt(np.bincount(self._of_row, np.where(together.linear, 0.0, squares), k))
        distance = np.sqrt(np.bincount(self._of_row, np.where(together.linear, squares, 0.0), k))
        if len(self._faces):
            ra, rb = (np.array([at[pair[side]].rotation for pair in self._bodies]) for side in (0, 1))
            ta, tb = (np.array([at[pair[side]].translation for pair in self._bodies]) for side in (0, 1))
            p, middle = (np.einsum("kij,kj->ki", ra, self._local[:, n]) for n in (0, 1))
            q, origin = (np.einsum("kij,kj->ki", rb, self._local[:, n]) for n in (2, 3))
            facing = (p * q).sum(axis=1)
            opening = ((origin + tb - middle - ta) * q).sum(axis=1) / np.where(facing < 0.0, facing, 1.0)
            # only parting counts: pressing together is what the faces are for
            distance[self._faces] = np.where(facing < 0.0, np.maximum(0.0, opening), np.inf)
        return distance, turn
