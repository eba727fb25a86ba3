"""A task that a type checker reads without a complaint; `test_wheel.py` runs it and checks it."""

from __future__ import annotations

import vpframe as vp


def surfaces(scene: vp.Scene, part: str) -> list[tuple[str, float]]:
    """Bores and shafts of a part: names and radii (m)."""
    found: list[tuple[str, float]] = []
    for surface in scene[part].surfaces:
        if isinstance(surface.geometry, vp.Cylinder):
            found.append((surface.name, surface.geometry.radius))
    return found


def task(session: vp.Session) -> None:
    """Out and in again."""
    hand: vp.Hand = session.hand()
    hand.grab("shaft")
    outcome: vp.Outcome = hand.move_by((0.0, 0.0, 0.06), duration=1.0)
    print(f"{outcome.reason} at {outcome.time:.2f} s")
    freedom: int = session.freedom("shaft")
    session.expect_freedom("shaft", freedom)
    session.expect_no_clash()


def main() -> None:
    """Load the demo's model and run the task."""
    scene: vp.Scene = vp.load("vpframe-demo/shaft_and_housing.step")
    assert surfaces(scene, "shaft")
    rule = vp.accept_kinds("concentric")
    with vp.Session(scene, rule=rule, tolerance=vp.Tolerance(reach=0.5e-3)) as session:
        task(session)
    events: list[str] = [event.text for event in session.events]
    assert events
    study: dict[str, vp.Normal | vp.Uniform] = {"bore": vp.Normal(0.02, 1e-6), "tilt": vp.Uniform(-0.1, 0.1)}
    assert len(study) == 2


if __name__ == "__main__":
    main()
