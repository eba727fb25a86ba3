"""Kernels are compiled once, kept between runs, and never answer for code that has changed."""

import ast
import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from collision.numeric import kernel_cache

ROOT = Path(__file__).parents[3]
CALLEE = """
from collision.numeric.kernel import inner_kernel
from collision.numbers import FACTOR

@inner_kernel
def scaled(x):
    return FACTOR * x
"""
CALLER = """
import sys
from collision.numeric.kernel import compilation, kernel
from collision.callee import scaled

compilation.announced = True

@kernel
def answer(x):
    return scaled(x) + 1.0

print(answer(2.0), compilation.kernels)
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A copy of the machinery with a caller, a callee and a constant, each in a file of its own."""
    made = tmp_path / "site" / "collision"
    shutil.copytree(ROOT / "collision" / "numeric", made / "numeric", ignore=shutil.ignore_patterns("__pycache__"))
    (made / "__init__.py").touch()
    (made / "numbers.py").write_text("FACTOR = 10.0\n")
    (made / "callee.py").write_text(CALLEE)
    (made / "caller.py").write_text(CALLER)
    return made


def start(package: Path, most: int | None = None, **environment: str) -> subprocess.Popen[str]:
    """Run the caller, in which no file can grow beyond `most` bytes."""
    home = {"XDG_CACHE_HOME": str(package.parents[1] / "cache"), "PYTHONPATH": str(package.parent)}
    known = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    return subprocess.Popen(
        [sys.executable, "-c", "import collision.caller"],
        cwd=package.parent,
        env=known | home | environment,
        preexec_fn=None if most is None else lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most)),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def run(package: Path, most: int | None = None, **environment: str) -> tuple[float, int, list[str]]:
    """The answer, how many kernels were compiled for it, and the lines on standard error."""
    process = start(package, most, **environment)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    answer, compiled = out.split()
    return float(answer), int(compiled), err.splitlines()


def test_a_change_of_a_callee_is_noticed(package: Path) -> None:
    assert run(package) == (21.0, 2, [])
    assert run(package) == (21.0, 0, [])
    (package / "callee.py").write_text(CALLEE.replace("FACTOR * x", "FACTOR * x * 3.0"))
    assert run(package) == (61.0, 2, [])


@pytest.mark.slow
def test_a_change_of_a_constant_in_a_third_file_is_noticed(package: Path) -> None:
    assert run(package)[0] == 21.0
    (package / "numbers.py").write_text("FACTOR = 20.0\n")
    assert run(package) == (41.0, 2, [])


@pytest.mark.parametrize("left", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in (10, 500))])
def test_a_damaged_file_counts_as_missing(package: Path, left: int) -> None:
    run(package)
    for path in (package.parents[1] / "cache").rglob("*.nbc"):
        path.write_bytes(path.read_bytes()[:left])
    answer, compiled, said = run(package)
    assert (answer, compiled) == (21.0, 2)
    assert len(said) == 1 and "damaged; the kernel is compiled again" in said[0]
    assert run(package) == (21.0, 0, [])


def test_processes_that_start_at_once_compile_each_kernel_once(package: Path) -> None:
    processes = [start(package) for _ in range(3)]
    ends = [process.communicate(timeout=120) for process in processes]
    assert [out.split()[0] for out, _ in ends] == ["21.0"] * 3 and [err for _, err in ends] == [""] * 3
    assert sum(int(out.split()[1]) for out, _ in ends) == 2
    assert {path.suffix for path in (package.parents[1] / "cache").rglob("*") if path.is_file()} == {".nbc"}


def test_a_process_killed_while_it_compiles_costs_nothing(package: Path) -> None:
    victim = start(package)
    cache = package.parents[1] / "cache"
    while victim.poll() is None and not list(cache.rglob("*.lock")):
        pass
    victim.kill()
    victim.communicate()
    assert run(package)[0] == 21.0


@pytest.mark.slow
def test_where_the_users_cache_cannot_be_written(package: Path, tmp_path: Path) -> None:
    barred = tmp_path / "a file"
    barred.touch()
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    home = {"XDG_CACHE_HOME": str(barred), "TMPDIR": str(temporary)}
    assert run(package, **home) == (21.0, 2, [])
    assert run(package, **home) == (21.0, 0, [])
    (folder,) = temporary.glob("vpframe-kernels-*")
    assert folder.stat().st_mode & 0o077 == 0
    folder.chmod(0o777)  # now anybody could have put code there
    answer, compiled, said = run(package, **home)
    assert (answer, compiled) == (21.0, 2)
    assert len(said) == 1 and "compiled kernels cannot be kept" in said[0] and "somebody else" in said[0]


@pytest.mark.slow
def test_where_the_disk_is_full(package: Path) -> None:
    answer, compiled, said = run(package, most=1000, PYTHONDONTWRITEBYTECODE="1")
    assert (answer, compiled) == (21.0, 2)
    assert len(said) == 1 and "compiled kernels cannot be kept" in said[0] and "File too large" in said[0]
    assert not [path for path in (package.parents[1] / "cache").rglob("*") if path.is_file()]
    assert run(package) == (21.0, 2, [])


def test_the_folder_that_numba_was_told_is_used(package: Path, tmp_path: Path) -> None:
    folder = tmp_path / "told"
    run(package, NUMBA_CACHE_DIR=str(folder))
    assert len(list(folder.rglob("*.nbc"))) == 2 and not (tmp_path / "cache").exists()


def test_folders_of_old_versions_are_removed(package: Path) -> None:
    folder = package.parents[1] / "cache" / "vpframe" / "kernels"
    for n in range(12):
        (folder / f"collision-{n:016x}").mkdir(parents=True)
        os.utime(folder / f"collision-{n:016x}", (n, n))
    (folder / "collision-of-mine").mkdir()
    run(package)
    left = sorted(path.name for path in folder.iterdir())
    assert "collision-of-mine" in left and f"collision-{11:016x}" in left and f"collision-{3:016x}" not in left
    assert len(left) == kernel_cache.KEPT + 1


def test_all_that_kernels_read_is_in_the_hash() -> None:
    """Names that a kernel uses come from its own file or from another file that is hashed."""
    hashed = {Path(path) for path in kernel_cache._sources()}
    missing = []
    for path in hashed:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        origin = {
            alias.asname or alias.name: ROOT / (node.module or "").replace(".", "/")
            for node in tree.body
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in kernel_cache.PACKAGES
            for alias in node.names
        }
        for node in tree.body:
            if isinstance(node, ast.FunctionDef) and any("kernel" in ast.unparse(d) for d in node.decorator_list):
                read = {name.id for name in ast.walk(node) if isinstance(name, ast.Name)} & origin.keys()
                sources = {name: {origin[name].with_suffix(".py"), origin[name] / f"{name}.py"} for name in read}
                missing += [(path.name, node.name, name) for name in read if not sources[name] & hashed]
    assert len(hashed) > 30 and missing == []
