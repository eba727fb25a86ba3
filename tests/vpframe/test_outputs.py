"""What a run may write: its own files of before, one run at a time; never its inputs, nor what somebody else wrote."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.vpframe.watching import fake_session, pressing_frames, pressing_scene
from vpframe import outputs
from vpframe.analysis import clash_status, mates
from vpframe.app import task_runner as study
from vpframe.errors import OutputError
from vpframe.outputs import CHECKPOINT, PAGE, RECORDING, Kind, Output, OutputFolder
from vpframe.report import SessionLog, write
from vpframe.scene import modelling
from vpframe.session.checkpoint import Journal
from vpframe.session.session import Session
from vpframe.view.meshcat_viewer import write_page
from vpframe.view.recorder import RerunRecorder

ROOT = Path(__file__).parents[2]
FOREIGN = {
    "text": b"three weeks of measurements\n",
    "json": b'{"clashes": [], "name": "somebody\'s"}',
    "html": b"<!DOCTYPE html>\n<html><head><title>mine</title></head></html>",
    "step": b"ISO-10303-21;\nHEADER;\nFILE_NAME('a','',(''),(''),'','CAD','');\n",
    "binary stl": b"solid".ljust(80) + b"\0" * 4,
    "rerun": b"RRF2\x00)\x00\x00\x01\x02\x00\x00\x01\x00\x00\x00\x00\x00\x00\x00\x1a\x09\x0a\x07another",
    "script": b"print('hello')\n",
}
KINDS = (
    outputs.RECORDING, outputs.CHECKPOINT, outputs.STATUS, outputs.URDF, outputs.MESH, outputs.MODEL, outputs.PAGE,
    outputs.REPORT, outputs.CLASHES, outputs.SCRIPT,
)  # fmt: skip


@pytest.mark.parametrize("content", FOREIGN.values(), ids=FOREIGN.keys())
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name or "a script")
def test_what_somebody_else_wrote_is_left_as_it_is_unless_forced(tmp_path, kind, content):
    path = tmp_path / "file"
    path.write_bytes(content)
    with pytest.raises(OutputError, match="exists") as raised:
        Output(path, kind)
    assert raised.value.path == str(path)
    assert path.read_bytes() == content
    with Output(path, kind, force=True) as output:
        assert not output.ours
        assert path.read_bytes() == content, "a claim changes nothing"


def recording(path):
    recorder = RerunRecorder(path)
    recorder.begin(fake_session().scene)
    for frame in pressing_frames(4):
        recorder.frame(frame)
    recorder.end()


def report(folder):
    log = SessionLog()
    log.begin(fake_session().scene)
    for frame in pressing_frames(6):
        log.frame(frame)
    write(folder, log)


def status(path):
    clash_status.write(path, clash_status.updated((), [clash_status.ClashKey("a", "b", 0, 1)]))


def test_what_vpframe_wrote_is_known_again_and_as_nothing_else(tmp_path):
    recording(tmp_path / "recording")
    Journal(tmp_path / "checkpoint", {"script": "a"}).close()
    status(tmp_path / "status")
    scene = pressing_scene()
    mates.write_urdf(scene, tmp_path / "urdf")
    modelling.write_step(tmp_path / "model", {"a": (modelling.box(0.01, 0.01, 0.01), scene["rod"].pose)})
    write_page(scene, (), tmp_path / "page")
    report(tmp_path / "report")
    meshes = sorted((tmp_path / "urdf_meshes").iterdir())
    assert len(meshes) == 2
    written = [
        (outputs.RECORDING, tmp_path / "recording"),
        (outputs.CHECKPOINT, tmp_path / "checkpoint"),
        (outputs.STATUS, tmp_path / "status"),
        (outputs.URDF, tmp_path / "urdf"),
        (outputs.MODEL, tmp_path / "model"),
        (outputs.PAGE, tmp_path / "page"),
        *((outputs.MESH, mesh) for mesh in meshes),
        *((kind, tmp_path / "report" / name) for name, kind in outputs.REPORT_FILES.items()),
    ]
    for kind, path in written:
        assert [k.name for k in KINDS if k.recognise(path)] == [kind.name], path
        with Output(path, kind) as output:
            assert output.ours
    recording(tmp_path / "recording")  # and all of it may be written again
    Journal(tmp_path / "checkpoint", {"script": "a"}).close()
    mates.write_urdf(scene, tmp_path / "urdf")
    report(tmp_path / "report")


def test_an_older_recording_stays_until_the_session_begins(tmp_path):
    path = tmp_path / "run.rrd"
    recording(path)
    before = path.read_bytes()
    session = Session(pressing_scene(), record=path)
    assert path.read_bytes() == before
    session.close()
    assert path.read_bytes() == before
    with Session(pressing_scene(), record=path) as session:
        session.step()
    assert path.read_bytes() != before


def test_a_claim_that_nothing_came_of_leaves_nothing(tmp_path):
    with Output(tmp_path / "run.rrd", outputs.RECORDING), OutputFolder(tmp_path / "report", outputs.REPORT_FILES):
        assert sorted(p.name for p in tmp_path.iterdir()) == ["report", "run.rrd"]
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "empty").touch()
    Output(tmp_path / "empty", outputs.RECORDING).close()
    assert (tmp_path / "empty").exists(), "not made by us"


def test_inputs_are_never_replaced(tmp_path):
    script, link = tmp_path / "task.py", tmp_path / "link.py"
    script.write_text("x = 1")
    link.symlink_to(script)
    for force in (False, True):
        with pytest.raises(OutputError, match="is what this run reads"):
            Output(link, outputs.RECORDING, force, [script])
    (tmp_path / "report").mkdir()
    index = tmp_path / "report" / "index.html"
    index.symlink_to(script)
    with pytest.raises(OutputError, match="is what this run reads"):
        OutputFolder(tmp_path / "report", outputs.REPORT_FILES, True, [script])
    with Output(tmp_path / "model.step", outputs.RECORDING, True) as output, pytest.raises(OutputError, match="reads"):
        output.spare(tmp_path / "model.step")
    assert script.read_text() == "x = 1"


def test_one_foreign_file_in_a_folder_is_enough_to_refuse_it(tmp_path):
    (tmp_path / "index.html").write_text("mine")
    with pytest.raises(OutputError, match=r"index\.html: exists and is not a page that vpframe wrote"):
        report(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["index.html"]
    (tmp_path / "index.html").rename(tmp_path / "notes.html")
    report(tmp_path)
    assert (tmp_path / "notes.html").read_text() == "mine"


def test_a_device_is_written_to_as_it_is():
    with Output(os.devnull, outputs.RECORDING) as output, output.open() as file:
        assert file.write(b"x") == 1
    assert os.path.exists(os.devnull)


def test_what_cannot_be_written_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    for path, words in ((tmp_path, "is a folder"), (tmp_path / "file" / "run.rrd", "cannot be written")):
        with pytest.raises(OutputError, match=words) as raised:
            Output(path, outputs.RECORDING)
        assert str(path) in str(raised.value) and "\n" not in str(raised.value)
    with pytest.raises(OutputError, match="cannot be made a folder"):
        OutputFolder(tmp_path / "file" / "report", {})


HOLD = """
import sys, time
from vpframe.outputs import RECORDING, REPORT_FILES, Output, OutputFolder
held = Output(sys.argv[1], RECORDING), OutputFolder(sys.argv[2], REPORT_FILES)
print("held", flush=True)
time.sleep(60)
"""


def test_two_runs_into_one_output_until_the_first_is_killed(tmp_path):
    if sys.platform == "win32":
        pytest.skip("no flock there")
    path, folder = tmp_path / "run.rrd", tmp_path / "report"
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    first = subprocess.Popen([sys.executable, "-c", HOLD, path, folder], stdout=subprocess.PIPE, text=True, env=env)
    try:
        assert first.stdout is not None and first.stdout.readline() == "held\n"
        with pytest.raises(OutputError, match="is being written by another run"):
            Output(path, outputs.RECORDING, force=True)
        with pytest.raises(OutputError, match="is being written by another run"):
            OutputFolder(folder, outputs.REPORT_FILES)
        assert path.exists() and folder.exists(), "they are the first run's"
    finally:
        first.send_signal(signal.SIGKILL)
        first.communicate(timeout=20)
    with Output(path, outputs.RECORDING), OutputFolder(folder, outputs.REPORT_FILES):
        pass


def test_two_sessions_into_one_recording(tmp_path):
    with Session(pressing_scene(), record=tmp_path / "run.rrd"), pytest.raises(OutputError, match="another run"):
        Session(pressing_scene(), record=tmp_path / "run.rrd")
    with Session(pressing_scene(), record=tmp_path / "run.rrd"):
        pass


TASK = """
from tests.vpframe.watching import pressing_scene

