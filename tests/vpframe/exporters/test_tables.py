"""Tables of motions and events."""

import csv
import json

import numpy as np
import pytest

import vpframe as vp
from tests.vpframe.exporters.moving import model, moving, placed
from vpframe.scene import modelling as m


def test_motion_goes_through_a_table_and_back(tmp_path):
    scene = model()
    motion = moving(scene)
    scene.export(tmp_path / "poses.csv", motion)
    back = vp.read_motion(tmp_path / "poses.csv")
    assert back.moving == ("ball",) and back.duration == pytest.approx(1.5)
    for t in (0.0, 0.52, 1.0, 1.5):
        for name, pose in motion.at(t).items():
            assert np.abs(pose.homogeneous - back.at(t)[name].homogeneous).max() < 1e-15
    assert len(motion.keys["ball"][0]) == 12 and len(motion.keys["base/plate"][0]) == 1
    pytest.importorskip("pyarrow")
    scene.export(tmp_path / "poses.parquet", motion)
    same = vp.read_motion(tmp_path / "poses.parquet")
    assert np.array_equal(same.keys["ball"][1], back.keys["ball"][1])


def test_events_are_tables_of_numbers_and_text(tmp_path):
    with vp.Session(m.scene({"a": m.box(0.1, 0.1, 0.1), "b": (m.box(0.1, 0.1, 0.1), placed(3))})) as session:
        session.note('said "so", twice')
        session.step()
        events = session.events
    vp.write_table(tmp_path / "events.csv", events)
    with (tmp_path / "events.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["kind"] for row in rows] == [event.kind for event in events]
    assert [float(row["time"]) for row in rows] == [event.time for event in events]
    assert any(row["text"] == 'said "so", twice' for row in rows)
    assert [tuple(json.loads(row["parts"])) for row in rows] == [event.parts for event in events]
    parquet = pytest.importorskip("pyarrow.parquet")
    vp.write_table(tmp_path / "events.parquet", events)
    table = parquet.read_table(tmp_path / "events.parquet")
    assert table.column("time").to_pylist() == [event.time for event in events]
    with pytest.raises(vp.VpframeError, match=r"\.csv or \.parquet"):
        vp.write_table(tmp_path / "events.xls", events)
