from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from tests.vpframe.view.recordings import quiet, rows_of
from tests.vpframe.watching import box, fake_session, pressing_frames, pressing_scene
from vpframe.scene.scene import Part, Scene
from vpframe.view.meshcat_viewer import MeshcatViewer
from vpframe.view.recorder import RerunRecorder


@pytest.fixture
def viewer():
    made = MeshcatViewer()
    made.begin(fake_session().scene)
    yield made
    made.end()


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    """A recording, its frames, and its rows by entity."""
    path = tmp_path_factory.mktemp("recording") / "deep" / "run.rrd"
    frames = pressing_frames(300)
    recorder = RerunRecorder(path)
    recorder.begin(fake_session().scene)
    for frame in frames:
        recorder.frame(frame)
    recorder.end()
    return path, frames, rows_of(path)


@pytest.fixture(scope="session")
def crowded(tmp_path_factory):
    """A recording of more parts than have entities of their own, its scene and its frames: three of the rods move,
    some surfaces collide throughout, some later, some no longer."""
    rod = pressing_scene()["rod"].shape
    plate = pressing_scene()["plate"].shape
    parts = [
        Part(f"row/{i}", rod if i % 5 else plate, pin.SE3(np.eye(3), np.array([0.1 * i, 0, 0]))) for i in range(220)
    ]
    parts.append(Part("lone", box((0.1, 0.2, 0.3)), pin.SE3(np.eye(3), np.array([-1.0, 0, 0]))))
    scene = Scene(parts)
    template, frames = pressing_frames(2)[0], []
    poses = {part.name: part.pose for part in parts}
    for step in range(1, 31):
        if step > 3:
            poses = {**poses, "lone": pin.SE3(np.eye(3), np.array([-1.0, 0, 0.1 * step]))}
        moving = {7: step >= 1, 8: step > 10, 9: 5 < step < 9}
        for i in (i for i, moves in moving.items() if moves):
            poses = {
                **poses,
                f"row/{i}": pin.SE3(pin.exp3(np.array([0, 0, 0.01 * step])), np.array([0, 0.01 * step, 1])),
            }
        colliding = [[1, 0, 2, 1], [3, 2, 4, 0]] + [[11, 0, 12, 1]] * (step > 20)
        colliding += [[21, 1, 22, 0]] * (step < 15) + [[7, 2, 8, 2]] * (step == 12)
        views = tuple(quiet(id, (f"row/{id % 220}", f"row/{(id + 1) % 220}"), step) for id in range(500))
        frames.append(
            replace(
                template, step=step, time=step / 60, poses=poses, colliding=np.array(sorted(colliding), np.int32),
                constraints=views, held=("row/8",) if step > 10 else (), joint={}, events=(),
            )
        )  # fmt: skip
    path = tmp_path_factory.mktemp("crowd") / "run.rrd"
    recorder = RerunRecorder(path)
    recorder.begin(fake_session(scene).scene)
    for frame in frames:
        recorder.frame(frame)
    recorder.end()
    return scene, frames, path, rows_of(path)
