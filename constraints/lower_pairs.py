"""Names for spaces of relative motion: which lower pair a space of twists belongs to.

A lower pair's motions form a subgroup of SE(3) (Hervé, Mechanism and Machine Theory 13, 1978); its twists are told from
others by the rank of their angular part, their pitch and the point their axes share.
"""

from __future__ import annotations

import numpy as np

from constraints.system import Array

ACROSS = 1e-6
"""1: how far from parallel, from meeting, or from zero pitch (in length scales) still counts as exactly so"""


def orthonormal(columns: Array, threshold: float) -> Array:
    """Orthonormal basis (n, k) of the columns' span, singular values up to `threshold` left out."""
    if columns.size == 0:
        return np.zeros((columns.shape[0], 0))
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    return u[:, : int(np.sum(s > threshold))]


def name_joint(twists: Array, length: float) -> str:
    """Lower pair of the space spanned by `twists` (6, f), linear first; `length` (m) scales pitch and offsets.

    "rigid", "revolute", "prismatic", "screw", "cylindrical", "pin-slot", "universal", "planar", "spherical",
    "translational", "free", else "n-dof".
    """
    freedom = twists.shape[1]
    if freedom == 0:
        return "rigid"
    if freedom == 6:
        return "free"
    basis = orthonormal(np.vstack([twists[:3] / length, twists[3:]]), 0.0)
    u, s, vt = np.linalg.svd(basis[3:])
    rank = int(np.sum(s > ACROSS))
    turning = basis @ vt[:rank].T  # (6, rank) motions that turn
    sliding = basis[:3] @ vt[rank:].T  # (3, freedom - rank) motions that only slide
    axes = u[:, :rank]
    if rank == 0:
        return {1: "prismatic", 3: "translational"}.get(freedom, f"{freedom}-dof")
    if freedom == rank and _meet(turning):
        return {1: "revolute", 2: "universal", 3: "spherical"}[rank]
    if rank == 1 and freedom == 1:
        return "screw"
    if rank == 1 and freedom == 2:
        along = float(abs(sliding[:, 0] @ axes[:, 0]) / np.linalg.norm(sliding[:, 0]))
        if along > 1.0 - ACROSS:
            return "cylindrical"
        rest = turning[:3, 0] - sliding[:, 0] * (sliding[:, 0] @ turning[:3, 0]) / (sliding[:, 0] @ sliding[:, 0])
        if along < ACROSS and abs(rest @ axes[:, 0]) < ACROSS:
            return "pin-slot"
    if rank == 1 and freedom == 3 and float(np.abs(axes[:, 0] @ sliding).max()) < ACROSS:
        pitch = float(turning[:3, 0] @ axes[:, 0])
        if abs(pitch) < ACROSS:
            return "planar"
    return f"{freedom}-dof"


def _meet(turning: Array) -> bool:
    """Whether all the motions are rotations about axes through one point c: v = c × ω for each."""
    rows = [np.array([[0.0, w[2], -w[1]], [-w[2], 0.0, w[0]], [w[1], -w[0], 0.0]]) for w in turning[3:].T]
    a, b = np.vstack(rows), turning[:3].T.ravel()
    c = np.linalg.lstsq(a, b, rcond=None)[0]
    return float(np.abs(a @ c - b).max()) < ACROSS * (1.0 + float(np.abs(c).max()))
