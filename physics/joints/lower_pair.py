"""The lower pair that joints leave between two bodies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from constraints.freedom.lower_pairs import LowerPair, lower_pair
from physics.joints.rows import JointConstraint

ACROSS = 1e-7
"""1: directions are parallel, axes meet and pitches vanish to this (see `name_joint`)"""
INDEPENDENT = 1e-9
"""1: singular value of the constraints' rows, relative to the largest or to 1, above which a row takes freedom"""


def pair_between(
    joints: Sequence[JointConstraint], child: int, pose_parent: pin.SE3, pose_child: pin.SE3
) -> LowerPair | None:
    """The lower pair that constraints between two bodies leave at these poses, in the child's frame; None if none."""
    rows = []
    for joint in joints:
        a, _ = joint.bodies
        poses = (pose_child, pose_parent) if a == child else (pose_parent, pose_child)
        by_a, by_b = joint.jacobian(*poses)
        rows.append(by_a if a == child else by_b)
    _, s, vt = np.linalg.svd(np.concatenate(rows))
    rank = int((s > INDEPENDENT * max(s.max(), 1.0)).sum())
    return lower_pair(vt[rank:].T, 1.0, ACROSS)
