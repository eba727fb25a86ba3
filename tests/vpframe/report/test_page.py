"""The page of the report."""

import re
from dataclasses import replace

import numpy as np

from tests.vpframe.report.runs import Page, by_origin, log_of, stacked
from tests.vpframe.watching import box, fake_session, place, pressing_frames
from vpframe.events import Event, Frame
from vpframe.report import SessionLog, write
from vpframe.report.page import INITIAL
from vpframe.scene.scene import Part, Scene


def test_the_page_lists_pairs_of_parts_with_a_picture_a_row_and_folds_their_surfaces(tmp_path):
    scene, frames = stacked([0.06, 0.048, 0.06])
    folder = write(tmp_path, log_of(frames, scene))
    text = (folder / "index.html").read_text()
    caused, stood = text.index("Caused by the task: 1 pair of parts clash"), text.index("At the start: 1 pair of parts")
    assert caused < stood
    rows = re.findall(r"<details class='pair'.*?</details>", text)
    assert len(rows) == 3, "one a pair of parts"
    for row, parts, pictures in zip(
        rows, (("cube", "floor"), ("block", "floor"), ("block", "lid")), (1, 1, 0), strict=True
    ):
        summary, _, inner = row.partition("</summary>")
        assert summary.count("<img") == pictures
        assert all(f"{part} · face " in summary for part in parts)
        found = by_origin(folder)["task" if parts[0] == "cube" else "as it stands", *parts]
        assert inner.count("<tr>") == found["count"] + 1
        assert f"{found['count']} pair" in summary
    assert "1.000 mm" in rows[1] and "2.000 mm" in rows[0]


def test_many_pairs_that_only_touch_are_one_folded_line(tmp_path):
    parts = [Part(f"tile_{k}", box((0.1, 0.1, 0.1)), place(x=0.1 * k)) for k in range(6)]
    scene = Scene(parts)
    poses = {p.name: p.pose for p in parts}
    rows = np.array([(k, 1, k + 1, 0) for k in range(5)], np.int32)
    frames = [Frame(s, s / 60, poses, rows, (), {}, {}, None, {}) for s in (1, 2)]
    text = (write(tmp_path, log_of(frames, scene)) / "index.html").read_text()
    assert "<summary>5 pairs of parts only touch (5 pairs of surfaces)</summary>" in text
    assert "clashes at the start</span><b>0</b>" in text, "contacts are no clashes"


def test_the_page_is_whole_and_needs_nothing_from_outside(written):
    folder, _ = written
    page = Page((folder / "index.html").read_text())
    assert page.open == []
    for tag, attributes in page.tags:
        assert tag not in ("script", "iframe", "object")
        source = attributes.get("src", "data:")
        assert source.startswith("data:")
    images = [a for tag, a in page.tags if tag == "img"]
    assert len(images) >= 3  # the end, the least clearance, the clash
    for target in (a["href"] for tag, a in page.tags if tag == "a"):
        assert (folder / target).is_file()
    text = " ".join(page.text)
    for expected in (
        "The task can be done.",
        "plate · face 5 · plane – rod · face 0 · shaft Ø20",
        "against",
        "clearance",
    ):
        assert expected in text


def test_what_lasts_from_beginning_to_end_is_counted_and_what_changed_comes_first(tmp_path):
    frame = pressing_frames()[30]
    (view,) = frame.constraints
    lasting = [replace(view, id=k, parts=(f"assembly/plate_{k}", "rod"), state="active") for k in range(15)]
    late = replace(view, id=99, parts=("assembly/deep/lid", "rod"), state="active")
    log = SessionLog()
    log.begin(fake_session().scene)
    start = Event(1, 1 / 60, "accepted", ("plate", "rod"), (), "as it stands")
    for step in range(1, 11):
        views = (*lasting, late) if step > 5 else tuple(lasting)
        events = (start,) if step == 1 else ()
        log.frame(replace(frame, step=step, time=step / 60, constraints=views, held=(), events=events))
    page = (write(tmp_path, log) / "index.html").read_text()
    assert "15 constraints hold from beginning to end" in page
    assert "against: lid – rod (99)" in page and "plate_3 – rod (3)" not in page
    assert page.index("assembly/deep/lid · face") < page.index("assembly/plate_0 · face")
    assert log.moments == [], "what the assembly was before anything happened is no moment of the task"


def test_what_the_assembly_is_from_the_beginning_is_folded_before_what_happens(tmp_path):
    frames = pressing_frames(4)
    found = [Event(1, 1 / 60, kind, ("plate", "rod"), (), f"{kind} {n}") for n in range(3) for kind in INITIAL]
    later = Event(2, 2 / 60, "accepted", ("plate", "rod"), (), "accepted later")
    grabbed = Event(1, 1 / 60, "grabbed", ("rod",), (), "hand holds rod")
    frames = [replace(f, events=e) for f, e in zip(frames, [(), (*found, grabbed), (later,), ()], strict=True)]
    text = (write(tmp_path, log_of(frames)) / "index.html").read_text()
    folded, _, rest = text.partition("<details>")[2].partition("</details>")
    assert folded.startswith("<summary>12 events") and all(event.text in folded for event in found)
    rest = rest.partition("</table>")[0]
    assert "hand holds rod" in rest and "accepted later" in rest and "accepted 0" not in rest
    few = write(tmp_path / "few", log_of([replace(frames[0], events=(*found[:4], grabbed))]))
    assert "<details>" not in (few / "index.html").read_text()
