import csv
import itertools
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pinocchio as pin
import pytest

from collision import colliding_surfaces
from tests.vpframe.watching import box, fake_session, place, pressing_frames, pressing_scene
from vpframe import __version__
from vpframe.analysis.clash_status import ClashKey
from vpframe.errors import VpframeError
from vpframe.events import ConstraintView, Event, Frame
from vpframe.report import SessionLog, SweptVolume, plots, write
from vpframe.report.page import INITIAL
from vpframe.report.where import least_gap
from vpframe.scene.scene import Part, Scene, Shape


def log_of(frames, scene=None):
    log = SessionLog()
    log.begin(fake_session(scene).scene)
    for frame in frames:
        log.frame(frame)
    log.end()
    return log


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A report's folder, and the frames it is about."""
    frames = pressing_frames(120)
    folder = write(tmp_path_factory.mktemp("report") / "deep" / "out", log_of(frames), task="press")
    return folder, frames


def document(folder):
    document = json.loads((folder / "report.json").read_text())
    assert document["version"] == __version__
    return document


class Page(HTMLParser):
    """Tags of a page with their attributes, and whether each that was opened is closed."""

    VOID = ("meta", "link", "img", "br")

    def __init__(self, text):
        super().__init__()
        self.tags, self.open, self.text = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def test_the_verdict_and_the_numbers_of_the_run(written):
    folder, frames = written
    found = document(folder)
    assert found["task"] == "press"
    assert found["can_be_done"] is True
    assert found["duration"] == frames[-1].time
    assert found["steps"] == frames[-1].step
    assert [(e["step"], e["kind"], e["text"]) for e in found["events"]] == [
        (e.step, e.kind, e.text) for f in frames for e in f.events
    ]


def test_freedom_and_clearance_are_those_of_the_frames(written):
    folder, frames = written
    found = document(folder)
    changes = found["freedom"]["rod"]
    assert [c["freedom"] for c in changes] == [6, 3, 6]
    touching = [f.time for f in frames if len(f.colliding)]
    assert changes[1]["time"] == touching[0]
    least = min(frames, key=lambda f: f.clearance)
    assert found["clearance"]["least"] == least.clearance
    assert found["clearance"]["step"] == least.step
    assert found["clearance"]["parts"] == ["plate", "rod"]
    assert found["clearance"]["poses"]["rod"]["translation"] == least.poses["rod"].translation.tolist()


def test_the_least_clearance_is_placed_between_the_surfaces_that_were_nearest():
    scene = Scene(
        [Part("floor", box((1, 1, 0.1)), place(z=-0.05)), Part("wall", box((0.1, 1, 1)), place(x=-0.55, z=0.5)),
         Part("cube", box((0.2, 0.2, 0.2)), place())]
    )  # fmt: skip
    frames = []
    for step, (x, z) in enumerate([(0.0, 0.5), (-0.36, 0.5), (0.0, 0.125)]):
        poses = {"floor": scene["floor"].pose, "wall": scene["wall"].pose, "cube": place(x, 0.0, z)}
        clearance = min(x - 0.1 + 0.5, z - 0.1)
        colliding = np.empty((0, 4), np.int32)
        frames.append(Frame(step, step / 60, poses, colliding, (), {"cube": 6}, {}, clearance, {}, ("cube",)))
    gap = least_gap(log_of(frames, scene))
    assert gap is not None
    assert gap.parts == ("floor", "cube")
    assert gap.surfaces[0] == 5  # of the cube, any surface that has the nearest point
    assert np.linalg.norm(gap.points[1] - gap.points[0]) == pytest.approx(0.025)
    assert gap.points[0][2] == pytest.approx(0.0, abs=1e-12)
    assert least_gap(log_of(frames[:2], scene)).parts == ("wall", "cube")
    assert least_gap(log_of([], scene)) is None


def test_stages_follow_the_scripts_lines_without_gaps(written):
    folder, frames = written
    stages = document(folder)["stages"]
    assert [s["text"] for s in stages] == [text for text, _ in itertools.groupby(f.script for f in frames)]
    assert all(a["end"] == b["start"] for a, b in itertools.pairwise(stages))
    assert stages[-1]["end"] == frames[-1].time


