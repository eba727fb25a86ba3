"""Removal paths, disassembly order, what is in the way.

Out of scope: moving A half way, then B, then A again; parts that leave at once in different directions; flexible parts;
whether a tool reaches.
May use `scene`, `analysis`, `session` (for replay), and the packages below; knows no pages.
Start with `plan` (`removal`, `disassembly`), then `assembly` (the scene as planning sees it) and `ways`.
"""

from __future__ import annotations

from vpframe.planning.plan import Disassembly, PlannedStep, PlanOptions, SearchOptions, disassembly, removal
from vpframe.planning.verdict import Removal

__all__ = ["Disassembly", "PlanOptions", "PlannedStep", "Removal", "SearchOptions", "disassembly", "removal"]
