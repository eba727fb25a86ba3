"""The report of a session: a folder with `index.html` (self-contained), `report.json`, `clashes.csv`.

`SessionLog` observes a session; `write` creates the folder from its data. Numbers are SI in `report.json` and
`clashes.csv`, and have the stated units on the page. `clashes.json` keeps the status of clashes between runs (see
`vpframe.analysis.clash_status`): a clash that is marked as accepted stays accepted.
May use `session`, `analysis`, `planning` (pages of plans) and `view` (pictures). Start with `writer`, then `page` and
its template `run.html`; `base.html` and `plots` serve the pages of plans and studies, too.
"""

from vpframe.analysis.swept import SweptVolume
from vpframe.report.writer import write
from vpframe.session.log import Clash, SessionLog, Stage

__all__ = ["Clash", "SessionLog", "Stage", "SweptVolume", "write"]