def test_constraints_tell_their_states_with_times(written):
    folder, frames = written
    (constraint,) = document(folder)["constraints"]
    assert constraint["kind"] == "against"
    assert [s["state"] for s in constraint["states"]] == ["candidate", "active"]
    for state in constraint["states"]:
        times = [f.time for f in frames if f.constraints and f.constraints[0].state == state["state"]]
        assert (state["from"], state["to"]) == (times[0], times[-1])


def test_the_clash_is_told_with_depth_place_and_times(written):
    folder, frames = written
    (clash,) = document(folder)["clashes"]
    touching = [f for f in frames if len(f.colliding)]
    assert clash["parts"] == ["plate", "rod"]
    assert clash["surfaces"] == [5, 0]
    assert clash["faces"] == ["face 5 · plane", "face 0 · shaft Ø20"]
    assert clash["status"] == "new"
    assert clash["first_time"] == touching[0].time
    assert clash["last_time"] == touching[-1].time
    assert clash["steps"] == len(touching)
    # the rod's end at z - 25 mm stands below the plate's top at 5 mm
    assert clash["depth"] == pytest.approx(max(0.030 - f.poses["rod"].translation[2] for f in touching), abs=2e-7)
    assert np.linalg.norm(clash["point"][:2]) <= 0.0101


def stacked(heights, aside=0.0):
    """A block that stands 1 mm deep in a floor, a lid flush on the block, and a cube that goes to those heights.

    Yields the scene and its frames, with all that collides.
    """
    scene = Scene(
        [
            Part("floor", box((1, 1, 0.1)), place(z=-0.05), fixed=True),
            Part("block", box((0.1, 0.1, 0.1)), place(z=0.049)),
            Part("lid", box((0.1, 0.1, 0.02)), place(z=0.109)),
            Part("cube", box((0.1, 0.1, 0.1)), place(x=0.3, z=0.051)),
        ]
    )
    frames = []
    for step, height in enumerate(heights, 1):
        poses = {p.name: p.pose.copy() for p in scene.parts}
        poses["cube"] = place(x=0.3 + aside * step, z=height)
        rows = []
        for a, b in itertools.combinations(range(4), 2):
            at = [poses[name] for name in (scene.names[a], scene.names[b])]
            met = colliding_surfaces(scene.parts[a].mesh, scene.parts[b].mesh, at[0].actInv(at[1]))
            rows += [(a, i, b, j) for i, j in met.tolist()]
        colliding = np.array(rows, np.int32).reshape(-1, 4)
        frames.append(Frame(step, step / 60, poses, colliding, (), {"cube": 6}, {}, None, {}, ("cube",)))
    return scene, frames


def by_origin(folder):
    return {(pair["origin"], *pair["parts"]): pair for pair in document(folder)["clashes"]}


def test_what_stood_so_is_told_apart_from_what_the_task_caused(tmp_path):
    scene, frames = stacked([0.06, 0.05, 0.048, 0.047, 0.07])
    found = by_origin(write(tmp_path, log_of(frames, scene)))
    assert list(found) == [
        ("task", "cube", "floor"),
        ("as it stands", "block", "floor"),
        ("as it stands", "block", "lid"),
    ]
    caused, stood, touching = found.values()
    assert (caused["kind"], stood["kind"], touching["kind"]) == ("clash", "clash", "contact")
    assert caused["depth"] == pytest.approx(0.003) and caused["steps"] >= 2
    assert stood["depth"] == pytest.approx(0.001) and stood["steps"] == 5
    assert stood["count"] == len(stood["surface_pairs"]) > 1
    assert {tuple(row["parts"]) for row in stood["surface_pairs"]} == {("block", "floor")}
    assert stood["point"] == stood["surface_pairs"][0]["point"]
    assert (caused["first_time"], caused["last_time"]) == (frames[1].time, frames[3].time), "flush, then in"


def test_what_met_before_the_first_step_stood_so_though_the_first_step_moved_it(tmp_path):
    scene, frames = stacked([0.049, 0.0495, 0.06], aside=0.01)
    scene["cube"].pose = place(x=0.3, z=0.0485)
    log = log_of(frames, scene)
    assert [clash.unmoved for key, clash in log.clashes.items() if key.part_a == "cube"] == [False] * 4
    found = by_origin(write(tmp_path, log))
    assert ("as it stands", "cube", "floor") in found and ("task", "cube", "floor") not in found


