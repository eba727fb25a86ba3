"""The journal: what was written comes back up to the last save, whatever happens to the file's tail."""

import contextlib
import pickle
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from physics import Friction, Gravity
from vpframe.scene import modelling
from vpframe.scene.scene import Scene
from vpframe.session.checkpoint import CODEC, CheckpointError, Journal
from vpframe.session.session import Session
from vpframe.session.state import State, StateError

RUN = {"script": "a", "model": "b"}


def write(path, steps: int, every: int = 10) -> None:
    journal = Journal(path, RUN, every=every)
    for k in range(steps):
        journal.advance(bytes([k]), {"step": k}, partial(CODEC.encode, {"after": k}))
    journal.close()


def after(journal: Journal) -> int:
    """The step after which the state of the journal was saved."""
    assert journal.saved is not None
    return CODEC.decode(journal.saved)["after"]


def test_a_resumed_journal_replays_up_to_the_last_save_and_goes_on(tmp_path) -> None:
    path = tmp_path / "run.journal"
    write(path, 25)
    journal = Journal(path, RUN, resume=True, every=10)
    for k in range(20):
        assert journal.replaying
        assert journal.recorded(bytes([k])) == {"step": k}
        journal.advance(bytes([k]), None, bytes)
    assert not journal.replaying
    assert after(journal) == 19
    due: list[int] = []
    for k in range(20, 30):
        journal.advance(bytes([k]), {"step": k}, lambda k=k: due.append(k) or CODEC.encode({"after": k}))
    assert due == [29]
    journal.close()
    again = Journal(path, RUN, resume=True, every=10)
    for k in range(30):
        assert again.recorded(bytes([k])) == {"step": k}
        again.advance(bytes([k]), None, bytes)
    again.close()


def test_any_cut_of_the_file_resumes_from_the_save_before_it(tmp_path) -> None:
    path = tmp_path / "run.journal"
    write(path, 25)
    data = path.read_bytes()
    seen = set()
    for cut in range(len(b"vpframe journal 1\n"), len(data), 7):
        path.write_bytes(data[:cut])
        journal = Journal(path, RUN, resume=True)
        steps = len(journal.past)
        journal.close()
        assert steps in (0, 10, 20)
        assert after(journal) == steps - 1 if steps else journal.saved is None
        seen.add(steps)
    assert seen == {0, 10, 20}


def test_a_flipped_byte_ends_what_is_believed(tmp_path) -> None:
    path = tmp_path / "run.journal"
    write(path, 25)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(bytes(data))
    journal = Journal(path, RUN, resume=True)
    assert len(journal.past) == 10
    journal.close()


def test_another_question_than_before_is_an_error_that_names_the_step(tmp_path) -> None:
    path = tmp_path / "run.journal"
    write(path, 12)
    journal = Journal(path, RUN, resume=True)
    journal.recorded(bytes([0]))
    journal.advance(bytes([0]), None, bytes)
    with pytest.raises(CheckpointError, match="step 2") as caught:
        journal.recorded(b"other")
    assert caught.value.step == 2
    journal.close()


def test_another_run_or_another_file_is_refused(tmp_path) -> None:
    path = tmp_path / "run.journal"
    write(path, 12)
    with pytest.raises(CheckpointError, match="model"):
        Journal(path, {**RUN, "model": "c"}, resume=True)
    path.write_text("hello")
    with pytest.raises(CheckpointError, match="not a vpframe checkpoint"):
        Journal(path, RUN, resume=True)
    with pytest.raises(CheckpointError, match="cannot be written"):
        Journal(path / "run.journal", RUN)


def test_without_resume_the_file_begins_anew(tmp_path) -> None:
    path = tmp_path / "run.journal"
    write(path, 25)
    Journal(path, RUN).close()
    journal = Journal(path, RUN, resume=True)
    assert not journal.replaying
    journal.close()


