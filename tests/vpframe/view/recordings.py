"""Recordings, and their rows."""

import numpy as np

from vpframe.events import ConstraintView
from vpframe.view import replay


def rows_of(path):
    rows = {}
    for entity, chunk in replay.tables(path):
        rows.setdefault(entity, []).extend(chunk)
    return rows


def at_step(rows, component):
    """Value by step of one component; a later row of a step counts."""
    return {row["step"]: row[component] for row in rows if component in row and "step" in row}


def quiet(id, parts, step):
    """A constraint in force that nothing happens to, but for number 300, which is accepted in step 16."""
    state = "candidate" if id == 300 and step < 16 else "active"
    return ConstraintView(id, "against", parts, ((0,), (1,)), 0.0, state, np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.01)