def test_what_the_task_pushes_deeper_is_the_tasks(tmp_path):
    scene, frames = stacked([0.049, 0.049, 0.040, 0.049])
    scene["cube"].pose = place(x=0.3, z=0.049)
    found = by_origin(write(tmp_path, log_of(frames, scene)))
    assert found["task", "cube", "floor"]["depth"] == pytest.approx(0.010)
    still, same = stacked([0.049, 0.049])
    still["cube"].pose = place(x=0.3, z=0.049)
    assert ("as it stands", "cube", "floor") in by_origin(write(tmp_path / "still", log_of(same, still)))


def test_parts_that_are_carried_together_stand_to_each_other_as_before(tmp_path):
    scene, frames = stacked([0.06] * 3)
    moved = []
    for step, frame in enumerate(frames):
        lift = place(z=0.1 * step)
        poses = {**frame.poses, "block": lift * frame.poses["block"], "lid": lift * frame.poses["lid"]}
        rows = frame.colliding[(frame.colliding[:, [0, 2]] == [1, 2]).all(axis=1)]
        moved.append(replace(frame, poses=poses, colliding=rows if step else rows[:0]))
    assert list(by_origin(write(tmp_path, log_of(moved, scene)))) == [("as it stands", "block", "lid")]


def test_shapes_that_are_meshes_without_faces_have_a_report(tmp_path):
    scene, frames = stacked([0.06, 0.048])
    for part in scene.parts:
        part.shape = Shape(part.mesh, (), ())
    found = by_origin(write(tmp_path, log_of(frames, scene)))
    assert found["task", "cube", "floor"]["faces"] == ["face 0", "face 5"]


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


