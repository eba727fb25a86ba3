"""What is released: wheel and sdist, installed in an environment of their own, far from the checkout."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from types import ModuleType

import pytest

from tests.release import stub

ROOT = Path(__file__).parents[2]
PACKAGES = {"collision", "constraints", "physics", "vpframe"}
INTERPRETERS = [sys.executable, *filter(None, os.environ.get("VPFRAME_PYTHONS", "").split(os.pathsep))]
"""the one of the tests, and others in the environment variable"""
TASK = """
import vpframe as vp

FILE = "vpframe-demo/shaft_and_housing.step"

def task(session):
    session.scene["housing"].fixed = True
    hand = session.hand()
    hand.grab("shaft")
    hand.move_by((0, 0, 0.06))
    hand.insert("housing")
    session.expect_constraint("against", "shaft", "housing")
"""


@pytest.mark.parametrize("package", stub.PACKAGES, ids=lambda package: package.__name__)
def test_the_stub_has_the_names_of_the_package(package: ModuleType) -> None:
    again = f"the names of {package.__name__}/__init__.py have changed: run python tests/release/stub.py"
    assert stub.path(package).read_text(encoding="utf-8") == stub.text(package), again


def command(*words: object, cwd: Path, code: int = 0) -> str:
    """Run a program that sees nothing of the checkout; returns what it printed."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(list(map(str, words)), cwd=cwd, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == code, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The sdist of the checkout, and the wheel of the sdist."""
    folder = tmp_path_factory.mktemp("built")
    command(sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", folder, cwd=ROOT)
    (sdist,) = folder.glob("*.tar.gz")
    shutil.unpack_archive(sdist, folder)  # our own, so that Pythons before 3.11.4 can run this
    (source,) = (path for path in folder.iterdir() if path.is_dir())
    command(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, cwd=source)
    (wheel,) = folder.glob("*.whl")
    return sdist, wheel


@pytest.mark.slow
def test_the_wheel_holds_the_four_packages_and_nothing_else(built: tuple[Path, Path]) -> None:
    names = zipfile.ZipFile(built[1]).namelist()
    tops = {name.partition("/")[0] for name in names}
    assert {top for top in tops if not top.endswith(".dist-info")} == PACKAGES
    for package in PACKAGES:
        assert f"{package}/py.typed" in names
    assert "vpframe/__init__.pyi" in names
    assert any(name.endswith("licenses/LICENSE") for name in names)
    tracked = command("git", "ls-files", "*.py", cwd=ROOT).split()
    assert {name for name in tracked if name.partition("/")[0] in PACKAGES} <= set(names), "each module is in it"


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("interpreter", INTERPRETERS)
def test_it_works_from_an_empty_environment(interpreter: str, built: tuple[Path, Path], tmp_path: Path) -> None:
    command(interpreter, "-m", "venv", "env", cwd=tmp_path)
    python = tmp_path / "env" / "bin" / "python"
    command(python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", built[1], cwd=tmp_path)
    vpframe = python.with_name("vpframe")
    where = command(
        python, "-c", "import vpframe, collision; print(vpframe.__file__, collision.__file__)", cwd=tmp_path
    )
    assert str(ROOT) not in where and where.count(str(tmp_path)) == 2
    assert "report     vpframe-demo/report/index.html" in command(vpframe, "demo", cwd=tmp_path)
    assert (tmp_path / "vpframe-demo" / "report" / "index.html").exists()
    command(vpframe, "clash", "vpframe-demo/shaft_and_housing.step", cwd=tmp_path)
    assert not command(vpframe, "bench", "collision", cwd=tmp_path, code=2), "benchmarks are in a clone only"
    (tmp_path / "insert.py").write_text(TASK)
    assert "done:" in command(vpframe, "run", "insert.py", cwd=tmp_path)
    typed = tmp_path / "typed_task.py"
    typed.write_text((ROOT / "tests" / "release" / "typed_task.py").read_text())
    command(python, typed, cwd=tmp_path)
    checked = command(sys.executable, "-m", "mypy", "--strict", "--python-executable", python, typed, cwd=tmp_path)
    assert checked == "Success: no issues found in 1 source file\n"