def records(path) -> list[tuple[bytes, bytes]]:
    """Tag and content of each record of a journal."""
    data, at, found = path.read_bytes(), len(b"vpframe journal 2\n"), []
    while at < len(data):
        tag, length, _ = struct.unpack_from("<4sII", data, at)
        found.append((tag, data[at + 12 : at + 12 + length]))
        at += 12 + length
    return found


def rewrite(path, tag: bytes, content: bytes) -> None:
    """Give all records of one tag another content, with the right checksum."""
    parts = [b"vpframe journal 2\n"]
    for name, payload in records(path):
        payload = content if name == tag else payload
        parts += [struct.pack("<4sII", name, len(payload), zlib.crc32(payload)), payload]
    path.write_bytes(b"".join(parts))


class Door:
    """Writes a file where it is unpickled."""

    def __init__(self, path) -> None:
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


def test_a_checkpoint_of_pickles_is_refused_unread(tmp_path) -> None:
    path, harm = tmp_path / "run.journal", tmp_path / "harm"
    payload = pickle.dumps(Door(harm))
    path.write_bytes(
        b"vpframe journal 1\n" + struct.pack("<4sII", b"HEAD", len(payload), zlib.crc32(payload)) + payload
    )
    with pytest.raises(CheckpointError, match=r"^[^\n]*run\.journal: a checkpoint of an older version[^\n]*$"):
        Journal(path, RUN, resume=True)
    assert not harm.exists()
    for tag in (b"HEAD", b"STEP"):
        write(path, 12)
        rewrite(path, tag, payload)
        with (
            pytest.raises(CheckpointError, match=r"^[^\n]*run\.journal: damaged[^\n]*; run it without --resume$"),
            contextlib.closing(Journal(path, RUN, resume=True)) as journal,
        ):
            journal.recorded(bytes([0]))
        assert not harm.exists()
    with Session(resting()) as session, pytest.raises(StateError, match="damaged"):
        session.restore(payload)
    assert not harm.exists()


def test_a_damaged_beginning_is_said_and_nothing_is_overwritten(tmp_path) -> None:
    path = tmp_path / "run.journal"
    write(path, 12)
    data = bytearray(path.read_bytes())
    data[40] ^= 0x01
    path.write_bytes(bytes(data))
    with pytest.raises(CheckpointError, match="damaged at its beginning"):
        Journal(path, RUN, resume=True)
    assert path.read_bytes() == bytes(data)


def test_another_version_is_refused(tmp_path) -> None:
    path = tmp_path / "run.journal"
    write(path, 12)
    rewrite(path, b"HEAD", CODEC.encode({"schema": "other", "run": RUN}))
    with pytest.raises(CheckpointError, match="of another version of vpframe; run it without --resume"):
        Journal(path, RUN, resume=True)


