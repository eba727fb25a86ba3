"""Clash status over the runs of a task."""

from __future__ import annotations

import pytest

from vpframe.clash_status import ClashKey, accept, read, updated, write
from vpframe.errors import VpframeError

A, B, C = ClashKey("bolt", "plate", 1, 2), ClashKey("bolt", "plate", 3, 2), ClashKey("nut", "plate", 0, 0)


def statuses(records) -> dict[ClashKey, str]:
    return {r.key: r.status for r in records}


def test_a_key_does_not_depend_on_the_order_of_the_parts() -> None:
    assert ClashKey.of("plate", 2, "bolt", 1) == ClashKey.of("bolt", 1, "plate", 2) == A


def test_the_life_of_a_clash() -> None:
    first = updated((), [B, A])
    assert statuses(first) == {A: "new", B: "new"}
    marked = accept(first, [B], "press fit")
    second = updated(marked, [A, B, C])
    assert statuses(second) == {A: "persistent", B: "accepted", C: "new"}
    third = updated(second, [C])
    assert statuses(third) == {A: "resolved", B: "resolved", C: "persistent"}
    fourth = updated(third, [A, C])
    assert statuses(fourth) == {A: "new", B: "resolved", C: "persistent"}
    assert {r.key: r.runs for r in fourth} == {A: 3, B: 2, C: 3}
    assert {r.key: r.remark for r in fourth}[B] == "press fit"


def test_the_file_keeps_everything(tmp_path) -> None:
    records = accept(updated((), [A, C]), [A], "as built")
    write(tmp_path / "clashes.json", records)
    assert read(tmp_path / "clashes.json") == records
    assert read(tmp_path / "none.json") == ()


def test_what_cannot_be_is_one_line(tmp_path) -> None:
    with pytest.raises(VpframeError, match="no clash between nut 0 and plate 0"):
        accept(updated((), [A]), [C])
    file = tmp_path / "clashes.json"
    file.write_text('{"clashes": [{"part_a": "a", "part_b": "b", "surface_a": 0, "surface_b": 0, "status": "odd"}]}')
    with pytest.raises(VpframeError, match="status 'odd'"):
        read(file)
    file.write_text('{"clashes": [{"part_a": "a"}]}')
    with pytest.raises(VpframeError, match="clash 0"):
        read(file)
    file.write_text("[]")
    with pytest.raises(VpframeError, match="not a clash status file"):
        read(file)
