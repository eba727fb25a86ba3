"""Candidates: their reasons and their order."""

import pytest

from collision import Tolerance
from tests.constraints.recognition.finding import found
from tests.constraints.shapes import at, box, turned


def test_better_mates_come_first():
    bodies = [box(0.1, 0.1, 0.02), box(0.05, 0.05, 0.05), box(0.05, 0.05, 0.05)]
    poses = [at(), at(z=0.035), at(x=0.06, y=0.06, z=0.0352)]
    scores = [c.score for c in found(bodies, poses, Tolerance())]
    assert scores[0] == pytest.approx(1.0) and scores == sorted(scores, reverse=True) and scores[-1] < 0.9


def test_every_candidate_says_why():
    tapered = turned([(0, 0), (0.01, 0), (0.02, 0.04), (0, 0.04)])
    seat = turned([(0.01, 0), (0.03, 0), (0.03, 0.04), (0.02, 0.04)])
    (candidate,) = found([tapered, seat], [at(), at()])
    assert candidate.kind == "conical" and "half angle 14.04°" in candidate.why and "touch" in candidate.why


@pytest.mark.parametrize(
    ("gap", "words"),
    [(0.0, "their faces touch"), (5e-6, "their faces touch"), (8.3e-4, "within reach, 0.83 mm apart at the nearest")],
)
def test_faces_are_said_to_touch_only_where_they_do(gap, words):
    (candidate,) = found([box(0.1, 0.1, 0.1), box(0.1, 0.1, 0.1)], [at(), at(z=0.1 + gap)], Tolerance())
    assert candidate.why.endswith(words)
    assert ("touch" in candidate.why) == (gap <= Tolerance().linear)
