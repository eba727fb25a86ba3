"""Studies: one task over many variants, on one machine or a cluster; see docs/studies.md.

May use `session`, `importers`, `scene`, `processes`, and base page and plots of `report`; Dask only with several jobs.
Start with `run` (a study from beginning to end), then `variants` and `distributions` (what varies), `child` and
`runner` (the process that runs variants), `summary` and `report` (what is found).
"""

from vpframe.studies.distributions import Choice, Distribution, LogNormal, Normal, Triangular, Uniform
from vpframe.studies.variants import Variant, load

__all__ = ["Choice", "Distribution", "LogNormal", "Normal", "Triangular", "Uniform", "Variant", "load"]
