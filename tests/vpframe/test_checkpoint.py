"""The journal: what was written comes back up to the last save, whatever happens to the file's tail."""

from __future__ import annotations

import pytest

from vpframe.checkpoint import CheckpointError, Journal

RUN = {"script": "a", "model": "b"}


def write(path, steps: int, every: int = 10) -> None:
    journal = Journal(path, RUN, every=every)
    for k in range(steps):
        if journal.append(bytes([k]), {"step": k}):
            journal.save({"after": k})
    journal.close()


def test_a_resumed_journal_replays_up_to_the_last_save_and_goes_on(tmp_path) -> None:
    path = tmp_path / "run.journal"
    write(path, 25)
    journal = Journal(path, RUN, resume=True, every=10)
    for k in range(20):
        assert journal.replaying
        assert journal.replay(bytes([k])) == {"step": k}
    assert not journal.replaying
    assert journal.restore() == {"after": 19}
    due = [journal.append(bytes([k]), {"step": k}) for k in range(20, 30)]
    assert due == [False] * 9 + [True]
    journal.save({"after": 29})
    journal.close()
    again = Journal(path, RUN, resume=True, every=10)
    assert [again.replay(bytes([k]))["step"] for k in range(30)] == list(range(30))
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
        saved = journal.restore()
        journal.close()
        assert steps in (0, 10, 20)
        assert saved == ({"after": steps - 1} if steps else None)
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
    journal.replay(bytes([0]))
    with pytest.raises(CheckpointError, match="step 2") as caught:
        journal.replay(b"other")
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
        Journal(tmp_path / "nowhere" / "run.journal", RUN)


def test_without_resume_the_file_begins_anew(tmp_path) -> None:
    path = tmp_path / "run.journal"
    write(path, 25)
    Journal(path, RUN).close()
    journal = Journal(path, RUN, resume=True)
    assert not journal.replaying
    journal.close()
