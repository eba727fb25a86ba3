"""Each package imports only those before it, and each folder of vpframe only those below it: also inside a function,
for types, and by a literal name."""

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ["collision", "constraints", "physics", "vpframe"]
ORDER = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["vpframe"]["layers"]["order"]


def imported(path: Path) -> Iterator[str]:
    """Dotted names that a file imports, as far as they lie in the four packages."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) == "import_module":
            yield from (arg.value for arg in node.args[:1] if isinstance(arg, ast.Constant))


def test_packages_import_only_those_before_them() -> None:
    wrong = [
        (path.name, name)
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        for name in imported(path)
        if name.split(".")[0] in PACKAGES[PACKAGES.index(package) + 1 :]
    ]
    assert not wrong


def test_folders_of_vpframe_import_only_those_below_them() -> None:
    parts = [p for p in (ROOT / "vpframe").iterdir() if p.stem[0] != "_"]
    rooms = {p.stem for p in parts if p.suffix == ".py" or (p.is_dir() and any(p.glob("*.py")))}
    assert rooms == set(ORDER), "every folder and file stands in [tool.vpframe.layers] of pyproject.toml"
    wrong = []
    for path in (ROOT / "vpframe").rglob("*.py"):
        room = path.relative_to(ROOT / "vpframe").parts[0].removesuffix(".py")
        for name in imported(path) if room in ORDER else ():
            words = name.split(".")
            if words[0] == "vpframe" and len(words) > 1 and words[1] in ORDER:
                wrong += [(str(path), name)] * (ORDER.index(words[1]) > ORDER.index(room))
    assert not wrong


def test_nobody_outside_collision_imports_its_inside() -> None:
    """Others use the names that `collision` exports, its modules of values, and `collision.numeric`."""
    inside = re.compile(r"collision\.(bvh|triangle|query|broad_phase|narrow_phase|objects|reference)\b")
    wrong = [
        (str(path), name)
        for package in PACKAGES[1:]
        for path in (ROOT / package).rglob("*.py")
        for name in imported(path)
        if inside.match(name)
    ]
    assert not wrong