def test_no_room_is_one_line_and_what_was_written_is_kept(tmp_path) -> None:
    path = tmp_path / "run.journal"
    code = f"""
import resource, signal
from tests.vpframe.session.test_checkpoint import RUN
from vpframe.session.checkpoint import CODEC, Journal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
journal = Journal({str(path)!r}, RUN, every=10)
resource.setrlimit(resource.RLIMIT_FSIZE, (4000, resource.RLIM_INFINITY))
try:
    for k in range(1000):
        journal.advance(bytes([k % 256]), {{"step": k}}, lambda: CODEC.encode({{"after": k}}))
except Exception as error:
    print(type(error).__name__, error)
journal.close()
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=100, cwd=Path(__file__).parents[3]
    )
    assert done.stdout == f"CheckpointError {path}: cannot be written: File too large\n", done.stderr
    journal = Journal(path, RUN, resume=True)
    kept = len(journal.past)
    assert kept >= 10 and after(journal) == kept - 1
    journal.close()


# ---- what a session makes of a state that does not fit it


def spoilt(path, change) -> None:
    """Change the saved state of a journal."""
    schema, names, state = CODEC.decode(next(content for tag, content in reversed(records(path)) if tag == b"SAVE"))
    rewrite(path, b"SAVE", CODEC.encode((schema, names, change(state) or state)))


def world(state: State) -> dict[str, Any]:
    return state.dynamics.world


def values(**changed: Any) -> Callable[[State], State]:
    return lambda state: replace(state, values=replace(state.values, **changed))


CHANGES = {
    "a state that is none": lambda state: {"poses": []},
    "one pose too few": lambda state: replace(state, poses=state.poses[1:]),
    "poses that are none": lambda state: replace(state, poses="here"),
    "rows of another type": values(rows=np.zeros(3)),
    "a row of an object far away": values(colliding=np.array([[10**9, 0, 1, 0]], np.int32)),
    "a row of a surface far away": values(colliding=np.array([[0, 0, 1, -7]], np.int32)),
    "an active part far away": values(held=frozenset([99])),
    "constraints that are none": lambda state: state.mates.accepted.__setitem__(0, "concentric"),
    "mates that are none": lambda state: replace(state, mates=[]),
    "no bodies": lambda state: replace(state, dynamics=None),
    "bodies of another shape": lambda state: world(state).__setitem__("center", np.zeros((9, 3))),
    "bodies of another type": lambda state: world(state).__setitem__("kind", np.zeros(3)),
    "near pairs far away": lambda state: world(state)["near"].update(pairs=np.array([[10**9, 0, 1, 0]])),
    "contacts far away": lambda state: world(state).update(
        contacts=(np.array([[0, 10**9, 0, 0, 0, 0]]), np.zeros((1, 7)), np.zeros((1, 3)))
    ),
    "a grip on nothing": lambda state: world(state)["grips"].__setitem__(7, (None, np.eye(4), np.zeros(6))),
    "a mechanism of nothing": lambda state: world(state)["mechanisms"].append(((5,), [3], {})),
}


@pytest.fixture(scope="module")
def journal_of_a_run(tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "run.journal"
    with Session(resting(), checkpoint=path) as session:
        stand(session)
    assert [tag for tag, _ in records(path)].count(b"SAVE") == 1
    return path


def resting() -> Scene:
    box = modelling.box(0.06, 0.05, 0.04)
    floor = modelling.box(1.0, 1.0, 0.1).translated(-0.5, -0.5, -0.1)
    made = modelling.scene({"floor": (floor, pin.SE3.Identity()), "box": (box, pin.SE3.Identity())})
    made["floor"].fixed = True
    return made


def stand(session: Session) -> None:
    session.behave("box", Gravity(), Friction(0.5))
    session.run(1.1)


def test_the_run_of_the_tests_below_resumes(journal_of_a_run, tmp_path) -> None:
    path = tmp_path / "run.journal"
    path.write_bytes(journal_of_a_run.read_bytes())
    with Session(resting(), checkpoint=path, resume=True) as session:
        stand(session)
    assert len([tag for tag, _ in records(path) if tag == b"STEP"]) == 66


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_a_state_that_does_not_fit_the_scene_is_one_line(journal_of_a_run, tmp_path, change) -> None:
    path = tmp_path / "run.journal"
    path.write_bytes(journal_of_a_run.read_bytes())
    spoilt(path, change)
    session = Session(resting(), checkpoint=path, resume=True)
    with pytest.raises(CheckpointError, match=r"^[^\n]*run\.journal: damaged: [^\n]*; run it without --resume$"):
        stand(session)


@pytest.mark.parametrize(
    "field", [{"colliding": np.array([[9, 0, 9, 0]], np.int32)}, {"freedom": {"nobody": 1}}, {"mates": 7}]
)
def test_a_step_that_does_not_fit_the_scene_is_one_line(journal_of_a_run, tmp_path, field) -> None:
    path = tmp_path / "run.journal"
    path.write_bytes(journal_of_a_run.read_bytes())
    digest, result = CODEC.decode(next(content for tag, content in records(path) if tag == b"STEP"))
    rewrite(path, b"STEP", CODEC.encode((digest, replace(result, **field))))
    with pytest.raises(CheckpointError, match=r"^[^\n]*run\.journal: damaged: [^\n]*; run it without --resume$"):
        stand(Session(resting(), checkpoint=path, resume=True))
