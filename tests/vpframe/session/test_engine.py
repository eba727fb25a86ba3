"""What the managers know besides the state is a cache; a state is a value that a session can go back to."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from collision.contact import surfaces_of
from tests.vpframe.session.fits import tight_fit
from tests.vpframe.session.test_step import falling, put_in, told
from tests.vpframe.session.test_there_and_back import HERE
from vpframe.events import Frame
from vpframe.hands.assist import Assist
from vpframe.scene import modelling
from vpframe.scene.scene import Part, Scene
from vpframe.session import rules
from vpframe.session.session import Session

ROOT = Path(__file__).parents[3]
Task = Callable[[Session], None]


def steps(session: Session) -> None:
    for _ in range(40):
        session.step()


def fitted(kind: str, gap: float, **options: object) -> Session:
    housing, key = (modelling.shape(solid) for solid in tight_fit(kind, gap))
    handle = Part(
        "handle", modelling.shape(modelling.cylinder(0.002, 0.01)), pin.SE3(np.eye(3), np.array([0, 0, 0.025]))
    )
    parts = [Part("housing", housing, HERE), Part("key", key, HERE), handle]
    parts[0].fixed = True
    return Session(Scene(parts), **options)  # type: ignore[arg-type]


def there_and_back(session: Session) -> None:
    hand = session.hand()
    hand.grab("key", carry="handle")
    hand.slide("z", 0.02, speed=0.3)
    hand.slide("z", -0.02, speed=0.3, required=False)
    hand.release()


def carefully(session: Session) -> None:
    hand = session.hand()
    hand.assist = Assist(snap=0.002, snap_angle=0.1, slow_within=0.01)
    hand.grab("handle")
    hand.move_by((0.03, 0.0, 0.0), duration=0.3, required=False)
    hand.move_by((-0.03, 0.0, -0.01), duration=0.4, required=False)
    session.thread("key", 1e-3)
    session.run(0.1)


def decided(session: Session) -> None:
    hand = session.hand()
    hand.grab("key")
    for distance in (1e-4, 2e-4, -1e-4):
        hand.slide("z", distance, required=False)
        for candidate in session.candidates:
            session.accept(candidate)
        hand.wait(0.05)
        for constraint in session.constraints[::2]:
            session.remove(constraint)
        hand.slide("z", distance, required=False)
    hand.release()
    hand.grab("key", carry="handle")
    hand.slide("z", 1e-4, required=False)
    session.ignore("key", "housing")
    hand.slide("x", 1e-3, required=False)
    hand.release()


TASKS: dict[str, tuple[Callable[[], Session], Task]] = {
    "put in": (put_in, steps),
    "falling": (falling, steps),
    "out of a bore and back": (lambda: fitted("bore", 1e-5), there_and_back),
    "out of a dovetail and back": (lambda: fitted("dovetail", 3e-5, rule=rules.leave_all), there_and_back),
    "decided by the script": (lambda: fitted("bore", 1e-5, rule=rules.leave_all), decided),
    "a hand that slows down": (lambda: fitted("pocket", 1e-4, clearance=True), carefully),
}


def without_caches(session: Session) -> Session:
    """Throw away every cache before each step."""
    original = session.step

    def step() -> Frame:
        session.engine.state = session.state
        return original()

    session.step = step  # type: ignore[method-assign]
    return session


@pytest.mark.parametrize("name", TASKS)
def test_a_session_without_caches_runs_to_the_same_bytes(name: str) -> None:
    make, task = TASKS[name]
    plain, bare = make(), without_caches(make())
    task(plain)
    task(bare)
    assert plain.step_count == bare.step_count > 10
    assert plain.save() == bare.save()
    assert told(plain) == told(bare)


@pytest.mark.parametrize("name", TASKS)
def test_a_session_goes_back_to_a_value_and_on_as_before(name: str) -> None:
    make, task = TASKS[name]
    session, plain = make(), make()
    mark = session.mark()
    task(session)
    session.undo(mark)
    assert session.save() == plain.save()
    task(session)
    task(plain)
    assert session.save() == plain.save()
    assert told(session) == told(plain)
    assert [f.step for f, _ in session.log.history] == [f.step for f, _ in plain.log.history]
    for collected in ("colliding", "stages", "freedom"):
        assert getattr(session.log, collected) == getattr(plain.log, collected)
    for id, mate in plain.log.mates.items():
        assert session.log.mates[id].spans == mate.spans
    assert {k: (c.steps, c.spans) for k, c in session.log.clashes.items()} == {
        k: (c.steps, c.spans) for k, c in plain.log.clashes.items()
    }
    assert list(session.log.clearance) == list(plain.log.clearance)
    for part in session.scene.names:
        there, here = ([(k, p.homogeneous.tobytes()) for k, p in s.trail(part)] for s in (session, plain))
        assert there == here


def test_the_log_of_steps_taken_back_is_that_of_the_steps_before() -> None:
    """Back to the middle of a task: the log is that of a session that never went on."""
    session, plain = (fitted("pocket", 1e-4, clearance=True) for _ in range(2))
    for each in (session, plain):
        hand = each.hand()
        hand.grab("key", carry="handle")
        hand.slide("z", 0.004, speed=0.1)
    mark = session.mark()
    session.hand().move_by((0.01, 0.0, 0.0), duration=0.2, required=False)
    session.hand().slide("z", 0.02, speed=0.3)
    session.undo(mark)
    one, other = session.log, plain.log
    assert (one.steps, one.colliding, one.stages, one.freedom) == (
        other.steps,
        other.colliding,
        other.stages,
        other.freedom,
    )
    assert {k: (c.spans, len(c.samples)) for k, c in one.clashes.items()} == {
        k: (c.spans, len(c.samples)) for k, c in other.clashes.items()
    }
    assert list(one.clearance) == list(other.clearance)
    assert one.least is not None and other.least is not None and one.least.clearance == other.least.clearance
    assert [e.text for e, _ in one.moments] == [e.text for e, _ in other.moments]
    assert {id: m.spans for id, m in one.mates.items()} == {id: m.spans for id, m in other.mates.items()}


def test_a_saved_state_of_twenty_parts_is_small() -> None:
    box, pin_ = modelling.box(0.06, 0.05, 0.04), modelling.cylinder(0.0049, 0.06)
    bore = box - modelling.cylinder(0.005, 0.04).translated(0.03, 0.025, 0.0)
    placed = {}
    for k in range(10):
        placed[f"block_{k}"] = (bore, pin.SE3(np.eye(3), np.array([0.1 * k, 0.0, 0.0])))
        placed[f"pin_{k}"] = (pin_, pin.SE3(np.eye(3), np.array([0.1 * k + 0.03, 0.025, 0.0])))
    with Session(modelling.scene(placed)) as session:
        session.step()
        assert len(session.constraints) == 10
        assert len(session.save()) < 50_000


def test_only_the_session_has_marks() -> None:
    found = {
        path.relative_to(ROOT).as_posix()
        for package in ("collision", "constraints", "physics", "vpframe")
        for path in (ROOT / package).rglob("*.py")
        if re.search(r"^ +def (mark|undo|reset|rollback)\(", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert found == {"vpframe/session/session.py"}


@pytest.mark.parametrize("name", TASKS)
def test_contacts_of_the_state_are_those_that_a_search_finds(name: str) -> None:
    make, task = TASKS[name]
    session = make()
    original, compared = session.step, [0]

    def step() -> Frame:
        frame, engine = original(), session.engine
        engine.collision.forget_nearest()
        carrier = engine.motion.groups.carriers(len(engine.names))
        for i, within in engine.searched.items():
            found = engine.collision.contacts(within, [i])
            rows = engine.rows[(engine.rows["object_a"] == i) | (engine.rows["object_b"] == i)]
            rows = rows[carrier[rows["object_a"]] != carrier[rows["object_b"]]]
            rows = rows[rows["distance"] <= within]
            assert surfaces_of(rows).tolist() == surfaces_of(found).tolist()
            np.testing.assert_allclose(rows["distance"], found["distance"], rtol=0.0, atol=1e-12)
            compared[0] += 1
        return frame

    session.step = step  # type: ignore[method-assign]
    task(session)
    assert compared[0] > 3 or name == "falling"
