"""Which clashes a session found when it began, and which came about by what was done."""

from __future__ import annotations

from collections.abc import Mapping

from collision import colliding_surfaces
from vpframe.analysis.clash_status import ClashKey
from vpframe.report.depth import Depth
from vpframe.report.log import SessionLog

BEFORE, TASK, EARLIER = "as it stands", "task", "earlier run"
ORIGINS = (TASK, BEFORE, EARLIER)
"""what a clash comes from, as a report lists them: the task, the assembly as it stood, a run before this one"""


def origins(log: SessionLog, found: Mapping[ClashKey, Depth]) -> dict[ClashKey, str]:
    """BEFORE or TASK for each clash that the log saw.

    As it stands are surfaces that met while their parts still stood to each other as before the first step, or that
    meet at those poses. If they only touched then and clash later, or got deeper by more than their facets stray, it is
    the task's.

    Parameters
    ----------
    found: the depths of the clashes.
    """
    begun: dict[tuple[str, str], frozenset[tuple[int, int]]] = {}
    out = {}
    for key, clash in log.clashes.items():
        standing = clash.unmoved
        if not standing and clash.first.step <= log.first_step:  # what was so before the first step was not seen
            a, b = key.part_a, key.part_b
            if (a, b) not in begun:
                pairs = colliding_surfaces(log.scene[a].mesh, log.scene[b].mesh, log.start[a].actInv(log.start[b]))
                begun[a, b] = frozenset(map(tuple, pairs.tolist()))
            standing = (key.surface_a, key.surface_b) in begun[a, b]
        depth = found.get(key)
        deeper = depth is not None and depth.clashes and depth.depth > depth.first + depth.slack
        out[key] = BEFORE if standing and not deeper else TASK
    return out