def scene():
    made = pressing_scene()
    made.source = "model.stl"
    return made

def task(session):
    session.step()
"""
ASKED = [
    ("run", "task.py", "--record", "task.py"),
    ("run", "task.py", "--record", "model.stl"),
    ("run", "task.py", "--checkpoint", "model.stl"),
    ("run", "task.py", "--report", "mine"),
    ("clash", "model.stl", "--status", "model.stl"),
    ("clash", "model.stl", "--status", "notes.json"),
    ("mates", "model.stl", "--urdf", "model.stl"),
    ("mates", "model.stl", "--urdf", "notes.json"),
    ("view", "model.stl", "--html", "model.stl"),
    ("view", "model.stl", "--html", "mine/index.html"),
    ("new", "task.py", "--from", "model.stl"),
    ("demo", "--out", "shafts"),
]


@pytest.fixture
def desk(tmp_path):
    """A folder with a task, a model and other things, and what they are."""
    from vpframe.scene.stl import write_stl

    (tmp_path / "task.py").write_text(TASK)
    mesh = pressing_scene()["rod"].mesh
    write_stl(tmp_path / "model.stl", mesh.vertices, mesh.triangles, header="somebody's")
    (tmp_path / "notes.json").write_text('{"notes": 3}')
    for folder, name in (("mine", "index.html"), ("shafts", "shaft_and_housing.step")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / name).write_text("mine")
    return tmp_path


def contents(folder):
    return {
        str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file() and ".pyc" not in p.name
    }


@pytest.mark.parametrize("arguments", ASKED, ids=" ".join)
def test_no_command_replaces_what_is_not_its_own(desk, vpframe, arguments):
    before = contents(desk)
    done = vpframe(*arguments, cwd=desk, timeout=120)
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    assert done.stderr.count("\n") == 1 and done.stderr.startswith("vpframe: ")
    assert arguments[-1] in done.stderr or "task.py" in done.stderr
    assert contents(desk) == before


@pytest.mark.parametrize("arguments", [ASKED[0], ASKED[1], ASKED[4], ASKED[6], ASKED[8]], ids=" ".join)
def test_force_does_not_replace_what_the_run_reads(desk, vpframe, arguments):
    before = contents(desk)
    done = vpframe(*arguments, "--force", cwd=desk, timeout=120)
    assert done.returncode == 2 and "is what this run reads" in done.stderr
    assert contents(desk) == before


@pytest.mark.slow
def test_force_replaces_the_rest(desk, vpframe):
    asked = ("--record", "notes.json", "--report", "mine", "--checkpoint", "mine/old", "--force")
    (desk / "mine" / "old").write_text("old")
    done = vpframe("run", "task.py", *asked, cwd=desk, timeout=120)
    assert done.returncode == 0, done.stderr
    assert outputs.RECORDING.recognise(desk / "notes.json")
    assert outputs.CHECKPOINT.recognise(desk / "mine" / "old")
    assert outputs.PAGE.recognise(desk / "mine" / "index.html")
    assert vpframe("run", "task.py", *asked[:-1], cwd=desk, timeout=120).returncode == 0, "now they are ours"


def test_a_script_that_runs_by_itself_has_force_too(desk, capsys, monkeypatch):
    monkeypatch.chdir(desk)
    with pytest.raises(SystemExit) as ended:
        study.main("task.py", ["--record", "notes.json"])
    assert ended.value.code == 2 and "notes.json: exists and is not a recording" in capsys.readouterr().err
    with pytest.raises(SystemExit) as ended:
        study.main("task.py", ["--record", "notes.json", "--force"])
    assert ended.value.code == 0


@pytest.mark.parametrize("kind", [RECORDING, CHECKPOINT, PAGE], ids=lambda kind: kind.name)
def test_the_folders_of_an_output_are_made_and_those_that_stay_empty_removed(tmp_path: Path, kind: Kind) -> None:
    (tmp_path / "there").mkdir()
    path = tmp_path / "there" / "a" / "b" / "out"
    with Output(path, kind):
        assert path.exists()
    assert [p.name for p in tmp_path.iterdir()] == ["there"] and not [*(tmp_path / "there").iterdir()]
    with Output(path, kind) as output, output.open() as file:
        file.write(b"x")
    assert path.read_bytes() == b"x"


def test_run_records_into_a_folder_that_is_not_there_yet(tmp_path: Path) -> None:
    script = tmp_path / "task.py"
    script.write_text("from tests.vpframe.bench_scene import scene\ndef task(session):\n    session.run(0.05)\n")
    assert (
        study.run_task(script, record=tmp_path / "runs" / "today" / "run.rrd", checkpoint=tmp_path / "c" / "run.vp")
        == 0
    )
    assert (tmp_path / "runs" / "today" / "run.rrd").stat().st_size > 1000
