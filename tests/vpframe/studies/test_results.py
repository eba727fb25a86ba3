"""`results.jsonl` over kills, torn lines, resumed and competing studies."""

import json
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest

from vpframe.errors import OutputError, VpframeError
from vpframe.outputs import STUDY_FILES, OutputFolder
from vpframe.studies.child import unanswered
from vpframe.studies.results import Record, Results, answer, record
from vpframe.studies.variants import Variant


def made(key: str, index: int = 0, status: str = "ok", timeout: float = 5.0, repeat: bool = False) -> Record:
    outcome = unanswered(status, "", worker="here:1", attempts=1)
    return record(key, Variant(index, 0, {"x": 0.1 + 0.2}), outcome, timeout, repeat)


def known(keys: str) -> dict[str, Variant]:
    return {key: Variant(i, 0, {"x": 0.1 + 0.2}) for i, key in enumerate(keys)}


@contextmanager
def opened(path: Path, keys: str, timeout: float = 5.0, resume: bool = False) -> Iterator[Results]:
    with OutputFolder(path, STUDY_FILES) as folder, Results(folder, known(keys), timeout, resume) as results:
        yield results


def read(path: Path, keys: str = "abcd", timeout: float = 5.0) -> AbstractContextManager[Results]:
    return opened(path, keys, timeout, True)


def test_what_was_added_is_there_again_to_the_last_bit(tmp_path: Path) -> None:
    with opened(tmp_path / "new", "abc") as results:
        results.add(made("a", 0))
        results.add(made("b", 1, "no"))
        results.add(made("a", 0, repeat=True))
        kept = dict(results.records)
    with read(tmp_path / "new") as again:
        assert again.records == kept
        assert again.records["a"]["parameters"]["x"] == 0.1 + 0.2
        assert list(again.repeats) == ["a"]
        assert again.unreadable == 0


@pytest.mark.parametrize("left", [1, 40, -1])
def test_a_torn_last_line_costs_that_line_and_no_more(tmp_path: Path, left: int) -> None:
    with opened(tmp_path, "abc") as results:
        for key in "abc":
            results.add(made(key))
    path = tmp_path / "results.jsonl"
    content = path.read_bytes()
    last = content.rindex(b"\n", 0, -1) + 1
    path.write_bytes(content[: last + left] if left > 0 else content[:left])
    with read(tmp_path) as again:
        whole = "abc" if left < 0 else "ab"  # without its line feed a line is whole
        assert sorted(again.records) == list(whole)
        assert again.unreadable == len("abc") - len(whole)
        again.add(made("d"))
    with read(tmp_path) as more:
        assert sorted(more.records) == [*whole, "d"]


LISTED = json.dumps(made("a") | {"measures": {"y": []}}).encode()
HUGE = json.dumps(made("a") | {"measures": {"y": 1e300}}).encode()
NAN = json.dumps(made("a") | {"clearance": float("nan")}).encode()


@pytest.mark.parametrize(
    "line",
    [
        b"[1, 2]",
        b'{"key": "a"}',
        b"\xff\xfe",
        b"null",
        b'{"key": ["a"], "index": 0}',
        b"9" * 5000,
        b"[" * 20000,
        LISTED,
        HUGE,
        NAN,
    ],
)
def test_lines_that_are_no_records_are_passed_over(tmp_path: Path, line: bytes) -> None:
    good = json.dumps(made("b")).encode()
    (tmp_path / "results.jsonl").write_bytes(good + b"\n" + line + b"\n" + good + b"\n")
    with read(tmp_path) as results:
        assert list(results.records) == ["b"]
        assert results.unreadable == 1


def test_records_of_other_variants_stay_in_the_file_and_out_of_the_study(tmp_path: Path) -> None:
    with opened(tmp_path, "ab") as results:
        results.add(made("a"))
        results.add(made("b"))
    with read(tmp_path, "b") as other:
        assert list(other.records) == ["b"]
    with read(tmp_path, "ab") as again:
        assert sorted(again.records) == ["a", "b"]


def test_a_longer_limit_runs_what_took_too_long_again(tmp_path: Path) -> None:
    with opened(tmp_path, "ab") as results:
        results.add(made("a", status="timeout", timeout=5.0))
        results.add(made("b", status="crashed", timeout=5.0))
    with read(tmp_path, timeout=5.0) as same:
        assert sorted(same.records) == ["a", "b"]
    with read(tmp_path, timeout=9.0) as longer:
        assert sorted(longer.records) == ["b"]


def test_old_results_are_neither_taken_nor_lost_unasked(tmp_path: Path) -> None:
    with opened(tmp_path, "a") as results:
        results.add(made("a"))
    before = (tmp_path / "results.jsonl").read_bytes()
    with pytest.raises(VpframeError, match=r"results.jsonl: holds results; --resume runs what is missing, or give"):
        opened(tmp_path, "a").__enter__()
    assert (tmp_path / "results.jsonl").read_bytes() == before


def test_two_studies_do_not_write_into_one_folder(tmp_path: Path) -> None:
    with opened(tmp_path, "a"), pytest.raises(OutputError, match="is being written by another run"):
        read(tmp_path).__enter__()
    with read(tmp_path):
        pass


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"runs: cannot be made a folder: "):
        opened(tmp_path / "file" / "runs", "a").__enter__()


def test_an_answer_is_what_does_not_depend_on_where_it_was_found() -> None:
    one, other = made("a"), made("a") | {"worker": "there:2", "seconds": 3.0, "memory": 7, "repeat": True}
    assert answer(one) == answer(other)
    assert answer(one) != answer(one | {"clearance": 1e-3})
    assert answer(one | {"measures": {"y": 0.3}}) != answer(one | {"measures": {"y": 0.1 + 0.2}})