def test_csv_has_a_row_a_clash(written):
    folder, _ = written
    with (folder / "clashes.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    (clash,) = document(folder)["clashes"]
    assert len(rows) == 1
    assert rows[0]["part_a"] == "plate" and rows[0]["surface_b"] == "0" and rows[0]["status"] == "new"
    assert float(rows[0]["depth_m"]) == clash["depth"]
    assert float(rows[0]["first_time_s"]) == clash["first_time"]
    assert (rows[0]["origin"], rows[0]["kind"], rows[0]["surface_pairs"]) == ("task", "clash", "1")
    assert rows[0]["face_b"] == "face 0 · shaft Ø20"


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


def test_a_failed_task_says_why_and_markup_in_names_stays_text(tmp_path):
    reason = 'the <script>bolt</script> & "nut" do not part'
    folder = write(tmp_path / "out", log_of(pressing_frames(10)), failure=reason)
    assert document(folder)["can_be_done"] is False
    assert document(folder)["reason"] == reason
    page = Page((folder / "index.html").read_text())
    assert f"The task cannot be done: {reason}" in "".join(page.text)


def test_a_session_that_never_stepped_has_a_report(tmp_path):
    folder = write(tmp_path, log_of([]))
    found = document(folder)
    assert (found["steps"], found["clashes"], found["clearance"]) == (0, [], None)
    assert Page((folder / "index.html").read_text()).open == []


def test_status_is_kept_from_run_to_run(tmp_path):
    def run(frames):
        folder = write(tmp_path, log_of(frames))
        return {tuple(c["surfaces"]): c["status"] for c in document(folder)["clashes"]}

    frames = pressing_frames(60)
    apart = [f for f in frames if not len(f.colliding)]
    assert run(frames) == {(5, 0): "new"}
    assert run(frames) == {(5, 0): "persistent"}
    status = json.loads((tmp_path / "clashes.json").read_text())
    status["clashes"][0].update(status="accepted", remark="press fit")
    (tmp_path / "clashes.json").write_text(json.dumps(status))
    assert run(frames) == {(5, 0): "accepted"}
    assert document(tmp_path)["clashes"][0]["remark"] == "press fit"
    assert run(apart) == {(5, 0): "resolved"}
    assert run(frames) == {(5, 0): "new"}


def test_a_spoilt_status_file_is_named_before_anything_is_overwritten(tmp_path):
    (tmp_path / "clashes.json").write_text("{")
    with pytest.raises(VpframeError, match=re.escape(str(tmp_path / "clashes.json"))):
        write(tmp_path, log_of(pressing_frames(10)))
    assert not (tmp_path / "report.json").exists()


def test_a_file_where_the_folder_should_be_is_named(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(VpframeError, match="out"):
        write(tmp_path / "out", log_of([]))


def test_swept_volumes_are_written_as_stl_in_millimetres(tmp_path):
    import trimesh

    mesh = box((0.1, 0.2, 0.3)).mesh
    volume = SweptVolume("shaft/1", mesh.vertices, mesh.triangles, 1e-4, ("wall",))
    folder = write(tmp_path, log_of(pressing_frames(5)), swept=[volume])
    (told,) = document(folder)["swept"]
    assert told["clashes"] == ["wall"]
    read = trimesh.load(folder / told["file"])
    assert read.is_watertight
    assert read.volume == pytest.approx(100 * 200 * 300, rel=1e-6)


def test_depth_is_the_greatest_of_the_steps_kept():
    scene = Scene([Part("a", box((1, 1, 1)), place()), Part("b", box((0.5, 0.5, 0.5)), place(z=0.75))])
    rows = np.array([[0, 5, 1, 0]], np.int32)
    frames = []
    for step in range(101):
        poses = {"a": place(), "b": place(z=0.75 - 0.1 * np.sin(np.pi * step / 100))}
        frames.append(Frame(step, step / 60, poses, rows, (), {}, {}, None, {}))
    from vpframe.report.depth import depths

    log = log_of(frames, scene)
    clash = log.clashes[ClashKey("a", "b", 5, 0)]
    assert clash.steps == 101
    assert len(clash.samples) <= 8
    assert clash.samples[0] is frames[0]
    assert depths(log)[clash.key].depth == pytest.approx(0.1, rel=0.03)


def test_the_depth_of_parts_that_stand_still_is_measured_once(monkeypatch):
    from collision import CollisionManager
    from vpframe.report.depth import depths

    scene = Scene([Part("a", box((1, 1, 1)), place()), Part("b", box((0.5, 0.5, 0.5)), place(z=0.7))])
    rows = np.array([[0, 5, 1, 0], [0, 5, 1, 1]], np.int32)
    heights = [0.7, 0.7, 0.7, 0.72, 0.72, 0.7]
    frames = []
    for step, height in enumerate(heights):
        poses = {"a": scene["a"].pose, "b": place(z=height)}
        frames.append(Frame(step, step / 60, poses, rows[: 1 + (step > 1)], (), {}, {}, None, {}))
    asked = []
    penetrations = CollisionManager.penetrations
    monkeypatch.setattr(
        CollisionManager,
        "penetrations",
        lambda self, *given, **more: asked.append(self.pose(1)) or penetrations(self, *given, **more),
    )
    found = depths(log_of(frames, scene))
    assert [pose.translation[2] for pose in asked] == [0.7, 0.72, 0.7]
    late = ClashKey("a", "b", 5, 1)
    assert found[late].depth == pytest.approx(0.05) and found[late].time == frames[2].time


def test_the_log_keeps_little_of_a_long_run():
    log = log_of(pressing_frames(5000))
    assert sum(1 for _ in log.history) <= log.history.limit + 1
    assert len(log.clearance) == 5000
    assert len(log.freedom["rod"]) == 3


@pytest.mark.parametrize(
    ("low", "high"), [(0, 1), (0, 0), (-3, 17), (0, 1e-9), (2.5e6, 2.6e6), (0, 0.00123), (-1e-3, 1e3)]
)
def test_ticks_enclose_the_range_and_are_few(low, high):
    ticks = plots.nice_ticks(low, high)
    assert ticks[0] <= low + 1e-9 * abs(low) and ticks[-1] >= high - 1e-9 * abs(high)
    assert 2 <= len(ticks) <= 8
    assert np.ptp(np.diff(ticks)) <= 1e-9 * (ticks[-1] - ticks[0])


def test_a_thinned_line_keeps_its_extremes():
    rng = np.random.default_rng(0)
    values = rng.normal(size=20000)
    values[[777, 15000]] = 9.0, -9.0
    line = [(i / 100, float(v)) for i, v in enumerate(values)]
    drawn = plots.lines({"noise": line}, "m", 200.0)
    points = np.array([[float(x) for x in p.split(",")] for p in re.search(r'points="([^"]*)"', drawn)[1].split()])
    assert len(points) < 2000
    assert (np.diff(points[:, 0]) >= 0).all()
    whole = plots.lines({"noise": [(7.77, 9.0), (150.0, -9.0)]}, "m", 200.0)
    two = np.array([[float(x) for x in p.split(",")] for p in re.search(r'points="([^"]*)"', whole)[1].split()])
    np.testing.assert_allclose([points[:, 1].min(), points[:, 1].max()], [two[:, 1].min(), two[:, 1].max()], atol=0.11)


def test_a_stepped_line_goes_sideways_and_then_up():
    drawn = plots.lines({"freedom": [(0.0, 6.0), (1.0, 2.0)]}, "", 2.0, steps=True)
    points = [[float(x) for x in p.split(",")] for p in re.search(r'points="([^"]*)"', drawn)[1].split()]
    assert len(points) == 4
    assert points[0][1] == points[1][1] and points[1][0] == points[2][0] and points[2][1] == points[3][1]


def test_a_line_is_broken_where_there_is_nothing_to_draw():
    line = [(0.0, 1.0), (0.5, 2.0), (1.0, float("nan")), (1.5, float("nan")), (2.0, 3.0), (2.5, 1.0)]
    drawn = plots.lines({"clearance": line}, "mm", 3.0)
    assert drawn.count("<polyline") == 2
    assert "nan" not in drawn


def test_pose_values_in_the_log_do_not_follow_the_scene():
    scene = pressing_scene()
    log = log_of([], scene)
    scene["rod"].pose = pin.SE3(np.eye(3), np.ones(3))
    np.testing.assert_array_equal(log.start["rod"].translation, [0, 0, 0.05])


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


def test_long_names_and_many_lines_stay_within_a_plot():
    name = "gearbox/housing/cover/" + 40 * "x"
    drawn = plots.lines({f"{name}_{k}": [(0.0, 6.0), (1.0, 2.0)] for k in range(30)}, "degrees of freedom", 1.0)
    assert drawn.count("<polyline") == 8
    assert "and 22 more" in drawn
    shown = re.sub(r"<title>.*?</title>", "", drawn)
    assert all(len(text) <= 19 for text in re.findall(r">([^<]*x_\d+)</text>", shown))
    assert f"<title>{name}_0</title>" in drawn


def test_of_many_constraints_pictures_leave_out_the_uninvolved_and_the_page_says_so(tmp_path, monkeypatch):
    scene = pressing_scene()
    a, b = scene.names[:2]
    frames = [
        replace(frame, held=(), constraints=tuple(lasting(id, (a, b)) for id in range(7)))
        for frame in pressing_frames(4)
    ]
    few = write(tmp_path / "few", log_of(frames, scene))
    assert "leave out" not in (few / "index.html").read_text()
    monkeypatch.setattr("vpframe.session.log.DRAWN", 5)
    assert log_of(frames, scene).uninvolved() == frozenset(range(7))
    many = write(tmp_path / "many", log_of(frames, scene))
    assert "leave out 7, of parts that no hand held" in (many / "index.html").read_text()
    assert len((many / "scene.html").read_text()) < len((few / "scene.html").read_text())
    assert document(many)["constraints"] == document(few)["constraints"]
    touched = [replace(frame, held=(a,)) for frame in frames]
    assert log_of(touched, scene).uninvolved() == frozenset()


def lasting(id, parts):
    """A constraint in force, seen in each frame."""
    return ConstraintView(
        id=id,
        kind="against",
        parts=parts,
        surfaces=((0,), (1,)),
        residual=0.0,
        state="active",
        origin=np.zeros(3),
        direction=np.array([0.0, 0.0, 1.0]),
        size=0.01,
        why="told",
    )
