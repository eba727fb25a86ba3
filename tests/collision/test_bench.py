"""The ways that the benchmark compares give the same answer where they should; its table and plot are made of rows."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pinocchio as pin
import pytest

from collision import CollisionManager
from examples import digger

FOLDER = Path(__file__).parent.parent / "benchmarks"


@pytest.fixture(scope="module")
def bench() -> ModuleType:
    sys.path.insert(0, str(FOLDER))
    try:
        spec = importlib.util.spec_from_file_location("bench_collision", FOLDER / "bench_collision.py")
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module
    finally:
        sys.path.remove(str(FOLDER))


def test_every_way_finds_the_pairs_but_boxes_invent_some(bench: ModuleType) -> None:
    a, b = digger.shaft(24, None), digger.housing(24, None)
    poses = digger.shaft_trajectory(24)
    measured = bench._Bench(quick=True)
    exact = ["bvh", "oaabb", "brute", bench.COAL_OBB, *bench.PEERS]
    measured.ways("case", a, b, poses, None, [*exact, "float32", "bounding boxes only"])
    error = {row["method"]: row["error"] for row in measured.rows}
    assert [error[method] for method in exact] == [0.0] * len(exact)
    assert error["float32"] <= 1.0
    assert error["bounding boxes only"] > 5.0
    assert all(row["seconds"] > 0.0 and row["n"] == 24 for row in measured.rows)


def test_rows_become_a_plot(bench: ModuleType, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    case = "shaft against true surfaces, deflection 86.4 µm"
    rows = [
        {"case": case, "method": m, "seconds": s, "error": e, "unit": "wrong pairs/query", "n": 3}
        for m, s, e in (("bvh", 1e-5, 0.0), ("bounding boxes only", 1e-4, 20.0))
    ]
    (path,) = bench.plot({"rows": rows}, tmp_path)
    assert path.stat().st_size > 10_000


def test_distances_of_the_manager_and_of_coal_are_the_same(bench: ModuleType) -> None:
    a, b = digger.shaft(12, None), digger.housing(12, None)
    manager, poses, measured = CollisionManager(), digger.shaft_trajectory(24)[::2], bench.queries._Rows(1)
    manager.add(a, pin.SE3.Identity(), movable=False), manager.add(b, poses[0])
    bench.queries.nearness(measured, "shaft", manager, (a, b), poses)
    error = {(row["case"], row["method"]): row["error"] for row in measured.rows}
    assert error["shaft: all surface pairs within 1 mm", "manager"] < 1e-9
    assert error["shaft: clearance", "manager"] < 1e-9
    assert all(error[case] < 1e-9 for case in error if case[1].startswith("FCL"))
    assert all(row["seconds"] > 0.0 for row in measured.rows)
    assert len(measured.ratios) == len(measured.rows) - 2


def test_the_papers_three_tables_are_printed(bench: ModuleType) -> None:
    case = "digger: along the trajectory"
    seconds = {
        "brute": 4e-3,
        "oaabb": 5e-4,
        "bvh": 2e-5,
        bench.COAL_OBB: 8e-3,
        bench.COAL_ALL: 6e-3,
        bench.COAL_FIRST: 3e-3,
    }
    row = {"case": case, "error": 0.0, "unit": "wrong pairs/query", "n": 3}
    result = {
        "components": [{"component": "link", "surfaces": 14, "triangles": 4862}],
        "rows": [row | {"method": method, "seconds": s} for method, s in seconds.items()],
        "counts": [
            {"case": case, "method": m, "box_tests": n, "triangle_tests": 24.0, "colliding": 7.5}
            for m, n in (("brute", 1.3e6), ("oaabb", 8.7e4), ("bvh", 6.7e3))
        ],
        "ratios": {
            "box tests, without OAABB / with": 14.9, "time, without OAABB / with": 8.0,
            "time, coal OBB trees / with OAABB": 16.0,
        },
    }  # fmt: skip
    text = bench.table(result)
    first, second, third = (text.index(f"Table {k}.") for k in (1, 2, 3))
    lines = [text[first:second], text[second:third], text[third : text.index("Where this differs")]]
    assert "link" in lines[0] and "4862" in lines[0]
    assert "without OAABB" in lines[1] and "1300000" in lines[1] and "87000" in lines[1] and "14.9x" in lines[1]
    assert "8.0000 ms" in lines[2] and "16.0x (the paper, RAPID in coal's place: 15x)" in lines[2]


def test_fcl_motion_is_read(bench: ModuleType, tmp_path: Path) -> None:
    grids = "".join(
        f'<GRID id="{i}" x="{x}" y="{y}" z="{z}"/>'
        for i, (x, y, z) in enumerate([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])
    )
    sides = "".join(
        f'<TRIA id="{i}" g1="{a}" g2="{b}" g3="{c}"/>'
        for i, (a, b, c) in enumerate([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
    )
    unit = "1 0 0 0 1 0 0 0 1"
    quarter = "0 -1 0 1 0 0 0 0 1"
    frame = f'<FRAME id="1" obj1_pos="1 2 3" obj2_pos="1 3 3" obj1_dc="{unit}" obj2_dc="{quarter}"/>'
    parts = "".join(f'<OBJECT id="{k}">{grids}{sides}</OBJECT>' for k in (1, 2))
    path = tmp_path / "motion.xml"
    path.write_text(f"<MODEL>{parts}</MODEL>\n<MOTION>{frame}</MOTION>")
    a, b, poses = bench.read_fcl(path)
    assert (a.n_triangles, a.n_surfaces, b.n_surfaces, len(poses)) == (4, 4, 4, 1)
    assert poses[0].act(b.vertices[1]).tolist() == pytest.approx([0.0, 2.0, 0.0])
