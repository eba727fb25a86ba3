"""A verdict that is kept is the one that measuring gives, wherever bodies go; sliding along a mate measures seldom."""

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from collision import Tolerance
from constraints.geometry.views import Limits
from constraints.recognition.pairings import FITS, PAIRINGS, rows_for
from constraints.recognition.recognise import Recogniser
from tests.constraints.shapes import box, flanged_shaft, housing

BODIES = (housing(0.0101), flanged_shaft(phase=0.05), box(0.05, 0.05, 0.05), housing(0.0145, 0.01, 0.02))
KEEP = Limits.keep(Tolerance())
LIMITS = (Limits.offer(Tolerance()), KEEP, replace(KEEP, linear=np.inf, angular=np.pi / 2))
PAIRS = tuple(
    (a, fa, b, fb)
    for a, b in ((0, 1), (0, 2), (1, 2), (1, 3))
    for fa, fb in product(range(len(BODIES[a].features)), range(len(BODIES[b].features)))
)


class Counting(Recogniser):
    """Counts what is measured."""

    measured = 0

    def matches(self, *given: Any, **named: Any) -> Any:
        self.measured += 1
        return super().matches(*given, **named)


def poses_at(offset: np.ndarray, turn: np.ndarray) -> list[pin.SE3]:
    """The shaft off its seat in the housing, the box on top of both, the other housing around the shaft."""
    return [
        pin.SE3.Identity(),
        pin.SE3(pin.exp3(turn), np.array([0.0, 0.0, 0.03]) + offset),
        pin.SE3(pin.exp3(-turn), np.array([0.0, 0.0, 0.085]) - offset),
        pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.06])),
    ]


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    scale=st.sampled_from([1e-5, 1e-4, 1e-3, 1e-2]),
    tilt=st.sampled_from([0.0, 1e-4, 1e-2, 0.3]),
    limits=st.sampled_from(LIMITS),
    rows=st.sampled_from([PAIRINGS, rows_for(set(FITS))]),
)
def test_what_is_kept_is_what_measuring_gives(
    seed: int, scale: float, tilt: float, limits: Limits, rows: tuple[Any, ...]
) -> None:
    rng = np.random.default_rng(seed)
    kept = Recogniser([body.features for body in BODIES])
    fresh = Recogniser([body.features for body in BODIES])
    offset, turn = rng.normal(0, scale, 3), rng.normal(0, tilt, 3)
    for _ in range(12):
        poses = poses_at(offset, turn)
        kinds = kept.verdicts.kinds("test", PAIRS, poses, limits, rows)
        for pair, kind in zip(PAIRS, kinds, strict=True):
            found = fresh.matches(pair, poses, limits, rows)
            assert kind == (None if found is None else found.kind), pair
        offset, turn = offset + rng.normal(0, scale, 3), turn + rng.normal(0, 0.3 * tilt, 3)


@pytest.mark.parametrize("limits", LIMITS)
def test_a_shaft_that_slides_in_its_bore_is_measured_seldom(limits: Limits) -> None:
    recogniser = Counting([body.features for body in BODIES])
    steps, seated, rows = 200, poses_at(np.zeros(3), np.zeros(3)), rows_for(set(FITS))
    pairs = tuple(p for p in PAIRS if limits is not LIMITS[2] or recogniser.matches(p, seated, LIMITS[1]) is not None)
    assert len(pairs) > 1
    for k in range(steps):
        poses = poses_at(np.array([0.0, 0.0, 0.002 * k / steps]), np.zeros(3))
        recogniser.verdicts.kinds("test", pairs, poses, limits, rows)
    assert recogniser.measured < 0.05 * steps * len(pairs) + len(PAIRS)
