"""The report of a session: a folder with `index.html` (one file, nothing from outside), `report.json`, `clashes.csv`.

`SessionLog` watches a session; `write` makes the folder from what it saw. Numbers are SI in `report.json` and
`clashes.csv`, and in the units they name on the page. `clashes.json` keeps each clash's status between runs
(see `vpframe.analysis.clash_status`): mark a clash as accepted there and it stays accepted.
"""

from vpframe.report.log import Clash, SessionLog, Stage
from vpframe.report.swept import SweptVolume
from vpframe.report.writer import write

__all__ = ["Clash", "SessionLog", "Stage", "SweptVolume", "write"]
