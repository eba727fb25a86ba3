"""What `import vpframe as vp` gives a task script, and that examples ask for nothing else of vpframe."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import vpframe as vp

ROOT = Path(__file__).parents[2]


def test_every_name_is_there_and_is_public() -> None:
    assert len(set(vp.__all__)) == len(vp.__all__)
    for name in vp.__all__:
        assert getattr(vp, name) is not None
    assert set(dir(vp)) == set(vp.__all__)
    with pytest.raises(AttributeError, match="no attribute 'wheel'"):
        _ = vp.wheel


def test_importing_it_imports_nothing_heavy() -> None:
    code = "import sys, vpframe; print([m for m in ('numpy', 'pinocchio', 'numba', 'OCP') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, cwd=ROOT)
    assert done.stdout == "[]\n", done.stderr


@pytest.mark.parametrize("path", sorted((ROOT / "examples").glob("*.py")), ids=lambda path: path.stem)
def test_an_example_imports_vpframe_by_its_door_only(path: Path) -> None:
    if path.stem == "pictures":  # draws the frames of the others
        return
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            if ast.unparse(node) != "from vpframe.scene import modelling":  # their geometry, beside the public face
                assert (node.module or "").partition(".")[0] != "vpframe", ast.unparse(node)
        elif isinstance(node, ast.Import):
            assert all(alias.name == "vpframe" for alias in node.names if alias.name.startswith("vpframe"))
