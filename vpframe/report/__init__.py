"""The report of a session: a folder with `index.html` (self-contained), `report.json`, `clashes.csv`.

`SessionLog` observes a session; `write` creates the folder from its data. Numbers are SI in `report.json` and
`clashes.csv`, and have the stated units on the page. `clashes.json` keeps the status of clashes between runs (see
`vpframe.analysis.clash_status`): a clash that is marked as accepted stays accepted.
"""

from vpframe.report.log import Clash, SessionLog, Stage
from vpframe.report.swept import SweptVolume
from vpframe.report.writer import write

__all__ = ["Clash", "SessionLog", "Stage", "SweptVolume", "write"]
