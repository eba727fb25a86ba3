"""How far hands pull constraints apart, against the same computed one constraint at a time from its definition."""

import numpy as np
import pinocchio as pin

from constraints.geometry.surfaces import Plane
from constraints.recognition.pulls import LEAN, Pulls
from tests.constraints.recognition.test_attention import HOMES, manager_of, poses_at_home, world_of


def pulled(candidate, at, poses, limit):
    """m and rad that a candidate is pulled apart."""
    a, b = candidate.bodies
    residual = candidate.constraint.residual(at[a], at[b])
    angular = candidate.constraint.angular
    turn = np.linalg.norm(residual[angular])
    p, q = candidate.geometries
    if not (candidate.kind == "against" and isinstance(p, Plane) and isinstance(q, Plane)):
        return np.linalg.norm(residual[~angular]), turn

    def place(poses):
        return poses[a].act(candidate.match.local) - poses[b].act(q.origin)

    normal = at[b].rotation @ q.normal
    facing = (at[a].rotation @ p.normal) @ normal
    if facing >= 0.0:
        return np.inf, turn
    opening = -place(at) @ normal / facing
    if opening > LEAN * limit:
        turned, stood = (x[a].actInv(x[b]).rotation for x in (at, poses))
        angle = np.linalg.norm(pin.log3(stood.T @ turned))
        pull = np.linalg.norm(place(at) - place(poses)) + candidate.match.size * angle
        if opening > LEAN * pull:
            opening = max(opening, pull)
    return max(0.0, opening), turn


def test_pulls_are_those_of_the_definition():
    rng = np.random.default_rng(7)
    manager, poses = manager_of([lambda c: True]), poses_at_home()
    for seated in (1, 3):
        poses[seated].translation[2] = 0.01
    manager.update(poses, world_of(poses).contacts(manager.within))
    candidates = [entry.candidate for entry in manager.accepted.values()]
    assert {c.kind for c in candidates} >= {"against", "concentric"}
    limits = rng.uniform(1e-4, 1e-2, len(candidates))
    pulls = Pulls(candidates, limits)
    leant = 0
    for size in (0.0, 1e-4, 1e-3, 0.01, 0.5):
        for _ in range(40):
            twists = size * rng.normal(size=(len(HOMES), 6)) * ([0.05] * 3 + [1.0] * 3)
            at = [pose * pin.exp6(twist) for pose, twist in zip(poses, twists, strict=True)]
            distance, turn = pulls.apart(at, poses)
            wanted = [pulled(c, at, poses, limit) for c, limit in zip(candidates, limits, strict=True)]
            np.testing.assert_allclose(np.transpose([distance, turn]), wanted, rtol=1e-9, atol=1e-8)
            leant += int((distance > limits).sum())
    assert leant > 20
    half = pin.SE3(pin.exp3(np.array([np.pi, 0.0, 0.0])), np.zeros(3))
    flipped = [pose * half if i % 2 else pose for i, pose in enumerate(poses)]
    assert np.isinf(pulls.apart(flipped, poses)[0]).any()  # faces that look the same way face each other nowhere
