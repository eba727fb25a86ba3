"""Origin of clashes: in the initial assembly, or caused by the task."""

from __future__ import annotations

from collections.abc import Mapping

from collision import colliding_surfaces
from vpframe.analysis.clash_status import ClashKey
from vpframe.report.depth import Depth
from vpframe.session.log import SessionLog

BEFORE, TASK, EARLIER = "as it stands", "task", "earlier run"
ORIGINS = (TASK, BEFORE, EARLIER)
"""origins in the order of the report: the task, the initial assembly, an earlier run"""


def origins(log: SessionLog, found: Mapping[ClashKey, Depth]) -> dict[ClashKey, str]:
    """Return BEFORE or TASK for each clash of the log.

    BEFORE are surfaces that intersected while their parts had their initial relative pose, or that intersect at that
    pose. A clash is the task's if they only touched then, or got deeper by more than their deflections.

    Parameters
    ----------
    found: depths of the clashes.
    """
    begun: dict[tuple[str, str], frozenset[tuple[int, int]]] = {}
    out = {}
    for key, clash in log.clashes.items():
        unmoved = clash.unmoved
        if not unmoved and clash.first.step <= log.first_step:  # nothing was recorded before the first step
            a, b = key.part_a, key.part_b
            if (a, b) not in begun:
                pairs = colliding_surfaces(log.scene[a].mesh, log.scene[b].mesh, log.start[a].actInv(log.start[b]))
                begun[a, b] = frozenset(map(tuple, pairs.tolist()))
            unmoved = (key.surface_a, key.surface_b) in begun[a, b]
        depth = found.get(key)
        deeper = depth is not None and depth.clashes and depth.depth > depth.first + depth.slack
        out[key] = BEFORE if unmoved and not deeper else TASK
    return out
