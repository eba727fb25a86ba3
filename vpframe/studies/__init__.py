"""Studies: one task over many variants, on one machine or a cluster; see docs/studies.md."""

from vpframe.studies.distributions import Choice, Distribution, LogNormal, Normal, Triangular, Uniform
from vpframe.studies.variants import Variant, load

__all__ = ["Choice", "Distribution", "LogNormal", "Normal", "Triangular", "Uniform", "Variant", "load"]
