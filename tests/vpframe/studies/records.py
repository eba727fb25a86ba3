"""Records of variants that were never run."""

from typing import Any

import numpy as np

from vpframe.studies.distributions import Choice, Distribution, LogNormal, Normal, Triangular, Uniform


def section(page: str, title: str) -> str:
    return page.split(f"<h2>{title}</h2>")[1].split("<h2>")[0]


VARIABLES: dict[str, Distribution] = {
    "bore": Normal(8.02e-3, 5e-6, unit="m"),
    "gap (m)": Uniform(1e-5, 4e-5),
    "tilt": Triangular(-0.01, 0.0, 0.01, unit="rad"),
    "wear": LogNormal(2e-6, 0.3, unit="m"),
    "plain": Uniform(0.0, 1.0),
    "seal": Choice("a", "b"),
}


def records(count: int = 120, seed: int = 3) -> list[dict[str, Any]]:
    """Variants of which those with a narrow gap fail: they have a clearance and no measure."""
    rng = np.random.default_rng(seed)
    out = []
    for k in range(count):
        given = {name: distribution.quantile(float(rng.random())) for name, distribution in VARIABLES.items()}
        good = given["gap (m)"] > 1.6e-5
        found = {"force (N)": 1e3 * given["bore"], "depth (m)": 1e-6 * k} if good else {}
        out.append(
            {
                "key": str(k),
                "index": k,
                "status": "ok" if good else "no",
                "reason": "" if good else "expected it",
                "parameters": given,
                "measures": found,
                "clearance": given["gap (m)"] / 3,
                "time": 1.0,
                "steps": 60,
                "seconds": 0.1,
                "memory": 1,
                "attempts": 1,
                "worker": "",
            }
        )
    return out
