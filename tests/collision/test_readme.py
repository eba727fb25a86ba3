"""The page that a stranger reads runs as it stands."""

import re
from pathlib import Path

import pinocchio as pin

import collision
from tests.collision.brute_force import box

PAGE = Path(collision.__file__).parent / "README.md"


def test_the_example_runs() -> None:
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.S)
    part = box(1.0, 1.0, 1.0)
    pose = pin.SE3.Identity()
    pose.translation[:] = (0.2, 0.1, 1.5)
    names: dict = {
        "vertices": part.vertices, "triangles": part.triangles, "surface_of_triangle": part.surface_of_triangle,
        "mesh_a": part, "mesh_b": part, "pose_ab": pose, "pose": pose, "target": pin.SE3.Identity(),
    }  # fmt: skip
    exec(compile(code, str(PAGE), "exec"), names)
    assert names["pairs"].tolist() == []
    assert names["hit"].hit and 0.3 < names["hit"].t < 0.5


def test_names_on_the_page_exist() -> None:
    text = PAGE.read_text(encoding="utf-8")
    for name in ("contacts", "clearance", "contains", "penetration", "time_of_impact", "add_shape", "ignore_surfaces"):
        assert f"`{name}" in text
        assert hasattr(collision.CollisionManager, name)
