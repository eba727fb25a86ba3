"""A session that uses none loads no planning, studies, pages, recordings, reports, exporters or rare formats."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from vpframe.scene import modelling as m

ROOT = Path(__file__).parents[2]
SESSION = """
import sys
import vpframe as vp

scene = vp.load(sys.argv[1])
with vp.Session(scene) as session:
    session.step()
    hand = session.hand()
    hand.grab("pin")
    hand.slide("up", distance=0.05)
    hand.release()
    session.expect_no_clash()
print(*sorted(sys.modules))
"""
OPTIONAL = ("planning", "studies", "view", "report", "exporters", "app", "warm_up")
"""folders and files of vpframe"""
FORMATS = ("mesh_files", "meshes", "urdf", "mjcf", "segmentation", "step_writer", "document", "objects", "pmi")
"""readers of `vpframe.importers`: those of other formats, and of STEP, which runs in a process of its own"""
LIBRARIES = (
    "rerun", "meshcat", "tornado", "IPython", "jinja2", "trimesh", "manifold3d", "OCP", "distributed", "dask", "mujoco",
    "pyarrow", "pxr", "matplotlib",
)  # fmt: skip


def test_a_session_loads_nothing_that_it_does_not_use(tmp_path: Path) -> None:
    block = m.box(0.04, 0.04, 0.02).translated(-0.02, -0.02, 0.0) - m.cylinder(0.0052, 0.02)
    model = m.write_step(tmp_path / "pinned.step", {"block": block, "pin": m.cylinder(0.005, 0.03)})
    done = subprocess.run(
        [sys.executable, "-c", SESSION, str(model)], capture_output=True, text=True, timeout=240, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    loaded = set(done.stdout.splitlines()[-1].split())
    assert {"vpframe.session.session", "vpframe.importers.cad", "vpframe.hands.hand"} <= loaded
    rooms = {f"vpframe.{name}" for name in OPTIONAL} | {f"vpframe.importers.{name}" for name in FORMATS}
    assert not {name for name in loaded if name in rooms or name.startswith(tuple(f"{room}." for room in rooms))}
    assert not loaded & set(LIBRARIES)
